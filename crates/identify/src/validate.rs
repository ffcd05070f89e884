//! Validation on held-out runs: a model is identified from all other runs, and tested on the held-out run. Only whole
//! runs are held out, because neighbouring minutes of a run depend on each other. Cz is the compensation value of the
//! axis.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use crate::campaign::Campaign;
use crate::expected::Inside;
use crate::learn::{Learned, Learner};
use crate::method::Settings;
use crate::statistics::{count, percentile_95, range, rms};

/// Callback for the progress of the validation. The arguments are the number of runs that have been held out so far,
/// and the number of all runs.
pub(crate) type Progress<'a> = &'a (dyn Fn(usize, usize) + Sync);

/// Result of a model on a run that was held out of its identification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunScore {
    /// Name of the run.
    pub name: String,
    /// Range of the residual error (maximum minus minimum), µm.
    pub range_um: f64,
    /// Root mean square of the residual error, µm.
    pub rmse_um: f64,
    /// Absolute residual error that 95 % of the log rows do not exceed, µm.
    pub p95_um: f64,
    /// Range of the error without compensation, µm.
    pub uncompensated_range_um: f64,
    /// Root mean square of the error without compensation, µm.
    pub uncompensated_rmse_um: f64,
    /// Reduction of the range of the error in percent. It is negative if the range grew. `None` if the range without
    /// compensation is zero.
    pub range_cut_percent: Option<f64>,
    /// Shares of the log rows whose residual is within the expected error; `None` if the expected error is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_um: Option<Inside>,
    /// Number of touches if the run was measured by touches of a probe; `None` if it was measured row by row. A range
    /// over touches is smaller than a range over all rows, see [`OVER_TOUCHES`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub touches: Option<usize>,
}

/// Usual ratio of the range over all rows to the range over eight touches.
pub const OVER_TOUCHES: f64 = 1.3;

impl RunScore {
    /// Creates a score from the measured error and the residual error, µm.
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
            touches: None,
        }
    }

    /// Returns the score with the number of touches by which the run was measured. `touches` is `None` if the run was
    /// measured row by row.
    #[must_use]
    pub(super) fn over(self, touches: Option<usize>) -> RunScore {
        RunScore { touches, ..self }
    }

    /// Returns the mark ` (× 1.3)` if the range was measured by touches, for reports. The mark is empty if the run was
    /// measured row by row.
    pub fn mark(&self) -> String {
        self.touches.map_or_else(String::new, |_| format!(" (× {OVER_TOUCHES})"))
    }

    /// Returns whether the range of the residual error is larger than the range without compensation.
    pub fn is_worse(&self) -> bool {
        self.range_um > self.uncompensated_range_um
    }
}

/// Means of the results over all runs; NaN without runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Means {
    /// Mean of the error ranges of the runs, µm.
    pub mean_range_um: f64,
    /// Largest error range of a run, µm.
    pub worst_range_um: f64,
    /// Mean of the root mean square errors of the runs, µm.
    pub mean_rmse_um: f64,
    /// Share of the runs in which the range of the residual error is larger than without compensation.
    pub worse_share: f64,
}

impl Means {
    /// Returns the means of the residual errors of these runs.
    pub(super) fn of<'a>(runs: impl IntoIterator<Item = &'a RunScore>) -> Means {
        Means::over(runs.into_iter().map(|run| (run.range_um, run.rmse_um, run.is_worse())))
    }

    /// Returns the means of the residual errors without the corrections of the simulated probe. They are compared with
    /// the results of stand-ins, which are also tested without a probe.
    pub(super) fn unprobed(held_out: &[HeldOut]) -> Means {
        Means::over(held_out.iter().map(|held| {
            let left = held.residual(None);
            let range = range(&left);
            (range, rms(&left), range > held.score.uncompensated_range_um)
        }))
    }

    /// Returns the means of the errors without compensation of these runs.
    pub(super) fn uncompensated(runs: &[RunScore]) -> Means {
        Means::over(runs.iter().map(|run| (run.uncompensated_range_um, run.uncompensated_rmse_um, false)))
    }

    /// Returns the means over several runs. Each item of `scores` contains the range, the root mean square, and whether
    /// the run is worse than without compensation.
    fn over(scores: impl Iterator<Item = (f64, f64, bool)>) -> Means {
        let scores: Vec<(f64, f64, bool)> = scores.collect();
        // Without runs, the means are NaN.
        let runs = count(scores.len());
        Means {
            mean_range_um: scores.iter().map(|score| score.0).sum::<f64>() / runs,
            worst_range_um: scores.iter().map(|score| score.0).fold(f64::NAN, f64::max),
            mean_rmse_um: scores.iter().map(|score| score.1).sum::<f64>() / runs,
            worse_share: count(scores.iter().filter(|score| score.2).count()) / runs,
        }
    }
}

/// Run that was held out of the identification. For each row, it contains the measured error and the Cz of the model.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// Score of the run: range and root mean square of its errors.
    pub score: RunScore,
    /// Number of the averaging window of each row.
    pub(crate) windows: Vec<u128>,
    /// Time of each row, s since the run's first row.
    pub seconds: Vec<f64>,
    /// Measured error e in each row, µm, counted from its cold value.
    pub error: Vec<f64>,
    /// Cz that the model would have added in each row, µm.
    pub cz: Vec<f64>,
    /// Model that was identified from all other runs.
    pub learned: Learned,
}

impl HeldOut {
    /// Returns whether the run was measured by touches of a probe.
    pub(crate) fn is_touched(&self) -> bool {
        self.score.touches.is_some()
    }

    /// Returns the residual error in each log row: e + Cz. `probe` is the interval of a simulated probe, s; `None` for
    /// no probe. With a probe, the residual at the last probing is subtracted.
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
            // The references are zero at the start: the first touch is at the zero point of the error, so its residual
            // is zero.
            last = (window, if last.0.is_finite() { left } else { 0.0 });
        }
        left - last.1
    };
    left.zip(seconds).map(&mut since_probing).collect()
}

/// For each run, calls `held` with the run and the list of all other runs. The calls run in parallel; the results are
/// in the order of the runs.
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

/// For each run, identifies a model from all other runs, and tests the model on this run. If `probe` is set, a
/// simulated probe measures and removes the residual at this interval, in s. If the repair of a faulty sensor used data
/// of the held-out run, the learner is prepared again without these data. `settings` contains the settings of the
/// learner.
///
/// Returns for each list of inputs in `without` the results of all runs with models without these inputs. If the method
/// requires one of these inputs, the result for this list is an error message.
pub(super) fn leave_one_run_out(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    settings: &Settings,
    without: &[Vec<usize>],
    probe: Option<f64>,
    progress: Progress<'_>,
) -> Vec<Result<Vec<HeldOut>, String>> {
    let assess =
        |campaign: &Campaign<'_>, learner: &dyn Learner, out: usize, others: &[usize], without: &[usize]| {
            let learned = learner.learn(others, without)?;
            let run = &learner.bank().runs[out];
            let (error, cz) = (run.error(), learned.predict(campaign, learner.bank(), out));
            let (windows, seconds) = (run.windows.clone(), run.seconds.clone());
            let score = RunScore::new(&run.name, &error, &residual(&seconds, &error, &cz, probe));
            let score = score.over(campaign.touches(out, error.len()));
            Ok(HeldOut { score, windows, seconds, error, cz, learned })
        };
    let each = |campaign: &Campaign<'_>, learner: &dyn Learner, out: usize, others: &[usize]| {
        without.iter().map(|without| assess(campaign, learner, out, others, without)).collect::<Vec<_>>()
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
