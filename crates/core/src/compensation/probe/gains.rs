//! The gains of a linear model, by recursive least squares with forgetting.
//!
//! What is looked for is the share θ by which each gain is wrong: with φ what the term contributes to the model's Cz
//! now, the correction should be `Σ θ·φ + b`. The offset b is estimated along with the gains, so that an error that does
//! not move with the temperatures is not blamed on them; the axis's own offset is filtered from what is left.
//!
//! ```text
//! K = Pφ / (λσ² + φᵀPφ)     θ += K·(wanted − θᵀφ)     P = (P − K·φᵀP) / λ
//! ```
//!
//! # What keeps it safe
//! - θ stays inside ±limit, b inside the probe's limit.
//! - Forgetting lets P grow where nothing is learned for long. It never grows beyond where it began: a row and its
//!   column are shrunk together, which keeps P symmetric and positive.
//! - Where a number is not finite or a variance not positive, P begins anew.

use serde::{Deserialize, Serialize};

/// The scatter of a probing, µm: a touch probe's repeatability and what the surface adds.
const SCATTER: f64 = 1.0;

/// What is known of the gains, and how well.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Gains {
    /// θ, and b as the last.
    estimate: Vec<f64>,
    /// P, row by row.
    covariance: Vec<f64>,
    /// How far each estimate may go: believed to be two standard deviations at first.
    bounds: Vec<f64>,
    /// Room for φ and Pφ: learning asks for none.
    #[serde(skip)]
    regressors: Vec<f64>,
    #[serde(skip)]
    product: Vec<f64>,
}

impl Gains {
    /// For so many gains, each inside ±`limit`, and an offset inside ±`offset_limit` µm.
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

    /// The same as it was kept, inside the bounds of `fresh`; `fresh` itself where it is not of this shape.
    pub(super) fn recalled(self, fresh: Gains) -> Gains {
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

    /// θ.
    pub(super) fn factors(&self) -> &[f64] {
        self.estimate.split_last().map_or(&[], |(_, factors)| factors)
    }

    /// Σ θ·φ, µm.
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

    /// The offset is this from here on, and not well known.
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

/// What is not known yet lies within ±`bound`: two standard deviations.
fn variance_within(bound: f64) -> f64 {
    (0.5 * bound).powi(2)
}

fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

#[cfg(test)]
mod tests;
