//! The bank: every input through every lag, as the gateway itself would compute it.
//!
//! The gateway's own [`Compensation`] captures the references and its own [`Lag`] follows each input, row by row of the
//! log as it was recorded; only then are rows averaged. So what is found on the bank is what runs: the replay of a run
//! gives the same values.
//!
//! While the references settle the axis waits, and a rise is zero. Where an error is measured from the first visit of its
//! place, so are the rises.

use rayon::prelude::*;
use std::collections::HashMap;
use std::time::Duration;

use nalgebra::{DMatrix, DVector};

use crate::campaign::{Campaign, Wanted};
use crate::gram::Gram;
use isotherm_core::compensation::model::{Input, Inputs, Lag, Reference, Unusable};
use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};

/// Time constants that are tried: none, 3, 6, 12, 25, 50, 100 and 200 minutes.
pub const LAGS_MIN: [u32; 8] = [0, 3, 6, 12, 25, 50, 100, 200];

/// The usual lags.
pub fn usual_lags() -> Vec<Option<Duration>> {
    LAGS_MIN
        .iter()
        .map(|minutes| (*minutes > 0).then(|| Duration::from_secs(u64::from(*minutes) * 60)))
        .collect()
}

/// One column of the bank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Its place among the campaign's inputs.
    pub input: usize,
    /// Time constant; `None`: the rise itself.
    pub lag: Option<Duration>,
    /// Multiplied with the distance from the campaign's reference position: a term of the slope, mm·°C.
    pub along: bool,
}

/// Every candidate over every run.
#[derive(Clone, Debug)]
pub struct Bank {
    /// The columns.
    pub candidates: Vec<Candidate>,
    /// In the order of the dataset.
    pub runs: Vec<Traced>,
}

/// One run, row by row after averaging.
#[derive(Clone, Debug)]
pub struct Traced {
    /// The run's name.
    pub name: String,
    /// Seconds since the run's first row.
    pub seconds: Vec<f64>,
    /// The compensation that is wanted, µm: −(e − its cold value).
    pub wanted: Vec<f64>,
    /// One row per row, one column per candidate: rises in the unit of their inputs, from where `wanted` is measured.
    pub rises: DMatrix<f64>,
}

impl Bank {
    /// Every input through these lags.
    pub fn of(campaign: &Campaign<'_>, lags: &[Option<Duration>]) -> Bank {
        let inputs = 0..campaign.inputs.len();
        let all = |input| lags.iter().map(move |lag| Candidate { input, lag: *lag, along: false });
        Bank::new(campaign, inputs.flat_map(all).collect())
    }

    /// These candidates.
    pub fn new(campaign: &Campaign<'_>, candidates: Vec<Candidate>) -> Bank {
        let places: Vec<usize> = (0..campaign.dataset.runs.len()).collect();
        let runs = places.par_iter().map(|place| trace(campaign, *place, &candidates)).collect();
        Bank { candidates, runs }
    }

    /// How many columns.
    pub fn width(&self) -> usize {
        self.candidates.len()
    }

    /// The products of each run.
    pub fn grams(&self) -> Vec<Gram> {
        self.runs.par_iter().map(Traced::gram).collect()
    }
}

impl Traced {
    /// The products of the run.
    pub fn gram(&self) -> Gram {
        Gram::of(&self.rises, &DVector::from_column_slice(&self.wanted))
    }
}

/// Rows of one averaging window.
#[derive(Debug)]
struct Window {
    index: u128,
    rows: f64,
    seconds: f64,
    wanted: f64,
    rises: Vec<f64>,
}

/// One run through the gateway's own references and lags.
pub fn trace(campaign: &Campaign<'_>, run: usize, candidates: &[Candidate]) -> Traced {
    let run = &campaign.dataset.runs[run];
    let wanted = campaign.wanted(run);
    let inputs: Vec<Input> = candidates.iter().map(|candidate| input(campaign, candidate)).collect();
    let mut lags = vec![Lag::default(); inputs.len()];
    let mut compensation =
        Compensation::new(campaign.machine.clone(), campaign.axes.clone(), Remembered::default());
    let controls = vec![Control { permit: Permit::Armed, ..Control::default() }; campaign.axes.len()];
    let first = run.times.first().copied().unwrap_or_default();
    let (mut readings, mut rises, mut windows) = (Vec::new(), vec![0.0; inputs.len()], Vec::<Window>::new());
    let mut visits: HashMap<usize, Vec<f64>> = HashMap::new();
    for (row, now) in run.times.iter().copied().enumerate() {
        campaign.readings(run, row, now, &mut readings);
        let snapshot = Snapshot { now, readings: &readings };
        compensation.step(&snapshot, &controls);
        let machine = compensation.machine();
        let known = Inputs { snapshot: &snapshot, machine, lags: &[], splits_slope: false };
        let distance = campaign.position.as_ref().map(|position| {
            snapshot.value(position.signal).map_or(f64::NAN, |place| place - position.reference)
        });
        for (((rise, lag), input), candidate) in rises.iter_mut().zip(&mut lags).zip(&inputs).zip(candidates)
        {
            lag.follow(input, &snapshot, machine);
            *rise = rise_of(*lag, input, &known);
            if candidate.along {
                *rise *= distance.unwrap_or(f64::NAN);
            }
        }
        let Wanted { cz, since } = wanted[row];
        if let Some(since) = since {
            let first = visits.entry(since).or_insert_with(|| rises.clone());
            rises.iter_mut().zip(first).for_each(|(rise, first)| *rise -= *first);
        }
        if !cz.is_finite() || !rises.iter().all(|rise| rise.is_finite()) {
            continue;
        }
        let passed = now.since(first);
        let index = passed.as_nanos() / campaign.resample.as_nanos().max(1);
        let window = match windows.last_mut() {
            Some(window) if window.index == index => window,
            _ => {
                let rises = vec![0.0; inputs.len()];
                windows.push(Window { index, rows: 0.0, seconds: 0.0, wanted: 0.0, rises });
                let Some(window) = windows.last_mut() else { continue };
                window
            }
        };
        window.rows += 1.0;
        window.seconds += passed.as_secs_f64();
        window.wanted += cz;
        window.rises.iter_mut().zip(&rises).for_each(|(sum, rise)| *sum += rise);
    }
    Traced {
        name: run.name.clone(),
        seconds: windows.iter().map(|window| window.seconds / window.rows).collect(),
        wanted: windows.iter().map(|window| window.wanted / window.rows).collect(),
        rises: DMatrix::from_fn(windows.len(), inputs.len(), |row, column| {
            windows[row].rises[column] / windows[row].rows
        }),
    }
}

fn input(campaign: &Campaign<'_>, candidate: &Candidate) -> Input {
    let signal = campaign.inputs[candidate.input].signal;
    Input { signal, reference: Reference::Start, lag: candidate.lag }
}

/// NaN where the signal cannot be used; zero while its reference settles.
fn rise_of(lag: Lag, input: &Input, known: &Inputs<'_>) -> f64 {
    match input.rise(known, &lag) {
        Ok(rise) => rise.get(),
        Err(Unusable::Reference(_)) => 0.0,
        Err(_) => f64::NAN,
    }
}
