//! Leave one run out, never rows: neighbouring minutes are not independent.

use crate::campaign::Campaign;
use crate::learn::{Learned, Learner};
use crate::method::Settings;
use crate::statistics::{percentile_95, range, rms};
use rayon::prelude::*;

/// How a run fared that the model never saw.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
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
}

/// One held-out run, row by row.
#[derive(Clone, Debug)]
pub struct HeldOut {
    /// How it fared.
    pub score: RunScore,
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
    /// What is left, row by row: e + Cz, since the last probing where there is one.
    pub fn residual(&self, probe: Option<f64>) -> Vec<f64> {
        let left: Vec<f64> = self.error.iter().zip(&self.cz).map(|(error, cz)| error + cz).collect();
        match probe {
            Some(interval) => since_probing(&self.seconds, &left, interval),
            None => left,
        }
    }
}

/// Learns once for each run from all the others, and judges on that run. With `probe`, the residual is measured and
/// taken out at that interval, in seconds. Where a fault of another run was mended with a run's help, the method begins
/// anew without it: `settings` are those of the learner.
///
/// # Errors
/// What the method says.
pub fn leave_one_run_out(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    settings: &Settings,
    without: &[usize],
    probe: Option<f64>,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<HeldOut>, String> {
    let runs: Vec<usize> = (0..learner.bank().runs.len()).collect();
    let done = std::sync::atomic::AtomicUsize::new(0);
    let held = |out: &usize| {
        let others: Vec<usize> = runs.iter().copied().filter(|run| run != out).collect();
        let judged = match campaign.never_saw(*out) {
            None => judge(campaign, learner, learner.learn(&others, without)?, *out, probe),
            Some(blind) => {
                let learner = settings.method.prepare(&blind, settings)?;
                judge(&blind, learner.as_ref(), learner.learn(&others, without)?, *out, probe)
            }
        };
        progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, runs.len());
        Ok(judged)
    };
    // In their order, so that what is wrong with the first of them is what is said.
    let judged: Vec<_> = runs.par_iter().map(held).collect();
    judged.into_iter().collect()
}

/// A model over one run.
pub fn judge(
    campaign: &Campaign<'_>,
    learner: &dyn Learner,
    learned: Learned,
    run: usize,
    probe: Option<f64>,
) -> HeldOut {
    let traced = &learner.bank().runs[run];
    let error: Vec<f64> = traced.wanted.iter().map(|wanted| -wanted).collect();
    let (uncompensated_range_um, uncompensated_rmse_um) = (range(&error), rms(&error));
    let score = RunScore {
        name: traced.name.clone(),
        range_um: 0.0,
        rmse_um: 0.0,
        p95_um: 0.0,
        uncompensated_range_um,
        uncompensated_rmse_um,
        range_cut_percent: None,
    };
    let seconds = traced.seconds.clone();
    let cz = learned.predict(campaign, learner.bank(), run);
    let mut held = HeldOut { score, seconds, error, cz, learned };
    let left = held.residual(probe);
    held.score.range_um = range(&left);
    held.score.range_cut_percent = cut(held.score.range_um, uncompensated_range_um);
    held.score.rmse_um = rms(&left);
    held.score.p95_um = percentile_95(&left);
    held
}

/// The figures of a run without compensation, and with what is left.
pub(super) fn scored(name: &str, error: &[f64], left: &[f64]) -> RunScore {
    RunScore {
        name: name.to_owned(),
        range_um: range(left),
        rmse_um: rms(left),
        p95_um: percentile_95(left),
        uncompensated_range_um: range(error),
        uncompensated_rmse_um: rms(error),
        range_cut_percent: cut(range(left), range(error)),
    }
}

fn cut(left: f64, bare: f64) -> Option<f64> {
    (bare > 0.0).then(|| 100.0 * (1.0 - left / bare))
}

/// At each multiple of the interval the residual is touched by a probe, and from there on only what changed counts.
fn since_probing(seconds: &[f64], left: &[f64], interval: f64) -> Vec<f64> {
    let mut last = (f64::NEG_INFINITY, 0.0);
    let mut at = |(second, left): (&f64, &f64)| {
        let window = (second / interval).floor();
        if window > last.0 {
            // The references begin at zero: the first touch is the datum itself.
            last = (window, if last.0.is_finite() { *left } else { 0.0 });
        }
        left - last.1
    };
    seconds.iter().zip(left).map(&mut at).collect()
}
