//! Rebuilds the readings of a faulty sensor from the other sensors, which are called its neighbours.
//!
//! The rebuilt reading is a sum of the neighbours' readings, with and without lags. Ridge regression fits the gains of
//! this sum on the donors and on the good rows of the same run. Donors are the runs in which the sensor and its
//! neighbours were good.
//!
//! To measure the error of this sum, the hours of the fault, counted from the start of the run, are hidden in
//! each donor in turn, and rebuilt. The lags and the ridge penalty with the smallest error are chosen. The
//! rebuilt readings are shifted so that they continue the good readings at both ends without a step.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::dataset::Dataset;
use crate::gram::Gram;
use crate::solve::ridge;
use crate::statistics::{count, median};

/// Time constants of the lags of the neighbours, s.
const LAGS: [f64; 4] = [180.0, 720.0, 3000.0, 12_000.0];
const RIDGES: [f64; 4] = [1e-2, 1e-3, 1e-4, 1e-5];
/// Ridge penalty for the correction of a step. This value has little effect, because the windows before and after the
/// step are short.
const STEP_RIDGE: f64 = 1e-3;
/// Time before and after the rebuilt readings over which the residuals of the prediction are averaged, s. The rebuilt
/// readings are shifted by this mean.
const TIE: f64 = 300.0;
/// Lengths of the window before and of the window after a step, min. The step is the difference of the mean
/// residuals (reading minus prediction) in the two windows.
const WINDOWS: [usize; 4] = [1, 3, 10, 30];
/// Minimum time between two used rows of the good runs, s.
const THIN: f64 = 60.0;
/// Minutes between the points of the good runs at which the estimate of a step is tested. The true step at these points
/// is zero, so each estimate is an error.
const EVERY: usize = 7;
/// Minimum distance of a tested point from both ends of its run, min.
const FROM_ENDS: usize = 10;

/// Prediction of the readings of one sensor from its neighbours. Donors are the runs in which all these sensors were
/// good.
pub(super) struct Likeness<'a> {
    dataset: &'a Dataset,
    column: usize,
    neighbours: Vec<usize>,
    /// Log rows of each donor (run in which all these sensors were good).
    tables: Vec<Table>,
    /// Gram products (X'X, X'y, y'y) of the rows of each donor.
    grams: Vec<Gram>,
}

/// Repaired readings of one sensor in one run.
pub(super) struct Replaced {
    /// Readings after the repair in each row of the run, °C.
    pub(super) values: Vec<f64>,
    /// Description of the repair for the operator.
    pub(super) message: String,
    /// Error of the same repair on good runs, as a root mean square, °C.
    pub(super) error: f64,
}

/// Rows of a run: the readings of the neighbours with and without lags (features), and the readings of the sensor.
struct Table {
    seconds: Vec<f64>,
    features: DMatrix<f64>,
    values: Vec<f64>,
}

/// Start and end of a time span, s. The end is excluded.
type Span = (f64, f64);

