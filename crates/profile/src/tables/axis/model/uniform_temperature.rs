//! Value of a model if the whole machine has the same temperature. This value shows a missing reference, a wrong offset
//! or a wrong unit before the machine moves.

use std::time::Duration;

use super::KINDS;
use super::effect::{figure, signed};
use crate::document::Section;
use crate::tables::signal::Signal;
use isotherm_core::compensation::Snapshot;
use isotherm_core::compensation::model::{Inputs, Lag, Model, Reference, Unusable};
use isotherm_core::compensation::reference::Machine;
use isotherm_core::compensation::settings::MachineSettings;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::{Reading, SignalId};

/// 0 °C in K.
const FREEZING: f64 = 273.15;
/// Time after machine start at which every lag has settled.
const SETTLED: Duration = Duration::from_hours(100 * 7 * 24);
/// Temperatures in the preview, °C.
const SHOWN: [f64; 3] = [15.0, 20.0, 25.0];

/// Simulated machine with the same temperature everywhere. Its readings have not changed since machine start.
pub(crate) struct UniformTemperature {
    celsius: f64,
    readings: Vec<Reading>,
    machine: Machine,
}

/// Value of a model on a machine that has the same temperature everywhere.
pub(crate) struct UniformValue {
    /// Cz that the model gives, µm.
    pub(crate) cz: f64,
    /// Position at which the absolute value of Cz is largest, in mm, with its signal. `None` if Cz is the same at all
    /// positions.
    pub(crate) position: Option<(SignalId, f64)>,
}

impl UniformTemperature {
    /// Creates a machine with these signals, all at the temperature `celsius`. Temperature differences and all other
    /// signals are 0. All values are limited to the range of their signal.
    pub(crate) fn at(celsius: f64, signals: &[Signal]) -> UniformTemperature {
        let reading = |signal: &Signal| {
            let value = match signal.unit.0 {
                _ if signal.is_difference => 0.0,
                "degC" => celsius,
                "K" => celsius + FREEZING,
                _ => 0.0,
            };
            let accepted = signal.range.map_or(value, |(low, high)| value.max(low).min(high));
            Reading::good(accepted, Moment::default())
        };
        let readings: Vec<Reading> = signals.iter().map(reading).collect();
        let mut machine = Machine::default();
        let settings = MachineSettings { signals: signals.len(), ..MachineSettings::default() };
        machine.observe(&settings, &Snapshot::new(Moment::default(), &readings));
        UniformTemperature { celsius, readings, machine }
    }

    /// Returns one simulated machine for each temperature in [`SHOWN`].
    pub(crate) fn shown(signals: &[Signal]) -> Vec<UniformTemperature> {
        SHOWN.into_iter().map(|celsius| UniformTemperature::at(celsius, signals)).collect()
    }

    /// Returns the Cz of a model on this simulated machine, at the position where the absolute value is largest. `None`
    /// if the model has no value at one of the positions.
    pub(crate) fn asked(&mut self, model: &Model) -> Option<UniformValue> {
        let places = KINDS.into_iter().find_map(|kind| (kind.places)(&model.kind));
        let Some((signal, mut places)) = places else {
            return Some(UniformValue { cz: self.cz(model)?, position: None });
        };
        let own = *self.readings.get(signal.0)?;
        if places.is_empty() {
            places.push(own.usable()?);
        }
        let value_at = |place| {
            self.readings[signal.0] = Reading::good(place, Moment::default());
            Some(UniformValue { cz: self.cz(model)?, position: Some((signal, place)) })
        };
        let found: Option<Vec<UniformValue>> = places.into_iter().map(value_at).collect();
        self.readings[signal.0] = own;
        let found = found?;
        let is_everywhere = found.iter().all(|other| (other.cz - found[0].cz).abs() < f64::EPSILON);
        let most = found.into_iter().max_by(|one, other| one.cz.abs().total_cmp(&other.cz.abs()))?;
        Some(UniformValue { position: most.position.filter(|_| !is_everywhere), ..most })
    }

    fn cz(&self, model: &Model) -> Option<f64> {
        let (begin, machine, readings) = (Moment::default(), &self.machine, &self.readings);
        let follows = |input| {
            let mut lag = Lag::default();
            for now in [begin, begin.after(SETTLED)] {
                lag.follow(input, &Snapshot::new(now, readings), machine);
            }
            lag
        };
        let lags: Vec<Lag> = model.rises().map(follows).collect();
        // A formula has no lag. It is evaluated at machine start.
        let is_late = model.rises().any(|input| input.lag.is_some());
        let now = if is_late { begin.after(SETTLED) } else { begin };
        let snapshot = Snapshot::new(now, readings);
        let inputs = Inputs { snapshot, machine, lags: &lags, splits_slope: false };
        model.outputs(&inputs).ok().map(|outputs| outputs.cz.get())
    }

    /// Returns whether the value of a model depends on machine start, through a reference or through the time since
    /// then.
    pub(crate) fn counts_from_start(&self, model: &Model) -> bool {
        let snapshot = Snapshot::new(Moment::default(), &self.readings);
        let machine = &Machine::default();
        let inputs = Inputs { snapshot, machine, lags: &[], splits_slope: false };
        model.references().any(|reference| reference == Reference::Start)
            || model.outputs(&inputs) == Err(Unusable::MachineOff)
    }
}

/// Adds the values of a model to the preview. The text is `all temperatures at 15, 20, 25 °C: Cz = −12, 0,
/// +12 µm`. The JSON has the same values.
pub(super) fn preview(
    section: &mut Section,
    signals: &[Signal],
    model: &Model,
    shown: &mut [UniformTemperature],
) {
    let asked: Vec<Option<UniformValue>> = shown.iter_mut().map(|all_over| all_over.asked(model)).collect();
    let temperatures: Vec<String> = shown.iter().map(|all_over| figure(all_over.celsius)).collect();
    let figures = asked
        .iter()
        .map(|asked| asked.as_ref().map_or_else(|| "no value".to_owned(), |asked| signed(asked.cz)));
    let figures = figures.collect::<Vec<String>>().join(", ");
    let position = asked.iter().flatten().find_map(|asked| asked.position);
    let position = position
        .map(|(signal, _)| format!(", at the value of {} with the largest |Cz|", signals[signal.0].name));
    let position = position.unwrap_or_default();
    section.line(format!(
        "     all temperatures at {} °C: Cz = {figures} µm{position}",
        temperatures.join(", ")
    ));
    let document = shown.iter().zip(&asked).map(|(all_over, asked)| {
        let cz = asked.as_ref().map(|asked| (asked.cz * 1000.0).round() / 1000.0);
        let position = asked.as_ref().and_then(|asked| asked.position).map(|(_, place)| place);
        let mut entry = serde_json::json!({ "temperature_c": all_over.celsius, "cz_um": cz });
        if let Some(position) = position {
            entry["position_mm"] = position.into();
        }
        entry
    });
    section.entry("all_over", document.collect::<Vec<_>>());
}
