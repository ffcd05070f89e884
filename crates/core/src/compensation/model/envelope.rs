//! Region of inputs on which a model was identified, and the action of an axis whose inputs are outside this region.
//!
//! Inputs are inside the region if two conditions are true. Every input is between its smallest and its largest value.
//! The Mahalanobis distance `d = √((x − m)ᵀ·S⁻¹·(x − m))` of all inputs from their means is at most r, the reach.
//!
//! The excess e is the distance from the region as one number: `e = max(d/r − 1, largest (distance beyond min or max) /
//! (max − min))`. It is negative inside the region, and then gives the distance to the nearest edge. Extrapolation
//! begins at the edge, and ends when e is below [`CLEARLY_INSIDE`]. An input that fluctuates at the edge therefore
//! causes one report only.
//!
//! A model that is the mean of two models (its halves) also gives the difference h between the Cz of the
//! halves. Both h and the Cz z of the model are measured from the datum (zero point). The larger the excess
//! e, the more the difference reduces the used Cz: `Cz = z·z²/(z² + (a·h)²)` with
//! `a = clamp((e − 0.10)/0.25, 0, 1)`.

use serde::{Deserialize, Serialize};

use super::{Input, Inputs, Lag, Unusable};
use crate::quantity::Micron;
use crate::reading::SignalId;

/// Maximum number of inputs of an envelope. It is limited because a step stores them in an array of fixed size.
pub const MOST: usize = 64;

/// Excess below which the inputs count as clearly inside. Each input is then inside by at least 5 % of its range, and
/// the Mahalanobis distance is at most 95 % of the largest distance inside.
pub const CLEARLY_INSIDE: f64 = -0.05;

/// Excess above which a difference between the model's two halves reduces the value. Over the next `WIDTH` of excess,
/// the weight of the difference grows from 0 to 1.
const BEGINS: f64 = 0.10;
const WIDTH: f64 = 0.25;

/// Action of an axis while the inputs of its model are outside the region on which the model was identified.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outside {
    /// The axis follows the model, and reports that the inputs are outside.
    Warn,
    /// The axis keeps its last value until the inputs are inside again.
    Hold,
    /// The axis follows `g·Cz` with `g = 1 / (1 + e²)`, where e is the excess. The gain g is 1 at the edge, without a
    /// kink, and 1/2 if the excess is 1.
    Shrink,
    /// The axis follows the model as far as its two halves agree. The halves are two models whose mean is this model.
    /// The more the halves differ, the smaller is Cz.
    Agree,
}

/// Range and mean of one input in the data from which the model was identified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identified {
    /// Signal of the input, with its reference.
    pub input: Input,
    /// Mean of the input, in the signal's unit.
    pub mean: f64,
    /// Smallest and largest value of the input, in the signal's unit.
    pub range: (f64, f64),
}

impl Identified {
    /// Returns the distance of the input's value `rise` from the range, as a fraction of the range's width; negative
    /// inside.
    fn beyond(&self, rise: f64) -> f64 {
        let (min, max) = self.range;
        (min - rise).max(rise - max) / (max - min)
    }
}

/// Region of inputs on which a model was identified.
#[derive(Clone, Debug, PartialEq)]
pub struct Envelope {
    inputs: Vec<Identified>,
    /// Lower triangle of the Cholesky factor of the covariance, row by row.
    factor: Vec<f64>,
    reach: f64,
    outside: Outside,
    /// Difference of the gains between the two halves (the models whose mean is this model), by term, µm per unit.
    /// Empty if the model is not such a mean.
    apart: Vec<f64>,
}

/// Reason why an envelope is invalid. The numbers are indices of inputs, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadEnvelope {
    /// The envelope has no inputs, or more than [`MOST`].
    Count,
    /// The covariance does not have one row and one column for each input.
    Size,
    /// Range and mean of this input are not `min ≤ mean ≤ max` with `min < max`, all finite.
    Range(usize),
    /// The covariance matrix is not symmetric: the element for these two inputs differs from the element in the
    /// opposite order.
    NotSymmetric(usize, usize),
    /// The covariance is not positive definite: this input does not vary, or is a linear combination of the inputs
    /// before it.
    NotPositiveDefinite(usize),
    /// The reach (largest distance inside) is not a finite number above zero.
    Reach,
}

