//! The region of inputs that a model was identified on, and what an axis does outside it.
//!
//! Inside is where every input is between its smallest and its largest value, and the Mahalanobis distance
//! `d = √((x − m)ᵀ·S⁻¹·(x − m))` of all of them together is at most the reach r. How far outside is one number:
//! the excess `e = max(d/r − 1, largest (distance beyond min or max) / (max − min))`; inside it is negative, and says how
//! far the nearest edge is. Outside begins at the edge, and ends where e is below [`CLEARLY_INSIDE`]: an input that
//! trembles at the edge is outside once.
//!
//! A model that is the mean of two says by how much they differ; d, measured from the datum like its Cz x, counts the
//! more the farther outside: `Cz = x·x²/(x² + (a·d)²)` with `a = clamp((e − 0.10)/0.25, 0, 1)`.

use serde::{Deserialize, Serialize};

use super::{Input, Inputs, Lag, Unusable};
use crate::quantity::Micron;
use crate::reading::SignalId;

/// Most inputs of an envelope: a step keeps its numbers in a place of fixed size.
pub const MOST: usize = 64;

/// The excess below which the inputs are clearly inside: each by a twentieth of its range, and the distance by as much
/// of its reach.
pub const CLEARLY_INSIDE: f64 = -0.05;

/// The excess at which a difference of the halves begins to count, and that on which it comes to count whole.
const BEGINS: f64 = 0.10;
const WIDTH: f64 = 0.25;

/// What an axis does while its inputs lie outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outside {
    /// Follows the model all the same, and says so.
    Warn,
    /// Keeps its last value until the inputs are inside again.
    Hold,
    /// Follows `g·Cz` with `g = 1 / (1 + e²)`: 1 at the edge, without a kink there, a half where the excess is 1.
    Shrink,
    /// Follows the model as far as its two halves agree.
    Agree,
}

/// One input as it was when the model was identified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identified {
    /// The signal, less its reference.
    pub input: Input,
    /// Its mean, in the signal's unit.
    pub mean: f64,
    /// Smallest and largest.
    pub range: (f64, f64),
}

impl Identified {
    /// How far this rise is beyond the smallest or the largest value, as a share of their distance; negative inside.
    fn beyond(&self, rise: f64) -> f64 {
        let (min, max) = self.range;
        (min - rise).max(rise - max) / (max - min)
    }
}

/// A region.
#[derive(Clone, Debug, PartialEq)]
pub struct Envelope {
    inputs: Vec<Identified>,
    /// The lower triangle of the covariance's Cholesky factor, row by row.
    factor: Vec<f64>,
    reach: f64,
    outside: Outside,
    /// By term of the model: what the gains of its two halves differ by, µm per unit; of a model without halves none.
    apart: Vec<f64>,
}

/// Why there is no such region. Inputs are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadEnvelope {
    /// No inputs, or more than [`MOST`].
    Count,
    /// The covariance is not one row and one column per input.
    Size,
    /// This input's numbers are not `min ≤ mean ≤ max` with `min < max`, all finite.
    Range(usize),
    /// The covariance of these two is not that of the two in the other order.
    NotSymmetric(usize, usize),
    /// The covariance is not positive definite: this input does not vary, or is made of those before it.
    NotPositiveDefinite(usize),
    /// The reach is not above zero.
    Reach,
}

/// Where the inputs lie outside, and what follows from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extrapolation {
    /// Mahalanobis distance and reach; `None` where only a guideway ends.
    pub distance: Option<(f64, f64)>,
    /// The input that is farthest beyond its smallest or largest value; `None` where it is the combination that is new.
    pub farthest: Option<Beyond>,
    /// What the axis does.
    pub outside: Outside,
    /// What the model's Cz is multiplied with: 1 but for [`Outside::Shrink`] and [`Outside::Agree`].
    pub gain: f64,
    /// What the two halves of the model differ by, where it has them.
    #[serde(default)]
    pub apart: Option<Micron>,
}

