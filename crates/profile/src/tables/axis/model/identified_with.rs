//! `identified_with` of a model: what `isotherm identify` found it with, and what the profile must agree with.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::duration::{Timespan, shown};
use crate::tables::At;

/// How a model was identified.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "IdentifiedWith")]
pub(super) struct RawIdentifiedWith {
    /// What its references were the mean over; `check` warns where `settle` of `[machine]` is another.
    settle: Option<Timespan>,
}

impl RawIdentifiedWith {
    pub(super) fn doubt(&self, at: &At<'_>) {
        let Some(Timespan(own)) = self.settle else { return };
        let machine = at.check.raw.machine.as_ref().and_then(|machine| machine.settle);
        let of_machine = machine.map(|Timespan(span)| span);
        if of_machine.unwrap_or_default() == own {
            return;
        }
        let own = shown(own);
        let has = of_machine.map_or_else(|| "none".to_owned(), |span| format!("\"{}\"", shown(span)));
        let message = format!(
            "the model was identified with `settle = \"{own}\"`, and [machine] has {has}: its rises are measured from \
             something else"
        );
        let help = format!("write settle = \"{own}\" in [machine], or identify the model again");
        at.key("settle").warn(message, help);
    }
}
