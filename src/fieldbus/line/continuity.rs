//! Detection of devices that may have been exchanged or restarted (breaks of their continuity), see
//! [`isotherm_core::continuity`].
//!
//! A device that is exchanged, or switched off and on, breaks its connections. A connection that was refused,
//! or that did not end with an orderly close, is therefore evidence of a break. Some servers close each
//! connection after its answer, or when it is idle. Such a close is no evidence of a break.
//!
//! `place` is the index of a unit in the list of the line.

use std::time::Duration;

use super::DeviceLine;
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::{Answer, Ending};
use isotherm_core::continuity::Break;
use isotherm_core::quantity::Moment;

/// Maximum time between two orderly closes of connections. Two closes within this time count as a habit of the server,
/// and not as a broken contact.
const HABIT: Duration = Duration::from_secs(3600);
/// Time without an answer of the device, after which a timeout that ends the connection counts as a broken
/// contact. At the usual polling periods, one lost answer causes a shorter silence.
const SILENCE: Duration = Duration::from_secs(3);

impl DeviceLine {
    /// Returns whether the device has checks, and has not passed them since the last loss of contact. A check compares
    /// a value of the device (key `verify`) or the OPC UA namespaces with the expected content.
    pub(super) fn is_unverified(&self, place: usize) -> bool {
        let unit = self.units.at(place);
        unit.is_checked && self.observer.as_ref().is_some_and(|observer| !observer.is_verified(unit.device))
    }

    /// Reports a broken contact with the device to the observer, if the result of a request shows it.
    pub(super) fn check_for_break(&mut self, place: usize, answer: &Result<Answer, Fault>, now: Moment) {
        let (Err(fault), Some(connection)) = (answer, &mut self.wire) else { return };
        let ending = connection.wire().ending();
        let unit = self.units.at(place);
        let broken = match connection.has_transaction_id() {
            // Without transaction numbers a missed answer leaves the connection open.
            false if *fault == Fault::Timeout => BrokenContact::None,
            _ => self.evidence.ends(*fault, ending, unit.received, now),
        };
        match broken {
            BrokenContact::None => {}
            BrokenContact::Unit => self.unit_breaks(unit.number, Break::ConnectionLost),
            BrokenContact::All => self.all_break(Break::ConnectionLost),
        }
    }

    /// Reports to the observer that contact with the devices of this unit number was lost.
    pub(super) fn unit_breaks(&self, number: u8, cause: Break) {
        let Some(observer) = &self.observer else { return };
        self.units.named(number).for_each(|device| observer.breaks(Some(device), cause));
    }

    /// Reports to the observer that contact with all devices of the line was lost.
    pub(super) fn all_break(&self, cause: Break) {
        let Some(observer) = &self.observer else { return };
        observer.breaks(None, cause);
    }
}

/// Record of how the connections of one line ended.
#[derive(Debug, Default)]
pub(super) struct Evidence {
    /// Number of answers on the present connection.
    answers: u32,
    /// Time of the last orderly close by the other end; `None` if no such close is known.
    closed_at: Option<Moment>,
}

/// Devices with which the gateway lost contact when a request failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BrokenContact {
    None,
    /// Only the devices with the unit number of the request.
    Unit,
    /// All devices of the line.
    All,
}

impl Evidence {
    /// Records that a new connection was opened.
    pub(super) fn connected(&mut self) {
        self.answers = 0;
    }

    /// Counts an answer on the present connection.
    pub(super) fn answered(&mut self) {
        self.answers = self.answers.saturating_add(1);
    }

    /// Returns the devices with which contact was lost, after a request has failed with `fault` and the connection has
    /// ended with `ending`. `received` is the time of the last request that the device has answered.
    pub(super) fn ends(
        &mut self,
        fault: Fault,
        ending: Ending,
        received: Moment,
        now: Moment,
    ) -> BrokenContact {
        match (fault, ending) {
            (_, Ending::Kept) => BrokenContact::None,
            (Fault::Link(_), Ending::Closed) => {
                let before = self.closed_at.replace(now);
                let by_habit = before.is_some_and(|before| now.since(before) < HABIT);
                match self.answers {
                    1 => BrokenContact::None,
                    2.. if by_habit => BrokenContact::None,
                    _ => BrokenContact::All,
                }
            }
            (Fault::Link(_), Ending::Lost) => BrokenContact::All,
            (Fault::Timeout, Ending::Closed | Ending::Lost) if now.since(received) > SILENCE => {
                BrokenContact::Unit
            }
            _ => BrokenContact::None,
        }
    }
}

#[cfg(test)]
mod tests;
