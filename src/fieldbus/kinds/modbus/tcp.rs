//! Modbus TCP: frames with a transaction number.
//!
//! - Transaction numbers are random. A device that answers with its own count, or with a number that is one
//!   too high, is therefore detected: the numbers do not match.
//! - A late answer has the transaction number of a request of this connection that was given up after its
//!   timeout. The wire (the code for this connection) discards the late answer and keeps the connection, see
//!   `given_up`.
//! - All other bytes that answer no open request close the connection, and so do bytes after an answer. The
//!   wire recognizes input that arrived before the request by its transaction number.
//! - Before a write, and while a late answer is expected, the wire checks for input before it sends the
//!   request. If it finds any except late answers, it does not send the request.
//! - A write directly after an answer skips this check, because nothing else had arrived with the answer. The
//!   write after the first answer of a connection does not skip the check. Some servers close each connection
//!   after one answer, and the outcome of the write would then be unknown.
//! - A read may be sent in the same TCP segment after another request, with its own transaction number.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};
use std::io;
use std::time::Duration;

use super::pdu;
use super::reply_signature::ReplySignature;
use super::request::ModbusRequest;
use super::text;
use super::wire::{LateReply, ModbusWire};
use crate::fieldbus::error::{CallerFault, Fault, LinkFault, PeerFault};
use crate::fieldbus::port::{Port, Tapped, is_in_order};
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::{Answer, Boxed, Call, Ending, Request, Wire};
use crate::tls::TlsFault;
use follow_up_read::FollowUpRead;
use given_up::{GivenUp, SentRequest};
use isotherm_core::quantity::Moment;

mod follow_up_read;
mod given_up;

/// Length in bytes of the fields transaction, protocol and length. The length field counts the bytes after these three
/// fields.
const HEADER: usize = 6;
/// Length in bytes of header, unit number and the longest message.
const LONGEST: usize = HEADER + 1 + pdu::LONGEST;
/// Time after an answer in which a write skips the check for unexpected input. The input was checked together with that
/// answer. Another check would make a loop on one computer about one percent slower.
const AT_ONCE: Duration = Duration::from_millis(1);

/// Open Modbus TCP connection, with its unanswered and its given up requests.
pub struct ModbusTcp {
    port: Tapped,
    /// State of the random number generator for transaction numbers.
    drawn: u64,
    question: Vec<u8>,
    /// Receive buffer; its first `filled` bytes are received and not processed yet.
    received: Box<[u8; 2 * LONGEST]>,
    filled: usize,
    behind: FollowUpRead,
    /// Request whose answer has not arrived yet; `None` if the last request was answered.
    open: Option<SentRequest>,
    /// Whether the present request may have been sent only in part.
    is_sending: bool,
    given_up: GivenUp,
    /// Form (function and length) of the received answer to the present request; `None` before it arrives.
    form: Option<ReplySignature>,
    /// Whether a request was answered on this connection.
    has_answered: bool,
    /// Time at which the last answer arrived. `Moment::default()` if no answer, or only the first answer of the
    /// connection, has arrived.
    answered: Moment,
    ending: Ending,
}

/// First frame in the receive buffer, which may still be incomplete.
struct First {
    transaction: u16,
    unit: Option<u8>,
    /// End of the frame in the buffer; `None` while the frame is incomplete.
    end: Option<usize>,
}

impl ModbusTcp {
    /// Returns a connection on this port. `tap` receives all its bytes.
    pub fn new(port: impl Port + 'static, tap: &Tap) -> ModbusTcp {
        ModbusTcp {
            port: Tapped::new(port, tap),
            // Xorshift would stay at zero.
            drawn: RandomState::new().build_hasher().finish().max(1),
            question: Vec::with_capacity(LONGEST),
            received: Box::new([0; 2 * LONGEST]),
            filled: 0,
            behind: FollowUpRead::default(),
            open: None,
            is_sending: false,
            given_up: GivenUp::default(),
            form: None,
            has_answered: false,
            answered: Moment::default(),
            ending: Ending::Lost,
        }
    }

