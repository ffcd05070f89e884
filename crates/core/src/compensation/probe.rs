//! Probings: correction of an axis's models with measured errors.
//!
//! A probing measures the error e that remains while a Cz acts in the machine. The Cz that would have left no
//! error is `Cz_acting − e`. The residual r is the difference between this Cz and the Cz of the model with
//! its correction:
//!
//! ```text
//! r = (Cz_acting − e) − (model's Cz + correction)        correction += K · r        |correction| ≤ limit
//! ```
//!
//! The factor K is a fixed number, or depends on the certainty of the correction.
//!
//! If the acting Cz was the Cz that the model requested, `r = −e`. If another Cz acted, the difference
//! between the two is not counted as an error of the model. Another Cz acts, for example, during a ramp after
//! arming, at a limit, or while the axis is off and the register is constant.
//!
//! # Rules
//! - The correction is added to the raw Cz, before the limits of the axis. Therefore it reaches the register in steps.
//! - Each model has its own correction. A probing corrects every model that has a value at that moment, so that a
//!   fallback model is also corrected. A model whose envelope holds or reduces its value is not corrected while its
//!   inputs are outside.
//! - A residual beyond `max_error` is rejected. A residual that is too large for the certainty of the model's
//!   correction waits for a second residual that agrees with it.
//! - The residuals of a model scale its expected error.
//! - If a reference of the model is captured again (a zero command, a machine start), its correction starts from zero.
//!   The new datum (zero point of Cz) contains the error that the old correction had corrected. Corrections of gains
//!   stay, and act from the new datum on.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::model::Model;
use super::settings::ProbeSettings;
use crate::quantity::{Micron, Moment, Shift, Shifted, shifted};

mod certainty;
mod comparison;
mod error_scale;
mod gains;
mod learned;
mod report;

use report::TakenReports;

pub(super) use certainty::Occasion;
pub use comparison::Worse;
pub(super) use comparison::{Credit, Touch};
pub use error_scale::ErrorScale;
pub(super) use learned::Learned;
pub use report::{MeasuredReport, Rejected};

/// Number of residuals that are stored for display: two days with one probing in each hour.
const KEPT: usize = 48;

/// Measured error, and the Cz that acted in the machine during the measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Measured error: actual minus commanded position.
    pub error: Micron,
    /// Verified Cz that acted in the machine during the measurement; `None` means the Cz of the last decision
    /// of the axis.
    pub acting: Option<Micron>,
}

/// Result of a probing: the measured error, and how the axis has used it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Probed {
    /// Time at which the axis received the probing.
    pub at: Moment,
    /// Measured error: actual minus commanded position.
    pub error: Micron,
    /// Cz that acted in the machine during the measurement.
    pub acting: Micron,
    /// Residual error: error that would remain if the model's Cz with its correction acted. `None` if no model had a
    /// value.
    pub residual: Option<Micron>,
    /// Reason why the models were not corrected; `None` if the probing was accepted.
    pub refused: Option<Refused>,
}

/// Reason why no model is corrected with a measured error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Refused {
    /// The axis has no model that can be used now.
    NoModel,
    /// The model has requested more than the error level of the axis, and is not used.
    Tripped,
    /// The inputs are outside the range on which the model was identified, and the axis does not follow the model
    /// there.
    Outside,
    /// The residual error of the model is more than `max_error`.
    Implausible,
    /// The residual error of the model is larger than this value, which the certainty of its correction allows. A
    /// second probing must agree.
    Doubted(Micron),
}

/// Residual error of an accepted probing, with which the axis corrected its models.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Time of the probing.
    pub at: Moment,
    /// Residual error of the model: actual minus commanded position.
    pub residual: Micron,
}

shifted!(Probed: at);
shifted!(Residual: at);

/// Results of the probings of one axis: corrections of its models, last results, and used reports. They are saved for a
/// restart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    /// Correction of each model from probings, in the order of the axis's models.
    pub(super) models: Vec<Learned>,
    last: Option<Probed>,
    history: VecDeque<Residual>,
    /// Reports that were used. A repeated report is recognised by comparison with these reports.
    #[serde(default, skip_serializing_if = "TakenReports::is_empty")]
    pub(super) reports: TakenReports,
}

shifted!(Probe: models, last, history, reports);

impl Probe {
    pub(super) fn new(models: &[Model], settings: Option<&ProbeSettings>) -> Probe {
        Probe {
            models: models.iter().map(|model| Learned::new(model, settings)).collect(),
            last: None,
            history: VecDeque::with_capacity(if settings.is_some() { KEPT } else { 0 }),
            reports: TakenReports::default(),
        }
    }

    /// Restores the saved results, within the present bounds. A model that has changed since then starts without a
    /// correction.
    pub(super) fn recall(&mut self, kept: &Probe, settings: &ProbeSettings) {
        for learned in &mut self.models {
            learned.recall(&kept.models, settings);
        }
        self.last = kept.last;
        self.history.extend(kept.history.iter().skip(kept.history.len().saturating_sub(KEPT)));
        self.reports = kept.reports.clone().newest();
    }

    /// Shifts the saved times by the time in which the gateway did not run. Times of measurements and reports shift by
    /// the wall clock. Times that determine the age of a probing or the certainty of a correction shift by the longest
    /// possible pause.
    pub(super) fn away(&mut self, (by_the_clock, at_most): (Shift, Shift)) {
        self.last.shift(by_the_clock);
        self.history.shift(by_the_clock);
        self.reports.shift(by_the_clock);
        for learned in &mut self.models {
            learned.certainty.shift(at_most);
            learned.comparison.shift(at_most);
        }
    }

    /// Returns the last probing, even if it was refused; `None` before the first probing.
    pub fn last(&self) -> Option<&Probed> {
        self.last.as_ref()
    }

    /// Returns the residuals of the last accepted probings, oldest first.
    pub fn history(&self) -> impl ExactSizeIterator<Item = &Residual> {
        self.history.iter()
    }

    /// Returns the relative correction of each gain of a model from probings; empty if the profile does not let gains
    /// change.
    pub fn gains(&self, model: usize) -> &[f64] {
        self.models.get(model).map_or(&[], Learned::gains)
    }

    /// Returns the comparison between a model and no compensation if the model is worse than no compensation; else
    /// `None`.
    pub fn worse(&self, model: usize) -> Option<Worse> {
        self.models.get(model).and_then(Learned::worse)
    }

    pub(super) fn note(&mut self, probed: Probed) {
        if let (None, Some(residual)) = (probed.refused, probed.residual) {
            if self.history.len() >= KEPT {
                self.history.pop_front();
            }
            self.history.push_back(Residual { at: probed.at, residual });
        }
        self.last = Some(probed);
    }

    /// Discards all corrections and comparisons. The history of the measurements stays.
    pub(super) fn clear(&mut self) {
        self.models.iter_mut().for_each(Learned::clear);
    }
}