/// Details about inputs outside the region on which a model was identified, and the effect on Cz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extrapolation {
    /// Mahalanobis distance of the inputs, and the reach (largest distance inside); `None` beyond the end of a
    /// guideway.
    pub distance: Option<(f64, f64)>,
    /// Input that is farthest beyond its range; `None` if each input is inside its range, and only their combination is
    /// outside.
    pub farthest: Option<Beyond>,
    /// Action of the axis while the inputs are outside.
    pub outside: Outside,
    /// Factor for the Cz of the model. It differs from 1 only for [`Outside::Shrink`] and [`Outside::Agree`].
    pub gain: f64,
    /// Difference of Cz between the model's two halves (the two models whose mean is this model); `None` unless
    /// [`Outside::Agree`] uses it.
    #[serde(default)]
    pub apart: Option<Micron>,
}

/// Position of the inputs relative to the region on which a model was identified.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coverage {
    /// Distance from the region as one number: positive outside, negative inside.
    pub excess: f64,
    /// Details about inputs outside the region; `None` if they are inside.
    pub extrapolating: Option<Extrapolation>,
}

/// Input of a model whose value is outside the range in which the model was identified, and the distance from this
/// range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beyond {
    /// Signal of the input whose value is out of range.
    pub signal: SignalId,
    /// Distance from the range in the signal's unit: positive above the largest value, negative below the smallest.
    pub by: f64,
}

impl Envelope {
    /// Creates an envelope of these inputs with their covariance. The default reach is the distance within which 99 %
    /// of a normal distribution lie (chi-squared, by Wilson and Hilferty 1931).
    ///
    /// # Errors
    /// Returns the first number that is invalid, with the index of its input.
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

    /// Adds the difference of the gains between the two halves, by term. The halves are the two models whose mean is
    /// this model.
    #[must_use]
    pub fn of_halves(self, apart: Vec<f64>) -> Envelope {
        Envelope { apart, ..self }
    }

    /// Returns the difference of the gains between the model's two halves, by term; empty if the model is not the mean
    /// of two models.
    pub fn apart(&self) -> &[f64] {
        &self.apart
    }

    /// Returns the inputs of the envelope, with their ranges.
    pub fn inputs(&self) -> &[Identified] {
        &self.inputs
    }

    /// Returns the largest Mahalanobis distance that is inside the envelope.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// Returns the action of the axis while the inputs are outside the envelope.
    pub fn outside(&self) -> Outside {
        self.outside
    }

    /// Returns the present position of the inputs relative to the envelope.
    ///
    /// # Errors
    /// Returns that a signal cannot be used, or that a reference has not been captured.
    pub fn coverage(&self, inputs: &Inputs<'_>) -> Result<Coverage, Unusable> {
        let mut rises = [0.0; MOST];
        for (rise, identified) in rises.iter_mut().zip(&self.inputs) {
            *rise = identified.input.rise(inputs, &Lag::NONE)?.get();
        }
        Ok(self.assess(&rises))
    }

    /// Returns the distance of this signal from its range, as a fraction of the range's width; negative inside. If
    /// several inputs have the signal, the largest distance is returned. `None` if no input has the signal, or its rise
    /// is unknown.
    pub(in crate::compensation) fn beyond_range(&self, signal: SignalId, inputs: &Inputs<'_>) -> Option<f64> {
        let known = self.inputs.iter().filter(|known| known.input.signal == signal);
        let shares =
            known.filter_map(|known| Some(known.beyond(known.input.rise(inputs, &Lag::NONE).ok()?.get())));
        shares.reduce(f64::max)
    }

    /// Returns the distance of this rise of an input from its range, as a fraction of the range's width. The rise may
    /// be lagged, because a lagged value stays in the range of its input. `None` if the envelope does not contain the
    /// input.
    pub(in crate::compensation) fn rise_beyond_range(&self, input: &Input, rise: f64) -> Option<f64> {
        let is_same = |known: &&Identified| {
            known.input.signal == input.signal
                && known.input.reference == input.reference
                && known.input.squared == input.squared
        };
        self.inputs.iter().filter(is_same).map(|known| known.beyond(rise)).reduce(f64::max)
    }

    fn assess(&self, rises: &[f64; MOST]) -> Coverage {
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

    /// Returns the Mahalanobis distance `|L⁻¹·(x − m)|` of the inputs, by forward substitution. An infinite result
    /// becomes the largest finite number.
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

/// Returns the fraction of a model's Cz `x`, µm, that is used at this excess. `apart`: difference of Cz between the two
/// halves (the models whose mean is this model), µm. If `x` and `apart` are zero, the fraction is 1.
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

/// Returns the lower triangle L of the covariance S with `L·Lᵀ = S`, row by row.
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
        // A smaller remainder of the variance is rounding.
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
