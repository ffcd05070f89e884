//! Transfer of an output set (outputs that are written together) to the control: values that were sent, values that the
//! control has taken, and the number of the set.
//!
//! A control takes a set when the number of the set changes or its strobe signal rises. If that happens after the
//! request with the values, the registers can hold values that the control has not taken yet. Such values differ by one
//! step at most from the values that the control has taken. No other values are sent until the control has taken them.
//! If this run is not stopped cleanly, the next run first sends the register values again.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::demand::SetCommit;
use super::numbers::{Attempt, Numbers};
use super::sequence::Sequence;
use crate::quantity::{Counts, Moment, shifted};

/// Event at which a control takes over the values of an output set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CommitTrigger {
    /// The control takes the values with the request that writes them. If the output set has a number, that request
    /// contains the number too.
    AtOnce,
    /// The control takes the values when the number of the output set changes. The number is written after the values.
    Number,
    /// The control takes the values at the rising edge of the strobe signal, and acknowledges them.
    Strobe,
    /// The control takes each value separately, when its node is written. An OPC UA server may carry out only some of
    /// the writes of a request.
    Nodes,
}

/// Whether the control may have received the next number before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum NextNumber {
    /// The control has not received the next number.
    New,
    /// The control may have received the next number with other values, from an earlier run or an earlier attempt.
    PerhapsOld,
}

/// Way in which the previous run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LastRun {
    /// The previous run was stopped cleanly: the control has taken the values that this run reads first.
    InOrder,
    /// The previous run was not stopped cleanly, or its end no longer matters because the registers have been read.
    Over,
}

/// State of the transfer of a set of outputs to its control.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Transaction {
    taking: CommitTrigger,
    last_run: LastRun,
    /// Values that were sent and that the control must still take.
    sent: Option<Vec<Counts>>,
    /// Values that the control took last, if they are known.
    taken: Option<Vec<Counts>>,
    sequence: Sequence,
    /// Possible numbers of the next output set, if the control acknowledges output sets. The control accepts one of
    /// them. `None` until the register of the number was read.
    numbers: Option<Numbers>,
    /// Values of the last attempt. `None` after the control has acknowledged an output set.
    tried: Option<Vec<Counts>>,
    /// Sequence number and values of the last attempt, if it was not answered. Unused if the control acknowledges
    /// output sets.
    unanswered: Option<(u16, Vec<Counts>)>,
    next_number: NextNumber,
}

/// State of one output of an output set, as the transfer of the set needs it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    /// Last verified register value.
    pub(super) held: Counts,
    /// Whether the axis is armed and the interlock closed.
    pub(super) is_driven: bool,
    /// Whether the control has perhaps not yet taken the register value.
    pub(super) is_bound: bool,
}

impl Transaction {
    /// Creates the state at a start of the gateway. `was_in_order`: the previous run was stopped cleanly. If it was
    /// not, the control has perhaps not taken the register values. The second result must be passed to the outputs of
    /// the output set.
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

    /// Records the number and the values that the registers hold. Returns whether the control has taken these values,
    /// for the outputs of the output set. `None` if that has not changed.
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

    /// Updates the possible numbers with the latest number that the register has held.
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

    /// Returns the number to send with the next set.
    pub(super) fn next_number(&self) -> u16 {
        self.numbers.map_or_else(|| self.sequence.next(), |numbers| numbers.next())
    }

    /// Forgets the numbers, because the control was restarted. The next set follows the number in the register.
    pub(super) fn forget_number(&mut self) {
        self.sequence.forget();
        (self.numbers, self.tried, self.unanswered) = (None, None, None);
    }

    /// Records that these values were, or may have been, sent with this number. `is_done`: the device answered that it
    /// has carried out the write. Returns whether the control has taken the values, for the outputs of the output set.
    /// `None` if that has not changed.
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
            // An earlier attempt with this number may arrive first. The control then takes the values of that attempt.
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

    /// Records the result of an attempt to make the control take the output set.
    pub(super) fn attempt(&mut self, attempt: Attempt) {
        if attempt == Attempt::Acknowledged {
            self.tried = None;
        }
        let Some(numbers) = &mut self.numbers else { return };
        if !numbers.result(attempt) && attempt == Attempt::Acknowledged {
            // The same values are sent again with the next number.
            self.next_number = NextNumber::PerhapsOld;
        }
    }

    /// Returns the values that were sent, if the registers of only some outputs hold them.
    fn half_sent(&self, members: &[Member]) -> Option<&[Counts]> {
        let sent = self.sent.as_ref().filter(|_| members.iter().any(|member| member.is_bound))?;
        let is_new = |place: usize| self.taken.as_ref().is_none_or(|taken| taken[place] != sent[place]);
        let driven = members.iter().zip(sent).enumerate();
        let driven = driven.filter(|(place, (member, _))| member.is_driven && is_new(*place));
        let (held, missing): (Vec<bool>, Vec<bool>) =
            driven.map(|(_, (member, value))| member.held == *value).partition(|is_held| *is_held);
        (!held.is_empty() && !missing.is_empty()).then_some(sent)
    }

    /// Returns the values that were sent, if the registers hold only a part of them and all of these values can be sent
    /// once more. `can_be` returns whether a value can be sent once more to the output with this index. A value can no
    /// longer be sent after another change, or if its readings are too old.
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

    /// Returns false if the registers hold only a part of the values that were sent, and `values` would not complete
    /// them.
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

    /// Records that the control has not taken the sent values, or has perhaps not taken them.
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

    /// Creates an output set with a handshake whose registers hold these values with this number.
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
