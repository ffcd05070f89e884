//! Continuity of devices: whether another device may answer next.
//!
//! A device that is exchanged, or switched off and on, breaks its connections. So each connection that was refused, or did
//! not end with an orderly close, is a possible exchange. A server that closes each connection after its answer, or
//! whenever it is idle, does so by habit. Those closes are no exchange.

use std::time::Duration;

use super::DeviceLine;
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::{Answer, Ending};
use isotherm_core::quantity::Moment;

/// A server that closed a connection this recently closes them by habit.
const HABIT: Duration = Duration::from_secs(3600);
/// A device may have been exchanged if it has not answered for longer than this. At the usual periods one lost answer is
/// shorter.
const SILENCE: Duration = Duration::from_secs(3);

impl DeviceLine {
    /// Whether the device has checks that have not passed since its last possible exchange.
    pub(super) fn is_unverified(&self, place: usize) -> bool {
        let unit = self.units.at(place);
        unit.is_checked && self.witness.as_ref().is_some_and(|witness| !witness.is_verified(unit.device))
    }

    /// Reports a possible exchange if a request ended like this on an open connection.
    pub(super) fn look_for_exchange(&mut self, place: usize, answer: &Result<Answer, Fault>, now: Moment) {
        let (Err(fault), Some(connection)) = (answer, &mut self.wire) else { return };
        let ending = connection.wire().ending();
        let unit = self.units.at(place);
        let exchanged = match connection.wire().has_transaction_id() {
            // Without transaction numbers a missed answer leaves the connection open.
            false if *fault == Fault::Timeout => Exchanged::None,
            _ => self.continuity.ends(*fault, ending, unit.heard, now),
        };
        match exchanged {
            Exchanged::None => {}
            Exchanged::Unit => self.unit_may_be_exchanged(unit.number),
            Exchanged::All => self.all_may_be_exchanged(),
        }
    }

    /// Reports the devices with this unit number.
    pub(super) fn unit_may_be_exchanged(&self, number: u8) {
        let Some(witness) = &self.witness else { return };
        self.units.named(number).for_each(|device| witness.may_be_exchanged(Some(device)));
    }

    /// Reports all devices of the line.
    pub(super) fn all_may_be_exchanged(&self) {
        let Some(witness) = &self.witness else { return };
        witness.may_be_exchanged(None);
    }
}

/// Evidence of continuity on one line.
#[derive(Debug, Default)]
pub(super) struct Continuity {
    /// Answers on the present connection.
    answers: u32,
    /// When the other end last closed a connection in order.
    closed_at: Option<Moment>,
}

/// Devices that may have been exchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Exchanged {
    None,
    /// The devices with the unit number of the request.
    Unit,
    /// All devices of the line.
    All,
}

impl Continuity {
    /// Notes a new connection.
    pub(super) fn connected(&mut self) {
        self.answers = 0;
    }

    /// Notes an answer.
    pub(super) fn answered(&mut self) {
        self.answers = self.answers.saturating_add(1);
    }

    /// Returns the devices that may have been exchanged if a request ends with this fault and ending. `heard` is the time
    /// of the device's last answer.
    pub(super) fn ends(&mut self, fault: Fault, ending: Ending, heard: Moment, now: Moment) -> Exchanged {
        match (fault, ending) {
            (_, Ending::Kept) => Exchanged::None,
            (Fault::Link(_), Ending::Closed) => {
                let before = self.closed_at.replace(now);
                let by_habit = before.is_some_and(|before| now.since(before) < HABIT);
                match self.answers {
                    1 => Exchanged::None,
                    2.. if by_habit => Exchanged::None,
                    _ => Exchanged::All,
                }
            }
            (Fault::Link(_), Ending::Lost) => Exchanged::All,
            (Fault::Timeout, Ending::Closed | Ending::Lost) if now.since(heard) > SILENCE => Exchanged::Unit,
            _ => Exchanged::None,
        }
    }
}

#[cfg(test)]
mod tests;
