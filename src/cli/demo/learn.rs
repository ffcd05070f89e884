//! `isotherm demo --learn`: ten days of a virtual machine whose error is measured by a probe once an hour (a touch).
//! Each night, a model is learned from the touches of the day. A better model is adopted at the next machine start.
//!
//! ```text
//! plant ── readings, touches ── compensation ── log ── learning ── candidate ── adoption
//! ```
//! The days run without sockets and without a clock, with the gateway's own code for compensation, log and learning. The
//! model at the start belongs to another machine: its gains are too small.

use std::io::Write;
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use serde::Serialize;

use super::logs::Logs;
use super::machines;
use crate::cli::print::say;
use crate::gateway::log::Recorder;
use crate::gateway::model_change;
use crate::virtual_machine::{Plant, PlantSpec};
use isotherm_core::candidate::{Occasion, Policy, Step};
use isotherm_core::compensation::model::Kind;
use isotherm_core::compensation::{Compensation, Control, Measured, Permit, Remembered, Snapshot, When};
use isotherm_core::quantity::{Micron, MicronPerCelsius, Moment};
use isotherm_core::reading::{Reading, Reason};
use isotherm_identify::applied::Applied;
use isotherm_identify::dataset::{Dataset, Split};
use isotherm_identify::learning::{InUse, Learning, choice};
use isotherm_identify::setup::units;
use isotherm_identify::uses;
use isotherm_profile::{Profile, Signal};

/// Number of simulated days.
const DAYS: u32 = 10;
/// Duration of the simulated work shift on each day.
const SHIFT: Duration = Duration::from_hours(8);
const A_DAY: Duration = Duration::from_hours(24);
/// Time from the beginning of each day until the machine is switched on.
const OFF: Duration = Duration::from_mins(1);
/// Length of one step of the simulation.
const STEP: Duration = Duration::from_secs(10);
/// Time between two measurements by the probe (touches).
const TOUCHED_EVERY: Duration = Duration::from_hours(1);
/// Largest difference between Cz and its target at which the evaluation of a day begins, µm. Before that, Cz still
/// moves from its value of the previous day to its target.
const ARRIVED: f64 = 1.0;
/// Largest simulated measurement error of the probe, µm.
const SCATTER: f64 = 0.5;
/// Factor that makes the gains of the first model too small, because that model belongs to another machine.
const FOREIGN: f64 = 0.5;
/// Profile keys of the probe, as TOML for the table `[axis.NAME.probe]`.
const PROBE: &str = "limit = 20.0\nmax_error = 60.0\nq = 40.0\nlearn = \"daily\"\nadopt = \"auto\"\n";

/// Errors of the axis on one simulated day, printed as a table row or as JSON.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Day {
    /// Number of the simulated day, from 0.
    pub(super) day: u32,
    /// Name of the learned model in use at the end of the day; `None` for the model of the profile.
    pub(super) model: Option<String>,
    /// Range and root mean square of the error without compensation, µm.
    pub(super) uncompensated_um: [f64; 2],
    /// Range and root mean square of the error of the model alone, without the correction from touches, µm.
    pub(super) model_left_um: [f64; 2],
    /// Range and root mean square of the residual error with Cz, µm.
    pub(super) left_um: [f64; 2],
}

/// Simulated machine with the gateway's own compensation, without bus lines.
struct Rig {
    profile: Profile,
    /// Index of the axis whose model is learned.
    axis: usize,
    plant: PlantSpec,
    seed: u64,
    compensation: Compensation,
    recorder: Recorder,
}

