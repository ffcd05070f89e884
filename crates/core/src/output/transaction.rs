//! Transfer of a set to its control: the values sent, the values taken, and their number.
//!
//! A control takes a set when its number changes or its strobe rises. If that is not in one request with the values,
//! the registers can hold values that the control has not taken. The values it has taken are at most one step from
//! them. Therefore nothing else is sent until the control has taken the register values. If this run does not end in
//! order, the next run begins with them.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::demand::SetCommit;
use super::numbers::{Attempt, Numbers};
use super::sequence::Sequence;
use crate::quantity::{Counts, Moment, shifted};

/// Event at which a control takes over the values of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CommitTrigger {
    /// The request that writes the values. If the set has a number, the control takes the values when the number
    /// changes. The number is in the same request.
    AtOnce,
    /// A change of the number, which is written after the values.
    Number,
    /// The rising edge of the strobe. The control acknowledges it.
    Strobe,
    /// The write of each node: the control takes each value by itself. A server may carry out only a part of a call.
    Nodes,
}

/// History of the next number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum NextNumber {
    /// The control has not received the next number.
    New,
    /// The control may have received the next number with other values, because an earlier run may have sent that
    /// number.
    PerhapsOld,
}

/// End of the last run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LastRun {
    /// The run ended in order: the control has taken the first register values of this run.
    InOrder,
    /// The run did not end in order, or the registers have been read since.
    Over,
}

/// Transfer state of a set.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Transaction {
    taking: CommitTrigger,
    last_run: LastRun,
    /// Values that were sent and must be taken.
    sent: Option<Vec<Counts>>,
    /// Values that the control last took.
    taken: Option<Vec<Counts>>,
    sequence: Sequence,
    /// Numbers of a set that the control acknowledges. `None` until its register was read.
    numbers: Option<Numbers>,
    /// Values of the last attempt since the control acknowledged one.
    tried: Option<Vec<Counts>>,
    /// Number and values of the last attempt, if it was not answered. Unused if the control acknowledges sets.
    unanswered: Option<(u16, Vec<Counts>)>,
    next_number: NextNumber,
}

/// Output of a set.
#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    /// Last verified register value.
    pub(super) held: Counts,
    /// Whether the axis is armed and the interlock closed.
    pub(super) is_driven: bool,
    /// Whether the control may not have taken the register value.
    pub(super) is_bound: bool,
}

impl Transaction {
    /// Creates the state at a start. If the last run did not end in order, the control may not have taken the register
    /// values. The returned result applies to the members.
    pub(super) fn new(
        taking: CommitTrigger,
        has_number: bool,
        was_in_order: bool,
    ) -> (Transaction, SetCommit) {
        let is_open = !was_in_order && (has_number || taking != CommitTrigger::AtOnce);
        let transaction = Transaction {
            taking,
            last_run: if was_in_order { LastRun::InOrder } else { LastRun::Over },
            sent: None,
            taken: None,
            sequence: Sequence::default(),
            numbers: None,
            tried: None,
            unanswered: None,
            next_number: if is_open && has_number { NextNumber::PerhapsOld } else { NextNumber::New },
        };
        (transaction, if is_open { SetCommit::Open } else { SetCommit::Taken })
    }

    /// Records number and values of the registers. Values that were not taken must be taken before anything else is
    /// sent. Returns the result for the members, or `None` if it does not change.
    pub(super) fn read(
        &mut self,
        number: Option<u16>,
        values: &[Counts],
        late: Duration,
        now: Moment,
    ) -> Option<SetCommit> {
        let is_late = number.is_some_and(|number| self.sequence.record(number, values, now, late));
        let was_in_order = std::mem::replace(&mut self.last_run, LastRun::Over) == LastRun::InOrder;
        if was_in_order {
            self.taken = Some(values.to_vec());
        }
        if self.taking == CommitTrigger::Strobe {
            self.number_is(was_in_order);
        }
        if is_late && self.taking == CommitTrigger::AtOnce {
            self.sent = None;
        }
        let is_untaken = self.taken.as_deref() != Some(values) || self.next_number == NextNumber::PerhapsOld;
        match self.taking {
            CommitTrigger::AtOnce if is_late => Some(SetCommit::Open),
            CommitTrigger::AtOnce => None,
            _ if is_untaken => Some(SetCommit::Open),
            _ => Some(SetCommit::Taken),
        }
    }

    /// Compares the latest number of the register with the numbers that the control may have.
    fn number_is(&mut self, was_in_order: bool) {
        let Some(newest) = self.sequence.newest() else { return };
        let next = std::mem::replace(&mut self.next_number, NextNumber::New);
        self.numbers = Some(match self.numbers {
            Some(numbers) if numbers.contains(newest) => {
                self.next_number = next;
                numbers
            }
            // A set of an earlier run arrived late.
            Some(numbers) if numbers.is_unsure() && numbers.reaches(newest) => {
                self.next_number = next;
                numbers.with(newest)
            }
            None if next == NextNumber::PerhapsOld && !was_in_order => Numbers::perhaps(newest),
            // The control has set another number itself.
            Some(_) | None => Numbers::after(newest),
        });
    }

