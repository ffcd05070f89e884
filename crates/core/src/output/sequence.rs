//! Number of a set of outputs, as the register of the number shows it.
//!
//! Some controls take a set when its number differs from the last number, other controls only when it is the next
//! number. A number must therefore not repeat with other values, and no number may be omitted. A set gets the number
//! after the latest number that the register has held. A set that arrives late restores an older number, or puts other
//! values under the same number. The control has then perhaps not taken the register values.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::{Counts, Moment, shifted};

/// Largest number of sets that are sent before a late write of an older set arrives: ten sets per second, for more than
/// a minute. A number that is lower by more than this does not come from a late write.
const LATELY: u16 = 1024;

/// Number of an output set, as the register of the number shows it. The number counts the sets that were sent.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Sequence {
    /// Latest number that the register has held, and the values of the output set at that time.
    newest: Option<(u16, Vec<Counts>)>,
    /// Time since which the register has held an older number.
    older_since: Option<Moment>,
}

impl Sequence {
    /// Returns the latest number that the register has held. `None` before the first read.
    pub(super) fn newest(&self) -> Option<u16> {
        self.newest.as_ref().map(|(newest, _)| *newest)
    }

    /// Returns the number for the next output set: the newest number plus one. The state does not change.
    pub(super) fn next(&self) -> u16 {
        next(self.newest.as_ref().map_or(0, |(newest, _)| *newest))
    }

    /// Records the number and the values that the registers hold. Returns whether the control may have taken other
    /// values, because an older set arrived late.
    pub(super) fn record(&mut self, number: u16, values: &[Counts], now: Moment, late: Duration) -> bool {
        let Some((newest, beside)) = self.newest.as_ref().filter(|(newest, _)| !is_older(*newest, number))
        else {
            // A number that no set of the gateway can have any more was set by the control.
            let since = *self.older_since.get_or_insert(now);
            if self.newest.is_none() || now.since(since) > late {
                (self.newest, self.older_since) = (Some((number, values.to_vec())), None);
                return false;
            }
            return true;
        };
        self.older_since = None;
        let is_late = *newest == number && beside != values;
        if *newest != number {
            self.newest = Some((number, values.to_vec()));
        }
        is_late
    }

    /// Forgets the number, because the control was restarted. The next set follows the number in the register.
    pub(super) fn forget(&mut self) {
        *self = Sequence::default();
    }

    /// Returns a copy in which `to` is applied to every moment, for the comparison of two states that differ only in
    /// time.
    pub(super) fn moved(&self, to: impl Fn(Moment) -> Moment) -> Sequence {
        Sequence { older_since: self.older_since.map(to), ..self.clone() }
    }
}

shifted!(Sequence: older_since);

/// Returns the number after `number`. Zero is reserved for a control that has just been started.
fn next(number: u16) -> u16 {
    number.checked_add(1).unwrap_or(1)
}

fn is_older(newest: u16, number: u16) -> bool {
    newest != 0 && number != 0 && (1..=LATELY).contains(&newest.wrapping_sub(number))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LATE: Duration = Duration::from_secs(30);

    fn second(second: u64) -> Moment {
        Moment::from_nanos(1_000_000_000 * second)
    }

    #[test]
    fn the_sequence_counts_from_one_and_never_comes_back_to_zero() {
        assert_eq!((next(0), next(7), next(65535)), (1, 8, 1));
    }

    #[test]
    fn the_next_set_follows_what_stands_there_but_for_an_older_one_that_came_late() {
        let cases = [
            ("at a start", &[40][..], 41),
            ("at a start, high up", &[65000], 65001),
            ("it arrived", &[40, 41], 42),
            ("it was lost", &[41, 41], 42),
            ("an older one came late", &[41, 17], 42),
            ("an older one came late, from before the round was over", &[3, 65530], 4),
            ("the round is over", &[65535, 1], 2),
            ("the control was restarted", &[41, 0], 1),
            ("the control was restarted, and remembers then", &[41, 0, 65000], 65001),
            ("a control that remembers another day", &[5000, 300], 301),
        ];
        for (case, stands, follows) in cases {
            let mut sequence = Sequence::default();
            for number in stands {
                sequence.record(*number, &[], second(0), LATE);
            }
            assert_eq!(sequence.next(), follows, "{case}");
        }
    }

    #[test]
    fn an_older_number_that_stays_longer_than_a_set_can_be_late_is_the_controls_own() {
        let mut sequence = Sequence::default();
        sequence.record(300, &[], second(0), LATE);
        assert!(sequence.record(298, &[], second(1), LATE));
        assert!(sequence.record(298, &[], second(31), LATE));
        assert_eq!(sequence.next(), 301);
        assert!(!sequence.record(298, &[], second(32), LATE));
        assert_eq!(sequence.next(), 299);
    }

    #[test]
    fn other_values_under_the_same_number_or_an_older_one_were_perhaps_not_taken() {
        let [one, two] = [1, 2].map(Counts);
        let mut sequence = Sequence::default();
        assert!(!sequence.record(41, &[one], second(0), LATE));
        assert!(!sequence.record(42, &[two], second(1), LATE));
        assert!(!sequence.record(42, &[two], second(2), LATE));
        assert!(sequence.record(42, &[one], second(3), LATE), "the same number was sent twice");
        assert!(sequence.record(41, &[two], second(4), LATE), "an older one came late");
        assert!(!sequence.record(43, &[one], second(5), LATE));
    }
}
