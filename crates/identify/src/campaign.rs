//! The runs of a dataset as the gateway would see them: through a profile's signals, with one measured error.

use std::borrow::Cow;
use std::collections::HashMap;
use std::time::Duration;

use crate::dataset::{Dataset, Kind, Run};
use crate::faults::Finding;
use crate::faults::mend::Mending;
use isotherm_core::compensation::settings::{
    AxisSettings, Datum, GuardSettings, Levels, MachineSettings, OnFault,
};
use isotherm_core::quantity::{Micron, MicronPerSecond, Moment};
use isotherm_core::reading::{Reading, Reason, SignalId};
use isotherm_profile::{Axis, Profile, Unit};

/// What a reference is the mean over where the profile does not say.
pub(crate) const USUAL_SETTLE: Duration = Duration::from_secs(180);

/// Runs, inputs and the error that is to be compensated.
#[derive(Clone, Debug)]
pub(crate) struct Campaign<'a> {
    /// The logs, faults mended.
    pub(crate) dataset: Cow<'a, Dataset>,
    /// What a model may be made of.
    pub(crate) inputs: Vec<Input>,
    /// The column with the measured error e, µm.
    pub(crate) error: usize,
    /// The profile's machine; its `settle` is [`USUAL_SETTLE`] where the profile has none.
    pub(crate) machine: MachineSettings,
    /// Rows are averaged over this long; zero leaves them as they are.
    pub(crate) resample: Duration,
    /// Where the axis was, for errors measured at several positions.
    pub(crate) position: Option<Position>,
    pub(crate) axes: Vec<AxisSettings>,
    /// By signal of the profile.
    columns: Vec<Option<Channel>>,
    mending: Option<Mending<'a>>,
}

/// A column, and the range outside which its values are no readings.
type Channel = (usize, Option<(f64, f64)>);

/// One input of a model.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Input {
    /// The signal's name, in the profile and in the logs.
    pub(crate) name: String,
    pub(crate) signal: SignalId,
    /// In the dataset.
    pub(crate) column: usize,
    pub(crate) unit: Unit,
}

impl Input {
    /// How fast a spindle turns, or is to turn.
    pub(crate) fn is_speed(&self) -> bool {
        self.unit.0 == "rpm"
    }
}

/// The signal that says where the axis is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Position {
    pub(crate) input: Input,
    /// Where the slope adds nothing, mm.
    pub(crate) reference: f64,
}

impl<'a> Campaign<'a> {
    /// The runs through the profile's signals.
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
        let without_models = |axis: &Axis| AxisSettings { models: Vec::new(), ..axis.settings.clone() };
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

    /// The runs without a profile: every column is a signal of its own, in its place.
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

    /// The inputs that are no speeds.
    pub(crate) fn sensors(&self) -> Vec<usize> {
        (0..self.inputs.len()).filter(|input| !self.inputs[*input].is_speed()).collect()
    }

    /// The same with what was faulty mended.
    #[must_use]
    pub(super) fn with_mending(self, mending: Option<Mending<'a>>) -> Campaign<'a> {
        match &mending {
            Some(own) => Campaign { dataset: Cow::Owned(own.mended()), mending, ..self },
            None => self,
        }
    }

    /// The same as if this run had not been recorded yet when the other runs were mended; `None`: it is no other.
    pub(super) fn never_saw(&self, run: usize) -> Option<Campaign<'a>> {
        let dataset = self.mending.as_ref()?.never_saw(run)?;
        Some(Campaign { dataset: Cow::Owned(dataset), ..self.clone() })
    }

