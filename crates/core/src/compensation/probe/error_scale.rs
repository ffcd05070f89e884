//! Scale φ of the expected error of one model, from its last touches. A touch is one accepted probing.
//!
//! The expected error is identified on the days of the commissioning: σ² = a·h + b, with the time h in hours.
//! On other days, the model may be worse or better. The residuals e at the last 24 touches show by how much:
//!
//! ```text
//! φ = (8 + Σ e²/(a·h + b + r²)) / (8 + number of touches)        σ² = φ·(a·h + b)
//! ```
//!
//! A residual contains the error of the touch itself, with the standard deviation r (`repeat`). Without r²,
//! the first touches after a datum would increase the expected error, because the error of the model is then
//! smaller than the error of the probe. The number 8 is the weight of the commissioning: without a touch, φ
//! is 1. A new datum (zero point of Cz) changes nothing, because the touches belong to the model. The
//! functions are pure, and allocate no memory after the creation.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

/// Maximum number of touches from which the scale is calculated.
const KEPT: usize = 24;
/// Weight of the error that was identified at commissioning, as a number of touches (probings).
const COMMISSIONED: f64 = 8.0;

/// Residuals of the last touches, each as its square divided by the expected variance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ErrorScale {
    ratios: VecDeque<f64>,
}

impl ErrorScale {
    /// Creates a scale with memory for all its touches.
    #[must_use]
    pub fn new() -> ErrorScale {
        ErrorScale { ratios: VecDeque::with_capacity(KEPT) }
    }

    /// Restores the saved touches. A saved value that is negative or not finite is skipped.
    pub(super) fn recall(&mut self, kept: &ErrorScale) {
        self.ratios.clear();
        let skipped = kept.ratios.len().saturating_sub(KEPT);
        self.ratios.extend(kept.ratios.iter().copied().skip(skipped).filter(|ratio| is_ratio(*ratio)));
    }

    /// Adds a touch: its residual, µm, the expected variance of the model before scaling, µm², and the standard
    /// deviation of the touch itself, µm. A touch with an expected variance of zero is ignored.
    pub fn take(&mut self, residual: f64, variance: f64, repeat: f64) {
        let ratio = residual * residual / (variance + repeat * repeat);
        if variance <= 0.0 || !is_ratio(ratio) {
            return;
        }
        if self.ratios.len() >= KEPT {
            self.ratios.pop_front();
        }
        self.ratios.push_back(ratio);
    }

    /// Returns φ, by which the expected variance is multiplied.
    #[must_use]
    pub fn factor(&self) -> f64 {
        (COMMISSIONED + self.ratios.iter().sum::<f64>()) / (COMMISSIONED + f64::from(self.touches()))
    }

    /// Returns the number of touches from which the scale is calculated.
    pub(super) fn touches(&self) -> u32 {
        u32::try_from(self.ratios.len()).unwrap_or(u32::MAX)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.ratios.is_empty()
    }

    /// Discards all touches (probings), so that the scale is 1 again.
    pub(super) fn clear(&mut self) {
        self.ratios.clear();
    }
}

fn is_ratio(ratio: f64) -> bool {
    ratio.is_finite() && ratio >= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, wanted: f64) {
        assert!((found - wanted).abs() < 1e-12, "{found}, not {wanted}");
    }

    #[test]
    fn without_a_touch_it_is_one_and_touches_move_it_by_their_share() {
        let mut scale = ErrorScale::new();
        near(scale.factor(), 1.0);
        // The residual is 3 times the expected error of 2 µm.
        scale.take(6.0, 4.0, 0.0);
        near(scale.factor(), (8.0 + 9.0) / 9.0);
        scale.take(0.0, 4.0, 0.0);
        near(scale.factor(), (8.0 + 9.0) / 10.0);
        assert_eq!(scale.touches(), 2);
    }

    #[test]
    fn only_the_last_24_touches_count() {
        let mut scale = ErrorScale::new();
        (0..10).for_each(|_| scale.take(100.0, 1.0, 0.0));
        (0..24).for_each(|_| scale.take(2.0, 4.0, 0.0));
        assert_eq!(scale.touches(), 24);
        near(scale.factor(), 1.0);
    }

    #[test]
    fn the_error_of_the_touches_themselves_does_not_widen_the_expected_error() {
        let (mut counted, mut exact) = (ErrorScale::new(), ErrorScale::new());
        // Just after the datum, the model errs by 0.1 µm and the probe by 0.5 µm.
        let (model, probe) = (0.1_f64, 0.5_f64);
        (0..24).for_each(|_| counted.take(model.hypot(probe), model * model, probe));
        (0..24).for_each(|_| exact.take(model.hypot(probe), model * model, 0.0));
        near(counted.factor(), 1.0);
        assert!(exact.factor() > 19.0, "{}", exact.factor());
    }

    #[test]
    fn a_touch_without_an_expected_error_and_what_is_no_number_are_left_out() {
        let mut scale = ErrorScale::new();
        for (residual, variance) in
            [(1.0, 0.0), (1.0, -1.0), (f64::NAN, 1.0), (1.0, f64::NAN), (f64::MAX, 1.0)]
        {
            scale.take(residual, variance, 0.5);
        }
        assert!(scale.is_empty());
        let kept: ErrorScale = serde_json::from_str("[1.0, -2.0, 3.0]").unwrap();
        scale.recall(&kept);
        assert_eq!(serde_json::to_string(&scale).unwrap(), "[1.0,3.0]");
        scale.clear();
        near(scale.factor(), 1.0);
    }
}
