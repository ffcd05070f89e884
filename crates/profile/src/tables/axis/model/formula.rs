//! `kind = "formula"`: an expression over signals, constants and the time since machine start.

use std::collections::BTreeMap;

use super::effect::{effect, figure, middle};
use super::inputs::Inputs;
use super::kind::{Computation, KindOfModel};
use super::raw::{FORMULA, RawModel};
use crate::tables::signal::Signal;
use crate::tables::{KeyContext, expression};
use isotherm_core::compensation::model::{Formula, Kind};
use isotherm_core::reading::SignalId;

pub(super) const KIND: KindOfModel = KindOfModel {
    word: FORMULA,
    one: "a formula",
    keys: &["formula", "constants", "inputs"],
    resolve,
    preview,
    places: |_| None,
};

fn resolve(raw: &RawModel, at: &KeyContext<'_>) -> Option<Kind> {
    let none = (BTreeMap::new(), BTreeMap::new());
    let inputs = match &raw.inputs {
        Some(Inputs::ByName(inputs)) => inputs,
        Some(Inputs::InOrder(_)) => {
            let help = "write inputs = { A = \"bed\" }: a formula uses its signals by name";
            return at.key("inputs").reject("a list of signals has no names", help);
        }
        None => &none.0,
    };
    // A wrong value or a misspelt name of one of them has been reported.
    if ["inputs", "constants"].into_iter().any(|key| !at.has(key) && !at.key(key).is_left_out()) {
        return None;
    }
    let help = "write formula = \"K * (A - 20)\", with inputs = { A = \"bed\" } and constants = { K = 2.4 }";
    at.key("formula").missing("`formula` is missing", help);
    let constants = raw.constants.as_ref().unwrap_or(&none.1);
    expression::formula(at, raw.formula.as_ref()?, inputs, constants).map(Kind::Formula)
}

fn preview(signals: &[Signal], kind: &Kind) -> Option<Computation> {
    let Kind::Formula(formula) = kind else { return None };
    let names: Vec<&str> =
        formula.expression.signals().into_iter().map(|id| signals[id.0].name.as_str()).collect();
    let text = format!("Cz = {} µm, over {}", formula.expression.text(), names.join(", "));
    Some(Computation { formula: text, effects: effects(signals, formula) })
}

/// Describes the effect of each signal for one state of the machine, because a formula may not be linear. The state is
/// machine start, with every signal in the middle of its range.
fn effects(signals: &[Signal], formula: &Formula) -> Vec<String> {
    let middle = |id: SignalId| middle(signals, id);
    let at = |raised: Option<SignalId>| {
        let value = |id: SignalId| Some(middle(id) + if raised == Some(id) { 1.0 } else { 0.0 });
        formula.expression.evaluate(&value, Some(0.0)).ok().filter(|cz| cz.is_finite())
    };
    let change = |id: SignalId| match (at(None), at(Some(id))) {
        (Some(before), Some(after)) => {
            let place = format!(" (from {} at t = 0)", figure(middle(id)));
            effect(signals, id, after - before, &place)
        }
        _ => format!("at {} = {} and t = 0 the formula has no value", signals[id.0].name, figure(middle(id))),
    };
    formula.expression.signals().into_iter().map(change).collect()
}
