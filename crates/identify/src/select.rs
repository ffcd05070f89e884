//! Which temperature points to keep, without a profile.
//!
//! ```text
//! dataset ── points ── bank ──┬─ alike      correlation with the error and with each other, groups
//!                             ├─ grey       grey relational grades
//!                             ├─ steps      stepwise order by partial F tests
//!                             └─ counted    held-out error over how many points are kept
//! ```
//! Correlation, groups and their thresholds 0.9 and 0.7 as Tachiya et al. 2013 choose points; grey relation after Deng
//! 1982. The recommendation comes from runs that were left out alone.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Serialize;

use crate::alike::{correlations, groups};
use crate::ambient::AmbientLike;
use crate::bank::Bank;
use crate::faults::Excluded;
use crate::validate::RunScore;

mod counted;
mod grey;
mod points;
mod steps;

pub use counted::Counted;
pub use points::{Choice, Pointed, points};
pub use steps::{Step, Steps};

/// What the points are worth. Serialized, it is the JSON of `select`.
#[derive(Clone, Debug, Serialize)]
pub struct Selected {
    /// The column with the measured error.
    pub error: String,
    /// Each run as it is, and held out with the recommended points.
    pub runs: Vec<RunScore>,
    /// The points, most correlated with the error first.
    pub points: Vec<Point>,
    /// Correlations of the points with each other, in the order of `points`.
    pub mutual: Vec<Vec<f64>>,
    /// Groups by each threshold.
    pub groups: Vec<Grouped>,
    /// By partial F tests.
    pub stepwise: Steps,
    /// Held out, by how many points are kept, from none on.
    pub by_count: Vec<Counted>,
    /// Held out with every point.
    pub all_points: Counted,
    /// The fewest points whose mean range and root mean square (their geometric mean) are at most a tenth above the best of
    /// `by_count`.
    pub recommended: Recommended,
    /// Sensors left out, with the reason.
    pub excluded: Vec<Excluded>,
    /// Points that behave like the air, with the reason.
    pub ambient: Vec<AmbientLike>,
    /// What is odd.
    pub remarks: Vec<String>,
}

/// A point and its figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// The column.
    pub name: String,
    /// Correlation of its rise with the error.
    pub correlation: f64,
    /// Grey relational grade, 0 to 1.
    pub grey_grade: f64,
    /// The largest rise or fall in any run, °C.
    pub moved: f64,
}

/// Groups of which every two members are correlated at least so.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Grouped {
    /// The threshold.
    pub correlation: f64,
    /// Members by name, the one most correlated with the error first: it stands for the others.
    pub groups: Vec<Vec<String>>,
}

/// Which points to keep.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Recommended {
    /// How many.
    pub k: usize,
    /// Which, in the order in which they came in.
    pub points: Vec<String>,
    /// For each, in how many of the held-out fits it was chosen too.
    pub chosen_in: BTreeMap<String, usize>,
    /// For each, those of its first group, which could stand in for it.
    pub alike: BTreeMap<String, Vec<String>>,
    /// In one sentence.
    pub why: String,
}

/// What is tried.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Thresholds of the groups.
    pub groups: Vec<f64>,
    /// Time constants through which each point is looked at.
    pub lags: Vec<Option<Duration>>,
    /// Most points of `by_count`.
    pub most: usize,
    /// Rows closer than this count as one sample in F tests.
    pub independent: Duration,
}

/// A time constant or none.
type Lags = [Option<Duration>; 4];

/// None, 6, 25 and 100 minutes.
pub const LAGS: Lags =
    [None, Some(Duration::from_secs(360)), Some(Duration::from_secs(1500)), Some(Duration::from_secs(6000))];

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            groups: vec![0.9, 0.7],
            lags: LAGS.to_vec(),
            most: 8,
            independent: Duration::from_secs(1800),
        }
    }
}

/// Looks at every point. `progress` is told what is done, out of how much.
///
/// # Errors
/// A sentence that says what to do.
pub fn select(
    pointed: &Pointed<'_>,
    settings: &Settings,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Selected, String> {
    let campaign = &pointed.campaign;
    let mut lags = settings.lags.clone();
    if !lags.contains(&None) {
        lags.insert(0, None);
    }
    let bank = Bank::of(campaign, &lags);
    if let Some(run) = bank.runs.iter().find(|run| run.wanted.is_empty()) {
        return Err(format!(
            "{} has no row in which the error and every point are there: leave it out, or leave the point out that is \
             missing with --without",
            run.name
        ));
    }
    let count = campaign.inputs.len();
    let all: Vec<usize> = (0..count).collect();
    let between = correlations(&bank, &all);
    let mut order = all.clone();
    order.sort_by(|one, other| between[*other][count].abs().total_cmp(&between[*one][count].abs()));
    let grades = grey::grades(&bank, &all, &between);
    let name = |point: &usize| campaign.inputs[*point].name.clone();
    let grouped = |least: &f64| Grouped {
        correlation: *least,
        groups: groups(&between, count, *least)
            .into_iter()
            .map(|group| named(group, &between, &name))
            .collect(),
    };
    let grouped: Vec<Grouped> = settings.groups.iter().map(grouped).collect();
    let rows_per_sample = (settings.independent.as_secs_f64() / campaign.row_seconds()).max(1.0);
    let stepwise = steps::steps(&bank, rows_per_sample, &name);
    let found = counted::counted(campaign, &bank, settings.most, progress);
    let alike = found.recommended(&grouped, &name);
    let points = order.iter().map(|point| Point {
        name: name(point),
        correlation: between[*point][count],
        grey_grade: grades[*point],
        moved: points::moved(&bank, *point),
    });
    Ok(Selected {
        error: campaign.dataset.columns[campaign.error].name.clone(),
        runs: found.scores(alike.k),
        points: points.collect(),
        mutual: order.iter().map(|one| order.iter().map(|other| between[*one][*other]).collect()).collect(),
        groups: grouped,
        stepwise,
        by_count: found.table(&name),
        all_points: found.all_points(&name),
        recommended: alike,
        excluded: pointed.excluded.clone(),
        ambient: pointed.ambient.clone(),
        remarks: pointed.remarks.clone(),
    })
}

/// By name, the one most correlated with the error first.
fn named(mut group: Vec<usize>, between: &[Vec<f64>], name: &dyn Fn(&usize) -> String) -> Vec<String> {
    let error = between.len() - 1;
    group.sort_by(|one, other| between[*other][error].abs().total_cmp(&between[*one][error].abs()));
    group.iter().map(name).collect()
}

#[cfg(test)]
mod tests;
