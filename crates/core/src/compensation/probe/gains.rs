//! Estimation of the gains of a linear model from probings (measured errors of the axis), by recursive least squares
//! with forgetting.
//!
//! The estimate is the relative error θ of each gain. φ is the contribution of each term to the model's
//! present Cz. The correction should be `Σ θ·φ + b`. The offset b is estimated together with the gains, so
//! that a constant error does not change the gains. The offset that corrects the axis is not b: it is
//! filtered from the error that remains after the correction of the gains.
//!
//! ```text
//! K = Pφ / (λσ² + φᵀPφ)     θ += K·(wanted − θᵀφ)     P = (P − K·φᵀP) / λ
//! ```
//!
//! # Safety
//! - θ stays inside ±limit, and b inside the limit of the probe's correction.
//! - Forgetting lets P grow while no probings change the gains. P never grows beyond its start value. A row and its
//!   column are reduced together, which keeps P symmetric and positive.
//! - If a number is not finite or a variance is not positive, P is reset.

use serde::{Deserialize, Serialize};

/// Standard deviation of a probing, µm: the repeatability of a touch probe and the effect of the surface.
const SCATTER: f64 = 1.0;

/// Estimate of the relative error of each gain of a model, with its covariance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Gains {
    /// Relative error θ of each gain, then the offset b in µm.
    estimate: Vec<f64>,
    /// Covariance P of the estimate, row by row.
    covariance: Vec<f64>,
    /// Largest absolute value of each number of the estimate. Half of this bound is the start value of the standard
    /// deviation.
    bounds: Vec<f64>,
    /// Buffers for φ and Pφ, so that an update allocates no memory.
    #[serde(skip)]
    regressors: Vec<f64>,
    #[serde(skip)]
    product: Vec<f64>,
}

impl Gains {
    /// Creates an estimate of zero for `terms` gains, each with a relative error inside ±`limit`, and an offset inside
    /// ±`offset_limit` µm.
    pub(super) fn new(terms: usize, limit: f64, offset_limit: f64) -> Gains {
        let bounds: Vec<f64> = (0..terms).map(|_| limit).chain([offset_limit]).collect();
        let mut gains = Gains { estimate: vec![0.0; terms + 1], bounds, ..Gains::default() };
        gains.make_room();
        gains.begin_covariance();
        gains
    }

    fn make_room(&mut self) {
        let size = self.bounds.len();
        self.covariance.resize(size * size, 0.0);
        self.regressors.resize(size, 0.0);
        self.product.resize(size, 0.0);
    }

    /// Returns this saved estimate, clamped to the bounds of `fresh`. Returns `fresh` itself if the number of gains
    /// differs or a number is not finite.
    pub(super) fn restored(self, fresh: Gains) -> Gains {
        let size = fresh.bounds.len();
        let finite = self.estimate.iter().chain(&self.covariance).all(|number| number.is_finite());
        if (self.estimate.len(), self.covariance.len()) != (size, size * size) || !finite {
            return fresh;
        }
        let mut gains = self;
        gains.make_room();
        if gains.bounds != fresh.bounds {
            gains.bounds = fresh.bounds;
            for (estimate, bound) in gains.estimate.iter_mut().zip(&gains.bounds) {
                *estimate = estimate.clamp(-bound, *bound);
            }
            gains.bound_covariance();
        }
        gains
    }

    /// Returns the estimated relative error θ of each gain.
    pub(super) fn factors(&self) -> &[f64] {
        self.estimate.split_last().map_or(&[], |(_, factors)| factors)
    }

    /// Returns the change of Cz by the estimated errors of the gains, µm. `parts`: contribution of each term to the
    /// model's Cz, µm.
    pub(super) fn change(&self, parts: impl Iterator<Item = f64>) -> f64 {
        self.factors().iter().zip(parts).map(|(factor, part)| factor * part).sum()
    }

    pub(super) fn learn(&mut self, wanted: f64, parts: impl Iterator<Item = f64>, forgetting: f64) {
        let size = self.bounds.len();
        for (regressor, part) in self.regressors.iter_mut().zip(parts.chain([1.0])) {
            *regressor = part;
        }
        for (product, row) in self.product.iter_mut().zip(self.covariance.chunks_exact(size)) {
            *product = dot(row, &self.regressors);
        }
        let scatter = forgetting * SCATTER * SCATTER + dot(&self.regressors, &self.product);
        let surprise = wanted - dot(&self.regressors, &self.estimate);
        if !(scatter.is_finite() && scatter > 0.0 && surprise.is_finite()) {
            return self.begin_covariance();
        }
        for (place, (estimate, bound)) in self.estimate.iter_mut().zip(&self.bounds).enumerate() {
            *estimate = (*estimate + self.product[place] / scatter * surprise).clamp(-bound, *bound);
        }
        for row in 0..size {
            for column in row..size {
                let taken = self.product[row] * self.product[column] / scatter;
                let value = (self.covariance[row * size + column] - taken) / forgetting;
                self.covariance[row * size + column] = value;
                self.covariance[column * size + row] = value;
            }
        }
        self.bound_covariance();
    }

    fn bound_covariance(&mut self) {
        let size = self.bounds.len();
        for place in 0..size {
            let variance = self.covariance[place * size + place];
            if !(variance.is_finite() && variance > 0.0) {
                return self.begin_covariance();
            }
            let most = variance_within(self.bounds[place]);
            if variance > most {
                let shrink = (most / variance).sqrt();
                for other in 0..size {
                    self.covariance[place * size + other] *= shrink;
                    self.covariance[other * size + place] *= shrink;
                }
            }
        }
    }

    fn begin_covariance(&mut self) {
        self.covariance.fill(0.0);
        let size = self.bounds.len();
        for (place, bound) in self.bounds.iter().enumerate() {
            self.covariance[place * size + place] = variance_within(*bound);
        }
    }

    /// Sets the estimated offset b, µm, and resets its variance to the start value.
    pub(super) fn begin_at(&mut self, offset: f64) {
        let size = self.bounds.len();
        let last = size - 1;
        self.estimate[last] = offset;
        for other in 0..size {
            self.covariance[last * size + other] = 0.0;
            self.covariance[other * size + last] = 0.0;
        }
        self.covariance[last * size + last] = variance_within(self.bounds[last]);
    }

    pub(super) fn clear(&mut self) {
        self.estimate.fill(0.0);
        self.begin_covariance();
    }
}

/// Returns the variance of an unknown value between −`bound` and +`bound`: `bound` is taken as two standard deviations.
fn variance_within(bound: f64) -> f64 {
    (0.5 * bound).powi(2)
}

fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

#[cfg(test)]
mod tests;
