//! `identified_with` of a model: settings that were used when the model was identified. The profile should have the
//! same settings.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::duration::{Timespan, shown};
use crate::tables::KeyContext;

/// Settings that were used for the identification.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "IdentifiedWith")]
pub(super) struct RawIdentifiedWith {
    /// Averaging time of the references. `isotherm check` warns if `settle` of `[machine]` differs.
    settle: Option<Timespan>,
}

impl RawIdentifiedWith {
    pub(super) fn doubt(&self, at: &KeyContext<'_>, machine: Option<Timespan>) {
        let Some(Timespan(own)) = self.settle else { return };
        let of_machine = machine.map(|Timespan(span)| span);
        if of_machine.unwrap_or_default() == own {
            return;
        }
        let own = shown(own);
        let has = of_machine.map_or_else(|| "none".to_owned(), |span| format!("\"{}\"", shown(span)));
        let message = format!(
            "the model was identified with `settle = \"{own}\"`, but [machine] has {has}: the references of \
             the temperature rises differ"
        );
        let help = format!("write settle = \"{own}\" in [machine], or identify the model again");
        at.key("settle").warn(message, help);
    }
}
