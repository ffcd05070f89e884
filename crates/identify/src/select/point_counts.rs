//! Residual error on held-out runs, for each number of measuring points in the model.
//!
//! For each held-out run, the points are selected again with the data of all other runs, one point after the other. For
//! each number of points, a model is identified by the method `whitened`. Therefore no result depends on the run on
//! which it is validated.

use nalgebra::DVector;
use serde::Serialize;

use super::{Grouped, Recommended};
use crate::bank::Bank;
use crate::campaign::Campaign;
use crate::method::whitened::fit;
use crate::products::Products;
use crate::sensors::Forward;
use crate::statistics::smallest;
use crate::validate::{Means, Progress, RunScore, hold_out_each};

/// Held-out result of models with one number of points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Counted {
    /// Number of points in the model.
    pub k: usize,
    /// Names of the points, which were selected on all runs.
    pub points: Vec<String>,
    /// Means of the held-out results over all runs.
    #[serde(flatten)]
    pub means: Means,
}

/// Maximum ratio of a result to the best result. Up to this ratio, the result counts as equally good, because smaller
/// differences are not significant with few runs.
const AS_GOOD: f64 = 1.1;

/// Results of all held-out runs for each number of points.
pub(crate) struct Counts {
    /// Points in the order in which the search over all runs adds them.
    path: Vec<usize>,
    /// For each held-out run: the points in the order in which the search over the other runs adds them, and one score
    /// for each number of points. The last score is with all points.
    held_out: Vec<(Vec<usize>, Vec<RunScore>)>,
    /// Result for each number of points, beginning with zero points.
    pub(crate) table: Vec<Counted>,
    /// Result of the model with all points.
    pub(crate) all_points: Counted,
}

/// Validates the model with 0 to `most` of these points, and with all of them.
pub(crate) fn point_counts(
    campaign: &Campaign<'_>,
    bank: &Bank,
    points: &[usize],
    most: usize,
    progress: Progress<'_>,
) -> Counts {
    let name = |point: usize| campaign.inputs[point].name.clone();
    let (forward, products) = (Forward::new(campaign), Products::of(bank));
    let left_out: Vec<usize> = (0..campaign.inputs.len()).filter(|input| !points.contains(input)).collect();
    let most = most.min(points.len());
    let held_out = hold_out_each(bank.runs.len(), progress, |out, others| {
        let path = forward.path(others, &left_out, most);
        let score = |points: &[usize]| score(bank, &products, others, out, points);
        let scores: Vec<RunScore> = (0..=most).map(|k| score(&path[..k])).chain([score(points)]).collect();
        (path, scores)
    });
    let runs: Vec<usize> = (0..bank.runs.len()).collect();
    let path = forward.path(&runs, &left_out, most);
    let row = |place: usize, points: &[usize]| Counted {
        k: points.len(),
        points: points.iter().map(|point| name(*point)).collect(),
        means: Means::of(held_out.iter().filter_map(|(_, scores)| scores.get(place))),
    };
    let table = (0..=path.len()).map(|k| row(k, &path[..k])).collect();
    let all_points = row(path.len() + 1, points);
    Counts { path, held_out, table, all_points }
}

/// Returns the score of the held-out run `out` for a model with these points. The model always uses the speeds of the
/// spindle, because they are not measuring points.
fn score(bank: &Bank, products: &Products, others: &[usize], out: usize, points: &[usize]) -> RunScore {
    let run = &bank.runs[out];
    let may = |input: usize| points.contains(&input) || bank.is_speed[input];
    let candidates = bank.candidates.iter().enumerate().filter(|(_, candidate)| may(candidate.input));
    let columns: Vec<usize> = candidates.map(|(column, _)| column).collect();
    let mut cz = DVector::zeros(run.target.len());
    for (column, gain) in columns.iter().zip(fit(products, others, &columns, bank).gains) {
        cz.axpy(gain, &run.rises.column(*column), 1.0);
    }
    RunScore::new(&run.name, &run.error(), (cz - &run.target).as_slice())
}

impl Counts {
    /// Returns the score of each held-out run for `k` points.
    pub(super) fn scores(&self, k: usize) -> Vec<RunScore> {
        self.held_out.iter().filter_map(|(_, scores)| scores.get(k).cloned()).collect()
    }

    /// Recommends the smallest number of points whose result is not clearly worse than the best result.
    pub(super) fn recommended(&self, groups: &[Grouped], name: &dyn Fn(usize) -> String) -> Recommended {
        let size = |row: &Counted| (row.means.mean_range_um * row.means.mean_rmse_um).sqrt();
        let sizes: Vec<f64> = self.table.iter().map(size).collect();
        let best = smallest(&sizes);
        let k = sizes.iter().position(|size| *size <= AS_GOOD * sizes[best]).unwrap_or(0);
        let range = |row: usize| self.table[row].means.mean_range_um;
        let most = self.path.len();
        let why = if k == 0 {
            format!(
                "on held-out runs, no selection of up to {most} points is clearly better than no \
                 compensation. The smallest mean range is {:.2} µm; without compensation it is {:.2} µm. \
                 Record more runs, or points nearer to the heat sources",
                range(best),
                range(0)
            )
        } else {
            let points = if k == 1 { "1 point".to_owned() } else { format!("{k} points") };
            format!(
                "with {points}, the mean range of the residual error on held-out runs is {:.2} µm; without \
                 compensation, it is {:.2} µm. More points, up to {most}, improve this by at most 10 %, \
                 which is not significant with few runs",
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
