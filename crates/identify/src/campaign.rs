//! Logged runs as the gateway would read them: through the signals of a profile, with one measured error. The target of
//! a model is the Cz (compensation value) that would leave no error. A rise is the value of an input minus its
//! reference.

use std::borrow::Cow;
use std::cmp::Ordering;
use std::collections::HashMap;
use std::time::Duration;

use crate::dataset::{Dataset, Datum as TouchDatum, Errors, Kind, Run};
use crate::faults::Finding;
use crate::faults::mend::Mending;
use isotherm_core::compensation::settings::{
    AxisSettings, Datum, GuardSettings, Levels, MachineSettings, OnFault,
};
use isotherm_core::quantity::{Micron, MicronPerSecond, Moment};
use isotherm_core::reading::{Reading, Reason, SignalId};
use isotherm_profile::{Axis, Profile, Unit};

/// Averaging time of a reference if the profile has no `settle`. A reference is a value that is subtracted from a
/// signal.
pub(crate) const USUAL_SETTLE: Duration = Duration::from_secs(180);

/// Input of an identification: the logged runs, the possible inputs of a model, and the error to compensate.
#[derive(Clone, Debug)]
pub(crate) struct Campaign<'a> {
    /// Logged runs, in which the faults of sensors are repaired.
    pub(crate) dataset: Cow<'a, Dataset>,
    /// Possible inputs of a model.
    pub(crate) inputs: Vec<Input>,
    /// Index of the log column with the measured error e, µm.
    pub(crate) error: usize,
    /// Machine settings of the profile. If the profile has no `settle`, this field contains [`USUAL_SETTLE`] instead.
    pub(crate) machine: MachineSettings,
    /// Time over which the rows of the logs are averaged; zero means no averaging.
    pub(crate) resample: Duration,
    /// Position signal of the axis, if the error was measured at several positions; `None` if it was measured at one
    /// position.
    pub(crate) position: Option<Position>,
    pub(crate) axes: Vec<AxisSettings>,
    /// Log column of each signal of the profile; `None` if the logs do not have that signal.
    columns: Vec<Option<Channel>>,
    mending: Option<Mending<'a>>,
}

/// Index of the log column of a signal, and the range of valid values; `None` if the profile gives no range.
type Channel = (usize, Option<(f64, f64)>);

/// Possible input of a model: a signal of the profile with its log column.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Input {
    /// Name of the signal, in the profile and in the logs.
    pub(crate) name: String,
    pub(crate) signal: SignalId,
    /// Index of the column in the dataset.
    pub(crate) column: usize,
    pub(crate) unit: Unit,
}

impl Input {
    /// Returns whether the input is the actual or commanded speed of a spindle.
    pub(crate) fn is_speed(&self) -> bool {
        self.unit.0 == "rpm"
    }
}

/// Position signal of the axis, with the reference position of the slope.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Position {
    pub(crate) input: Input,
    /// Reference position, mm. At this position, the slope adds nothing to Cz (the compensation value).
    pub(crate) reference: f64,
}