/// Simulates all days. Prints the errors of each day, and returns them.
pub(super) fn run(machine: &str, seed: u64, json: bool) -> anyhow::Result<Vec<Day>> {
    let logs =
        Logs::make().context("the log directory of the demo cannot be created in the temporary directory")?;
    let mut rig = Rig::new(machine, seed)?;
    let name = rig.profile.axes[rig.axis].settings.name.clone();
    let choice = choice(&rig.profile, &name, &[]);
    let mut learning = Learning::restore(&name, Vec::new(), None).0;
    let (applied, mut days) = (Applied::AsLogged, Vec::new());
    for number in 0..DAYS {
        let file = logs.path().join(format!("day-{number:02}.csv"));
        let (day, end) = rig.day(number, &file)?;
        if !json {
            show(&day)?;
        }
        days.push(day);
        let preferred = rig.compensation.preference(rig.axis).map(|own| own.preferred().clone());
        let adopted = preferred.as_ref().and_then(|preferred| preferred.learned());
        let in_use = match adopted {
            Some(model) => InUse::adopted(&rig.profile, &name, model),
            None => InUse::of(&rig.profile, &name).map_err(anyhow::Error::msg)?,
        };
        let uses = uses::of_identify(&rig.profile, &choice, &applied);
        let dataset = Dataset::read(&[file], &Split::default(), &units(&rig.profile), &uses)?;
        let now = end.after(Duration::from_hours(2));
        learning.take(&rig.profile, dataset, (&choice, Some(&in_use)), Some(now))?;
        let Some(candidate) = learning.candidate() else { continue };
        let offer = learning.offer(&rig.profile, &candidate, adopted.map(|model| model.name.clone()));
        if let Step::WaitForDatum(_) | Step::Adopt(_) =
            offer.judgement.decide(Policy::Auto, Occasion::default())
        {
            let change = model_change(&rig.profile, rig.axis, &offer, When::AtDatum);
            let change = change.map_err(|why| anyhow::anyhow!("{why}"))?;
            rig.recorder.preferred(rig.axis, Some(&change));
            rig.compensation.prefer(rig.axis, Some(change)).map_err(|why| anyhow::anyhow!("{why}"))?;
        }
    }
    Ok(days)
}

/// Prints the errors of a day as one line of text.
fn show(day: &Day) -> std::io::Result<()> {
    let Day { day, model, uncompensated_um, model_left_um, left_um } = day;
    let model = model.as_deref().unwrap_or("of the profile");
    say!(
        "day {day:2}  range, RMS µm: residual {:5.1} {:5.2}   model alone {:5.1} {:5.2}   uncompensated {:5.1} {:5.2}   model {model}",
        left_um[0],
        left_um[1],
        model_left_um[0],
        model_left_um[1],
        uncompensated_um[0],
        uncompensated_um[1]
    )
}

impl Rig {
    fn new(machine: &str, seed: u64) -> anyhow::Result<Rig> {
        let (shipped, plant) = machines::with_plant(machine, &[])?;
        let (path, text) = machines::text(machine).context("there is no such machine")?;
        let measured = |name: &str| plant.axes().any(|axis| axis == name);
        let axis = shipped.axes.iter().position(|axis| {
            measured(&axis.settings.name)
                && matches!(axis.settings.models.first().map(|model| &model.kind), Some(Kind::Linear(linear)) if linear.slope.is_none())
        });
        let axis =
            axis.with_context(|| format!("{machine} has no axis with a linear model, which --learn needs"))?;
        let name = &shipped.axes[axis].settings.name;
        let text = format!("{text}\n[axis.{name}.probe]\n{PROBE}");
        let loaded = isotherm_profile::parse_with(&path, &text, &machines::FILES, &[], &[]);
        let mut profile = loaded.map_err(|errors| anyhow::anyhow!("{errors}"))?.profile;
        if let Some(Kind::Linear(linear)) =
            profile.axes[axis].settings.models.first_mut().map(|model| &mut model.kind)
        {
            for term in &mut linear.terms {
                term.gain = MicronPerCelsius::new(FOREIGN * term.gain.get()).unwrap_or_default();
            }
        }
        let settings = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
        let compensation = Compensation::new(profile.machine.clone(), settings, Remembered::default());
        let recorder = Recorder::new(&profile);
        Ok(Rig { profile, axis, plant, seed, compensation, recorder })
    }

