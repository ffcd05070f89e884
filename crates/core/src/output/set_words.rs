//! Heartbeat and control word of an output set, as they were written last.

use serde::{Deserialize, Serialize};

use super::heartbeat::{Beat, count_after};
use super::set::{ControlWord, OwnWords, SetDemand, SetSettings, WriteResult};
use crate::quantity::{Moment, shifted};

/// Largest count of the heartbeat of an output set. It is positive even in a register that the control reads as signed.
const HIGHEST_BEAT: u16 = 32767;

/// Heartbeat and control word in their registers, and the time of their last write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct WrittenWords {
    /// Count of the heartbeat in its register.
    beat: u16,
    /// Control word in its register, if known.
    control: Option<u16>,
    /// Whether the control word may indicate that every axis is armed.
    may_say_enabled: bool,
    written_at: Moment,
}

shifted!(WrittenWords: written_at);

impl WrittenWords {
    /// Returns whether the control word may indicate that every axis is armed.
    pub(super) fn may_say_enabled(&self) -> bool {
        self.may_say_enabled
    }

    /// Records the count of the heartbeat that was read. `None` means that it was not read, and changes nothing.
    pub(super) fn receive_beat(&mut self, beat: Option<u16>) {
        self.beat = beat.unwrap_or(self.beat);
    }

    /// Returns the number, heartbeat and control word for the next request.
    pub(super) fn next(&self, demand: &SetDemand, number: Option<u16>) -> OwnWords {
        let beat = if demand.beat == Beat::Counts { count_after(self.beat, HIGHEST_BEAT) } else { self.beat };
        OwnWords { number, beat, control: demand.control }
    }

    /// Records the result of a request with this heartbeat and control word. `left`: time after its last byte was sent.
    pub(super) fn sent(&mut self, own: OwnWords, result: WriteResult, left: Moment) {
        if result.may_have_arrived() {
            let is_done = result == WriteResult::Done;
            (self.beat, self.written_at) = (own.beat, left);
            self.control = is_done.then_some(own.control);
            let says_enabled = own.control & ControlWord::ENABLE != 0;
            self.may_say_enabled = says_enabled || (self.may_say_enabled && !is_done);
        }
    }

    /// Returns whether the control word in the register differs from the demanded control word, or is unknown.
    pub(super) fn has_news(&self, settings: &SetSettings, demand: &SetDemand) -> bool {
        settings.words.has_control() && self.control != Some(demand.control)
    }

    /// Returns the time when the output set must be sent again without a change. `None` if there is no such time.
    pub(super) fn refreshes(&self, settings: &SetSettings) -> Option<Moment> {
        settings.refresh.map(|refresh| self.written_at.after(refresh))
    }

    /// Returns a copy in which `to` is applied to every moment, for the comparison of two states that differ only in
    /// time.
    pub(super) fn moved(&self, to: impl Fn(Moment) -> Moment) -> WrittenWords {
        WrittenWords { written_at: to(self.written_at), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks whether the control word may still say "enabled" after two writes: the first says it, the
    /// second does not. Each row has the results of both writes, and the expected answer.
    #[test]
    fn a_control_word_may_say_enabled_until_another_one_has_surely_arrived() {
        let own = |control: u16| OwnWords { number: None, beat: 7, control };
        for (first, second, expected) in [
            (WriteResult::Done, WriteResult::Done, false),
            (WriteResult::Done, WriteResult::Unknown, true),
            (WriteResult::Done, WriteResult::Refused, true),
            (WriteResult::Unknown, WriteResult::Done, false),
            (WriteResult::Refused, WriteResult::Unknown, false),
        ] {
            let mut words = WrittenWords::default();
            words.sent(own(ControlWord::ENABLE), first, Moment::from_nanos(1));
            words.sent(own(ControlWord::HOLD), second, Moment::from_nanos(2));
            assert_eq!(words.may_say_enabled(), expected, "{first:?} {second:?}");
        }
    }

    #[test]
    fn the_heartbeat_counts_from_the_register_and_stays_positive_as_a_signed_value() {
        let mut words = WrittenWords::default();
        words.receive_beat(Some(HIGHEST_BEAT - 1));
        words.receive_beat(None);
        let demand = |beat: Beat| SetDemand { beat, ..SetDemand::default() };
        assert_eq!(words.next(&demand(Beat::Stands), Some(3)).beat, HIGHEST_BEAT - 1);
        let own = words.next(&demand(Beat::Counts), Some(3));
        assert_eq!((own.number, own.beat), (Some(3), HIGHEST_BEAT));
        words.sent(own, WriteResult::Unknown, Moment::from_nanos(1));
        assert_eq!(words.next(&demand(Beat::Counts), None).beat, 0);
    }
}
