//! A shipped machine without sockets: its plant, its profile, and the compensation of `core`.

use std::path::Path;
use std::time::Duration;

use super::fit::{Fit, least_squares, left, rms};
use crate::virtual_machine::{Plant, PlantSpec};
use isotherm_core::compensation::model::{Input, Kind, Linear, Model, Term};
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use isotherm_core::quantity::{Micron, MicronPerCelsius};
use isotherm_core::reading::Reading;
use isotherm_profile::Profile;

/// Seconds at the start of a day that the test ignores.
const FIRST: u64 = 60;

pub(super) struct Rig {
    pub(super) name: String,
    pub(super) profile: Profile,
    plant: PlantSpec,
}

/// One axis with its fit on the recorded days.
pub(super) struct Fitted {
    pub(super) axis: String,
    /// Gains with the smallest residuals.
    pub(super) fit: Fit,
    /// Root mean square of the residuals with the profile's gains, µm.
    pub(super) shipped_rms: f64,
}

/// Smallest and largest error of a day, without and with compensation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extents {
    pub(super) uncompensated: (f64, f64),
    pub(super) compensated: (f64, f64),
}

impl Extents {
    const NOTHING: Extents = Extents {
        uncompensated: (f64::INFINITY, f64::NEG_INFINITY),
        compensated: (f64::INFINITY, f64::NEG_INFINITY),
    };

    /// Both ranges, µm.
    pub(super) fn ranges(self) -> (f64, f64) {
        (self.uncompensated.1 - self.uncompensated.0, self.compensated.1 - self.compensated.0)
    }
}

impl Rig {
    pub(super) fn new(name: &str, text: &str, plant: &str, files: &[(&str, &[u8])]) -> Rig {
        let loaded = isotherm_profile::parse_with(Path::new("rig.toml"), text, files, &[], &[]);
        let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
        assert_eq!(profile.name, name);
        let plant = PlantSpec::parse(plant).unwrap_or_else(|error| panic!("{error}"));
        Rig { name: name.to_owned(), profile, plant }
    }

    /// Axes with a linear first model.
    pub(super) fn lines(&self) -> Vec<(String, Linear)> {
        let axes = self.profile.axes.iter().map(|axis| &axis.settings);
        let line = |axis: &AxisSettings| match &axis.models[0].kind {
            Kind::Linear(linear) => Some((axis.name.clone(), linear.clone())),
            _ => None,
        };
        axes.filter_map(line).collect()
    }

    /// Calls `look` for every second of the seed's day, with the plant and the readings of the gateway.
    pub(super) fn day(&self, seed: u64, hours: u64, mut look: impl FnMut(u64, &Plant, &Snapshot<'_>)) {
        let begin = self.plant.start();
        let mut plant = Plant::new(&self.plant, seed, begin);
        let mut readings = vec![Reading::NEVER; self.profile.signals.len()];
        for second in 0..=hours * 3600 {
            let now = begin.after(Duration::from_secs(second));
            plant.advance_to(now);
            for (reading, signal) in readings.iter_mut().zip(&self.profile.signals) {
                if let Some(value) = plant.sensor(&signal.name) {
                    *reading = Reading::good(value, now);
                }
            }
            look(second, &plant, &Snapshot::new(now, &readings));
        }
    }

    /// Fits the gains of these linear models to the days of these seeds, with one sample each minute.
    pub(super) fn fitted(&self, lines: &[(String, Linear)], seeds: &[u64], hours: u64) -> Vec<Fitted> {
        // One axis for each term, with the temperature rise as its target.
        let inputs: Vec<Input> = lines.iter().flat_map(|(_, line)| line.rises()).copied().collect();
        let controls = vec![Control::default(); inputs.len()];
        let mut rows = vec![Vec::new(); lines.len()];
        let mut targets = vec![Vec::new(); lines.len()];
        for seed in seeds {
            let mut core = self.core(inputs.iter().map(|input| self.alone(*input)).collect());
            self.day(*seed, hours, |second, plant, snapshot| {
                core.step(snapshot, &controls);
                let rise = |place| Some(core.model_value(place, snapshot)?.1.get());
                let rises: Option<Vec<f64>> = (0..inputs.len()).map(rise).collect();
                let Some(rises) = rises.filter(|_| second % 60 == 0) else { return };
                let mut rises = rises.into_iter();
                for (place, (axis, line)) in lines.iter().enumerate() {
                    let mut row: Vec<f64> = rises.by_ref().take(line.rises().count()).collect();
                    if let Some(slope) = &line.slope {
                        let distance = snapshot.value(slope.position).unwrap() - slope.reference.get();
                        row[line.terms.len()..].iter_mut().for_each(|value| *value *= distance);
                    }
                    rows[place].push(row);
                    targets[place].push(-plant.true_error_um(axis).unwrap());
                }
            });
        }
        let fitted = lines.iter().zip(rows.iter().zip(&targets)).map(|((axis, line), (rows, target))| {
            let gains: Vec<f64> = line.gains().collect();
            let shipped_rms = rms(&left(rows, &gains, target));
            Fitted { axis: axis.clone(), fit: least_squares(rows, target), shipped_rms }
        });
        fitted.collect()
    }

    fn alone(&self, input: Input) -> AxisSettings {
        let gain = MicronPerCelsius::new(1.0).unwrap();
        let linear = Linear { offset: Micron::ZERO, terms: vec![Term { input, gain }], slope: None };
        let model = Model::new("alone".to_owned(), Kind::Linear(linear));
        let every = Duration::from_secs(1);
        AxisSettings { models: vec![model], every, ..self.profile.axes[0].settings.clone() }
    }

    fn core(&self, axes: Vec<AxisSettings>) -> Compensation {
        Compensation::new(self.profile.machine.clone(), axes, Remembered::default())
    }

    /// Extents of this seed's day with the compensation of the profile.
    pub(super) fn extents(&self, seed: u64, hours: u64) -> Vec<(String, Extents)> {
        let axes: Vec<_> = self.profile.axes.iter().map(|axis| axis.settings.clone()).collect();
        let mut all: Vec<_> = axes.iter().map(|axis| (axis.name.clone(), Extents::NOTHING)).collect();
        let mut core = self.core(axes);
        let controls = vec![Control { permit: Permit::Armed, ..Control::default() }; all.len()];
        self.day(seed, hours, |second, plant, snapshot| {
            // The value that was active until now applies to the new position.
            for (place, (axis, extent)) in all.iter_mut().enumerate().filter(|_| second >= FIRST) {
                let error = plant.true_error_um(axis).unwrap();
                let left = error + core.decision(place).unwrap().cz.get();
                extent.uncompensated = (extent.uncompensated.0.min(error), extent.uncompensated.1.max(error));
                extent.compensated = (extent.compensated.0.min(left), extent.compensated.1.max(left));
            }
            core.step(snapshot, &controls);
        });
        all.sort_by(|one, other| one.0.cmp(&other.0));
        all
    }
}
