//! Matrix of candidate terms (the bank) of a model: one column for each input with each lag, one row for each row of
//! the logs. An input is a sensor or a speed. Its rise is its value minus a reference value. The matrix contains the
//! same values that the gateway would compute.
//!
//! The gateway's own [`Compensation`] captures the references. A [`Lag`] of the gateway follows each input, row by row
//! of the recorded log. Rows are averaged only after that. A model identified from this matrix therefore gives the same
//! values in a replay of the run.
//!
//! A rise is zero until its reference has been captured, because the axis does not compensate before. The error and the
//! rises always have the same zero point: machine start, the first visit of a position, a zero command, or the first
//! touch of a probe.

use std::collections::HashMap;
use std::time::Duration;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::campaign::{Campaign, Target};
use crate::gram::Gram;
use isotherm_core::compensation::model::{Input, Inputs, Lag, Reference, Unusable};
use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use isotherm_core::quantity::Celsius;

/// Time constants of the lags that are tried, min. 0 means no lag.
pub(crate) const LAGS_MIN: [u32; 8] = [0, 3, 6, 12, 25, 50, 100, 200];

/// Returns the time constants of [`LAGS_MIN`]; `None` means no lag.
pub(crate) fn usual_lags() -> Vec<Option<Duration>> {
    LAGS_MIN.iter().map(|minutes| (*minutes > 0).then(|| Duration::from_mins((*minutes).into()))).collect()
}

/// Candidate term of a model: an input with a lag, its square, or its product with the position. Each candidate has one
/// column in the matrix of candidate terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Index of the input in the inputs of the campaign.
    pub input: usize,
    /// Time constant of the lag; `None` for a rise without a lag.
    pub lag: Option<Duration>,
    /// Whether the term is the square of the input.
    pub squared: bool,
    /// Whether the rise is multiplied by the distance of the axis from the campaign's reference position. The term then
    /// belongs to the slope over the position, and its unit is mm·°C.
    pub along: bool,
}

/// Selection of log rows for the matrix. Masked rows, in which some sensor was frozen, are never selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rows {
    /// Only log rows in which the error was measured.
    WithError,
    /// All log rows. If the error is missing in a row, the target is NaN.
    Every,
}

/// Matrix of candidate terms: value of each term in each row of each run.
#[derive(Clone, Debug)]
pub(crate) struct Bank {
    /// Candidate term of each column of the matrix.
    pub(crate) candidates: Vec<Candidate>,
    /// For each input of the campaign: whether it is a speed.
    pub(crate) is_speed: Vec<bool>,
    /// Values of each run, in the order of the runs in the dataset.
    pub(crate) runs: Vec<Traced>,
}

/// Values of one run. Each row is the mean over one averaging window.
#[derive(Clone, Debug)]
pub(crate) struct Traced {
    pub(crate) name: String,
    /// Number of the averaging window of each row, counted from the first row of the run. Windows in which a candidate
    /// term has no value have no row.
    pub(crate) windows: Vec<u128>,
    /// Time of each row, in seconds since the first row of the run.
    pub(crate) seconds: Vec<f64>,
    /// Cz (compensation value) that would compensate the whole error, µm. The Cz is the negative error, counted from
    /// its cold value.
    pub(crate) target: DVector<f64>,
    /// Rises of the inputs, in the unit of each input. Each candidate term has one column. The rises have the same zero
    /// point as the target.
    pub(crate) rises: DMatrix<f64>,
}

impl Candidate {
    pub(crate) fn new(input: usize, lag: Option<Duration>) -> Candidate {
        Candidate { input, lag, squared: false, along: false }
    }
}

impl Bank {
    /// Creates the matrix of candidate terms: all inputs with these lags, and the additional candidates in `beside`.
    /// For a speed, the square of the speed is also a candidate. A speed is used only with a lag, because a spindle
    /// warms the machine with a delay.
    pub(crate) fn with_speeds(
        campaign: &Campaign<'_>,
        lags: &[Option<Duration>],
        beside: impl Iterator<Item = Candidate>,
    ) -> Bank {
        let of_input = |input: usize| {
            let own = lags.iter().map(move |lag| Candidate::new(input, *lag));
            if !campaign.inputs[input].is_speed() {
                return own.collect::<Vec<Candidate>>();
            }
            let late = own.filter(|candidate| candidate.lag.is_some());
            late.flat_map(|plain| [plain, Candidate { squared: true, ..plain }]).collect()
        };
        let mut candidates: Vec<Candidate> = (0..campaign.inputs.len()).flat_map(of_input).collect();
        for more in beside {
            if !candidates.contains(&more) {
                candidates.push(more);
            }
        }
        Bank::new(campaign, candidates)
    }

