//! Effects of the result of a request on the connection and on the unit: whether the connection is kept, and how long
//! the unit backs off.
//!
//! A timeout of a read over TCP leaves the connection open, because a new connection may not help. Some
//! Modbus gateways accept one client, and do not accept the next one for seconds. The line drops the
//! connection if:
//!
//! - the request was a write: the operating system may still hold its bytes;
//! - the wire could not recognise the late answer: a part of a frame was sent or received, or a second
//!   request is unanswered;
//! - the answer to a repeated request arrived so late that it may belong to the first attempt;
//! - a Modbus gateway has answered a request with the answer to an earlier request before;
//! - at least two answers in a row are missing, and more than the line has devices: the other end may have
//!   lost the connection.
//!
//! `place` is the index of a unit in the list of the line.

use std::time::Duration;

use super::{AfterTimeout, DeviceLine, MISSES};
use crate::fieldbus::connection::Connection;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::quantity::Moment;

impl DeviceLine {
    /// Updates the state of the connection and of the unit with the result of a request: its answer, or the fault.
    /// `may_keep` says whether the connection can be kept after a timeout.
    pub(super) fn settle(
        &mut self,
        place: usize,
        request: Request<'_>,
        answer: Result<Answer, Fault>,
        may_keep: bool,
        now: Moment,
    ) -> Result<Answer, Fault> {
        let Some(connection) = &mut self.wire else { return answer };
        let has_ids = connection.has_transaction_id();
        self.is_nameless = !has_ids;
        let is_behind_gateway = self.units.at(place).is_behind_gateway;
        let has_left = self.send_guard.asked().is_some();
        let is_first = has_left && !self.history.has_answered;
        self.history.has_answered |= has_left;
        let answer = match answer {
            Err(Fault::BROKEN) if is_first && has_ids => {
                self.gateway.refuses_connection();
                Err(self.dial.turned_away())
            }
            answer => answer,
        };
        match &answer {
            // The request was not sent, so the result says nothing about the device.
            Err(Fault::Caller(_)) => {}
            // The Modbus gateway has answered instead of the unit.
            Err(fault) if is_behind_gateway && fault.is_of_a_gateway() => {
                self.misses = 0;
                self.history.answers = self.history.answers.saturating_add(1);
                self.evidence.answered();
                self.note_gateway_miss(place, *fault);
                self.note_miss(place, request, *fault, now);
                self.put_down(place);
            }
            Err(fault) if fault.spoils_connection() => {
                self.misses += 1;
                let is_lost = matches!(fault, Fault::Link(_) | Fault::Peer(PeerFault::Unasked));
                if *fault == Fault::Peer(PeerFault::OutOfOrder) {
                    // This pause comes first: the wait for a late answer may extend it.
                    self.rest_out_of_order(place, now);
                }
                // A write that was given up must not leave this computer later. Closing the connection discards it.
                let may_keep = may_keep && request.is_read() && *fault == Fault::Timeout;
                let is_kept = has_ids && may_keep && self.keeps_connection();
                let is_renewed = if has_ids { !is_kept } else { is_lost || self.misses >= MISSES };
                // After timeouts on a connection that has worked before, the device may answer on another connection.
                let is_worn_out =
                    *fault == Fault::Timeout && is_renewed && self.misses > 1 && self.history.answers > 0;
                if is_renewed {
                    self.misses = 0;
                    let unanswered = self.drop_connection().filter(|_| !matches!(fault, Fault::Link(_)));
                    if let Some(read) = unanswered {
                        self.note_lost_read(read, now);
                    }
                }
                if has_ids && is_behind_gateway && has_left && *fault == Fault::Timeout {
                    self.note_gateway_miss(place, *fault);
                }
                if has_ids && !(is_behind_gateway && has_left && !matches!(fault, Fault::Link(_))) {
                    // The pause begins at the end of the timeout. Otherwise, several dead units would leave no pause.
                    let waited = if *fault == Fault::Timeout { self.timeout } else { Duration::ZERO };
                    let unit = self.units.at_mut(place);
                    match is_worn_out {
                        true => unit.breaker.succeed(),
                        false => unit.breaker.fail(now.after(waited)),
                    }
                    unit.last_fault = *fault;
                } else {
                    self.note_miss(place, request, *fault, now);
                }
            }
            _ => {
                self.misses = 0;
                self.history.answers = self.history.answers.saturating_add(1);
                self.evidence.answered();
                let asked = self.send_guard.asked().unwrap_or(now);
                let unit = self.units.at_mut(place);
                unit.received = asked;
                unit.breaker.succeed();
                self.put_down(place);
            }
        }
        answer
    }

    /// Returns whether the line keeps the connection after a timeout. If so, the wire discards the late answer when it
    /// arrives.
    fn keeps_connection(&mut self) -> bool {
        let most = MISSES.max(self.units.count() + 1);
        self.after_timeout == AfterTimeout::Keep
            && self.misses < most
            && self.gateway.returns_numbers()
            && self.wire.as_mut().and_then(Connection::modbus).is_some_and(|modbus| modbus.give_up())
    }

    /// Prepares the connection for a request: connects if necessary, waits for the Modbus gateway, discards late input,
    /// and waits for the pause of the unit. Returns [`Answer::Done`] on success.
    pub(super) async fn make_ready(
        &mut self,
        place: usize,
        request: Request<'_>,
        now: Moment,
    ) -> Result<Answer, Fault> {
        if self.wire.is_none() {
            self.connect(now).await?;
        }
        self.wait_for_gateway(place).await?;
        self.wait_for_late(place, request).await?;
        if !self.history.is_opened {
            self.send_opening_read(place, request).await?;
            self.wait_for_late(place, request).await?;
        }
        let unit = self.units.at(place);
        let pause = unit.quirks.pause_between_requests;
        if self.history.needs_pause && !pause.is_zero() {
            self.send_guard.away_for(pause);
            tokio::time::sleep(pause).await;
            self.send_guard.sample();
        }
        self.history.needs_pause = true;
        Ok(Answer::Done)
    }
}
