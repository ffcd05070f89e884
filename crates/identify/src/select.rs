//! Selection of temperature measuring points from logs, without a profile.
//!
//! ```text
//! dataset ── points ── bank ──┬─ similarity     correlation with the error and with each other, groups
//!                             ├─ grey           grey relational grades
//!                             ├─ steps          stepwise order by partial F tests
//!                             └─ point_counts   held-out error by the number of points
//! ```
//! Correlation, groups and their thresholds 0.9 and 0.7 follow Tachiya et al. 2013, grey relation follows Deng 1982.
//! The recommendation depends on held-out runs only. A held-out run is not used to identify the model that is tested on
//! it. The rise of a point is its temperature minus its reference value.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Serialize;

use crate::bank::{Bank, Traced};
use crate::faults::Notes;
use crate::similarity::{correlations, groups};
use crate::statistics::range;
use crate::validate::{Progress, RunScore};

mod grey;
mod point_counts;
mod points;
mod steps;

pub use point_counts::Counted;
pub(crate) use point_counts::point_counts;
pub use points::{Pointed, points, without_incomplete};
pub use steps::{Step, Steps};

/// Result of the assessment of all measuring points. In JSON, this structure is the output of `isotherm select`.
#[derive(Clone, Debug, Serialize)]
pub struct Selected {
    /// Name of the log column with the measured error.
    pub error: String,
    /// Result of each run: its error without compensation, and its residual error as a held-out run with the
    /// recommended points.
    pub runs: Vec<RunScore>,
    /// Measuring points, sorted by the absolute correlation with the error, the strongest first.
    pub points: Vec<Point>,
    /// Correlation of each two measuring points. Rows and columns are in the order of `points`.
    pub mutual: Vec<Vec<f64>>,
    /// Groups of similar points, for each threshold of the correlation.
    pub groups: Vec<Grouped>,
    /// Result of the stepwise selection by partial F tests.
    pub stepwise: Steps,
    /// Result on the held-out runs for each number of points, beginning with zero points.
    pub by_count: Vec<Counted>,
    /// Result of the model with all points on the held-out runs.
    pub all_points: Counted,
    /// Recommended points: the smallest number of points whose result is at most 1.1 times the best result in
    /// `by_count`. This result is the geometric mean of the mean range and the mean root mean square.
    pub recommended: Recommended,
    /// Remarks about the points and the logs.
    #[serde(flatten)]
    pub notes: Notes,
}

/// Measuring point (temperature column) with the results of its assessment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Name of the log column.
    pub name: String,
    /// Correlation of the rise of the point with the error, −1 to 1.
    pub correlation: f64,
    /// Grey relational grade of the point, 0 to 1.
    pub grey_grade: f64,
    /// Largest range (maximum minus minimum) of the temperature rise at the point in any run, °C.
    pub moved: f64,
}

/// Groups of similar points for one threshold. Any two points of a group have at least the absolute correlation
/// `correlation`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Grouped {
    /// Threshold: minimum absolute correlation between any two points of a group.
    pub correlation: f64,
    /// Names of the points of each group. The first point has the strongest correlation with the error, and represents
    /// the group.
    pub groups: Vec<Vec<String>>,
}

/// Recommended measuring points, and the reason for the recommendation.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Recommended {
    /// Number of recommended points.
    pub k: usize,
    /// Recommended points, in the order in which the search added them.
    pub points: Vec<String>,
    /// For each recommended point: number of held-out fits that also selected this point.
    pub chosen_in: BTreeMap<String, usize>,
    /// For each recommended point: the other points of its group at the first threshold. Each of them could replace the
    /// point.
    pub alike: BTreeMap<String, Vec<String>>,
    /// Reason for the recommendation, in one sentence.
    pub why: String,
}

/// Settings of the selection of points.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Thresholds for groups of similar points: minimum absolute correlation between any two points of a group.
    pub groups: Vec<f64>,
    /// Time constants of the lags through which each point is used; `None` means no lag.
    pub lags: Vec<Option<Duration>>,
    /// Maximum number of points for which the held-out result is calculated.
    pub most: usize,
    /// Minimum time between two rows that count as independent samples in the F tests.
    pub independent: Duration,
}

/// Default time constants of the lags: none (no lag), 6, 25 and 100 minutes.
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

/// Assesses every temperature measuring point, and recommends some points.
///
/// # Errors
/// A run has no complete row. The message says what to do.
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
    // The member with the strongest correlation with the error is first, and represents the group.
    let named = |mut group: Vec<usize>| {
        group.sort_by(by_error);
        group.into_iter().map(name).collect()
    };
    let grouped = settings.groups.iter().map(|least| Grouped {
        correlation: *least,
        groups: groups(&between, count, *least).into_iter().map(named).collect(),
    });
    let grouped: Vec<Grouped> = grouped.collect();
    let counts = point_counts::point_counts(campaign, &bank, &all, settings.most, progress);
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
