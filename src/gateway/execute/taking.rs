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
    pub(super) sequence: Sequence,
    /// What is sent next may bear the number that the control took last: a run before this one may have sent it.
    may_bear_an_old_number: bool,
}

impl Taking {
    /// At a start. What stands in these registers is perhaps not taken, if the last run did not end in order.
    pub(super) fn new(
        profile: &Profile,
        id: SetId,
        was_in_order: bool,
        registers: &mut [Register],
    ) -> Taking {
        let set = profile.set(id);
        let is_in_nodes = set.is_in_nodes(profile);
        let is_in_one = set.sequence.is_none() || stretches(profile, set).len() == 1;
        let is_at_once = set.handshake.is_none() && is_in_one && !is_in_nodes;
        let has_numbers = set.sequence.is_some();
        let is_bound = !was_in_order && (has_numbers || !is_at_once);
        registers.iter_mut().for_each(|register| register.is_bound = is_bound);
        Taking {
            is_at_once,
            is_in_nodes,
            sent: None,
            taken: None,
            was_in_order,
            sequence: Sequence::default(),
            may_bear_an_old_number: is_bound && has_numbers,
        }
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
        registers: &mut [Register],
        now: Moment,
    ) {
        let late = registers.iter().map(|register| register.settings.late).max().unwrap_or(Duration::ZERO);
        let is_late = number.is_some_and(|number| self.sequence.stands(number, values, now, late));
        if std::mem::take(&mut self.was_in_order) {
            self.taken = Some(values.to_vec());
        }
        if is_late && self.is_at_once {
            self.sent = None;
        }
        let is_untaken = self.taken.as_deref() != Some(values);
        for register in registers {
            register.is_bound = if self.is_at_once { register.is_bound || is_late } else { is_untaken };
        }
    }

    /// These values have been sent, or may have been.
    pub(super) fn sends(&mut self, values: Vec<Encoded>) {
        self.sent = Some(values);
    }

    /// Not all of it was answered as done.
    pub(super) fn is_not_done(&self, registers: &mut [Register]) {
        registers.iter_mut().for_each(|register| register.is_bound |= !self.is_at_once);
    }

    /// Just that was sent.
    pub(super) fn is_sent(&self, values: &[Encoded]) -> bool {
        self.sent.as_deref() == Some(values)
    }

    /// What was sent, in counts, where some of it stands there and some does not.
    fn half_sent(&self, registers: &[Register]) -> Option<Vec<Counts>> {
        let sent = self.sent.as_ref().filter(|_| registers.iter().any(|register| register.is_bound))?;
        let values: Vec<Counts> = registers
            .iter()
            .zip(sent)
            .map(|(register, sent)| register.units.found(sent.registers()))
            .collect();
        let is_new = |place: usize| self.taken.as_ref().is_none_or(|taken| taken[place] != sent[place]);
        let mut has = (false, false);
        for (place, (register, value)) in registers.iter().zip(&values).enumerate() {
            if register.is_driven() && is_new(place) {
                let stands = register.stands() == *value;
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
            each.all(|((register, value), sent)| value == sent || !register.is_driven())
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