impl Likeness<'_> {
    pub(super) fn new<'a>(
        dataset: &'a Dataset,
        column: usize,
        neighbours: Vec<usize>,
        donors: &[usize],
    ) -> Likeness<'a> {
        let mut own = Likeness { dataset, column, neighbours, tables: Vec::new(), grams: Vec::new() };
        own.tables = donors.iter().map(|donor| own.table(*donor, THIN)).collect();
        own.grams = own.tables.iter().map(|table| table.gram(None)).collect();
        own
    }

    /// Rebuilds the readings in consecutive rows of a run from the neighbours. `None` if `rows` is empty.
    pub(super) fn rebuilt(&self, run: usize, rows: &[usize]) -> Option<Replaced> {
        let own = self.table(run, 0.0);
        let (first, last) = (*rows.first()?, *rows.last()?);
        let until = own.seconds.get(last + 1).copied().unwrap_or(f64::INFINITY);
        let hidden = (*own.seconds.get(first)?, until);
        let usual = || ((0..self.neighbours.len()).collect(), RIDGES[0], f64::NAN);
        let (columns, penalty, error) = self.choose(hidden).unwrap_or_else(usual);
        let sum = Gram::total(&[self.grams.as_slice(), &[own.gram(Some(hidden))]].concat());
        let gains = ridge(&sum, &columns, penalty);
        let scales = sum.scales();
        let mut says: Vec<(f64, usize)> =
            self.neighbours.iter().map(|neighbour| (0.0_f64, *neighbour)).collect();
        for (column, gain) in columns.iter().zip(gains.iter()) {
            says[column % self.neighbours.len()].0 += (gain * scales[*column]).abs();
        }
        says.sort_by(|one, other| other.0.total_cmp(&one.0));
        let mostly = says.iter().take(2).map(|(_, neighbour)| self.dataset.columns[*neighbour].name.as_str());
        let message = format!(
            "the constant readings were rebuilt, mostly from {}; in a test of this repair on good runs, the \
             error was ± {error:.2} °C",
            mostly.collect::<Vec<&str>>().join(" and ")
        );
        let mut values = self.dataset.runs[run].values[self.column].to_vec();
        let filled = own.filled(&columns, &gains, hidden);
        rows.iter().zip(filled).for_each(|(row, rebuilt)| values[*row] = rebuilt);
        Some(Replaced { values, message, error })
    }

    /// Returns the feature columns and the ridge penalty with the smallest error on the hidden hours of the donors.
    /// Also returns that error, °C. `None` if no donor has these hours.
    fn choose(&self, hidden: Span) -> Option<(Vec<usize>, f64, f64)> {
        let plain = self.neighbours.len();
        let widths: [Vec<usize>; 2] = [(0..plain).collect(), (0..plain * (1 + LAGS.len())).collect()];
        let fold = |(out, table): (usize, &Table)| {
            let mut grams = self.grams.clone();
            grams[out] = table.gram(Some(hidden));
            Gram::total(&grams)
        };
        let folds: Vec<Gram> = self.tables.iter().enumerate().map(fold).collect();
        let mut best: Option<(Vec<usize>, f64, f64)> = None;
        for columns in widths {
            for penalty in RIDGES {
                let (mut square, mut rows) = (0.0, 0.0);
                for (table, fold) in self.tables.iter().zip(&folds).filter(|(_, fold)| fold.rows >= 1.0) {
                    let filled = table.filled(&columns, &ridge(fold, &columns, penalty), hidden);
                    let truth = table.inside(hidden).map(|row| table.values[row]);
                    let off = truth.zip(&filled).map(|(truth, filled)| (truth - filled).powi(2));
                    square += off.filter(|off| off.is_finite()).sum::<f64>();
                    rows += count(filled.len());
                }
                let error = (square / rows).sqrt();
                // No donor lasts into these hours: the error is 0/0.
                if error.is_finite() && best.as_ref().is_none_or(|(.., least)| error < *least) {
                    best = Some((columns.clone(), penalty, error));
                }
            }
        }
        best
    }

    /// Removes the step at the start of these rows. Each estimate of the step compares the mean residuals
    /// (reading minus prediction) in two windows of one length, or uses the change of the reading alone. The
    /// estimate with the smallest error on the good runs is used. `None` if no estimate is possible.
    pub(super) fn without_step(&self, run: usize, rows: &[usize]) -> Option<Replaced> {
        let columns: Vec<usize> = (0..self.neighbours.len() * (1 + LAGS.len())).collect();
        let gains = ridge(&Gram::total(&self.grams), &columns, STEP_RIDGE);
        let own = self.table(run, THIN);
        let second = self.dataset.runs[run].seconds().nth(*rows.first()?)?;
        let at = own.seconds.partition_point(|other| *other < second);
        let left = |table: &Table| table.left(&columns, &gains);
        let own_left = left(&own);
        let donors: Vec<(Vec<f64>, &Table)> = self.tables.iter().map(|table| (left(table), table)).collect();
        let tried = [None].into_iter().chain(WINDOWS.map(Some)).filter_map(|window| {
            let none = donors.iter().flat_map(|(left, table)| {
                let last = left.len().saturating_sub(FROM_ENDS);
                let places = (FROM_ENDS..last).step_by(EVERY);
                places.filter_map(move |at| step_at(left, &table.values, at, window))
            });
            let none: Vec<f64> = none.collect();
            let error = (none.iter().map(|step| step * step).sum::<f64>() / count(none.len())).sqrt();
            Some((error, step_at(&own_left, &own.values, at, window)?)).filter(|(error, _)| error.is_finite())
        });
        let (error, step) = tried.min_by(|one, other| one.0.total_cmp(&other.0))?;
        let mut values = self.dataset.runs[run].values[self.column].to_vec();
        rows.iter().for_each(|row| values[*row] -= step);
        let message = format!(
            "a correction of {:+.2} °C (± {error:.2}) was added to all readings after the jump",
            -step
        );
        Some(Replaced { values, message, error })
    }

    /// Returns how much the readings of the sensor change in the good runs, °C: the root mean square of the readings
    /// about the mean of their run.
    pub(super) fn moves(&self) -> f64 {
        let all = Gram::total(&self.grams);
        (all.power / all.rows.max(1.0)).sqrt()
    }

    /// Returns rows of a run as features and readings. Successive rows are at least `apart` seconds apart.
    fn table(&self, run: usize, apart: f64) -> Table {
        let run = &self.dataset.runs[run];
        let seconds: Vec<f64> = run.seconds().collect();
        let of = |neighbour: &usize| bridged(&seconds, &run.values[*neighbour].to_vec());
        let mut features: Vec<Vec<f64>> = self.neighbours.iter().map(of).collect();
        for constant in LAGS {
            for place in 0..self.neighbours.len() {
                features.push(lagged(&seconds, &features[place], constant));
            }
        }
        let mut last = f64::NEG_INFINITY;
        let is_next = |row: &usize| {
            let next = seconds[*row] - last >= apart;
            if next {
                last = seconds[*row];
            }
            next
        };
        let kept: Vec<usize> = (0..seconds.len()).filter(is_next).collect();
        Table {
            seconds: kept.iter().map(|row| seconds[*row]).collect(),
            features: DMatrix::from_fn(kept.len(), features.len(), |row, column| features[column][kept[row]]),
            values: kept.iter().map(|row| run.values[self.column].at(*row)).collect(),
        }
    }
}