    pub(in crate::fieldbus) async fn exchange(
        &mut self,
        unit: u8,
        request: Request<'_>,
        send_guard: &mut SendGuard,
    ) -> Result<Answer, Fault> {
        let Request::Modbus(request) = request else { return Err(Fault::Caller(CallerFault::Function)) };
        (self.form, self.open) = (None, None);
        if let Some((transaction, asked)) = self.behind.take_unanswered(unit, request) {
            // The request was sent, even if it gets no answer.
            send_guard.left(asked);
            self.open = Some(SentRequest { transaction, unit, asked });
            let answer = |message: &[u8]| pdu::answer(request, message);
            return self.receive_answer((transaction, unit), send_guard, answer).await;
        }
        if let Some((transaction, unit, request)) = self.behind.unanswered() {
            let answer = |message: &[u8]| Ok(pdu::answer(request, message));
            let answer = self.receive_answer((transaction, unit), send_guard, answer).await?;
            self.behind.answered(answer);
            self.form = None;
        }
        if let Some((answer, asked)) = self.behind.take(unit, request, send_guard) {
            send_guard.left(asked);
            return answer;
        }
        let may_hide_input = !request.is_read() && send_guard.last_sample().since(self.answered) >= AT_ONCE;
        if may_hide_input || self.given_up.is_expected() {
            self.check_input()?;
        }
        self.question.clear();
        let transaction = self.frame(unit, request);
        let behind = self.behind.take_question();
        let behind = behind.map(|(unit, request)| (unit, request, self.frame(unit, request)));
        let asked = send_guard.leave()?;
        self.is_sending = true;
        self.port.send(&self.question).await.map_err(|error| self.ended(Some(&error), Fault::BROKEN))?;
        self.is_sending = false;
        self.open = Some(SentRequest { transaction, unit, asked });
        if let Some((unit, request, transaction)) = behind {
            self.behind.left(unit, request, transaction, asked);
        }
        self.answered = Moment::default();
        let answer = |message: &[u8]| pdu::answer(request, message);
        let answer = self.receive_answer((transaction, unit), send_guard, answer).await?;
        if std::mem::replace(&mut self.has_answered, true) {
            self.answered = send_guard.now();
        }
        Ok(answer)
    }