    /// Number of the next set.
    pub(super) fn next_number(&self) -> u16 {
        self.numbers.map_or_else(|| self.sequence.next(), |numbers| numbers.next())
    }

    /// Forgets the numbers, because the control was restarted. The next set follows the number in the register.
    pub(super) fn forget_number(&mut self) {
        self.sequence.forget();
        (self.numbers, self.tried, self.unanswered) = (None, None, None);
    }

    /// Records that these values were sent with this number, or may have been. Returns the result for the members, or
    /// `None` if it does not change.
    pub(super) fn sends(
        &mut self,
        number: Option<u16>,
        values: Vec<Counts>,
        is_done: bool,
    ) -> Option<SetCommit> {
        if let Some(numbers) = &mut self.numbers {
            if self.tried.as_ref().is_some_and(|tried| *tried != values) {
                numbers.change_values();
            }
        } else if let Some(number) = number {
            // An earlier attempt with this number may arrive first. The control then takes that one instead.
            let is_other = |(tried, with): &(u16, Vec<Counts>)| *tried == number && *with != values;
            if self.unanswered.as_ref().is_some_and(is_other) {
                self.next_number = NextNumber::PerhapsOld;
            }
            self.unanswered = (!is_done).then(|| (number, values.clone()));
        }
        self.tried = Some(values.clone());
        self.sent = Some(values);
        let is_open = !is_done && self.taking != CommitTrigger::AtOnce;
        (is_open || self.next_number == NextNumber::PerhapsOld).then_some(SetCommit::Open)
    }

    /// Returns whether the registers hold the values that were sent.
    pub(super) fn is_sent(&self, values: &[Counts]) -> bool {
        self.sent.as_deref() == Some(values)
    }

    /// Records the result of an attempt to have the set taken.
    pub(super) fn attempt(&mut self, attempt: Attempt) {
        if attempt == Attempt::Acknowledged {
            self.tried = None;
        }
        let Some(numbers) = &mut self.numbers else { return };
        if !numbers.result(attempt) && attempt == Attempt::Acknowledged {
            // The same values follow with the next number.
            self.next_number = NextNumber::PerhapsOld;
        }
    }

    /// Returns the values that were sent, if only some of the members hold theirs.
    fn half_sent(&self, members: &[Member]) -> Option<&[Counts]> {
        let sent = self.sent.as_ref().filter(|_| members.iter().any(|member| member.is_bound))?;
        let is_new = |place: usize| self.taken.as_ref().is_none_or(|taken| taken[place] != sent[place]);
        let driven = members.iter().zip(sent).enumerate();
        let driven = driven.filter(|(place, (member, _))| member.is_driven && is_new(*place));
        let (held, missing): (Vec<bool>, Vec<bool>) =
            driven.map(|(_, (member, value))| member.held == *value).partition(|is_held| *is_held);
        (!held.is_empty() && !missing.is_empty()).then_some(sent)
    }

    /// Returns the values that were sent, if the registers hold only a part of them and the rest can be sent once more.
    /// `can_be` decides that for each member. It is false after another change, and if the readings are too old.
    pub(super) fn demanded_again(
        &mut self,
        members: &[Member],
        can_be: impl Fn(usize, Counts) -> bool,
    ) -> Option<Vec<Counts>> {
        let values = self.half_sent(members)?.to_vec();
        let can_be = values.iter().enumerate().all(|(place, value)| can_be(place, *value));
        if !can_be {
            self.sent = None;
        }
        can_be.then_some(values)
    }

    /// Returns whether these values complete a set of which the registers hold only a part.
    pub(super) fn is_whole(&self, members: &[Member], values: &[Counts]) -> bool {
        self.half_sent(members).is_none_or(|sent| {
            let mut each = members.iter().zip(values).zip(sent);
            each.all(|((member, value), sent)| value == sent || !member.is_driven)
        })
    }

    /// Records that the control has taken the register values. Returns true if that is certain. It is not certain if
    /// the control may have had this number before; the same values are then sent with the next number.
    pub(super) fn is_taken(&mut self) -> bool {
        let is_known = std::mem::replace(&mut self.next_number, NextNumber::New) == NextNumber::New;
        if is_known {
            self.taken = self.sent.take();
        }
        is_known
    }

    /// Records that the control has not taken the sent values, or may not have taken them.
    pub(super) fn doubt(&mut self) {
        self.taken = None;
    }

    /// Returns a copy in which `to` is applied to every moment, for the comparison of two states that differ only in
    /// time.
    pub(super) fn moved(&self, to: impl Fn(Moment) -> Moment) -> Transaction {
        Transaction { sequence: self.sequence.moved(to), ..self.clone() }
    }
}

shifted!(Transaction: sequence);

#[cfg(test)]
mod tests {
    use super::*;

