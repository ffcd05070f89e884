//! A shipped machine without sockets: its plant, its profile, and the core of the gateway between them.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use super::fit::{Fit, least_squares};
use super::hold::{Lag, Line};
use crate::compensation::{Compensation, Control, Permit, Snapshot};
use crate::profile::{self, Errors, Profile};
use crate::quantity::Moment;
use crate::reading::Reading;
use crate::virtual_machine::{Plant, PlantSpec};

/// What the truth of the first minute is worth: setting up.
const FIRST: u64 = 60;

pub(super) struct Rig {
    pub(super) name: String,
    text: String,
    profile: toml::Table,
    plant: PlantSpec,
    on: String,
    /// References are the mean over this long.
    settle: Duration,
}

/// An axis of a calibration day.
pub(super) struct Identified {
    pub(super) axis: String,
    pub(super) line: Line,
    pub(super) fit: Fit,
}

/// Smallest and largest of a day, without compensation and with it.
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

/// The rises since machine start, second by second.
struct Rises {
    sums: BTreeMap<String, (f64, u32)>,
    on: Option<u64>,
    settle: u64,
}

impl Rises {
    fn new(lines: &[(String, Line)], settle: Duration) -> Rises {
        let signals = lines.iter().flat_map(|(_, line)| line.all());
        let sums = signals.map(|term| (term.signal.clone(), (0.0, 0))).collect();
        Rises { sums, on: None, settle: settle.as_secs() }
    }

    /// Takes in a second; whether the references are there.
    fn take(&mut self, plant: &Plant, on: &str, second: u64) -> bool {
        if plant.sensor(on).unwrap() > 0.5 {
            self.on = self.on.or(Some(second));
        }
        let Some(running) = self.on.map(|on| second - on) else { return false };
        if running <= self.settle {
            for (signal, (sum, count)) in &mut self.sums {
                *sum += plant.sensor(signal).unwrap();
                *count += 1;
            }
        }
        running >= self.settle
    }

    fn of(&self, plant: &Plant, signal: &str) -> f64 {
        let (sum, count) = self.sums[signal];
        plant.sensor(signal).unwrap() - sum / f64::from(count)
    }
}

impl Rig {
    pub(super) fn new(name: &str, profile: &str, plant: &str) -> Rig {
        let table: toml::Table = profile.parse().unwrap();
        let on = table["machine"]["on"].as_str().unwrap().to_owned();
        let settle = humantime::parse_duration(table["machine"]["settle"].as_str().unwrap()).unwrap();
        assert_eq!(table["machine"]["name"].as_str(), Some(name));
        Rig {
            name: name.to_owned(),
            text: profile.to_owned(),
            profile: table,
            plant: PlantSpec::parse(plant).unwrap_or_else(|error| panic!("{error}")),
            on,
            settle,
        }
    }

    fn plant(&self, seed: u64) -> (Plant, Moment) {
        let begin = self.plant.start();
        (Plant::new(&self.plant, seed, begin), begin)
    }

    /// Each axis with its first model.
    pub(super) fn lines(&self) -> Vec<(String, Line)> {
        let axes = self.profile["axis"].as_table().unwrap();
        let line = |axis: &toml::Value| Line::read(axis["model"][0].as_table().unwrap());
        axes.iter().map(|(name, axis)| (name.clone(), line(axis))).collect()
    }

    /// Fits every axis's first model, as it stands but for its numbers, to the day of this seed, one sample a minute.
    /// A term of no lag keeps none.
    pub(super) fn identify(&self, lines: &[(String, Line)], seed: u64, hours: u64) -> Vec<Identified> {
        let (mut plant, begin) = self.plant(seed);
        let mut rises = Rises::new(lines, self.settle);
        let mut lags: Vec<Vec<Lag>> =
            lines.iter().map(|(_, line)| vec![Lag::default(); line.all().count()]).collect();
        let mut rows = vec![Vec::new(); lines.len()];
        let mut targets = vec![Vec::new(); lines.len()];
        for second in 0..=hours * 3600 {
            plant.advance_to(begin.after(Duration::from_secs(second)));
            if !rises.take(&plant, &self.on, second) {
                continue;
            }
            for (place, (axis, line)) in lines.iter().enumerate() {
                let states = line.all().zip(&mut lags[place]);
                let lagged =
                    states.map(|(term, lag)| lag.advance(rises.of(&plant, &term.signal), 1.0, term.lag));
                let mut row: Vec<f64> = lagged.collect();
                if second % 60 != 0 {
                    continue;
                }
                if let Some(slope) = &line.slope {
                    let distance = plant.sensor(&slope.position).unwrap() - slope.reference;
                    row[line.terms.len()..].iter_mut().for_each(|value| *value *= distance);
                }
                row.push(1.0);
                rows[place].push(row);
                targets[place].push(-plant.true_error_um(axis).unwrap());
            }
        }
        let fitted = lines.iter().zip(rows.iter().zip(&targets)).map(|((axis, line), (rows, target))| {
            let fit = least_squares(rows, target);
            let mut line = line.clone();
            let mut found = fit.coefficients.iter().copied();
            let slope = line.slope.iter_mut().flat_map(|slope| &mut slope.terms);
            line.terms.iter_mut().chain(slope).for_each(|term| term.gain = found.next().unwrap());
            line.offset = found.next().unwrap();
            Identified { axis: axis.clone(), line, fit }
        });
        fitted.collect()
    }

