//! What of a set the control has taken.
//!
//! A control takes a set when its sequence changes or its strobe rises. Where that is not one with the values (several
//! requests, or a handshake), values can stand in the registers that were not taken. What was taken is at most a step from
//! them; so until the control has taken what stands there, nothing else is sent than just that. The next run begins with
//! it, if this one does not end in order.

use std::time::Duration;

use super::cells::stretches;
use super::register::Register;
use super::sequence::Sequence;
use isotherm_core::codec::Encoded;
use isotherm_core::output::{Attempt, Numbers, SetCommit};
use isotherm_core::quantity::{Counts, Moment};
use isotherm_profile::{Profile, SetId};

/// What was sent, and what was taken of it.
#[derive(Debug)]
pub(super) struct Taking {
    /// What its registers hold is what the control has taken: it comes with the sequence, or the control takes what it
    /// finds. Never in nodes, where a call may be carried out by half.
    is_at_once: bool,
    is_in_nodes: bool,
    /// What was sent and is to be taken.
    sent: Option<Vec<Encoded>>,
    /// What its outputs held when the control took them last.
    taken: Option<Vec<Encoded>>,
    /// The last run ended in order: what stands there first was taken.
    was_in_order: bool,
    sequence: Sequence,
    /// Numbers of a set that the control acknowledges, once its register was read.
    numbers: Option<Numbers>,
    is_acknowledged: bool,
    /// Values of the last attempt since the control acknowledged one.
    tried: Option<Vec<Encoded>>,
    /// What is sent next may bear the number that the control took last: a run before this one may have sent it.
    may_bear_an_old_number: bool,
}

/// What was read says of the set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stands {
    AsBefore,
    Untaken,
    Taken,
}

impl Stands {
    pub(super) fn commit(self, is_bound: bool) -> SetCommit {
        match self {
            Stands::AsBefore if is_bound => SetCommit::Open,
            Stands::AsBefore | Stands::Taken => SetCommit::Taken,
            Stands::Untaken => SetCommit::Open,
        }
    }
}

impl Taking {
    /// At a start. What stands in these registers is perhaps not taken, if the last run did not end in order.
    pub(super) fn new(profile: &Profile, id: SetId, was_in_order: bool) -> (Taking, SetCommit) {
        let set = profile.set(id);
        let is_in_nodes = set.is_in_nodes(profile);
        let is_in_one = set.sequence.is_none() || stretches(profile, set).len() == 1;
        let is_at_once = set.handshake.is_none() && is_in_one && !is_in_nodes;
        let has_numbers = set.sequence.is_some();
        let is_bound = !was_in_order && (has_numbers || !is_at_once);
        let commit = if is_bound { SetCommit::Open } else { SetCommit::Taken };
        let taking = Taking {
            is_at_once,
            is_in_nodes,
            sent: None,
            taken: None,
            was_in_order,
            sequence: Sequence::default(),
            numbers: None,
            is_acknowledged: set.handshake.is_some(),
            tried: None,
            may_bear_an_old_number: is_bound && has_numbers,
        };
        (taking, commit)
    }

    pub(super) fn is_at_once(&self) -> bool {
        self.is_at_once
    }

    /// A server may keep a number with fewer digits than it was sent with. What comes to the same counts as what was sent, or
    /// taken, is that.
    pub(super) fn know_again(&self, values: &mut [Encoded], registers: &[Register]) {
        for (place, (value, register)) in values.iter_mut().zip(registers).enumerate() {
            let counts = |value: &Encoded| register.units.found(value.registers());
            let known = self.sent.iter().chain(&self.taken).filter_map(|values| values.get(place));
            let mut known = known.filter(|_| self.is_in_nodes);
            if let Some(known) = known.find(|known| counts(known) == counts(value)) {
                *value = *known;
            }
        }
    }