    const LATE: Duration = Duration::from_secs(30);
    const NOW: Moment = Moment::from_nanos(1_000_000_000);

    fn counts<const N: usize>(values: [i64; N]) -> Vec<Counts> {
        values.map(Counts).to_vec()
    }

    /// Creates a set with a handshake whose registers hold these values with this number.
    fn acknowledged(was_in_order: bool, number: u16, values: &[Counts]) -> Transaction {
        let (mut set, commit) = Transaction::new(CommitTrigger::Strobe, true, was_in_order);
        assert_eq!(commit, if was_in_order { SetCommit::Taken } else { SetCommit::Open });
        let read = set.read(Some(number), values, LATE, NOW);
        assert_eq!(read, Some(if was_in_order { SetCommit::Taken } else { SetCommit::Open }));
        set
    }

    /// Lets the control take and acknowledge the register values. Returns true if it is certain that it has taken them.
    fn takes(set: &mut Transaction, values: &[Counts]) -> bool {
        set.sends(Some(set.next_number()), values.to_vec(), true);
        set.read(Some(set.next_number()), values, LATE, NOW);
        assert!(set.is_sent(values));
        set.attempt(Attempt::Acknowledged);
        set.is_taken()
    }

    #[test]
    fn the_number_advances_with_each_set_that_is_acknowledged() {
        let mut set = acknowledged(true, 6, &counts([1, 2]));
        for (number, value) in [(7, 3), (8, 4), (9, 5)] {
            assert_eq!(set.next_number(), number);
            assert!(takes(&mut set, &counts([value, value])));
        }
    }

    #[test]
    fn the_number_stays_after_a_loss_and_its_values_stay_bound_to_it() {
        let mut set = acknowledged(true, 6, &counts([1, 2]));
        let sent = counts([3, 4]);
        set.sends(Some(7), sent.clone(), false);
        for _ in 0..5 {
            set.attempt(Attempt::Unknown);
            set.doubt();
            assert_eq!(set.read(Some(7), &sent, LATE, NOW), Some(SetCommit::Open));
            assert_eq!(set.next_number(), 7);
        }
        assert!(takes(&mut set, &sent));
        assert_eq!(set.next_number(), 8);
    }

    #[test]
    fn after_a_run_that_was_killed_the_register_values_are_taken_under_two_numbers() {
        let held = counts([3, 4]);
        let mut set = acknowledged(false, 17, &held);
        assert_eq!(set.next_number(), 17);
        assert!(!takes(&mut set, &held), "the control may have had number 17 with other values");
        assert_eq!(set.next_number(), 18);
        assert!(takes(&mut set, &held));
    }

    #[test]
    fn other_values_under_a_number_that_was_tried_are_not_known_to_be_taken() {
        let mut set = acknowledged(true, 6, &counts([1, 2]));
        set.sends(Some(7), counts([3, 4]), false);
        set.attempt(Attempt::Unknown);
        assert!(!takes(&mut set, &counts([5, 6])));
        assert_eq!(set.next_number(), 8);
        assert!(takes(&mut set, &counts([5, 6])));
    }

    #[test]
    fn other_values_under_a_number_that_may_still_arrive_are_sent_again_with_the_next() {
        let (mut set, _) = Transaction::new(CommitTrigger::AtOnce, true, true);
        set.read(Some(6), &counts([0, 0]), LATE, NOW);
        assert_eq!(set.sends(Some(7), counts([1, 1]), false), None);
        set.read(Some(6), &counts([0, 0]), LATE, NOW);
        assert_eq!(set.sends(Some(7), counts([0, 0]), true), Some(SetCommit::Open));
        set.read(Some(7), &counts([0, 0]), LATE, NOW);
        assert!(!set.is_taken(), "the control may have taken 1 and 1 under number 7");
        assert_eq!(set.sends(Some(8), counts([0, 0]), true), None);
        assert!(set.is_taken());
    }

    #[test]
    fn a_restarted_control_is_followed_from_the_number_of_its_register() {
        let mut set = acknowledged(true, 600, &counts([1, 2]));
        set.forget_number();
        set.read(Some(0), &counts([0, 0]), LATE, NOW);
        assert_eq!(set.next_number(), 1);
    }

    #[test]
    fn what_was_sent_by_half_is_demanded_again_or_given_up() {
        let (mut set, _) = Transaction::new(CommitTrigger::Number, true, true);
        set.read(Some(6), &counts([1, 1]), LATE, NOW);
        set.sends(Some(7), counts([2, 2]), false);
        let members = [Counts(2), Counts(1)].map(|held| Member { held, is_driven: true, is_bound: true });
        assert!(!set.is_whole(&members, &counts([2, 1])));
        assert!(set.is_whole(&members, &counts([2, 2])));
        assert_eq!(set.demanded_again(&members, |_, _| true), Some(counts([2, 2])));
        assert_eq!(set.demanded_again(&members, |place, _| place == 0), None);
        assert_eq!(set.demanded_again(&members, |_, _| true), None, "it was given up");
    }
}