impl Table {
    /// Returns the Gram products of the log rows outside the time span `hidden`. The mean is subtracted from each
    /// column.
    fn gram(&self, hidden: Option<Span>) -> Gram {
        let hidden = hidden.map_or(0..0, |hidden| self.inside(hidden));
        let may = |row: &usize| self.values[*row].is_finite() && !hidden.contains(row);
        let good: Vec<usize> = (0..self.values.len()).filter(may).collect();
        let rows = count(good.len()).max(1.0);
        let mut features = self.features.select_rows(&good);
        for mut column in features.column_iter_mut() {
            let mean = column.sum() / rows;
            column.add_scalar_mut(-mean);
        }
        let mut values = DVector::from_iterator(good.len(), good.iter().map(|row| self.values[*row]));
        let mean = values.sum() / rows;
        values.add_scalar_mut(-mean);
        Gram::of(&features, &values)
    }

    fn inside(&self, (from, to): Span) -> Range<usize> {
        let before = |time: f64| self.seconds.partition_point(|second| *second < time);
        before(from)..before(to)
    }

    /// Returns the residual of each row, °C: the reading minus its prediction from the neighbours.
    fn left(&self, columns: &[usize], gains: &DVector<f64>) -> Vec<f64> {
        let mut left = DVector::from_column_slice(&self.values);
        for (column, gain) in columns.iter().zip(gains.iter()) {
            left.axpy(-gain, &self.features.column(*column), 1.0);
        }
        left.data.into()
    }

