//! Applied value: the offset that a control applies. The control reports it in another register, and the gateway
//! verifies its writes with it.
//!
//! The written register itself is read and compared like the register of any other output. After each change, the
//! control has the time `settle` to apply the value. Until the control applies the value, nothing else is sent. If the
//! control does not apply the value in this time, the axis is frozen.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::settings::AppliedSettings;
use super::state::RETRY;
use super::state_parts::TimedValue;
use crate::quantity::{Counts, Moment, shifted};

/// Applied value of one output: the times of its reads, and whether it equals the register value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Applied {
    /// Register value, and the time when it was first known.
    value: Option<TimedValue>,
    /// Time of the last read of the applied value. `None` if the register value has changed since then.
    read_at: Option<Moment>,
    shown: AppliedState,
}

/// Whether the control applies the register value, as far as the gateway knows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum AppliedState {
    /// The control has not reported that it applies the register value.
    #[default]
    NotYet,
    /// The control has reported that it applies the register value.
    Applied,
}

shifted!(Applied: value, read_at);

impl Applied {
    /// Records the register value. After a change the applied value is read again.
    pub(super) fn register_is(&mut self, value: Counts, now: Moment) {
        if self.value.is_none_or(|known| known.value != value) {
            *self = Applied { value: Some(TimedValue { value, asked: now }), ..Applied::default() };
        }
    }

    /// Returns whether the control applies the register value.
    pub(super) fn is_applied(&self) -> bool {
        self.shown == AppliedState::Applied
    }

    /// Records the applied value `found`, in thousandths of a count; `None` if the value is not a number.
    /// Returns true if the applied value equals the register value within the tolerance.
    pub(super) fn read(&mut self, found: Option<i64>, asked: Moment, settings: &AppliedSettings) -> bool {
        self.read_at = Some(asked);
        let held = self.value.map(|known| known.value.0.saturating_mul(1000));
        let distance = held.zip(found).map(|(held, found)| held.abs_diff(found));
        let fits = distance.is_some_and(|distance| distance <= settings.tolerance.unsigned_abs());
        self.shown = if fits { AppliedState::Applied } else { AppliedState::NotYet };
        fits
    }

    /// Records that a read of the applied value was not answered.
    pub(super) fn no_answer(&mut self, asked: Moment) {
        self.read_at = Some(asked);
    }

    /// Returns whether the settling time was over when the applied value was read at `asked`.
    pub(super) fn is_over(&self, asked: Moment, settings: &AppliedSettings) -> bool {
        self.value.is_some_and(|known| asked >= known.asked.after(settings.settle))
    }

    /// Returns the time of the next read of the applied value. The first read follows a change directly. Until the
    /// settling time is over, the next reads follow at doubled intervals. After that, the applied value is read every
    /// second if the control does not apply the register value. If the control applies the register value, the applied
    /// value is read with the period of the axis.
    pub(super) fn due(&self, settings: &AppliedSettings, every: Duration) -> Moment {
        let Some(TimedValue { asked: since, .. }) = self.value else { return Moment::END };
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

    /// Returns a copy in which `to` is applied to every moment, for the comparison of two states that differ only in
    /// time.
    pub(super) fn moved(self, to: impl Fn(Moment) -> Moment) -> Applied {
        Applied {
            value: self.value.map(|known| TimedValue { asked: to(known.asked), ..known }),
            read_at: self.read_at.map(&to),
            ..self
        }
    }
}
