//! Expected error of a model: the standard deviation of its residual error. The expected error grows with the hours
//! since the datum, or since the last touch of a probe. The datum is the zero point of Cz, the compensation value. The
//! expected error is estimated from the residuals of held-out runs.
//!
//! ```text
//! σ²(h) = a·h + b        µm², h in hours
//! ```
//!
//! a and b are fitted to the squared residuals by least squares, and are not negative. The fit is then
//! repeated with the weights 1/σ⁴, because squares of normal errors scatter in proportion to σ² (gamma
//! likelihood). Each run has the same total weight. Only every fifth of the rows that were recorded
//! continuously is used, because neighbouring rows are similar. Every touch (measurement with a probe) is
//! used.
//!
//! If at least three runs were measured row by row, only these runs are used. If there are fewer, the runs that were
//! measured by touches are used, too.

use serde::Serialize;

use crate::statistics::count;
use crate::validate::HeldOut;

const EVERY: usize = 5;
const ROUNDS: usize = 12;
/// Assumed time between two touches of the probe, s.
const TOUCHES_EVERY: f64 = 3600.0;

/// Coefficients a (µm²/h) and b (µm²) of the growth σ² = a·h + b.
pub type Growth = [f64; 2];

/// Expected error of a model, as the growth of its variance σ².
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Expected {
    /// Growth of σ² with the hours since the datum (zero point). In this fit, the datum is the start of the run.
    pub since_datum: Growth,
    /// Growth of σ² with the hours since the last touch (measurement with the probe).
    pub since_touch: Growth,
}

/// Shares of the log rows in which the residual is within the expected error, for one held-out run. The
/// expected error is estimated from the other held-out runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Inside {
    /// Share of the log rows whose residual is within one standard deviation, 0 to 1. It is 0.68 for normal errors.
    pub inside_1: f64,
    /// Share of the log rows whose residual is within two standard deviations, 0 to 1. It is 0.95 for normal errors.
    pub inside_2: f64,
}

/// Row for the fit: hours since the datum or the last touch, squared residual in µm², and weight.
type Row = (f64, f64, f64);

/// Estimates the expected error from the held-out runs.
///
/// # Errors
/// Returns the reason why no expected error is known: all residuals are zero, or there are fewer than three runs. Two
/// runs are too few, because each held-out model would be identified from one run only.
pub(crate) fn expected(held_out: &[HeldOut]) -> Result<Expected, &'static str> {
    is_enough(held_out).ok_or(
        "at least three runs are needed: a held-out run is tested with a model from at least two others",
    )?;
    let used = preferred(held_out.iter(), 3);
    let all = |rows: fn(&HeldOut) -> Vec<Row>| growth(used.iter().flat_map(|held| rows(held)).collect());
    let since_datum = all(since_datum).ok_or("the residual error is zero in every held-out run")?;
    let since_touch =
        all(since_touch).ok_or("the residual error does not change within an hour in any held-out run")?;
    Ok(Expected { since_datum, since_touch })
}

/// Returns the runs that were measured row by row, if there are at least `enough` of them; otherwise all runs.
fn preferred<'a>(all: impl Iterator<Item = &'a HeldOut>, enough: usize) -> Vec<&'a HeldOut> {
    let (recorded, touched): (Vec<&HeldOut>, Vec<&HeldOut>) = all.partition(|held| !held.is_touched());
    if recorded.len() < enough { recorded.into_iter().chain(touched).collect() } else { recorded }
}

fn is_enough(held_out: &[HeldOut]) -> Option<()> {
    (held_out.len() > 2).then_some(())
}

/// Returns the shares of the rows of this run in which the residual is within the expected error. The
/// expected error is estimated from the other runs. `None` if this estimate is not possible.
pub(crate) fn inside(held_out: &[HeldOut], run: usize) -> Option<Inside> {
    is_enough(held_out)?;
    let others = held_out.iter().enumerate().filter(|(other, _)| *other != run).map(|(_, held)| held);
    let others = preferred(others, 2);
    let [a, b] = growth(others.iter().flat_map(|held| since_datum(held)).collect())?;
    let rows = since_datum(held_out.get(run)?);
    let within = |times: f64| {
        let inside = rows.iter().filter(|(hours, square, _)| *square <= times * times * (a * hours + b));
        count(inside.count()) / count(rows.len()).max(1.0)
    };
    Some(Inside { inside_1: within(1.0), inside_2: within(2.0) })
}

