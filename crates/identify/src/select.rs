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
use crate::bank::{Bank, Traced};
use crate::faults::Notes;
use crate::statistics::range;
use crate::validate::{Progress, RunScore};

mod counted;
mod grey;
mod points;
mod steps;

pub use counted::Counted;
pub(crate) use counted::counted;
pub use points::{Pointed, points};
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
    /// What is odd about the points and the logs.
    #[serde(flatten)]
    pub notes: Notes,
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

/// Time constants that are usual: none, 6, 25 and 100 minutes.
const LAGS: [Option<Duration>; 4] =
    [None, Some(Duration::from_mins(6)), Some(Duration::from_mins(25)), Some(Duration::from_mins(100))];

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

/// Looks at every point.
///
/// # Errors
/// A sentence that says what to do.
pub fn select(
    pointed: &Pointed<'_>,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Selected, String> {
    let campaign = &pointed.campaign;
    let mut lags = settings.lags.clone();
    if !lags.contains(&None) {
        lags.insert(0, None);
    }
    let bank = Bank::of(campaign, &lags);
    bank.check_rows("every point", "the point")?;
    let count = campaign.inputs.len();
    let all: Vec<usize> = (0..count).collect();
    let between = correlations(&bank, &all);
    let by_error =
        |one: &usize, other: &usize| between[*other][count].abs().total_cmp(&between[*one][count].abs());
    let grades = grey::grades(&bank, &all, &between);
    let name = |point: usize| campaign.inputs[point].name.clone();
    // The one most correlated with the error first: it stands for the others.
    let named = |mut group: Vec<usize>| {
        group.sort_by(by_error);
        group.into_iter().map(name).collect()
    };
    let grouped = settings.groups.iter().map(|least| Grouped {
        correlation: *least,
        groups: groups(&between, count, *least).into_iter().map(named).collect(),
    });
    let grouped: Vec<Grouped> = grouped.collect();
    let counts = counted::counted(campaign, &bank, &all, settings.most, progress);
    let recommended = counts.recommended(&grouped, &name);
    let mut order = all;
    order.sort_by(by_error);
    let moved = |point: usize| {
        let of_run =
            |run: &Traced| bank.plain(point).map_or(0.0, |column| range(run.rises.column(column).iter()));
        bank.runs.iter().map(of_run).fold(0.0, f64::max)
    };
    let points = order.iter().map(|point| Point {
        name: name(*point),
        correlation: between[*point][count],
        grey_grade: grades[*point],
        moved: moved(*point),
    });
    Ok(Selected {
        error: campaign.dataset.columns[campaign.error].name.clone(),
        runs: counts.scores(recommended.k),
        points: points.collect(),
        mutual: order.iter().map(|one| order.iter().map(|other| between[*one][*other]).collect()).collect(),
        groups: grouped,
        stepwise: steps::steps(&bank, campaign.rows_per_sample(settings.independent), &name),
        by_count: counts.table,
        all_points: counts.all_points,
        recommended,
        notes: pointed.notes.clone(),
    })
}

#[cfg(test)]
mod tests;
