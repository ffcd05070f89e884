//! Leave one run out, never rows: neighbouring minutes are not independent.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use crate::campaign::Campaign;
use crate::expected::Inside;
use crate::learn::{Learned, Learner};
use crate::method::Settings;
use crate::statistics::{count, percentile_95, range, rms};

/// Called with how many runs have been held out, and how many there are.
pub(crate) type Progress<'a> = &'a (dyn Fn(usize, usize) + Sync);

/// How a run fared that the model never saw.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunScore {
    /// The run.
    pub name: String,
    /// Largest minus smallest residual, µm.
    pub range_um: f64,
    /// Root mean square residual, µm.
    pub rmse_um: f64,
    /// 95 % of the rows are within ± this of zero, µm.
    pub p95_um: f64,
    /// The range without compensation, µm.
    pub uncompensated_range_um: f64,
    /// The root mean square without compensation, µm.
    pub uncompensated_rmse_um: f64,
    /// How much of the range is gone, in percent; below zero where it grew, none where there was none.
    pub range_cut_percent: Option<f64>,
    /// How much of it was where it is expected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_um: Option<Inside>,
}

impl RunScore {
    /// From the measured error and what the model left of it, µm.
    pub(super) fn new(name: &str, error: &[f64], left: &[f64]) -> RunScore {
        let (range_um, uncompensated_range_um) = (range(left), range(error));
        RunScore {
            name: name.to_owned(),
            range_um,
            rmse_um: rms(left),
            p95_um: percentile_95(left),
            uncompensated_range_um,
            uncompensated_rmse_um: rms(error),
            range_cut_percent: (uncompensated_range_um > 0.0)
                .then(|| 100.0 * (1.0 - range_um / uncompensated_range_um)),
            expected_um: None,
        }
    }

    /// Whether the run is left with a larger range than it has without compensation.
    pub fn is_worse(&self) -> bool {
        self.range_um > self.uncompensated_range_um
    }
}

/// Figures over all runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Means {
    /// Mean range, µm.
    pub mean_range_um: f64,
    /// Worst range, µm.
    pub worst_range_um: f64,
    /// Mean of the root mean squares, µm.
    pub mean_rmse_um: f64,
    /// Share of the runs that are left worse than uncompensated, by their range.
    pub worse_share: f64,
}

impl Means {
    /// Of the held-out residuals.
    pub(super) fn of<'a>(runs: impl IntoIterator<Item = &'a RunScore>) -> Means {
        Means::over(runs.into_iter().map(|run| (run.range_um, run.rmse_um, run.is_worse())))
    }

    /// Of the residuals as the model left them, whatever probe takes them out: what stands in for a sensor is judged so, too.
    pub(super) fn unprobed(held_out: &[HeldOut]) -> Means {
        Means::over(held_out.iter().map(|held| {
            let left = held.residual(None);
            let range = range(&left);
            (range, rms(&left), range > held.score.uncompensated_range_um)
        }))
    }

    /// Of the errors without compensation.
    pub(super) fn uncompensated(runs: &[RunScore]) -> Means {
        Means::over(runs.iter().map(|run| (run.uncompensated_range_um, run.uncompensated_rmse_um, false)))
    }

    /// Of the range and the root mean square of each run, and whether it is worse than uncompensated.
    fn over(scores: impl Iterator<Item = (f64, f64, bool)>) -> Means {
        let scores: Vec<(f64, f64, bool)> = scores.collect();
        // Of nothing there is no mean.
        let runs = count(scores.len());
        Means {
            mean_range_um: scores.iter().map(|score| score.0).sum::<f64>() / runs,
            worst_range_um: scores.iter().map(|score| score.0).fold(f64::NAN, f64::max),
            mean_rmse_um: scores.iter().map(|score| score.1).sum::<f64>() / runs,
            worse_share: count(scores.iter().filter(|score| score.2).count()) / runs,
        }
    }
}