impl<'a> Campaign<'a> {
    /// Creates a campaign from the signals of a profile.
    pub(crate) fn new(
        profile: &Profile,
        dataset: &'a Dataset,
        error: usize,
        inputs: Vec<Input>,
        resample: Duration,
    ) -> Campaign<'a> {
        let mut machine = profile.machine.clone();
        if machine.settle.is_zero() {
            machine.settle = USUAL_SETTLE;
        }
        // The profile may name the signal since a later time than that of the logs.
        machine.on = machine.on.filter(|on| dataset.column(&profile.signal(*on).name).is_some());
        let without_models =
            |axis: &Axis| AxisSettings { models: Vec::new(), learned: None, ..axis.settings.clone() };
        Campaign {
            machine,
            axes: profile.axes.iter().map(without_models).collect(),
            columns: profile
                .signals
                .iter()
                .map(|signal| Some((dataset.column(&signal.name)?, signal.range)))
                .collect(),
            ..Campaign::of_columns(dataset, error, inputs, resample)
        }
    }

    /// Creates a campaign without a profile: every log column becomes a signal, in the order of the columns.
    pub(crate) fn of_columns(
        dataset: &'a Dataset,
        error: usize,
        inputs: Vec<Input>,
        resample: Duration,
    ) -> Campaign<'a> {
        let signals = dataset.columns.len();
        Campaign {
            dataset: Cow::Borrowed(dataset),
            inputs,
            error,
            machine: MachineSettings { settle: USUAL_SETTLE, signals, ..MachineSettings::default() },
            resample,
            position: None,
            mending: None,
            axes: vec![onlooker()],
            columns: (0..signals).map(|column| Some((column, None))).collect(),
        }
    }

    /// Returns the indices of the inputs that are not speeds.
    pub(crate) fn sensors(&self) -> Vec<usize> {
        (0..self.inputs.len()).filter(|input| !self.inputs[*input].is_speed()).collect()
    }

    /// Replaces the logged runs by the runs with repaired sensor faults. If `mending` is `None`, nothing was repaired,
    /// and the campaign does not change.
    #[must_use]
    pub(super) fn with_mending(self, mending: Option<Mending<'a>>) -> Campaign<'a> {
        match &mending {
            Some(own) => Campaign { dataset: Cow::Owned(own.mended()), mending, ..self },
            None => self,
        }
    }

    /// Returns a campaign for a test on the run `run`, which is held out. In this campaign, the faults of the other
    /// runs are repaired without data from `run`. `None` if no repair used data from `run`.
    pub(super) fn never_saw(&self, run: usize) -> Option<Campaign<'a>> {
        let dataset = self.mending.as_ref()?.never_saw(run)?;
        Some(Campaign { dataset: Cow::Owned(dataset), ..self.clone() })
    }

    /// Returns the campaign with one additional input. No fault of this input is repaired.
    #[must_use]
    pub(crate) fn with_input(&self, input: Input) -> Campaign<'a> {
        let mut inputs = self.inputs.clone();
        inputs.push(input);
        Campaign { inputs, ..self.clone() }
    }

    /// Returns for each row of a run whether the row is masked because some sensor was frozen in it. No model is
    /// identified from masked rows or tested on them, even if it does not use the frozen sensor. Therefore all models
    /// are tested on the same rows.
    pub(super) fn masked(&self, run: usize) -> Vec<bool> {
        let rows = self.dataset.runs.get(run).map_or(0, |run| run.times.len());
        let mut masked = vec![false; rows];
        let spoilt = self.mending.as_ref().map(|mending| mending.masked(run)).unwrap_or_default();
        spoilt.into_iter().filter(|row| *row < rows).for_each(|row| masked[row] = true);
        masked
    }

    /// Returns the time between rows after averaging, s: the averaging window, or the step of the log if that is
    /// longer.
    pub(crate) fn row_seconds(&self) -> f64 {
        let steps = self.dataset.runs.iter().flat_map(|run| run.times.windows(2));
        let mut steps: Vec<f64> = steps.map(|pair| pair[1].since(pair[0]).as_secs_f64()).collect();
        steps.sort_by(f64::total_cmp);
        let usual = steps.get(steps.len() / 2).copied().unwrap_or(60.0);
        usual.max(self.resample.as_secs_f64()).max(1e-3)
    }

    /// Returns the number of log rows that count as one independent sample, if rows closer in time than `independent`
    /// depend on each other.
    pub(crate) fn rows_per_sample(&self, independent: Duration) -> f64 {
        (independent.as_secs_f64() / self.row_seconds()).max(1.0)
    }

    /// Replaces the content of `readings` by the signal values in one log row, with the range checks of the gateway.
    pub(super) fn readings(&self, run: &Run, row: usize, now: Moment, readings: &mut Vec<Reading>) {
        readings.clear();
        readings.extend(self.columns.iter().map(|channel| {
            let Some((column, range)) = channel else { return Reading::bad(now, Reason::NotInLog) };
            let value = run.values[*column].at(row);
            match range {
                _ if value.is_nan() => Reading::bad(now, Reason::NotInLog),
                Some((low, high)) if !(*low..=*high).contains(&value) => {
                    Reading::bad(now, Reason::OutOfRange)
                }
                _ => Reading::good(value, now),
            }
        }));
    }

    /// Returns the time of the machine start in this run: the first row in which the profile's machine signal is on. If
    /// the profile has no machine signal, the start is the first row with a usable reading.
    pub(super) fn start(&self, run: &Run) -> Option<Moment> {
        let mut readings = Vec::new();
        run.times.iter().enumerate().find_map(|(row, now)| {
            self.readings(run, row, *now, &mut readings);
            let runs = match self.machine.on {
                Some(on) => readings.get(on.0).and_then(Reading::usable).is_some_and(|level| level >= 0.5),
                None => readings.iter().any(|reading| reading.usable().is_some()),
            };
            runs.then_some(*now)
        })
    }

    /// Returns the target of each row, µm: the Cz that would leave no error. The target is the mean of e while the
    /// references settle, minus e. With several positions, each position has its own mean, because the cold error of a
    /// scale is not a drift. At a position that is first visited after the references have settled, the error is
    /// counted from the first visit.
    pub(super) fn targets(&self, run: &Run) -> Vec<Target> {
        if let Errors::Touched(datum) = run.origin.errors {
            return self.touched(run, datum);
        }
        let errors = &run.values[self.error];
        let Some(start) = self.start(run) else { return vec![Target::UNKNOWN; errors.len()] };
        let places: Vec<i64> = match &self.position {
            Some(position) => run.values[position.input.column].iter().map(whole).collect(),
            None => vec![0; errors.len()],
        };
        // For each place: the sum of its cold errors, their number, and the row of its first visit if that was later.
        let mut cold: HashMap<i64, (f64, f64, Option<usize>)> = HashMap::new();
        // The rows of the temperatures' references: those before the settling time is over, and at least the first.
        let settled = start.after(self.machine.settle);
        let rows = || run.times.iter().zip(errors).zip(&places);
        for (row, ((time, error), place)) in rows().enumerate().filter(|(_, ((time, _), _))| **time >= start)
        {
            let settles = *time < settled || *time == start;
            if error.is_finite() && (settles || !cold.contains_key(place)) {
                let cold = cold.entry(*place).or_insert((0.0, 0.0, (!settles).then_some(row)));
                cold.0 += error;
                cold.1 += 1.0;
            }
        }
        let target = |((time, error), place): ((&Moment, f64), &i64)| match cold.get(place) {
            Some((sum, count, since)) if *time >= start => Target { cz: sum / count - error, since: *since },
            _ => Target::UNKNOWN,
        };
        rows().map(target).collect()
    }
}