    /// Simulates one day, and writes its log. Returns the errors of the day and the time at its end.
    fn day(&mut self, number: u32, file: &Path) -> anyhow::Result<(Day, Moment)> {
        let begin = self.plant.start().after(A_DAY * number);
        let mut plant = Plant::new(&self.plant, self.seed + u64::from(number), begin);
        let name = self.profile.axes[self.axis].settings.name.clone();
        let mut log = std::io::BufWriter::new(std::fs::File::create(file)?);
        log.write_all(Recorder::header(&self.profile).as_bytes())?;
        self.recorder.begin(&self.compensation.running().counted_until(begin));
        let mut controls = vec![Control::default(); self.profile.axes.len()];
        let mut errors = [Errors::default(); 3];
        let settle = 2 * self.profile.machine.settle;
        let (mut switched_on, mut has_arrived) = (None, false);
        let steps = SHIFT.as_secs() / STEP.as_secs();
        for step in 0..=steps {
            let passed = Duration::from_secs(step * STEP.as_secs());
            let now = begin.after(passed);
            plant.advance_to(now);
            let readings = self.readings(&plant, now, passed < OFF);
            if self.is_on(&readings) {
                switched_on = switched_on.or(Some(passed));
            }
            let has_settled = switched_on.is_some_and(|on| passed >= on + settle);
            let error = plant.true_error_um(&name).unwrap_or_default();
            let before =
                self.compensation.decision(self.axis).map(|decision| decision.cz).unwrap_or_default();
            let is_touch = step > 0 && passed.as_secs().is_multiple_of(TOUCHED_EVERY.as_secs());
            let scatter = SCATTER * f64::sin(12.9898 * passed.as_secs_f64() + f64::from(number));
            let measured = Micron::new(error + before.get() + scatter).filter(|_| is_touch);
            controls[self.axis] = Control {
                permit: Permit::Armed,
                take_over: (step == 0).then_some(before),
                measured: measured.map(|error| Measured { error, acting: Some(before) }),
                ..Control::default()
            };
            let snapshot = Snapshot::new(now, &readings);
            if self.compensation.step(&snapshot, &controls).anything {
                let decisions = self.compensation.decisions();
                log.write_all(self.recorder.row(&snapshot, &controls, decisions))?;
            }
            let Some(decision) = self.compensation.decision(self.axis).filter(|_| has_settled) else {
                continue;
            };
            has_arrived |= (decision.target.get() - decision.cz.get()).abs() < ARRIVED;
            if !has_arrived {
                continue;
            }
            let requested = decision.raw.map_or(0.0, |raw| raw.get() - decision.correction.get());
            errors[0].add(error);
            errors[1].add(error + requested);
            errors[2].add(error + decision.cz.get());
        }
        log.flush()?;
        let preferred = self.compensation.preference(self.axis);
        let model = preferred.and_then(|own| own.preferred().name()).map(str::to_owned);
        let [uncompensated_um, model_left_um, left_um] = errors.map(|errors| errors.figures());
        let day = Day { day: number + 1, model, uncompensated_um, model_left_um, left_um };
        Ok((day, begin.after(SHIFT)))
    }

    /// Returns whether the machine is on. A machine without a signal for this is always on.
    fn is_on(&self, readings: &[Reading]) -> bool {
        self.profile.machine.on.is_none_or(|on| readings[on.0].usable().is_some_and(|value| value > 0.5))
    }

    /// Returns the readings of all signals. `is_off`: whether the machine is still off.
    fn readings(&self, plant: &Plant, now: Moment, is_off: bool) -> Vec<Reading> {
        let on = self.profile.machine.on.map(|on| on.0);
        let signals = self.profile.signals.iter().enumerate();
        let reading = |(place, signal): (usize, &Signal)| match plant.sensor(&signal.name) {
            Some(_) if is_off && on == Some(place) => Reading::good(0.0, now),
            Some(value) => Reading::good(value, now),
            None if on == Some(place) => Reading::good(f64::from(u8::from(!is_off)), now),
            None => Reading::bad(now, Reason::NotInLog),
        };
        signals.map(reading).collect()
    }
}

/// Collector for the range and the root mean square of an error.
#[derive(Clone, Copy, Debug, Default)]
struct Errors {
    range: Option<(f64, f64)>,
    squares: f64,
    count: u32,
}

impl Errors {
    fn add(&mut self, error: f64) {
        let (least, most) = self.range.unwrap_or((error, error));
        self.range = Some((least.min(error), most.max(error)));
        self.squares += error * error;
        self.count += 1;
    }

    fn figures(self) -> [f64; 2] {
        let range = self.range.map_or(0.0, |(least, most)| most - least);
        [range, (self.squares / f64::from(self.count.max(1))).sqrt()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_falls_after_the_adoption_of_a_learned_model() {
        let days = run("surface-grinder", 1, true).unwrap();
        assert_eq!(days.len(), 10);
        assert_eq!(days[0].model, None);
        let adopted = days.iter().position(|day| day.model.is_some()).expect("a model is adopted");
        assert!(adopted < 8, "{days:?}");
        let mean = |days: &[Day]| {
            let sum: f64 = days.iter().map(|day| day.model_left_um[1]).sum();
            sum / f64::from(u32::try_from(days.len()).unwrap())
        };
        let (before, after) = (mean(&days[..adopted]), mean(&days[adopted..]));
        assert!(after < 0.7 * before, "{before} {after}: {days:?}");
        // Cz of the evening before is no error of the next day.
        let is_small = |day: &Day| day.left_um[0] < 0.3 * day.uncompensated_um[0];
        assert!(days.iter().all(is_small), "{days:?}");
    }
}
