//! How much is left on a run that was held out, by how many points are kept.
//!
//! For each run the points are chosen anew from all the other runs, one after the other: the one comes in whose rises,
//! through every lag, make the error smallest on runs left out within those. So the curve has seen nothing of the run
//! that it is judged on.

use nalgebra::DVector;
use serde::Serialize;

use super::{Grouped, Recommended};
use crate::bank::Bank;
use crate::folds::{Fold, inner_or_itself};
use crate::gram::Gram;
use crate::solve::ridge;
use crate::statistics::smallest;
use crate::validate::{Means, Progress, RunScore, hold_out_each};

/// Held out, with so many points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Counted {
    /// How many points.
    pub k: usize,
    /// Which, chosen on all runs.
    pub points: Vec<String>,
    /// How they fared.
    #[serde(flatten)]
    pub means: Means,
}

/// While points are chosen.
const PENALTY: f64 = 0.1;
/// Of the model at the end: the one that does best on inner runs.
const PENALTIES: [f64; 4] = [0.01, 0.1, 0.3, 1.0];
/// Differences under a tenth mean nothing: runs are few.
const AS_GOOD: f64 = 1.1;

/// Everything that was held out.
pub(super) struct Counts {
    /// In the order in which points came in, over all runs.
    path: Vec<usize>,
    /// By run: the order over all the others; and its scores by count, the last with every point.
    held_out: Vec<(Vec<usize>, Vec<RunScore>)>,
    /// One row for each count, from none on.
    pub(super) table: Vec<Counted>,
    /// The row of every point.
    pub(super) all_points: Counted,
}

/// Keeps none to `most` of these points, and all.
pub(super) fn counted(
    bank: &Bank,
    points: usize,
    most: usize,
    name: &dyn Fn(usize) -> String,
    progress: Progress<'_>,
) -> Counts {
    let grams = bank.grams();
    let most = most.min(points);
    let every: Vec<usize> = (0..points).collect();
    let held_out = hold_out_each(grams.len(), progress, |out, others| {
        let folds = inner_or_itself(&grams, others);
        let path = path(bank, &folds, points, most);
        let all = Gram::sum(&grams, others);
        let score = |points: &[usize]| score(bank, &all, &folds, out, points);
        let scores: Vec<RunScore> = (0..=most).map(|k| score(&path[..k])).chain([score(&every)]).collect();
        (path, scores)
    });
    let runs: Vec<usize> = (0..grams.len()).collect();
    let path = path(bank, &inner_or_itself(&grams, &runs), points, most);
    let row = |place: usize, points: &[usize]| Counted {
        k: points.len(),
        points: points.iter().map(|point| name(*point)).collect(),
        means: Means::of(held_out.iter().filter_map(|(_, scores)| scores.get(place))),
    };
    let table = (0..=path.len()).map(|k| row(k, &path[..k])).collect();
    let all_points = row(path.len() + 1, &every);
    Counts { path, held_out, table, all_points }
}

fn columns(bank: &Bank, points: &[usize]) -> Vec<usize> {
    let candidates = bank.candidates.iter().enumerate();
    candidates.filter(|(_, candidate)| points.contains(&candidate.input)).map(|(column, _)| column).collect()
}

/// What is left on the inner runs with these columns.
fn left(folds: &[Fold], columns: &[usize], penalty: f64) -> f64 {
    let of_fold = |fold: &Fold| fold.held.of_columns(columns).left(&ridge(&fold.training, columns, penalty));
    folds.iter().map(of_fold).sum()
}

fn path(bank: &Bank, folds: &[Fold], points: usize, most: usize) -> Vec<usize> {
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < most {
        let outside = (0..points).filter(|point| !chosen.contains(point));
        let tried = outside.map(|point| {
            let with = [chosen.as_slice(), &[point]].concat();
            (left(folds, &columns(bank, &with), PENALTY), point)
        });
        let Some((_, point)) = tried.min_by(|one, other| one.0.total_cmp(&other.0)) else { break };
        chosen.push(point);
    }
    chosen
}

fn score(bank: &Bank, all: &Gram, folds: &[Fold], out: usize, points: &[usize]) -> RunScore {
    let run = &bank.runs[out];
    let columns = columns(bank, points);
    let mut cz = DVector::zeros(run.target.len());
    if !columns.is_empty() {
        let costs: Vec<f64> = PENALTIES.iter().map(|penalty| left(folds, &columns, *penalty)).collect();
        let gains = ridge(all, &columns, PENALTIES[smallest(&costs)]);
        for (column, gain) in columns.iter().zip(gains.iter()) {
            cz.axpy(*gain, &run.rises.column(*column), 1.0);
        }
    }
    RunScore::new(&run.name, &run.error(), (cz - &run.target).as_slice())
}

impl Counts {
    /// Each run held out, with so many points.
    pub(super) fn scores(&self, k: usize) -> Vec<RunScore> {
        self.held_out.iter().filter_map(|(_, scores)| scores.get(k).cloned()).collect()
    }

    /// The fewest that are as good as the best.
    pub(super) fn recommended(&self, groups: &[Grouped], name: &dyn Fn(usize) -> String) -> Recommended {
        let size = |row: &Counted| (row.means.mean_range_um * row.means.mean_rmse_um).sqrt();
        let sizes: Vec<f64> = self.table.iter().map(size).collect();
        let best = smallest(&sizes);
        let k = sizes.iter().position(|size| *size <= AS_GOOD * sizes[best]).unwrap_or(0);
        let range = |row: usize| self.table[row].means.mean_range_um;
        let most = self.path.len();
        let why = if k == 0 {
            format!(
                "no choice of up to {most} points is clearly better on a run that was held out than no compensation: a mean \
                 range of {:.2} µm at best, {:.2} µm uncompensated; record more runs, or points nearer to the heat",
                range(best),
                range(0)
            )
        } else {
            let points = if k == 1 { "1 point leaves".to_owned() } else { format!("{k} points leave") };
            format!(
                "{points} a mean range of {:.2} µm on runs that were held out, {:.2} µm without compensation; no more \
                 than a tenth is to be had from up to {most} points, and a tenth means nothing: runs are few",
                range(k),
                range(0)
            )
        };
        let chosen_in =
            |point: usize| self.held_out.iter().filter(|(path, _)| path[..k].contains(&point)).count();
        let alike = |own: &String| {
            let group =
                groups.first().and_then(|first| first.groups.iter().find(|group| group.contains(own)));
            group.into_iter().flatten().filter(|other| *other != own).cloned().collect()
        };
        let points = &self.table[k].points;
        Recommended {
            k,
            points: points.clone(),
            chosen_in: self.path[..k].iter().map(|point| (name(*point), chosen_in(*point))).collect(),
            alike: points.iter().map(|point| (point.clone(), alike(point))).collect(),
            why,
        }
    }
}