    /// Creates the matrix of candidate terms from only these inputs with these lags.
    pub(crate) fn of_inputs(
        campaign: &Campaign<'_>,
        inputs: &[usize],
        lags: &[Option<Duration>],
        rows: Rows,
    ) -> Bank {
        let all = |input: &usize| {
            let input = *input;
            lags.iter().map(move |lag| Candidate::new(input, *lag))
        };
        Bank::with(campaign, inputs.iter().flat_map(all).collect(), rows)
    }

    /// Creates the matrix of candidate terms from every input with these lags.
    pub(crate) fn of(campaign: &Campaign<'_>, lags: &[Option<Duration>]) -> Bank {
        let inputs: Vec<usize> = (0..campaign.inputs.len()).collect();
        Bank::of_inputs(campaign, &inputs, lags, Rows::WithError)
    }

    /// Creates the matrix of these candidate terms, over the rows with a measured error.
    pub(crate) fn new(campaign: &Campaign<'_>, candidates: Vec<Candidate>) -> Bank {
        Bank::with(campaign, candidates, Rows::WithError)
    }

    /// Creates the matrix of these candidate terms, over the selected rows.
    pub(crate) fn with(campaign: &Campaign<'_>, candidates: Vec<Candidate>, rows: Rows) -> Bank {
        let places = 0..campaign.dataset.runs.len();
        let runs = places.into_par_iter().map(|place| trace(campaign, place, &candidates, rows)).collect();
        Bank { candidates, is_speed: campaign.inputs.iter().map(|input| input.is_speed()).collect(), runs }
    }

    /// Returns the index of the candidate's column; `None` if the matrix does not contain it.
    pub(crate) fn column(&self, candidate: &Candidate) -> Option<usize> {
        self.candidates.iter().position(|known| known == candidate)
    }

    /// Returns the index of the column of an input without a lag; `None` if the matrix does not contain it.
    pub(crate) fn plain(&self, input: usize) -> Option<usize> {
        self.column(&Candidate::new(input, None))
    }

    /// Returns the rises of a column in the rows of all runs.
    pub(crate) fn rises(&self, column: usize) -> Vec<f64> {
        self.runs
            .iter()
            .flat_map(|run| run.rises.column(column).iter().copied().collect::<Vec<f64>>())
            .collect()
    }

    /// Returns the largest absolute rise of a column in the rows of all runs.
    pub(crate) fn largest(&self, column: usize) -> f64 {
        self.runs.iter().map(|run| run.rises.column(column).amax()).fold(0.0, f64::max)
    }

    /// Returns the measured error in the matrix rows of all runs, µm, counted from its cold value.
    pub(crate) fn errors(&self) -> Vec<f64> {
        self.runs.iter().flat_map(Traced::error).collect()
    }

    /// Checks that every run has at least one row. The message calls the inputs `every` (for example "every sensor"),
    /// and a single input `one` (for example "the sensor").
    ///
    /// # Errors
    /// Returns a message that names the run without rows.
    pub(crate) fn check_rows(&self, every: &str, one: &str) -> Result<(), String> {
        match self.runs.iter().find(|run| run.target.is_empty()) {
            None => Ok(()),
            Some(run) => Err(format!(
                "{} has no row with values of the error and of {every}: leave out this run, or use --without \
                 to leave out {one} without values",
                run.name
            )),
        }
    }

    /// Returns the Gram products X'X, X'y and y'y of each run. X contains the rises of the candidate terms,
    /// and y the target.
    pub(crate) fn grams(&self) -> Vec<Gram> {
        self.runs_in_parallel(|run| Gram::of(&run.rises, &run.target))
    }

    /// Calls `of` for each run in parallel. Returns the results in the order of the runs.
    pub(crate) fn runs_in_parallel<T: Send>(&self, of: impl Fn(&Traced) -> T + Sync + Send) -> Vec<T> {
        self.runs.par_iter().map(of).collect()
    }
}

impl Traced {
    /// Returns the measured error in each matrix row of the run, µm, counted from its cold value.
    pub(crate) fn error(&self) -> Vec<f64> {
        self.target.iter().map(|target| -target).collect()
    }
}

