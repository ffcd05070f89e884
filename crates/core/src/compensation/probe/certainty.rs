//! Certainty of a model's correction, and the weight that it gives to a new probing (measured error of the axis).
//!
//! The right correction drifts. Between two probings the variance P of the correction grows by q for each hour, from 0
//! at the datum (zero point of Cz). A probing has its own variance σ². The fraction K of its residual r that is added
//! to the correction depends on both variances:
//!
//! ```text
//! P += q·Δt        K = P / (P + σ²)        correction += K·r        P *= 1 − K
//! ```
//!
//! # A probing that disagrees
//! If `r² > 16·(P + σ²)`, the cause may be a chip, another tool or a crash. The probing is doubted: it
//! corrects nothing until the residual of another probing lies within 4·√2·σ of the doubted residual. Then
//! both show the true position of the machine. P is then set so large that the second probing would have been
//! accepted at once. A probing that agrees with the model ends the doubt.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::compensation::settings::{Filter, ProbeSettings};
use crate::quantity::{Micron, Moment, shifted};

/// Largest residual that is accepted at once, in standard deviations.
const ACCEPTED_AT_ONCE: f64 = 4.0;
/// Largest variance of a correction, µm². This is the square of one metre, which no error reaches. The limit keeps the
/// variance finite.
const LARGEST: f64 = 1e12;

/// Certainty of one model's correction: its variance, the time of the last accepted probing, and a doubted residual.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Certainty {
    /// Variance P of the correction after the last accepted probing, µm². `None` if no probing was accepted since the
    /// datum (zero point), at which P was 0.
    variance: Option<f64>,
    /// Time of the last accepted probing; `None` if no probing was accepted since the datum (zero point).
    touched: Option<Moment>,
    /// Doubted residual, µm, which waits for a second residual that agrees with it. `None` if no residual waits.
    doubted: Option<f64>,
}

shifted!(Certainty: touched);

/// Time of a probing, and the time since the datum (zero point) of the model that judges the probing.
#[derive(Clone, Copy, Debug)]
pub(in crate::compensation) struct Occasion {
    pub(in crate::compensation) now: Moment,
    /// Time since the datum of the model was captured.
    pub(in crate::compensation) since_datum: Duration,
}

impl Certainty {
    /// Returns the certainty of a saved correction from a program version that did not store a certainty.
    pub(super) fn uncounted() -> Certainty {
        Certainty { variance: Some(f64::INFINITY), ..Certainty::default() }
    }

    /// Returns the certainty of a saved correction under these settings. The certainty is unknown after probings with a
    /// fixed factor, and in a state of an older program version. If it is unknown, the correction may have any value
    /// within its limit.
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

    /// Returns the time of the last accepted probing; `None` if no probing was accepted since the datum (zero point).
    pub(super) fn touched(&self) -> Option<Moment> {
        self.touched
    }

    /// Returns the variance P of the correction at this probing, µm². `walk`: increase of the variance in each hour,
    /// µm²/h.
    fn variance(&self, walk: f64, occasion: Occasion) -> f64 {
        let since = self.touched.map_or(occasion.since_datum, |touched| occasion.now.since(touched));
        let grown = self.variance.unwrap_or(0.0) + walk * since.as_secs_f64() / 3600.0;
        // The kept value may be no number.
        if grown.is_nan() { LARGEST } else { grown.clamp(0.0, LARGEST) }
    }

    /// Checks whether this residual, in µm, is accepted.
    ///
    /// # Errors
    /// Returns the largest residual that would be accepted at once.
    pub(super) fn assess(&self, residual: f64, filter: Filter, occasion: Occasion) -> Result<(), Micron> {
        let Filter::Weighed { repeat, walk } = filter else { return Ok(()) };
        let most = ACCEPTED_AT_ONCE * (self.variance(walk, occasion) + repeat * repeat).sqrt();
        let agrees =
            |first: f64| (residual - first).abs() <= ACCEPTED_AT_ONCE * std::f64::consts::SQRT_2 * repeat;
        if residual.abs() <= most || self.doubted.is_some_and(agrees) {
            return Ok(());
        }
        Err(Micron::new(most).unwrap_or_default())
    }

    /// Stores a residual that is not accepted, until another residual agrees with it.
    pub(super) fn doubt(&mut self, residual: f64) {
        self.doubted = Some(residual);
    }

    /// Updates the certainty with an accepted residual. Returns the fraction of the residual that is added to the
    /// correction.
    pub(super) fn learn(&mut self, residual: f64, filter: Filter, occasion: Occasion) -> f64 {
        let (share, variance) = match filter {
            Filter::Share(share) => (share, None),
            Filter::Weighed { repeat, walk } => {
                let own = repeat * repeat;
                let least = (residual / ACCEPTED_AT_ONCE).powi(2) - own;
                let before = self.variance(walk, occasion).max(least.min(LARGEST));
                // A scatter may be so small that its square is zero.
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
