//! How certain a model's correction is, and what a probing is worth beside it.
//!
//! The correction walks: between two probings its variance P grows by q for each hour, from 0 at the datum. A probing of
//! its own variance σ² takes so much of its residual r into it as it is the better of the two:
//!
//! ```text
//! P += q·Δt        K = P / (P + σ²)        correction += K·r        P *= 1 − K
//! ```
//!
//! # A probing that disagrees
//! With `r² > 16·(P + σ²)` it is a chip, another tool, a crash: it is doubted, and nothing is learned, until another
//! one's residual lies within 4·√2·σ of it. Then the machine is where both say, so P is taken for as large as it must
//! have been for the second one to be believed at once. A probing that agrees with the model again ends the doubt.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::compensation::settings::{Filter, ProbeSettings};
use crate::quantity::{Micron, Moment, shifted};

/// How many standard deviations a residual may be off.
const BELIEVED: f64 = 4.0;
/// µm²: nobody compensates a metre, and it stays a number.
const LARGEST: f64 = 1e12;

/// What is known of one model's correction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Certainty {
    /// P after the last probing that was learned from, µm²; `None`: none was since the datum, where it was 0.
    variance: Option<f64>,
    /// When that was.
    touched: Option<Moment>,
    /// The residual that waits for another one, µm.
    doubted: Option<f64>,
}

shifted!(Certainty: touched);

/// When a probing is taken in, as a model sees it.
#[derive(Clone, Copy, Debug)]
pub(in crate::compensation) struct Occasion {
    pub(in crate::compensation) now: Moment,
    /// How long ago the model's datum was taken.
    pub(in crate::compensation) since_datum: Duration,
}

impl Certainty {
    /// Certainty of a correction that was kept by a program that did not count it.
    pub(super) fn uncounted() -> Certainty {
        Certainty { variance: Some(f64::INFINITY), ..Certainty::default() }
    }

    /// Certainty under these settings. If nobody has counted it, because probings were taken in by a fixed share or by an older
    /// program, the correction is so uncertain that it fills its limit.
    pub(super) fn under(self, settings: &ProbeSettings) -> Certainty {
        let is_counted = self.variance.map_or(self.touched.is_none(), f64::is_finite);
        let half = 0.5 * settings.limit.get();
        match settings.filter {
            Filter::Weighed { .. } if !is_counted => {
                Certainty { variance: Some(half * half), touched: self.touched, doubted: None }
            }
            _ => self,
        }
    }

    /// When the last probing was learned from.
    pub(super) fn touched(&self) -> Option<Moment> {
        self.touched
    }

    /// P now.
    fn variance(&self, walk: f64, occasion: Occasion) -> f64 {
        let since = self.touched.map_or(occasion.since_datum, |touched| occasion.now.since(touched));
        let grown = self.variance.unwrap_or(0.0) + walk * since.as_secs_f64() / 3600.0;
        // Also where what was kept is no number.
        if grown.is_nan() { LARGEST } else { grown.clamp(0.0, LARGEST) }
    }

    /// Whether this residual is believed.
    ///
    /// # Errors
    /// What would be believed at once.
    pub(super) fn judge(&self, residual: f64, filter: Filter, occasion: Occasion) -> Result<(), Micron> {
        let Filter::Weighed { repeat, walk } = filter else { return Ok(()) };
        let most = BELIEVED * (self.variance(walk, occasion) + repeat * repeat).sqrt();
        let agrees = |first: f64| (residual - first).abs() <= BELIEVED * std::f64::consts::SQRT_2 * repeat;
        if residual.abs() <= most || self.doubted.is_some_and(agrees) {
            return Ok(());
        }
        Err(Micron::new(most).unwrap_or_default())
    }

    /// It waits for another one that agrees.
    pub(super) fn doubt(&mut self, residual: f64) {
        self.doubted = Some(residual);
    }

    /// The share of this residual, which is believed, that goes into the correction.
    pub(super) fn learn(&mut self, residual: f64, filter: Filter, occasion: Occasion) -> f64 {
        let (share, variance) = match filter {
            Filter::Share(share) => (share, None),
            Filter::Weighed { repeat, walk } => {
                let own = repeat * repeat;
                let least = (residual / BELIEVED).powi(2) - own;
                let before = self.variance(walk, occasion).max(least.min(LARGEST));
                // A scatter may be so small that its square is nothing.
                let share = if before > 0.0 { before / (before + own) } else { 0.0 };
                (share, Some(before * (1.0 - share)))
            }
        };
        *self = Certainty { variance, touched: Some(occasion.now), doubted: None };
        share
    }
}

#[cfg(test)]
mod tests;
