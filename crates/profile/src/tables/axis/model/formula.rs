//! `kind = "formula"`: an expression over signals, constants and the time since machine start.

use std::collections::BTreeMap;

use super::inputs::Inputs;
use super::{KindOfModel, RawModel};
use crate::tables::{At, expression};
use isotherm_core::compensation::model::Kind;

pub(super) const KIND: KindOfModel =
    KindOfModel { word: "formula", one: "a formula", keys: &["formula", "constants", "inputs"], resolve };

fn resolve(raw: &RawModel, at: &At<'_>) -> Option<Kind> {
    let none = (BTreeMap::new(), BTreeMap::new());
    let inputs = match &raw.inputs {
        Some(Inputs::ByName(inputs)) => inputs,
        Some(Inputs::InOrder(_)) => {
            let help = "write inputs = { A = \"bed\" }: a formula knows its signals by name";
            at.key("inputs").wrong("a list of signals has no names", help);
            return None;
        }
        None => &none.0,
    };
    // Where one of them is wrong, that has been reported.
    if ["inputs", "constants"].into_iter().any(|key| !at.has(key) && at.key(key).is_written()) {
        return None;
    }
    if raw.formula.is_none() {
        let help =
            "write formula = \"K * (A - 20)\", with inputs = { A = \"bed\" } and constants = { K = 2.4 }";
        at.key("formula").missing("`formula` is missing", help);
    }
    let constants = raw.constants.as_ref().unwrap_or(&none.1);
    expression::formula(at, raw.formula.as_ref()?, inputs, constants).map(Kind::Formula)
}