    /// This stands in the registers, under this number. What was not taken is to be taken before anything else is sent.
    pub(super) fn stands(
        &mut self,
        number: Option<u16>,
        values: &[Encoded],
        registers: &[Register],
        now: Moment,
    ) -> Stands {
        let late = registers.iter().map(|register| register.settings.late).max().unwrap_or(Duration::ZERO);
        let is_late = number.is_some_and(|number| self.sequence.stands(number, values, now, late));
        let was_in_order = std::mem::take(&mut self.was_in_order);
        if was_in_order {
            self.taken = Some(values.to_vec());
        }
        if let Some(newest) = self.sequence.newest().filter(|_| self.is_acknowledged) {
            match &self.numbers {
                Some(numbers) if numbers.contains(newest) => {}
                // The control has set another number itself.
                Some(_) => self.numbers = Some(Numbers::after(newest)),
                None if was_in_order || !self.may_bear_an_old_number => self.numbers = Some(Numbers::after(newest)),
                None => self.numbers = Some(Numbers::perhaps(newest)),
            }
            self.may_bear_an_old_number = false;
        }
        if is_late && self.is_at_once {
            self.sent = None;
        }
        let is_untaken = self.taken.as_deref() != Some(values);
        match self.is_at_once {
            true if is_late => Stands::Untaken,
            true => Stands::AsBefore,
            false if is_untaken => Stands::Untaken,
            false => Stands::Taken,
        }
    }

    /// Number of the next set.
    pub(super) fn next_number(&self) -> u16 {
        self.numbers.map_or_else(|| self.sequence.next(), |numbers| numbers.next())
    }

    /// The control was restarted: the set follows whatever number its register holds then.
    pub(super) fn forget_number(&mut self) {
        self.sequence.forget();
        (self.numbers, self.tried) = (None, None);
    }

    /// These values have been sent, or may have been.
    pub(super) fn sends(&mut self, values: Vec<Encoded>) {
        if let Some(numbers) = &mut self.numbers
            && self.tried.as_ref().is_some_and(|tried| *tried != values)
        {
            numbers.change_values();
        }
        self.tried = Some(values.clone());
        self.sent = Some(values);
    }

    /// Result of an attempt to have the set taken.
    pub(super) fn attempt(&mut self, attempt: Attempt) {
        if attempt == Attempt::Acknowledged {
            self.tried = None;
        }
        let Some(numbers) = &mut self.numbers else { return };
        if !numbers.result(attempt) && attempt == Attempt::Acknowledged {
            // The same values follow under the next number.
            self.may_bear_an_old_number = true;
        }
    }

    /// Just that was sent.
    pub(super) fn is_sent(&self, values: &[Encoded]) -> bool {
        self.sent.as_deref() == Some(values)
    }

    /// What was sent, in counts, where some of it stands there and some does not.
    fn half_sent(&self, registers: &[Register]) -> Option<Vec<Counts>> {
        let sent = self.sent.as_ref().filter(|_| registers.iter().any(|register| register.controller.is_bound()))?;
        let values: Vec<Counts> = registers
            .iter()
            .zip(sent)
            .map(|(register, sent)| register.units.found(sent.registers()))
            .collect();
        let is_new = |place: usize| self.taken.as_ref().is_none_or(|taken| taken[place] != sent[place]);
        let mut has = (false, false);
        for (place, (register, value)) in registers.iter().zip(&values).enumerate() {
            if register.controller.is_driven() && is_new(place) {
                let stands = register.held() == *value;
                has = (has.0 || stands, has.1 || !stands);
            }
        }
        (has == (true, true)).then_some(values)
    }

    /// No half of what was sent is taken: what the rest of it is, in counts, where it is wanted once more. Not after something
    /// else has happened to one of them, and not on readings that have died: `can_hold_again` says so of each.
    pub(super) fn wanted_again(
        &mut self,
        registers: &[Register],
        can_hold_again: impl Fn(usize, Counts) -> bool,
    ) -> Option<Vec<Counts>> {
        let values = self.half_sent(registers)?;
        let can_be = values.iter().enumerate().all(|(place, value)| can_hold_again(place, *value));
        if !can_be {
            self.sent = None;
        }
        can_be.then_some(values)
    }

    /// Where what was sent before is there by half, this is all of it.
    pub(super) fn is_whole(&self, registers: &[Register], values: &[Encoded]) -> bool {
        self.half_sent(registers).is_none_or(|_| {
            let mut each = registers.iter().zip(values).zip(self.sent.iter().flatten());
            each.all(|((register, value), sent)| value == sent || !register.controller.is_driven())
        })
    }

    /// The control has taken what stands there; not so where it bears a number that the control may know: then the same is
    /// sent with the next.
    pub(super) fn is_taken(&mut self) -> bool {
        let is_known = std::mem::take(&mut self.may_bear_an_old_number);
        if !is_known {
            self.taken = self.sent.take();
        }
        !is_known
    }

    /// The control has not taken what was sent, or nobody knows.
    pub(super) fn doubt(&mut self) {
        self.taken = None;
    }
}