    /// The same with one input more, with its readings as they were recorded.
    #[must_use]
    pub(crate) fn with_input(&self, input: Input) -> Campaign<'a> {
        let mut inputs = self.inputs.clone();
        inputs.push(input);
        Campaign { inputs, ..self.clone() }
    }

    /// By row of a run: whether it is masked, because some sensor was frozen. No model is learnt from such a row or judged
    /// by it, whichever its inputs are, so that all models are judged by the same rows.
    pub(super) fn masked(&self, run: usize) -> Vec<bool> {
        let rows = self.dataset.runs.get(run).map_or(0, |run| run.times.len());
        let mut masked = vec![false; rows];
        let spoilt = self.mending.as_ref().map(|mending| mending.masked(run)).unwrap_or_default();
        spoilt.into_iter().filter(|row| *row < rows).for_each(|row| masked[row] = true);
        masked
    }

    /// How long one row stands for after averaging, s: the averaging window, or the log's own step where that is longer.
    pub(crate) fn row_seconds(&self) -> f64 {
        let steps = self.dataset.runs.iter().flat_map(|run| run.times.windows(2));
        let mut steps: Vec<f64> = steps.map(|pair| pair[1].since(pair[0]).as_secs_f64()).collect();
        steps.sort_by(f64::total_cmp);
        let usual = steps.get(steps.len() / 2).copied().unwrap_or(60.0);
        usual.max(self.resample.as_secs_f64()).max(1e-3)
    }

    /// Number of rows in one independent sample, if rows closer than `independent` depend on each other.
    pub(crate) fn rows_per_sample(&self, independent: Duration) -> f64 {
        (independent.as_secs_f64() / self.row_seconds()).max(1.0)
    }

    /// The readings of one row, as the gateway would believe them.
    pub(super) fn readings(&self, run: &Run, row: usize, now: Moment, readings: &mut Vec<Reading>) {
        readings.clear();
        readings.extend(self.columns.iter().map(|channel| {
            let Some((column, range)) = channel else { return Reading::bad(now, Reason::NotInLog) };
            let value = run.values[*column][row];
            match range {
                _ if value.is_nan() => Reading::bad(now, Reason::NotInLog),
                Some((low, high)) if !(*low..=*high).contains(&value) => {
                    Reading::bad(now, Reason::OutOfRange)
                }
                _ => Reading::good(value, now),
            }
        }));
    }

    /// When the machine of this run starts: at the rising edge of its signal, else at the first good reading.
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

    /// The compensation of each row that would leave no error: Cz = −(e − its mean while the references settle), µm. With a
    /// position, each place has a mean of its own: a scale's cold error is no drift. A place first visited later is
    /// measured from its first visit.
    pub(super) fn targets(&self, run: &Run) -> Vec<Target> {
        let errors = &run.values[self.error];
        let Some(start) = self.start(run) else { return vec![Target::UNKNOWN; errors.len()] };
        let places: Vec<i64> = match &self.position {
            Some(position) => run.values[position.input.column].iter().map(|place| whole(*place)).collect(),
            None => vec![0; errors.len()],
        };
        // By place: the sum of its errors before anything moved there, how many they are, and since which row.
        let mut cold: HashMap<i64, (f64, f64, Option<usize>)> = HashMap::new();
        // The same rows as the references of the temperatures: those before their time is over, and at least the first.
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
        let target = |((time, error), place): ((&Moment, &f64), &i64)| match cold.get(place) {
            Some((sum, count, since)) if *time >= start => Target { cz: sum / count - error, since: *since },
            _ => Target::UNKNOWN,
        };
        rows().map(target).collect()
    }
}

/// What a model should compensate at one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Target {
    /// µm; NaN where the error is missing, and before the machine starts.
    pub(super) cz: f64,
    /// The row that it is measured from, where that is the first visit of a place after the references had settled. The
    /// machine was warm by then: a model's rises count from that row, too.
    pub(super) since: Option<usize>,
}

impl Target {
    const UNKNOWN: Target = Target { cz: f64::NAN, since: None };
}

/// An axis that moves nothing: references are captured for the axes that are due, so there must be one at every row.
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
    }
}

/// Positions are the same where they differ by less than a millimetre.
fn whole(place: f64) -> i64 {
    #[allow(clippy::cast_possible_truncation, reason = "a travel in mm; beyond it the cast saturates")]
    let whole = place.round() as i64;
    whole
}

/// These inputs but for those that are excluded.
pub(super) fn without(inputs: &[Input], excluded: &[Finding]) -> Vec<Input> {
    let is_good = |input: &&Input| !excluded.iter().any(|faulty| faulty.signal == input.name);
    inputs.iter().filter(is_good).cloned().collect()
}

/// The columns of these inputs that are temperatures.
pub(super) fn temperatures_of(dataset: &Dataset, inputs: &[Input]) -> Vec<usize> {
    let columns = inputs.iter().map(|input| input.column);
    columns.filter(|column| dataset.columns[*column].kind == Kind::Temperature).collect()
}
