//! Warnings about settings that are allowed but probably wrong. Each contains the suspicious figure.

use super::model::all_over::{AllOver, signed};
use crate::Profile;
use crate::document;
use crate::tables::Check;
use isotherm_core::compensation::settings::Datum;

/// Largest plausible correction, µm. A larger one is probably in another unit.
const LARGE_LIMIT: f64 = 500.0;
/// Temperature at which a model should give a small value, °C.
const WORKSHOP: f64 = 20.0;

pub(in crate::tables) fn warn(check: &Check<'_>, profile: &Profile) {
    let all_over = AllOver::at(WORKSHOP, &profile.signals);
    let mut from_start = Vec::new();
    for axis in &profile.axes {
        let (settings, at) = (&axis.settings, check.at("axis").key(&axis.settings.name));
        let limit = settings.guard.limit.get();
        if limit > LARGE_LIMIT {
            let message =
                format!("a limit of {} µm is more than half a millimetre", document::figure(limit, 3));
            at.key("limit")
                .warn(message, "it is in µm: write what the machine grows by at most, with a little room");
        }
        for (place, model) in settings.models.iter().enumerate() {
            if all_over.counts_from_start(model) {
                from_start.push(format!("`{}`", model.name));
            }
            // A datum subtracts the value that the model gives at zero.
            let asked = all_over.asked(model).filter(|asked| asked.cz.abs() > limit);
            let Some(asked) = asked.filter(|_| settings.datum == Datum::Model) else { continue };
            let position = asked.position.map(|(signal, place)| {
                format!(" with {} at {} mm", profile.signal(signal).name, document::figure(place, 3))
            });
            let message = format!(
                "with {WORKSHOP} °C all over `{}` asks for {} µm{}, beyond the limit of {} µm",
                model.name,
                signed(asked.cz),
                position.unwrap_or_default(),
                document::figure(limit, 3)
            );
            let help = "check the unit and sign of its numbers, its offset, and from what each rise is measured: its \
                        `reference`";
            at.key("model").item(place).warn(message, help);
        }
    }
    if profile.machine.on.is_none() && !from_start.is_empty() {
        let names = from_start.join(" and ");
        let message = format!(
            "a start counts in {names}, and nothing tells when it is: the first good reading of the first run \
             is taken for it, for good, over restarts too, however warm the machine is then"
        );
        let help = "name in [machine] the signal that rises when the machine is switched on: on = \"…\"; or write the \
                    references as numbers or \"zero\"";
        check.at("machine").warn_key(message, Some(help));
    }
}
