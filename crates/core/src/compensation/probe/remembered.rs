//! What of the probings is worth keeping over a restart.
//!
//! A model is known by its name. Where its gains are not those that were corrected it has been identified anew, and its
//! correction begins anew as well.

use serde::{Deserialize, Serialize};

use super::certainty::Certainty;
use super::gains::Gains;
use super::report::{TakenReport, TakenReports};
use super::{KEPT, Learned, Probe, Probed, Residual};
use crate::compensation::model::Model;
use crate::compensation::settings::ProbeSettings;
use crate::quantity::{Moment, Shift, Shifted, shifted};

/// The memory of one axis's probings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::compensation) struct ProbeRemembered {
    models: Vec<LearnedRemembered>,
    last: Option<Probed>,
    history: Vec<Residual>,
    /// Reports that were taken: none of them counts again.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    reports: Vec<TakenReport>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct LearnedRemembered {
    model: String,
    /// The gains and the offset that the profile gives the model.
    corrects: Vec<f64>,
    offset: f64,
    /// `None` in what was kept before there was one.
    certainty: Option<Certainty>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    gains: Option<Gains>,
    renews: Option<Moment>,
}

shifted!(ProbeRemembered: models, last, history, reports);
shifted!(LearnedRemembered: certainty, renews);

impl ProbeRemembered {
    /// Takes in how long the machine was away. The time of a manual measurement shifts by the wall clock. How certain a
    /// correction still is depends on the longest time that the machine can have been away.
    pub(in crate::compensation) fn away(&mut self, (by_the_clock, at_most): (Shift, Shift)) {
        self.last.shift(by_the_clock);
        self.history.shift(by_the_clock);
        self.reports.shift(by_the_clock);
        for learned in &mut self.models {
            learned.certainty.shift(at_most);
        }
    }
}

impl Probe {
    pub(in crate::compensation) fn remembered(&self, models: &[Model]) -> ProbeRemembered {
        let one = |(model, learned): (&Model, &Learned)| LearnedRemembered {
            model: model.name.clone(),
            corrects: model.numbers().collect(),
            offset: learned.offset,
            certainty: Some(learned.certainty),
            gains: learned.gains.clone(),
            renews: learned.renews,
        };
        ProbeRemembered {
            models: models.iter().zip(&self.models).map(one).collect(),
            last: self.last,
            history: self.history.iter().copied().collect(),
            reports: self.reports.remembered(),
        }
    }

    /// Takes up what was kept, inside the bounds that hold now.
    pub(in crate::compensation) fn recall(
        &mut self,
        kept: &ProbeRemembered,
        models: &[Model],
        settings: &ProbeSettings,
    ) {
        let limit = settings.limit.get();
        for (model, learned) in models.iter().zip(&mut self.models) {
            let same = |kept: &&LearnedRemembered| {
                kept.model == model.name && kept.corrects.iter().copied().eq(model.numbers())
            };
            let Some(kept) = kept.models.iter().find(same) else { continue };
            learned.offset = kept.offset.clamp(-limit, limit);
            let certainty = kept.certainty.map(|certainty| certainty.under(settings));
            learned.certainty = certainty.unwrap_or_else(|| Certainty::of_older_program(settings));
            learned.renews = kept.renews;
            if let (Some(gains), Some(kept)) = (learned.gains.take(), kept.gains.clone()) {
                learned.gains = Some(kept.recalled(gains));
            }
        }
        self.last = kept.last;
        let newest = kept.history.len().saturating_sub(KEPT);
        self.history.extend(&kept.history[newest..]);
        self.reports = TakenReports::recalled(kept.reports.clone());
    }
}