/// Where the inputs lie.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coverage {
    /// How far outside; negative: how far inside.
    pub excess: f64,
    /// What that means; `None` inside.
    pub extrapolating: Option<Extrapolation>,
}

/// An input beyond its range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beyond {
    /// Which.
    pub signal: SignalId,
    /// By how much, in its unit: above the largest value, or negative: below the smallest.
    pub by: f64,
}

impl Envelope {
    /// A region of these inputs with their covariance. Without a reach it is the distance within which 99 % of a
    /// normal distribution lie (chi-squared, by Wilson and Hilferty 1931).
    ///
    /// # Errors
    /// What is wrong, and with which input.
    pub fn new(
        inputs: Vec<Identified>,
        covariance: &[Vec<f64>],
        reach: Option<f64>,
        outside: Outside,
    ) -> Result<Envelope, BadEnvelope> {
        if inputs.is_empty() || inputs.len() > MOST {
            return Err(BadEnvelope::Count);
        }
        if covariance.len() != inputs.len() || covariance.iter().any(|row| row.len() != inputs.len()) {
            return Err(BadEnvelope::Size);
        }
        let good = |known: &Identified| {
            let (min, max) = known.range;
            (max - min).is_finite() && min < max && (min..=max).contains(&known.mean)
        };
        if let Some(place) = inputs.iter().position(|known| !good(known)) {
            return Err(BadEnvelope::Range(place));
        }
        let reach = reach.unwrap_or_else(|| usual_reach(inputs.len()));
        if !(reach > 0.0 && reach.is_finite()) {
            return Err(BadEnvelope::Reach);
        }
        Ok(Envelope { factor: cholesky(covariance)?, inputs, reach, outside, apart: Vec::new() })
    }

    /// The same, of a model that is the mean of two: by term, what their gains differ by.
    #[must_use]
    pub fn of_halves(self, apart: Vec<f64>) -> Envelope {
        Envelope { apart, ..self }
    }

    /// By term of the model; empty where it has no halves.
    pub fn apart(&self) -> &[f64] {
        &self.apart
    }

    /// The region's inputs.
    pub fn inputs(&self) -> &[Identified] {
        &self.inputs
    }

    /// The largest distance that is inside.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// What the axis does outside.
    pub fn outside(&self) -> Outside {
        self.outside
    }

    /// Where the machine is now.
    ///
    /// # Errors
    /// A signal that cannot be used, a reference that has not been captured.
    pub fn coverage(&self, inputs: &Inputs<'_>) -> Result<Coverage, Unusable> {
        let mut rises = [0.0; MOST];
        for (rise, identified) in rises.iter_mut().zip(&self.inputs) {
            *rise = identified.input.rise(inputs, &Lag::NONE)?.get();
        }
        Ok(self.judge(&rises))
    }

    /// How far the worst input of this signal is beyond its smallest or largest value, as a share of their distance; negative
    /// inside. `None` where the envelope does not know the signal, or it has no rise.
    pub(in crate::compensation) fn beyond_range(&self, signal: SignalId, inputs: &Inputs<'_>) -> Option<f64> {
        let known = self.inputs.iter().filter(|known| known.input.signal == signal);
        let shares =
            known.filter_map(|known| Some(known.beyond(known.input.rise(inputs, &Lag::NONE).ok()?.get())));
        shares.reduce(f64::max)
    }

    /// The same of this rise of an input, at once or behind a lag: what follows values of a range stays in it. `None` where the envelope
    /// does not know the signal with this reference.
    pub(in crate::compensation) fn rise_beyond_range(&self, input: &Input, rise: f64) -> Option<f64> {
        let is_same = |known: &&Identified| {
            known.input.signal == input.signal
                && known.input.reference == input.reference
                && known.input.squared == input.squared
        };
        self.inputs.iter().filter(is_same).map(|known| known.beyond(rise)).reduce(f64::max)
    }