    /// Checks that no input has arrived without a request. Late answers are allowed and discarded.
    fn check_input(&mut self) -> Result<(), Fault> {
        loop {
            match self.port.take_waiting(&mut self.received[self.filled..]) {
                Err(error)
                    if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) =>
                {
                    return Ok(());
                }
                Err(error) => return Err(self.ended(Some(&error), Fault::CLOSED)),
                Ok(0) => return Err(self.ended(None, Fault::CLOSED)),
                Ok(count) => self.filled += count,
            }
            // The time of arrival is not known: the input may have waited in the socket.
            self.discard_late(None)?;
        }
    }

    /// Discards the late answers in the receive buffer. `received` is the time of their arrival, if it is known.
    ///
    /// # Errors
    /// The buffer contains other input.
    fn discard_late(&mut self, received: Option<Moment>) -> Result<(), Fault> {
        self.discard_late_frames(received).map_err(|_| Fault::UNASKED)?;
        if self.filled == 0 { Ok(()) } else { Err(Fault::UNASKED) }
    }

    /// Discards the complete late answers at the beginning of the receive buffer.
    ///
    /// # Errors
    /// The next frame is not a late answer.
    fn discard_late_frames(&mut self, received: Option<Moment>) -> Result<(), Fault> {
        while let Some(first) = self.first()? {
            if !self.given_up.expects(&first) {
                return Err(Fault::Peer(PeerFault::Foreign));
            }
            let Some(end) = first.end else { break };
            self.discard_first(&first, end, received);
        }
        Ok(())
    }

    /// Discards the first frame in the receive buffer, which is a late answer and ends at `end`.
    fn discard_first(&mut self, first: &First, end: usize, received: Option<Moment>) {
        self.given_up.answered(first, &self.received[HEADER + 1..end], received);
        self.forget_first(end);
    }

    /// Receives and discards late answers until the answer to this given up request has arrived.
    async fn receive_late(
        &mut self,
        (unit, asked): (u8, Moment),
        send_guard: &mut SendGuard,
    ) -> Result<(), Fault> {
        loop {
            self.discard_late_frames(Some(send_guard.now()))?;
            if !self.given_up.contains(unit, asked) {
                return if self.filled == 0 { Ok(()) } else { Err(Fault::UNASKED) };
            }
            match self.port.receive(&mut self.received[self.filled..]).await {
                Ok(0) => return Err(self.ended(None, Fault::CLOSED)),
                Ok(count) => self.filled += count,
                Err(error) => return Err(self.ended(Some(&error), Fault::CLOSED)),
            }
        }
    }

    /// Appends the frame of a request to `question`, the bytes to send. Returns the transaction number of the request.
    fn frame(&mut self, unit: u8, request: ModbusRequest<'_>) -> u16 {
        let transaction = self.draw();
        let begin = self.question.len();
        self.question.extend(transaction.to_be_bytes());
        self.question.extend([0, 0, 0, 0, unit]);
        pdu::question(request, &mut self.question);
        let length = u16::try_from(self.question.len() - begin - HEADER).unwrap_or(u16::MAX);
        self.question[begin + 4..begin + HEADER].copy_from_slice(&length.to_be_bytes());
        transaction
    }

    /// Draws the next transaction number, by Marsaglia's xorshift. It differs from the last number, because two
    /// requests may be open, and from the numbers of given up requests.
    fn draw(&mut self) -> u16 {
        let last = self.drawn >> 48;
        loop {
            self.drawn ^= self.drawn << 13;
            self.drawn ^= self.drawn >> 7;
            self.drawn ^= self.drawn << 17;
            let drawn = u16::try_from(self.drawn >> 48).unwrap_or_default();
            if self.drawn >> 48 != last && !self.given_up.has(drawn) {
                return drawn;
            }
        }
    }

    /// Waits for the answer to this request. If a read was sent directly after the request, its answer is stored for
    /// later. The two answers may arrive in any order.
    async fn receive_answer<T>(
        &mut self,
        (transaction, unit): (u16, u8),
        send_guard: &mut SendGuard,
        answer: impl FnOnce(&[u8]) -> Result<T, Fault>,
    ) -> Result<T, Fault> {
        loop {
            while let Some(first) = self.first()? {
                let behind = self.behind.unanswered();
                let is_wanted = first.answers(transaction, unit);
                let is_late = !is_wanted && self.given_up.expects(&first);
                let is_behind = behind.is_some_and(|(number, unit, _)| first.answers(number, unit));
                if !is_wanted && !is_late && !is_behind {
                    return Err(Fault::Peer(first.answers_nothing(transaction)));
                }
                let Some(end) = first.end else { break };
                if is_late {
                    self.discard_first(&first, end, Some(send_guard.now()));
                    continue;
                }
                let message = &self.received[HEADER + 1..end];
                if is_wanted {
                    let is_last = behind.is_none_or(|(number, ..)| number == transaction);
                    self.form = ReplySignature::of_answer(message);
                    let answered = answer(message);
                    self.open = None;
                    self.forget_first(end);
                    if is_last && self.filled > 0 {
                        self.discard_late(Some(send_guard.now()))?;
                    }
                    return answered;
                }
                if let Some((_, _, request)) = behind {
                    let answered = pdu::answer(request, message);
                    self.behind.answered(answered);
                }
                self.forget_first(end);
            }
            match self.port.receive(&mut self.received[self.filled..]).await {
                Ok(0) => return Err(self.ended(None, Fault::BROKEN)),
                Ok(count) => self.filled += count,
                Err(error) => return Err(self.ended(Some(&error), Fault::BROKEN)),
            }
        }
    }

    /// Records whether the connection ended in an orderly way or with an error. Returns the TLS fault in `error`, if
    /// there is one, or else `otherwise`.
    fn ended(&mut self, error: Option<&io::Error>, otherwise: Fault) -> Fault {
        if self.filled == 0 && is_in_order(error) {
            self.ending = Ending::Closed;
        }
        error.and_then(TlsFault::of).map_or(otherwise, |fault| Fault::Link(LinkFault::Tls(fault)))
    }

    /// Returns the first frame in the receive buffer; `None` while the buffer contains less than a header.
    fn first(&self) -> Result<Option<First>, Fault> {
        let Some((header, rest)) = self.received[..self.filled].split_at_checked(HEADER) else {
            return Ok(None);
        };
        let number = |at: usize| u16::from_be_bytes([header[at], header[at + 1]]);
        let length = usize::from(number(4));
        if number(2) != 0 || !(2..=1 + pdu::LONGEST).contains(&length) {
            let text = text::recognise(&self.received[..self.filled]);
            return Err(Fault::Peer(text.map_or(PeerFault::Malformed, PeerFault::Text)));
        }
        let end = (rest.len() >= length).then_some(HEADER + length);
        Ok(Some(First { transaction: number(0), unit: rest.first().copied(), end }))
    }

    fn forget_first(&mut self, end: usize) {
        self.received.copy_within(end..self.filled, 0);
        self.filled -= end;
    }
}

