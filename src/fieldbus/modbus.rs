//! Modbus TCP: frames with a transaction number.
//!
//! - A transaction number begins anywhere, so that a device which numbers answers of its own from zero, as every
//!   simple client does, meets none of ours.
//! - Before a question there is nothing to be read: bytes that answer no open question close the connection, as does
//!   whatever comes behind an answer.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};
use std::io;

use super::departure::Departure;
use super::error::{CallerFault, Fault, PeerFault};
use super::pdu;
use super::port::{Port, Tapped};
use super::tls::tls_fault;
use super::trace::Tap;
use super::wire::{Answer, Boxed, Request, Wire};

/// Transaction, protocol and length, behind which the length counts; and the unit.
const HEADER: usize = 6;
/// Header, unit and the longest message.
const LONGEST: usize = HEADER + 1 + pdu::LONGEST;

/// An open Modbus TCP connection.
pub struct ModbusTcp {
    port: Tapped,
    transaction: u16,
    question: Vec<u8>,
}

impl ModbusTcp {
    /// On this port, whose bytes pass the tap.
    pub fn new(port: impl Port + 'static, tap: &Tap) -> ModbusTcp {
        let [low, high, ..] = RandomState::new().build_hasher().finish().to_le_bytes();
        let transaction = u16::from_le_bytes([low, high]);
        ModbusTcp { port: Tapped::new(port, tap), transaction, question: Vec::with_capacity(LONGEST) }
    }

    pub(super) async fn exchange(
        &mut self,
        unit: u8,
        request: Request<'_>,
        departure: &mut Departure,
    ) -> Result<Answer, Fault> {
        if matches!(request, Request::Can(_)) {
            return Err(Fault::Caller(CallerFault::Function));
        }
        let mut received = [0; 2 * LONGEST];
        match self.port.take_waiting(&mut received) {
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
            Err(error) => return Err(tls_fault(&error).unwrap_or(Fault::CLOSED)),
            Ok(0) => return Err(Fault::CLOSED),
            Ok(_) => return Err(Fault::Peer(PeerFault::Unasked)),
        }
        self.transaction = self.transaction.wrapping_add(1);
        self.frame(unit, request);
        departure.leave()?;
        let broken = |error| tls_fault(&error).unwrap_or(Fault::BROKEN);
        self.port.send(&self.question).await.map_err(broken)?;
        let mut filled = 0;
        loop {
            filled += match self.port.receive(&mut received[filled..]).await.map_err(broken)? {
                0 => return Err(Fault::BROKEN),
                count => count,
            };
            if let Some(message) = self.message(&received[..filled], unit)? {
                return pdu::answer(request, message);
            }
        }
    }

    fn frame(&mut self, unit: u8, request: Request<'_>) {
        self.question.clear();
        self.question.extend(self.transaction.to_be_bytes());
        self.question.extend([0, 0, 0, 0, unit]);
        pdu::question(request, &mut self.question);
        let length = u16::try_from(self.question.len() - HEADER).unwrap_or(u16::MAX);
        self.question[4..HEADER].copy_from_slice(&length.to_be_bytes());
    }

    /// The message in what has come; `None` while it is not whole.
    fn message<'a>(&self, received: &'a [u8], unit: u8) -> Result<Option<&'a [u8]>, Fault> {
        let Some((header, rest)) = received.split_at_checked(HEADER) else { return Ok(None) };
        let number = |at: usize| u16::from_be_bytes([header[at], header[at + 1]]);
        let length = usize::from(number(4));
        if number(2) != 0 || !(2..=1 + pdu::LONGEST).contains(&length) {
            return Err(Fault::Peer(PeerFault::Malformed));
        }
        if number(0) != self.transaction || rest.first().is_some_and(|answers| *answers != unit) {
            return Err(Fault::Peer(PeerFault::Foreign));
        }
        match rest.len() {
            came if came < length => Ok(None),
            came if came > length => Err(Fault::Peer(PeerFault::Unasked)),
            _ => Ok(Some(&rest[1..])),
        }
    }
}

impl Wire for ModbusTcp {
    fn exchange<'a>(
        &'a mut self,
        unit: u8,
        request: Request<'a>,
        departure: &'a mut Departure,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(self.exchange(unit, request, departure))
    }
}

#[cfg(test)]
mod tests;