    /// The core of the gateway on this seed's day, second by second.
    pub(super) fn day(&self, seed: u64, hours: u64) -> Vec<(String, Extents)> {
        match parse(&self.text) {
            Ok(profile) => self.run(&profile, seed, hours, |_, _, _| {}),
            Err(errors) if errors.0.iter().all(|error| error.message.starts_with("not built yet")) => {
                self.day_of_lines(seed, hours)
            }
            Err(errors) => panic!("{errors}"),
        }
    }

    /// The same where the model itself is computed here: the core is given each axis's raw Cz as if it were measured.
    fn day_of_lines(&self, seed: u64, hours: u64) -> Vec<(String, Extents)> {
        let lines = self.lines();
        let profile = parse(&self.with_raw_axes()).unwrap_or_else(|errors| panic!("{errors}"));
        let mut rises = Rises::new(&lines, self.settle);
        let mut lags: Vec<Vec<Lag>> =
            lines.iter().map(|(_, line)| vec![Lag::default(); line.all().count()]).collect();
        self.run(&profile, seed, hours, |plant, second, raw| {
            if !rises.take(plant, &self.on, second) {
                return;
            }
            for ((axis, line), lags) in lines.iter().zip(&mut lags) {
                let states = line.all().zip(lags);
                let parts: Vec<f64> = states
                    .map(|(term, lag)| term.gain * lag.advance(rises.of(plant, &term.signal), 1.0, term.lag))
                    .collect();
                let (fixed, along) = parts.split_at(line.terms.len());
                let distance = line
                    .slope
                    .as_ref()
                    .map_or(0.0, |slope| plant.sensor(&slope.position).unwrap() - slope.reference);
                let sum = line.offset + fixed.iter().sum::<f64>() + distance * along.iter().sum::<f64>();
                raw.insert(format!("raw_{axis}"), sum);
            }
        })
    }

    /// The profile with one model for each axis: a signal that is its raw Cz.
    fn with_raw_axes(&self) -> String {
        let mut profile = self.profile.clone();
        for (place, (axis, _)) in self.lines().into_iter().enumerate() {
            let model = format!(
                "[[model]]\nname = \"raw\"\nkind = \"linear\"\nterms = [{{ signal = \"raw_{axis}\", gain = 1.0 }}]"
            );
            let signal = format!(
                "device = \"thermometers\"\nregister = \"input:{}\"\ntype = \"f32\"\nword_order = \"msw-first\"\n\
                 unit = \"um\"\nmax_age = \"5s\"",
                100 + 2 * place
            );
            let (model, signal): (toml::Table, toml::Table) =
                (model.parse().unwrap(), signal.parse().unwrap());
            profile["axis"][&axis].as_table_mut().unwrap().extend(model);
            profile["signal"].as_table_mut().unwrap().insert(format!("raw_{axis}"), signal.into());
        }
        toml::to_string(&profile).unwrap()
    }

    /// Every second the plant's signals, and what `more` knows, go through the core.
    fn run(
        &self,
        profile: &Profile,
        seed: u64,
        hours: u64,
        mut more: impl FnMut(&Plant, u64, &mut BTreeMap<String, f64>),
    ) -> Vec<(String, Extents)> {
        let (mut plant, begin) = self.plant(seed);
        let axes: Vec<_> = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
        let names: Vec<String> = axes.iter().map(|axis| axis.name.clone()).collect();
        let mut core = Compensation::new(profile.machine.clone(), axes, Default::default());
        let mut readings = vec![Reading::NEVER; profile.signals.len()];
        let mut extents = vec![Extents::NOTHING; names.len()];
        let controls = vec![Control { permit: Permit::Armed, ..Control::default() }; names.len()];
        let mut known = BTreeMap::new();
        for second in 0..=hours * 3600 {
            let now = begin.after(Duration::from_secs(second));
            plant.advance_to(now);
            // What stood there until now is what the new position met.
            for (place, axis) in names.iter().enumerate().filter(|_| second >= FIRST) {
                let error = plant.true_error_um(axis).unwrap();
                let left = error + core.decision(place).unwrap().cz.get();
                let extent = &mut extents[place];
                extent.uncompensated = (extent.uncompensated.0.min(error), extent.uncompensated.1.max(error));
                extent.compensated = (extent.compensated.0.min(left), extent.compensated.1.max(left));
            }
            more(&plant, second, &mut known);
            for (reading, signal) in readings.iter_mut().zip(&profile.signals) {
                if let Some(value) = plant.sensor(&signal.name).or_else(|| known.get(&signal.name).copied()) {
                    *reading = Reading::good(value, now);
                }
            }
            core.step(&Snapshot { now, readings: &readings }, &controls);
        }
        let mut all: Vec<_> = names.into_iter().zip(extents).collect();
        all.sort_by(|one, other| one.0.cmp(&other.0));
        all
    }
}

fn parse(text: &str) -> Result<Profile, Errors> {
    profile::parse(Path::new("rig.toml"), text, &[], &[]).map(|loaded| loaded.profile)
}
