//! Warnings about settings of axes that are allowed but probably wrong. Each warning states the suspicious number.

use super::model::effect::signed;
use super::model::uniform_temperature::UniformTemperature;
use crate::Profile;
use crate::document;
use crate::tables::Check;
use crate::wording::NO_MACHINE_START;
use isotherm_core::compensation::settings::Datum;

/// Largest plausible limit of Cz, µm. A larger number was probably meant in another unit.
const LARGE_LIMIT: f64 = 500.0;
/// Typical temperature of a workshop, °C. If the whole machine has this temperature, a model should give a small value.
const WORKSHOP: f64 = 20.0;

pub(in crate::tables) fn warn(check: &Check<'_>, profile: &Profile) {
    let mut all_over = UniformTemperature::at(WORKSHOP, &profile.signals);
    let mut from_start = Vec::new();
    for axis in &profile.axes {
        let (settings, at) = (&axis.settings, check.at("axis").key(&axis.settings.name));
        let limit = settings.guard.limit.get();
        if limit > LARGE_LIMIT {
            let message =
                format!("a limit of {} µm is more than half a millimetre", document::figure(limit, 3));
            at.key("limit").warn(
                message,
                "`limit` is in µm: write the largest thermal growth of the machine, with a small margin",
            );
        }
        for (place, model) in settings.models.iter().enumerate() {
            if all_over.counts_from_start(model) {
                from_start.push(format!("`{}`", model.name));
            }
            // The datum "zero" subtracts the value that the model requested at the last zero command.
            let asked = all_over.asked(model).filter(|asked| asked.cz.abs() > limit);
            let Some(asked) = asked.filter(|_| settings.datum == Datum::Model) else { continue };
            let position = asked.position.map(|(signal, place)| {
                format!(" with {} at {} mm", profile.signal(signal).name, document::figure(place, 3))
            });
            let message = format!(
                "with all temperatures at {WORKSHOP} °C model `{}` gives {} µm{}, beyond the limit of {} µm",
                model.name,
                signed(asked.cz),
                position.unwrap_or_default(),
                document::figure(limit, 3)
            );
            let help = "check the unit and sign of the model's numbers, its `offset`, and the `reference` of \
                        each rise";
            at.key("model").item(place).warn(message, help);
        }
    }
    if profile.machine.on.is_none() && !from_start.is_empty() {
        let names = from_start.join(" and ");
        let help = format!(
            "these models depend on machine start: {names}. In [machine], write on = \"…\" with the \
             signal that is 1 while the machine is on. Or write the references as numbers or \"zero\""
        );
        check.at("machine").warn_key(NO_MACHINE_START, Some(&help));
    }
}
