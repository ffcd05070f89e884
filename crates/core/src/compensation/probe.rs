//! Probe updates: learning of an axis's models from measured errors.
//!
//! A probing measures the error e that remains while a Cz acts in the machine. The Cz that would have left no error is
//! `Cz_acting − e`. The residual r is what a model lacks of that value:
//!
//! ```text
//! r = (Cz_acting − e) − (model's Cz + correction)        correction += K · r        |correction| ≤ limit
//! ```
//!
//! K is a fixed share, or depends on the certainty of the correction.
//!
//! If Cz had reached the model's request, `r = −e`. If it had not, the missing way is not counted as an error of the
//! model. Reasons are a ramp after arming, a limit, or a constant register while the axis is off.
//!
//! # Rules
//! - The correction is added to the raw Cz, before the guard. It therefore reaches the register in steps.
//! - Each model has its own correction. A probing teaches every model that has a value then, so that a fallback model
//!   has learned as well. A model whose envelope holds or shrinks its value learns nothing outside.
//! - A residual beyond `max_error` is rejected. A residual that is too large for the model's certainty waits for a
//!   second one that agrees with it.
//! - If a reference of the model is captured again (a zero, a machine start), its correction begins at zero. The new
//!   datum (zero point of Cz) contains what the old correction had corrected. Learned gains are kept, and count from
//!   the new datum.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::Control;
use super::model::Model;
use super::settings::ProbeSettings;
use crate::quantity::{Micron, Moment, Shift, Shifted, shifted};

mod certainty;
mod comparison;
mod gains;
mod learned;
mod report;

use report::TakenReports;

pub(super) use certainty::Occasion;
pub use comparison::Worse;
pub(super) use comparison::{Credit, Touch};
pub(super) use learned::Learned;
pub use report::{MeasuredReport, Rejected};

/// Number of residuals kept for display: two days with one in each hour.
const KEPT: usize = 48;

/// Measured error, and the Cz that acted in the machine during the measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Actual minus commanded position.
    pub error: Micron,
    /// Verified Cz that acted; `None` means the last decision of the axis.
    pub acting: Option<Micron>,
}

/// Result of a probing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Probed {
    /// Time at which the axis received the probing.
    pub at: Moment,
    /// Measured error: actual minus commanded position.
    pub error: Micron,
    /// Cz that acted in the machine during the measurement.
    pub acting: Micron,
    /// Error that would remain if the model's Cz with its correction acted. `None` if no model had a value.
    pub residual: Option<Micron>,
    /// Why nothing was learned; `None` if the probing was accepted.
    pub refused: Option<Refused>,
}

/// Reason why nothing is learned from a measured error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Refused {
    /// No model can be used.
    NoModel,
    /// The model has requested more than the error level and is not used.
    Tripped,
    /// The inputs are outside the range on which the model was identified, and it is not followed there.
    Outside,
    /// The error of the model would be more than `max_error`.
    Implausible,
    /// The error of the model would be more than its certainty allows, which is this value. A second probing must
    /// agree.
    Doubted(Micron),
}

/// Residual from which the axis learned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// Time of the probing.
    pub at: Moment,
    /// Residual, with the sign of an error.
    pub residual: Micron,
}

shifted!(Probed: at);
shifted!(Residual: at);

/// Result of all probings of one axis. It is kept over a restart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    /// Learned correction of each model.
    pub(super) models: Vec<Learned>,
    last: Option<Probed>,
    history: VecDeque<Residual>,
    /// Reports that were taken. A repeated report is recognised by them.
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

    /// Restores what was kept, within the present bounds. A model that has changed since starts at zero.
    pub(super) fn recall(&mut self, kept: &Probe, settings: &ProbeSettings) {
        for learned in &mut self.models {
            learned.recall(&kept.models, settings);
        }
        self.last = kept.last;
        self.history.extend(kept.history.iter().skip(kept.history.len().saturating_sub(KEPT)));
        self.reports = kept.reports.clone().newest();
    }

    /// Accounts for the time without the gateway. The times of manual measurements shift by the wall clock. The age of
    /// a probing and the certainty of a correction use the longest possible time of the pause.
    pub(super) fn away(&mut self, (by_the_clock, at_most): (Shift, Shift)) {
        self.last.shift(by_the_clock);
        self.history.shift(by_the_clock);
        self.reports.shift(by_the_clock);
        for learned in &mut self.models {
            learned.certainty.shift(at_most);
            learned.comparison.shift(at_most);
        }
    }

    /// Returns the last probing, even if nothing was learned from it.
    pub fn last(&self) -> Option<&Probed> {
        self.last.as_ref()
    }

    /// Returns the residuals of the last accepted probings, oldest first.
    pub fn history(&self) -> impl ExactSizeIterator<Item = &Residual> {
        self.history.iter()
    }

    /// Returns the learned relative change of each gain of a model; empty if gains are not learned.
    pub fn gains(&self, model: usize) -> &[f64] {
        self.models.get(model).map_or(&[], Learned::gains)
    }

    /// Returns the comparison of a model that is worse than no compensation; `None` if it is not worse.
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

    /// Discards everything that was learned. The history of the measurements is kept.
    pub(super) fn clear(&mut self) {
        self.models.iter_mut().for_each(Learned::clear);
    }
}

impl Control {
    /// Returns whether the control contains something to learn or to forget.
    pub fn teaches(&self) -> bool {
        self.measured.is_some() || self.forget
    }
}