/// Computes the candidate terms of one run with the references and lags that the gateway would use.
pub(crate) fn trace(campaign: &Campaign<'_>, run: usize, candidates: &[Candidate], wanted: Rows) -> Traced {
    let masked = campaign.masked(run);
    let run = &campaign.dataset.runs[run];
    let targets = campaign.targets(run);
    let inputs: Vec<Input> = candidates.iter().map(|candidate| input(campaign, candidate)).collect();
    let mut lags = vec![Lag::default(); inputs.len()];
    let mut compensation =
        Compensation::new(campaign.machine.clone(), campaign.axes.clone(), Remembered::default());
    let controls = vec![Control { permit: Permit::Armed, ..Control::default() }; campaign.axes.len()];
    let first = run.times.first().copied().unwrap_or_default();
    let (mut readings, mut rises) = (Vec::new(), vec![0.0; inputs.len()]);
    let mut visits: HashMap<usize, Vec<f64>> = HashMap::new();
    let mut windows: Vec<Window> = Vec::new();
    for ((row, now), Target { cz, since }) in run.times.iter().copied().enumerate().zip(targets) {
        campaign.readings(run, row, now, &mut readings);
        let snapshot = Snapshot::new(now, &readings);
        compensation.step(&snapshot, &controls);
        let machine = compensation.machine();
        let known = Inputs { snapshot: snapshot.followed(), machine, lags: &[], splits_slope: false };
        let distance = campaign.position.as_ref().map(|position| {
            snapshot.value(position.input.signal).map_or(f64::NAN, |place| place - position.reference)
        });
        for (((rise, lag), input), candidate) in rises.iter_mut().zip(&mut lags).zip(&inputs).zip(candidates)
        {
            lag.follow(input, &snapshot, machine);
            *rise = rise_of(*lag, input, &known);
            if candidate.along {
                *rise *= distance.unwrap_or(f64::NAN);
            }
        }
        // Other sensors are predicted over all rows, which have one reference.
        let since = since.filter(|_| wanted == Rows::WithError || campaign.position.is_some());
        if let Some(since) = since {
            let first = visits.entry(since).or_insert_with(|| rises.clone());
            rises.iter_mut().zip(first).for_each(|(rise, first)| *rise -= *first);
        }
        let is_known = cz.is_finite() || wanted == Rows::Every;
        if masked[row] || !is_known || !rises.iter().all(|rise| rise.is_finite()) {
            continue;
        }
        let passed = now.since(first);
        let index = passed.as_nanos() / campaign.resample.as_nanos().max(1);
        if windows.last().is_none_or(|last| last.index != index) {
            let rises = vec![0.0; rises.len()];
            windows.push(Window { index, rows: 0.0, seconds: 0.0, rises, errors: 0.0, target: 0.0 });
        }
        if let Some(window) = windows.last_mut() {
            window.add(passed.as_secs_f64(), cz, &rises);
        }
    }
    let each = || windows.iter();
    Traced {
        name: run.name.clone(),
        windows: each().map(|window| window.index).collect(),
        seconds: each().map(|window| window.seconds / window.rows).collect(),
        target: DVector::from_iterator(windows.len(), each().map(|window| window.target / window.errors)),
        rises: DMatrix::from_fn(windows.len(), inputs.len(), |window, column| {
            windows[window].rises[column] / windows[window].rows
        }),
    }
}

/// Sums over the log rows in one averaging window: number of rows, number of rows with an error, and sums of the row
/// values.
struct Window {
    index: u128,
    rows: f64,
    seconds: f64,
    rises: Vec<f64>,
    errors: f64,
    target: f64,
}

impl Window {
    fn add(&mut self, seconds: f64, target: f64, rises: &[f64]) {
        self.rows += 1.0;
        self.seconds += seconds;
        self.rises.iter_mut().zip(rises).for_each(|(sum, rise)| *sum += rise);
        if target.is_finite() {
            self.errors += 1.0;
            self.target += target;
        }
    }
}

/// Returns the gateway input of a candidate. The rise of a temperature is counted from machine start. The rise of a
/// speed is the speed itself, because its reference is zero.
fn input(campaign: &Campaign<'_>, candidate: &Candidate) -> Input {
    let own = &campaign.inputs[candidate.input];
    let reference = if own.is_speed() { Reference::Fixed(Celsius::ZERO) } else { Reference::Start };
    Input { squared: candidate.squared, ..Input::of(own.signal, reference, candidate.lag) }
}

/// Returns the rise of an input: NaN if the signal cannot be used, zero until its reference has been captured.
fn rise_of(lag: Lag, input: &Input, known: &Inputs<'_>) -> f64 {
    match input.rise(known, &lag) {
        Ok(rise) => rise.get(),
        Err(Unusable::Reference(_)) => 0.0,
        Err(_) => f64::NAN,
    }
}
