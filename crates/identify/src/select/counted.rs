//! How much is left on a run that was held out, by how many points are kept.
//!
//! For each run the points are chosen anew from all the other runs, one after the other: the one comes in whose rises,
//! through every lag, make the error smallest on runs left out within those. So the curve has seen nothing of the run
//! that it is judged on.

use rayon::prelude::*;
use serde::Serialize;

use super::{Grouped, Recommended};
use crate::bank::Bank;
use crate::campaign::Campaign;
use crate::folds::inner;
use crate::gram::Gram;
use crate::solve::ridge;
use crate::statistics::{count, smallest};
use crate::validate::{RunScore, scored};

/// Held out, with so many points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Counted {
    /// How many points.
    pub k: usize,
    /// Which, chosen on all runs.
    pub points: Vec<String>,
    /// Mean range over the runs, µm.
    pub mean_range_um: f64,
    /// The worst run's range, µm.
    pub worst_range_um: f64,
    /// Mean over the runs of the root mean square, µm.
    pub mean_rmse_um: f64,
}

/// While points are chosen.
const PENALTY: f64 = 0.1;
/// Of the model at the end: the one that does best on inner runs.
const PENALTIES: [f64; 4] = [0.01, 0.1, 0.3, 1.0];
/// Differences under a tenth mean nothing: runs are few.
const AS_GOOD: f64 = 1.1;

/// Everything that was held out.
pub(super) struct Found {
    /// How many there are.
    points: usize,
    /// In the order in which points came in, over all runs.
    path: Vec<usize>,
    /// By run: the order over all the others.
    paths: Vec<Vec<usize>>,
    /// By run, by count, and last with every point.
    scores: Vec<Vec<RunScore>>,
}

/// Keeps none to `most` points, and all.
pub(super) fn counted(
    campaign: &Campaign<'_>,
    bank: &Bank,
    most: usize,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Found {
    let grams = bank.grams();
    let runs: Vec<usize> = (0..grams.len()).collect();
    let points = campaign.inputs.len();
    let most = most.min(points);
    let done = std::sync::atomic::AtomicUsize::new(0);
    let held = |out: &usize| {
        let others: Vec<usize> = runs.iter().copied().filter(|run| run != out).collect();
        let path = path(bank, &grams, &others, points, most);
        let counts = (0..=most).map(|k| path[..k].to_vec());
        let score = |points: Vec<usize>| score(bank, &grams, &others, *out, &points);
        let scores: Vec<RunScore> = counts.chain([(0..points).collect()]).map(score).collect();
        progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, runs.len());
        (path, scores)
    };
    let (paths, scores) = runs.par_iter().map(held).unzip();
    Found { points, path: path(bank, &grams, &runs, points, most), paths, scores }
}

fn columns(bank: &Bank, points: &[usize]) -> Vec<usize> {
    let candidates = bank.candidates.iter().enumerate();
    candidates.filter(|(_, candidate)| points.contains(&candidate.input)).map(|(column, _)| column).collect()
}

/// What is left on the inner runs with these columns.
fn left(folds: &[(Gram, Gram)], columns: &[usize], penalty: f64) -> f64 {
    let of_fold =
        |(training, held): &(Gram, Gram)| held.of_columns(columns).left(&ridge(training, columns, penalty));
    folds.iter().map(of_fold).sum()
}

fn folds(grams: &[Gram], runs: &[usize]) -> Vec<(Gram, Gram)> {
    let folds = inner(grams, runs);
    if folds.is_empty() {
        // One run alone judges itself.
        let sum = Gram::sum(grams, runs);
        return vec![(sum.clone(), sum)];
    }
    folds.into_iter().map(|(training, fold)| (training, Gram::sum(grams, &fold))).collect()
}

fn path(bank: &Bank, grams: &[Gram], runs: &[usize], points: usize, most: usize) -> Vec<usize> {
    let folds = folds(grams, runs);
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < most {
        let outside = (0..points).filter(|point| !chosen.contains(point));
        let tried = outside.map(|point| {
            let with: Vec<usize> = chosen.iter().copied().chain([point]).collect();
            (left(&folds, &columns(bank, &with), PENALTY), point)
        });
        let Some((_, point)) = tried.min_by(|one, other| one.0.total_cmp(&other.0)) else { break };
        chosen.push(point);
    }
    chosen
}

