//! Probe updates: what a measured error teaches the models of an axis.
//!
//! A probing measures the error e that remains while some Cz acts in the machine. The Cz that would have left none is
//! `Cz_acting − e`, and what a model lacks of that is its residual r:
//!
//! ```text
//! r = (Cz_acting − e) − (model's Cz + correction)        correction += K · r        |correction| ≤ limit
//! ```
//!
//! K is a fixed share, or what the certainty of the correction makes it.
//!
//! Where Cz had arrived at what the model asks for, `r = −e`. Where it had not (a ramp after arming, a limit, a register
//! that stands while the axis is off), what is still under way is not counted as the model's fault.
//!
//! # Rules
//! - The correction is added to the raw Cz, before the guard: it reaches the register in steps and never in one.
//! - Each model has its own; a probing teaches every model that has a value then, so that changing to a fallback model loses
//!   nothing. A model with an envelope that holds or shrinks it learns nothing outside.
//! - A residual beyond `max_error` is not believed. One that the model cannot have come to since it was last certain
//!   waits for a second one that agrees with it.
//! - Where what a model is measured from is captured anew (a zero, a machine start), the correction begins at nothing
//!   there: what it made up for is in the new datum. Gains that were learned go on from that point.

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

/// How many residuals are kept for people: two days of one an hour.
const KEPT: usize = 48;

/// A measured error, and the Cz that stood in the machine while it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Actual minus commanded.
    pub error: Micron,
    /// As verified; `None`: what the axis decided last.
    pub acting: Option<Micron>,
}

/// What a probing came to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Probed {
    /// When it was taken in.
    pub at: Moment,
    /// The measured error.
    pub error: Micron,
    /// The Cz that acted.
    pub acting: Micron,
    /// What would remain if the model's Cz with its correction acted: an error, with the sign of one. `None` where no
    /// model had a value.
    pub residual: Option<Micron>,
    /// Why nothing was learned from it.
    pub refused: Option<Refused>,
}

/// Why nothing is learned from a measured error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Refused {
    /// No model can be used.
    NoModel,
    /// The model asked for more than the error level and is not believed.
    Tripped,
    /// The inputs lie outside what the model was identified on, and it is not followed there.
    Outside,
    /// The model would be wrong by more than `max_error`.
    Implausible,
    /// The model would be wrong by more than it can have come to, which is this much: a second probing that agrees is
    /// waited for.
    Doubted(Micron),
}

/// A residual that was learned from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Residual {
    /// When.
    pub at: Moment,
    /// With the sign of an error.
    pub residual: Micron,
}

shifted!(Probed: at);
shifted!(Residual: at);

/// What probings have taught one axis. All of it is kept over a restart.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    /// By model.
    pub(super) models: Vec<Learned>,
    last: Option<Probed>,
    history: VecDeque<Residual>,
    /// Reports that were taken, by which a repetition is recognised.
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

    /// Takes up what was kept, inside the bounds that hold now. A model that has changed since begins at nothing.
    pub(super) fn recall(&mut self, kept: &Probe, settings: &ProbeSettings) {
        for learned in &mut self.models {
            learned.recall(&kept.models, settings);
        }
        self.last = kept.last;
        self.history.extend(kept.history.iter().skip(kept.history.len().saturating_sub(KEPT)));
        self.reports = kept.reports.clone().newest();
    }

    /// Takes in how long the machine was away. The time of a manual measurement shifts by the wall clock. How certain a
    /// correction still is, and how old a touch, depends on the longest time that the machine can have been away.
    pub(super) fn away(&mut self, (by_the_clock, at_most): (Shift, Shift)) {
        self.last.shift(by_the_clock);
        self.history.shift(by_the_clock);
        self.reports.shift(by_the_clock);
        for learned in &mut self.models {
            learned.certainty.shift(at_most);
            learned.comparison.shift(at_most);
        }
    }

    /// The last probing, learned from or not.
    pub fn last(&self) -> Option<&Probed> {
        self.last.as_ref()
    }

    /// The residuals of the last probings that were learned from, oldest first.
    pub fn history(&self) -> impl ExactSizeIterator<Item = &Residual> {
        self.history.iter()
    }

    /// By how much the gains of a model's terms have been changed, as a share of each; empty where gains are not learned.
    pub fn gains(&self, model: usize) -> &[f64] {
        self.models.get(model).map_or(&[], Learned::gains)
    }

    /// The figures of a model that is worse than no compensation; `None` of one that is not.
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

    /// Everything learned is taken back; what was measured stays on the record.
    pub(super) fn clear(&mut self) {
        self.models.iter_mut().for_each(Learned::clear);
    }
}

impl Control {
    /// It brings something to learn, or to forget.
    pub fn teaches(&self) -> bool {
        self.measured.is_some() || self.forget
    }
}