    /// Predicts the readings in the hidden rows from the neighbours. Shifts the predicted readings so that they
    /// continue the readings at both ends without a step.
    fn filled(&self, columns: &[usize], gains: &DVector<f64>, hidden: Span) -> Vec<f64> {
        let rows = self.inside(hidden);
        let left = self.left(columns, gains);
        let end = |rows: &mut dyn Iterator<Item = usize>, end: f64| {
            let (mut sum, mut near) = (0.0, 0.0);
            for row in rows.filter(|row| left[*row].is_finite()) {
                if near > 0.0 && (self.seconds[row] - end).abs() > TIE {
                    break;
                }
                sum += left[row];
                near += 1.0;
            }
            (near > 0.0).then(|| sum / near)
        };
        let before = end(&mut (0..rows.start).rev(), hidden.0);
        let after = end(&mut (rows.end..left.len()), hidden.1);
        // The sensor was frozen from the first row to the last. Its reading was true when it froze.
        let only = before.or(after).or_else(|| left.get(rows.start).copied()).unwrap_or(0.0);
        let (before, after) = (before.unwrap_or(only), after.unwrap_or(only));
        let lasts = (hidden.1.min(self.seconds.last().copied().unwrap_or(0.0)) - hidden.0).max(1.0);
        rows.map(|row| {
            let share = ((self.seconds[row] - hidden.0) / lasts).clamp(0.0, 1.0);
            self.values[row] - left[row] + before + share * (after - before)
        })
        .collect()
    }
}

/// Returns the step of the reading at the row `at`; `None` if it cannot be computed. With a window, the step
/// is the mean residual after the row minus the mean residual before it. Without a window, the step is the
/// change of the reading in the row, minus the median change in the rows near this row.
fn step_at(left: &[f64], values: &[f64], at: usize, window: Option<usize>) -> Option<f64> {
    let mean = |rows: &[f64]| {
        let finite = rows.iter().filter(|value| value.is_finite());
        let (sum, rows) = finite.fold((0.0, 0.0), |sum, value| (sum.0 + value, sum.1 + 1.0));
        (rows > 0.0).then(|| sum / rows)
    };
    match window {
        Some(window) => {
            let before = left.get(at.saturating_sub(window)..at)?;
            let after = left.get(at..(at + window).min(left.len()))?;
            Some(mean(after)? - mean(before)?)
        }
        None => {
            let around = |range: Range<usize>| {
                let pairs = values.get(range).unwrap_or_default().windows(2);
                pairs.map(|pair| pair[1] - pair[0]).collect::<Vec<f64>>()
            };
            let mut slopes = around(at.saturating_sub(4)..at);
            slopes.extend(around(at..(at + 4).min(values.len())));
            let step = values.get(at)? - values.get(at.checked_sub(1)?)?;
            Some(step - median(slopes)).filter(|step| step.is_finite())
        }
    }
}

/// Returns the values after a first-order lag with this time constant, s. The initial value is the first value.
fn lagged(seconds: &[f64], values: &[f64], constant: f64) -> Vec<f64> {
    let mut follower = values.first().copied().unwrap_or(0.0);
    let mut last = seconds.first().copied().unwrap_or(0.0);
    let mut follow = |(second, value): (&f64, &f64)| {
        follower -= (-(second - last) / constant).exp_m1() * (value - follower);
        last = *second;
        follower
    };
    seconds.iter().zip(values).map(&mut follow).collect()
}

/// Replaces missing values by linear interpolation. Missing values before the first value become the first
/// value. Missing values after the last value become the last value.
pub(super) fn bridged(seconds: &[f64], values: &[f64]) -> Vec<f64> {
    let good: Vec<usize> = (0..values.len()).filter(|row| values[*row].is_finite()).collect();
    let at = |row: usize| {
        let next = good.partition_point(|other| *other < row);
        let (before, after) = (next.checked_sub(1).map(|place| good[place]), good.get(next).copied());
        match (before, after) {
            (_, Some(after)) if after == row => values[row],
            (Some(before), Some(after)) => {
                let share = (seconds[row] - seconds[before]) / (seconds[after] - seconds[before]).max(1e-9);
                values[before] + share * (values[after] - values[before])
            }
            (Some(only), None) | (None, Some(only)) => values[only],
            (None, None) => f64::NAN,
        }
    };
    (0..values.len()).map(at).collect()
}