    fn judge(&self, rises: &[f64; MOST]) -> Coverage {
        let mut share = f64::NEG_INFINITY;
        let mut farthest = None;
        for (known, rise) in self.inputs.iter().zip(rises) {
            let of_range = known.beyond(*rise);
            if of_range > share {
                share = of_range;
                let (min, max) = known.range;
                let by = rise - rise.clamp(min, max);
                farthest = (of_range > 0.0).then_some(Beyond { signal: known.input.signal, by });
            }
        }
        let distance = self.distance(rises);
        let excess = (distance / self.reach - 1.0).max(share).min(f64::MAX);
        let gain = match self.outside {
            Outside::Shrink => 1.0 / (1.0 + excess * excess),
            Outside::Warn | Outside::Hold | Outside::Agree => 1.0,
        };
        let distance = Some((distance, self.reach));
        let found = Extrapolation { distance, farthest, outside: self.outside, gain, apart: None };
        Coverage { excess, extrapolating: (excess > 0.0).then_some(found) }
    }

    /// Mahalanobis: `|L⁻¹·(x − m)|`, by forward substitution. What is too large for a number is the largest there is.
    fn distance(&self, rises: &[f64; MOST]) -> f64 {
        let mut solved = [0.0; MOST];
        let mut squared = 0.0;
        let mut rows = self.factor.as_slice();
        for (place, (known, rise)) in self.inputs.iter().zip(rises).enumerate() {
            let (row, rest) = rows.split_at(place + 1);
            rows = rest;
            let (diagonal, before) = row.split_last().unwrap_or((&1.0, &[]));
            let known_part: f64 = before.iter().zip(&solved).map(|(factor, value)| factor * value).sum();
            solved[place] = (rise - known.mean - known_part) / diagonal;
            squared += solved[place] * solved[place];
        }
        if squared.is_finite() { squared.sqrt() } else { f64::MAX }
    }
}

/// How much of a Cz of x is used so far outside, where the halves of its model are so far apart: all of it where both are zero.
pub(in crate::compensation) fn agreed(excess: f64, x: f64, apart: f64) -> f64 {
    let counts = ((excess - BEGINS) / WIDTH).clamp(0.0, 1.0) * apart;
    let share = 1.0 / (1.0 + (counts / x).powi(2));
    if share.is_nan() { 1.0 } else { share }
}

fn usual_reach(inputs: usize) -> f64 {
    const NORMAL_99: f64 = 2.326_347_874;
    #[allow(clippy::cast_precision_loss, reason = "at most 64")]
    let count = inputs as f64;
    let ninth = 2.0 / (9.0 * count);
    (count * (1.0 - ninth + NORMAL_99 * ninth.sqrt()).powi(3)).sqrt()
}

/// The lower triangle L with `L·Lᵀ = S`, row by row.
fn cholesky(covariance: &[Vec<f64>]) -> Result<Vec<f64>, BadEnvelope> {
    let mut lower: Vec<Vec<f64>> = Vec::new();
    for (i, row) in covariance.iter().enumerate() {
        let mut made: Vec<f64> = Vec::with_capacity(i + 1);
        for (j, entry) in row.iter().take(i).enumerate() {
            let (mirrored, size) = (covariance[j][i], (row[i] * covariance[j][j]).abs().sqrt());
            if (entry - mirrored).abs() > 1e-6 * size {
                return Err(BadEnvelope::NotSymmetric(j, i));
            }
            let dot: f64 = made.iter().zip(&lower[j]).map(|(a, b)| a * b).sum();
            made.push((entry - dot) / lower[j][j]);
        }
        let left = row[i] - made.iter().map(|entry| entry * entry).sum::<f64>();
        // Less than that of the variance is rounding.
        if !(left > 1e-10 * row[i] && left.is_normal()) {
            return Err(BadEnvelope::NotPositiveDefinite(i));
        }
        made.push(left.sqrt());
        lower.push(made);
    }
    Ok(lower.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests;