fn score(bank: &Bank, grams: &[Gram], others: &[usize], out: usize, points: &[usize]) -> RunScore {
    let run = &bank.runs[out];
    let columns = columns(bank, points);
    let mut cz = vec![0.0; run.wanted.len()];
    if !columns.is_empty() {
        let folds = folds(grams, others);
        let costs: Vec<f64> = PENALTIES.iter().map(|penalty| left(&folds, &columns, *penalty)).collect();
        let gains = ridge(&Gram::sum(grams, others), &columns, PENALTIES[smallest(&costs)]);
        for (column, gain) in columns.iter().zip(gains.iter()) {
            cz.iter_mut().zip(run.rises.column(*column).iter()).for_each(|(cz, rise)| *cz += gain * rise);
        }
    }
    let error: Vec<f64> = run.wanted.iter().map(|wanted| -wanted).collect();
    let residual: Vec<f64> = error.iter().zip(&cz).map(|(error, cz)| error + cz).collect();
    scored(&run.name, &error, &residual)
}

impl Found {
    fn at(&self, place: usize, points: Vec<String>) -> Counted {
        let scores = || self.scores.iter().filter_map(|run| run.get(place));
        let runs = count(self.scores.len()).max(1.0);
        Counted {
            k: points.len(),
            points,
            mean_range_um: scores().map(|score| score.range_um).sum::<f64>() / runs,
            worst_range_um: scores().map(|score| score.range_um).fold(0.0, f64::max),
            mean_rmse_um: scores().map(|score| score.rmse_um).sum::<f64>() / runs,
        }
    }

    /// One row for each count.
    pub(super) fn table(&self, name: &dyn Fn(&usize) -> String) -> Vec<Counted> {
        (0..=self.path.len()).map(|k| self.at(k, self.path[..k].iter().map(name).collect())).collect()
    }

    /// The row of every point.
    pub(super) fn all_points(&self, name: &dyn Fn(&usize) -> String) -> Counted {
        self.at(self.path.len() + 1, (0..self.points).map(|point| name(&point)).collect())
    }

    /// Each run held out, with so many points.
    pub(super) fn scores(&self, k: usize) -> Vec<RunScore> {
        self.scores.iter().filter_map(|run| run.get(k).cloned()).collect()
    }

    /// The fewest that are as good as the best.
    pub(super) fn recommended(&self, groups: &[Grouped], name: &dyn Fn(&usize) -> String) -> Recommended {
        let table = self.table(name);
        let size = |row: &Counted| (row.mean_range_um * row.mean_rmse_um).sqrt();
        let least = table.iter().map(size).fold(f64::MAX, f64::min);
        let k = table.iter().position(|row| size(row) <= AS_GOOD * least).unwrap_or(0);
        let Some(best) = table.iter().min_by(|one, other| size(one).total_cmp(&size(other))) else {
            return Recommended::default();
        };
        let (row, bare) = (&table[k], &table[0]);
        let why = if k == 0 {
            format!(
                "no choice of up to {} points is clearly better on a run that was held out than no compensation: a mean \
                 range of {:.2} µm at best, {:.2} µm bare; record more runs, or points nearer to the heat",
                self.path.len(),
                best.mean_range_um,
                bare.mean_range_um
            )
        } else {
            let points = if k == 1 { "1 point leaves".to_owned() } else { format!("{k} points leave") };
            format!(
                "{points} a mean range of {:.2} µm on runs that were held out, {:.2} µm without compensation; no more \
                 than a tenth is to be had from up to {} points, and a tenth means nothing: runs are few",
                row.mean_range_um,
                bare.mean_range_um,
                self.path.len()
            )
        };
        let kept = &self.path[..k];
        let chosen_in = |point: &usize| self.paths.iter().filter(|path| path[..k].contains(point)).count();
        let alike = |point: &usize| {
            let own = name(point);
            let group =
                groups.first().and_then(|first| first.groups.iter().find(|group| group.contains(&own)));
            let others = group.into_iter().flatten().filter(|other| **other != own);
            (own.clone(), others.cloned().collect())
        };
        Recommended {
            k,
            points: row.points.clone(),
            chosen_in: kept.iter().map(|point| (name(point), chosen_in(point))).collect(),
            alike: kept.iter().map(alike).collect(),
            why,
        }
    }
}