/// One held-out run, row by row.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// How it fared.
    pub score: RunScore,
    /// By row: which averaging window of the run it is.
    pub(crate) windows: Vec<u128>,
    /// Seconds since the run's first row.
    pub seconds: Vec<f64>,
    /// The measured error e, µm, from its cold value.
    pub error: Vec<f64>,
    /// What the model would have added, µm.
    pub cz: Vec<f64>,
    /// The model, learnt from all the other runs.
    pub learned: Learned,
}

impl HeldOut {
    /// What is left, row by row: e + Cz. With the interval of a probe, s: what changed since it last touched and took the
    /// residual out.
    pub fn residual(&self, probe: Option<f64>) -> Vec<f64> {
        residual(&self.seconds, &self.error, &self.cz, probe)
    }
}

fn residual(seconds: &[f64], error: &[f64], cz: &[f64], probe: Option<f64>) -> Vec<f64> {
    let left = error.iter().zip(cz).map(|(error, cz)| error + cz);
    let Some(interval) = probe else { return left.collect() };
    let mut last = (f64::NEG_INFINITY, 0.0);
    let mut since_probing = |(left, second): (f64, &f64)| {
        let window = (second / interval).floor();
        if window > last.0 {
            // The references begin at zero: the first touch is the datum itself.
            last = (window, if last.0.is_finite() { left } else { 0.0 });
        }
        left - last.1
    };
    left.zip(seconds).map(&mut since_probing).collect()
}

/// What `held` makes of each run, by its number, and of all the others; in the order of the runs.
pub(super) fn hold_out_each<T: Send>(
    runs: usize,
    progress: Progress<'_>,
    held: impl Fn(usize, &[usize]) -> T + Sync,
) -> Vec<T> {
    let done = AtomicUsize::new(0);
    let each = (0..runs).into_par_iter().map(|out| {
        let others: Vec<usize> = (0..runs).filter(|run| *run != out).collect();
        let held = held(out, &others);
        progress(done.fetch_add(1, Ordering::Relaxed) + 1, runs);
        held
    });
    each.collect()
}

/// Learns once for each run from all the others, and judges on that run. With `probe`, the residual is measured and
/// taken out at that interval, in seconds. Where a fault of another run was mended with a run's help, the method begins
/// anew without it, once for all of `without`: `settings` are those of the learner.
///
/// For each list of inputs that are left out every run, or what the method says of the first that it cannot do without.
pub(super) fn leave_one_run_out(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    settings: &Settings,
    without: &[Vec<usize>],
    probe: Option<f64>,
    progress: Progress<'_>,
) -> Vec<Result<Vec<HeldOut>, String>> {
    let judge =
        |campaign: &Campaign<'_>, learner: &dyn Learner, out: usize, others: &[usize], without: &[usize]| {
            let learned = learner.learn(others, without)?;
            let run = &learner.bank().runs[out];
            let (error, cz) = (run.error(), learned.predict(campaign, learner.bank(), out));
            let (windows, seconds) = (run.windows.clone(), run.seconds.clone());
            let score = RunScore::new(&run.name, &error, &residual(&seconds, &error, &cz, probe));
            Ok(HeldOut { score, windows, seconds, error, cz, learned })
        };
    let each = |campaign: &Campaign<'_>, learner: &dyn Learner, out: usize, others: &[usize]| {
        without.iter().map(|without| judge(campaign, learner, out, others, without)).collect::<Vec<_>>()
    };
    let held = |out: usize, others: &[usize]| match campaign.never_saw(out) {
        None => each(campaign, learner, out, others),
        Some(blind) => match settings.method.prepare(&blind, settings) {
            Ok(learner) => each(&blind, learner.as_ref(), out, others),
            Err(why) => without.iter().map(|_| Err(why.clone())).collect(),
        },
    };
    let by_run = hold_out_each(learner.bank().runs.len(), progress, held);
    let mut by_run: Vec<_> = by_run.into_iter().map(Vec::into_iter).collect();
    without.iter().map(|_| by_run.iter_mut().filter_map(Iterator::next).collect()).collect()
}