impl Campaign<'_> {
    /// Returns the target of each row of a run with touches, µm. The target is 0 at the datum (zero point).
    /// The error of each touch is counted from the error at the datum. The target is NaN in rows without a
    /// touch. The datum is the first row at or after `datum` in which every input has a value. If `datum` is
    /// `Touch`, this row must also contain a touch.
    fn touched(&self, run: &Run, datum: TouchDatum) -> Vec<Target> {
        let errors = &run.values[self.error];
        let first = match datum {
            TouchDatum::Start => self.start(run).map(|start| run.times.partition_point(|time| *time < start)),
            TouchDatum::Zero(row) | TouchDatum::Touch(row) => Some(row),
        };
        let mut readings = Vec::new();
        let mut is_complete = |row: usize| {
            self.readings(run, row, run.times[row], &mut readings);
            let value = |input: &Input| readings.get(input.signal.0).and_then(Reading::usable);
            self.inputs.iter().all(|input| value(input).is_some())
        };
        let counts_from_touch = matches!(datum, TouchDatum::Touch(_));
        let may_be_zero = |row: &usize| !counts_from_touch || errors.at(*row).is_finite();
        let zero =
            first.and_then(|first| (first..errors.len()).filter(may_be_zero).find(|row| is_complete(*row)));
        let Some(zero) = zero else { return vec![Target::UNKNOWN; errors.len()] };
        let cold = Some(errors.at(zero)).filter(|error| error.is_finite()).unwrap_or_default();
        let since = (datum != TouchDatum::Start).then_some(zero);
        let target = |(row, error): (usize, f64)| match row.cmp(&zero) {
            Ordering::Less => Target::UNKNOWN,
            Ordering::Equal => Target { cz: 0.0, since },
            Ordering::Greater => Target { cz: cold - error, since },
        };
        errors.iter().enumerate().map(target).collect()
    }

    /// Returns the number of touches in a run with `rows` rows. One of these rows is the datum, which is not a touch.
    /// `None` if the errors of the run were recorded row by row.
    pub(super) fn touches(&self, run: usize, rows: usize) -> Option<usize> {
        let is_touched = self.dataset.runs.get(run).is_some_and(Run::is_touched);
        is_touched.then(|| rows.saturating_sub(1))
    }
}

/// Target of a model (Cz that would leave no error) at one log row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Target {
    /// Target Cz, µm. NaN if the error is missing in the row, or if the row is before the zero point.
    pub(super) cz: f64,
    /// Row that is the zero point of the target and of the rises, if the machine was already warm in that row. The row
    /// is the first visit of the position, or the datum of touches without a machine start. `None` if machine start is
    /// the zero point.
    pub(super) since: Option<usize>,
}

impl Target {
    const UNKNOWN: Target = Target { cz: f64::NAN, since: None };
}

/// Returns an axis without models, whose Cz is always zero. The gateway captures references only when the compensation
/// period of an axis has passed. Therefore this period is shorter than the time between two log rows.
fn onlooker() -> AxisSettings {
    AxisSettings {
        name: "onlooker".to_owned(),
        models: Vec::new(),
        guard: GuardSettings {
            limit: Micron::ZERO,
            step: Micron::ZERO,
            rate: MicronPerSecond::ZERO,
            deadband: Micron::ZERO,
            count: None,
        },
        every: Duration::from_nanos(1),
        on_fault: OnFault::Hold,
        levels: Levels::default(),
        datum: Datum::default(),
        intercept_slope: None,
        probe: None,
        learned: None,
    }
}

/// Rounds a position to whole millimetres. Two positions that round to the same millimetre are treated as equal.
fn whole(place: f64) -> i64 {
    #[allow(clippy::cast_possible_truncation, reason = "a travel in mm; beyond it the cast saturates")]
    let whole = place.round() as i64;
    whole
}

/// Returns the inputs without the excluded sensors.
pub(super) fn without(inputs: &[Input], excluded: &[Finding]) -> Vec<Input> {
    let is_good = |input: &&Input| !excluded.iter().any(|faulty| faulty.signal == input.name);
    inputs.iter().filter(is_good).cloned().collect()
}

/// Returns the indices of the log columns of those inputs that are temperatures.
pub(super) fn temperatures_of(dataset: &Dataset, inputs: &[Input]) -> Vec<usize> {
    let columns = inputs.iter().map(|input| input.column);
    columns.filter(|column| dataset.columns[*column].kind == Kind::Temperature).collect()
}