fn since_datum(held: &HeldOut) -> Vec<Row> {
    let begin = held.seconds.first().copied().unwrap_or_default();
    let left = held.residual(None);
    rows(held.seconds.iter().map(|second| second - begin).zip(left), step(held))
}

fn since_touch(held: &HeldOut) -> Vec<Row> {
    if held.is_touched() {
        // Each touch shows by how much the residual has changed since the touch before.
        let left = held.residual(None);
        let changes = left.windows(2).map(|pair| pair[1] - pair[0]);
        let spans = held.seconds.windows(2).map(|pair| pair[1] - pair[0]);
        return rows(spans.zip(changes), 1);
    }
    let left = held.residual(Some(TOUCHES_EVERY));
    let mut touched = (f64::NEG_INFINITY, 0.0);
    let since = held.seconds.iter().map(|second| {
        let window = (second / TOUCHES_EVERY).floor();
        if window > touched.0 {
            touched = (window, *second);
        }
        second - touched.1
    });
    rows(since.zip(left), step(held))
}

/// Returns the distance between two used rows of a run, in rows: 1 for touches, more for rows that were recorded
/// continuously.
fn step(held: &HeldOut) -> usize {
    if held.is_touched() { 1 } else { EVERY }
}

fn rows(all: impl ExactSizeIterator<Item = (f64, f64)>, step: usize) -> Vec<Row> {
    let weight = 1.0 / count(all.len().div_ceil(step)).max(1.0);
    all.step_by(step).map(|(seconds, left)| (seconds / 3600.0, left * left, weight)).collect()
}

fn growth(rows: Vec<Row>) -> Option<Growth> {
    let mean = rows.iter().map(|row| row.1 * row.2).sum::<f64>() / rows.iter().map(|row| row.2).sum::<f64>();
    if !(mean.is_finite() && mean > 0.0) {
        return None;
    }
    let mut found = line(&rows);
    for _ in 0..ROUNDS {
        let [a, b] = found;
        let again = |(hours, square, weight): &Row| {
            // Without a minimum, a line that begins at zero would give the whole weight to its first row.
            let fitted = (a * hours + b).max(1e-3 * mean);
            (*hours, *square, weight / (fitted * fitted))
        };
        // The weights of the runs, divided by the squared value of the line.
        found = line(&rows.iter().map(again).collect::<Vec<Row>>());
    }
    Some(found)
}

/// Returns the coefficients a and b of the least-squares line through weighted rows. Both coefficients are at least
/// zero.
fn line(rows: &[Row]) -> Growth {
    let sum = |of: &dyn Fn(f64, f64) -> f64| rows.iter().map(|(h, y, w)| w * of(*h, *y)).sum::<f64>();
    let (n, h, hh) = (sum(&|_, _| 1.0), sum(&|h, _| h), sum(&|h, _| h * h));
    let (y, hy) = (sum(&|_, y| y), sum(&|h, y| h * y));
    let free = n * hh - h * h;
    let (a, b) = ((n * hy - h * y) / free, (hh * y - h * hy) / free);
    if a >= 0.0 && b >= 0.0 && a.is_finite() && b.is_finite() {
        return [a, b];
    }
    // The solution is on one of the two boundaries: the one with the smaller residual.
    let (flat, steep) = (y / n, if hh > 0.0 { hy / hh } else { 0.0 });
    let left = |[a, b]: Growth| sum(&|h, y| (y - a * h - b).powi(2));
    let edges = [[0.0, flat], [steep, 0.0]];
    if hh > 0.0 && left(edges[1]) < left(edges[0]) { edges[1] } else { edges[0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_on_a_line_give_the_line_and_neither_number_is_below_zero() {
        let rows =
            |of: fn(f64) -> f64| (0..100).map(move |h| (f64::from(h) / 10.0, of(f64::from(h) / 10.0), 1.0));
        let [a, b] = growth(rows(|h| 0.9 * h + 1.1).collect()).unwrap();
        assert!((a - 0.9).abs() < 1e-9 && (b - 1.1).abs() < 1e-9, "{a} {b}");
        let [a, b] = growth(rows(|h| 3.0 - 0.2 * h).collect()).unwrap();
        assert!(a == 0.0 && b > 1.0, "{a} {b}");
        let [a, b] = growth(rows(|h| h * h).collect()).unwrap();
        assert!(a > 1.0 && b == 0.0, "{a} {b}");
        assert_eq!(growth(rows(|_| 0.0).collect()), None);
    }
}
