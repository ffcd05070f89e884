//! Applied value: a control says in another register what it applies of an offset. That verifies the write.
//!
//! The register that is written is compared as every other is. After each change of it the control has `settle` to apply the
//! value. Until it does, nothing else is sent, and after that the axis holds.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::settings::AppliedSettings;
use super::standing::Seen;
use super::state::RETRY;
use crate::quantity::{Counts, Moment, shifted};

/// Applied value of one output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Applied {
    /// Register value, and when it was first known.
    value: Option<Seen>,
    /// When the control was asked last since then.
    read_at: Option<Moment>,
    shown: Shown,
}

/// Whether a control applies the register value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Shown {
    /// The control has not said that it applies the value.
    #[default]
    NotYet,
    /// The control applies the value.
    Applied,
}

shifted!(Applied: value, read_at);

impl Applied {
    /// The register holds this value. After a change the control is asked again.
    pub(super) fn register_is(&mut self, value: Counts, now: Moment) {
        if self.value.is_none_or(|known| known.value != value) {
            *self = Applied { value: Some(Seen { value, asked: now }), ..Applied::default() };
        }
    }

    /// Returns whether the control applies the register value.
    pub(super) fn is_applied(&self) -> bool {
        self.shown == Shown::Applied
    }

    /// The control said what it applies. Returns whether that is the register value.
    pub(super) fn read(&mut self, found: Option<i64>, asked: Moment, settings: &AppliedSettings) -> bool {
        self.read_at = Some(asked);
        let held = self.value.map(|known| known.value.0.saturating_mul(1000));
        let distance = held.zip(found).map(|(held, found)| held.abs_diff(found));
        let fits = distance.is_some_and(|distance| distance <= settings.tolerance.unsigned_abs());
        self.shown = if fits { Shown::Applied } else { Shown::NotYet };
        fits
    }

    /// The control did not answer.
    pub(super) fn no_answer(&mut self, asked: Moment) {
        self.read_at = Some(asked);
    }

    /// Returns whether the control has had its time when it was asked at `asked`.
    pub(super) fn is_over(&self, asked: Moment, settings: &AppliedSettings) -> bool {
        self.value.is_some_and(|known| asked >= known.asked.after(settings.settle))
    }

    /// When the control is asked next: at once after a change, soon, and each time after twice as long, until it must have
    /// settled. Then each second while it does not apply the value, else with the axis.
    pub(super) fn due(&self, settings: &AppliedSettings, every: Duration) -> Moment {
        let Some(Seen { asked: since, .. }) = self.value else { return Moment::END };
        let over = since.after(settings.settle);
        match self.read_at {
            None => Moment::default(),
            Some(read) if self.is_applied() => read.after(every),
            Some(read) if read < over => {
                let soon = (settings.settle / 8).max(2 * read.since(since));
                over.min(since.after(soon))
            }
            Some(read) => read.after(RETRY),
        }
    }

    /// Moves every moment by `to`.
    pub(super) fn moved(self, to: impl Fn(Moment) -> Moment) -> Applied {
        Applied {
            value: self.value.map(|known| Seen { asked: to(known.asked), ..known }),
            read_at: self.read_at.map(&to),
            ..self
        }
    }
}