impl First {
    fn answers(&self, transaction: u16, unit: u8) -> bool {
        self.transaction == transaction && self.unit.is_none_or(|from| from == unit)
    }

    /// Returns the fault of a frame that answers no open request. `transaction` is the number of the present request. A
    /// server repeats this number even if its answer has another unit number.
    fn answers_nothing(&self, transaction: u16) -> PeerFault {
        match self.unit {
            Some(unit) if self.transaction == transaction => PeerFault::Unit(unit),
            _ => PeerFault::Foreign,
        }
    }
}

impl Wire for ModbusTcp {
    fn exchange<'a>(&'a mut self, unit: u8, request: Request<'a>, send_guard: &'a mut SendGuard) -> Call<'a> {
        Box::pin(self.exchange(unit, request, send_guard))
    }

    /// Returns the fault of a request without an answer. If text of another protocol has arrived, the fault
    /// names this protocol, even if the text is shorter than a header. Otherwise the fault is
    /// [`Fault::Timeout`].
    fn missed(&mut self) -> Fault {
        let text = text::recognise(&self.received[..self.filled]);
        text.map_or(Fault::Timeout, |text| Fault::Peer(PeerFault::Text(text)))
    }

    fn ending(&mut self) -> Ending {
        self.ending
    }
}

impl ModbusWire for ModbusTcp {
    fn give_up(&mut self) -> bool {
        // The rest of a frame could not be distinguished from the beginning of the next one.
        let is_between_frames = self.filled == 0 && !self.is_sending && !self.behind.is_under_way();
        if is_between_frames {
            self.given_up.extend(self.open.take());
        }
        is_between_frames
    }

    fn expects_late(&self, unit: u8, asked: Moment) -> bool {
        self.given_up.contains(unit, asked)
    }

    fn discard_arrived(&mut self) -> Result<(), Fault> {
        self.check_input()
    }

    fn await_late<'a>(
        &'a mut self,
        request: (u8, Moment),
        send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<(), Fault>> {
        Box::pin(self.receive_late(request, send_guard))
    }

    fn late_replies(&mut self) -> Vec<LateReply> {
        self.given_up.take_replies()
    }

    fn set_follow_up(&mut self, read: Option<(u8, Request<'static>)>) {
        self.behind.ask(read);
    }

    fn has_follow_up(&self) -> bool {
        self.behind.is_under_way()
    }

    fn unanswered_behind(&self) -> Option<(u8, Request<'static>, Moment)> {
        self.behind.unanswered_since()
    }

    fn received_form(&self) -> Option<ReplySignature> {
        self.form
    }
}

#[cfg(test)]
mod tests;
