//! Modbus RTU, on a serial port or through a TCP connection.
//!
//! - Before a request, noise is discarded, and the line must be silent for 3.5 characters (1.75 ms above 19,200 baud).
//!   A whole frame of the addressed unit is not noise but an unsolicited answer. If one has arrived, the request is not
//!   sent.
//! - An answer is recognized by its unit, length and checksum. Noise before the answer, and answers of other units, are
//!   skipped. If a second answer of the unit follows, both are rejected.
//! - RTU has no transaction number. After a missing answer, [`crate::fieldbus::line`] therefore sends the unit no
//!   request for which the late answer could be mistaken ([`super::pending_replies`]). The late answer is discarded in
//!   this module when it arrives.
//! - An adapter without echo suppression receives its own requests. The first read detects such an adapter. From then
//!   on, the echo of every request is expected before its answer. An echo never counts as an invalid answer, even if it
//!   arrives late, in parts or with noise.
//! - A frame that equals a read request counts as the echo of this request, not as the answer. Only a read of
//!   17 to 24 bits from 0x0300 to 0x03FF can have an answer that equals its request. Such an answer is also
//!   discarded.

use std::io;
use std::time::Duration;

use super::pdu;
use super::reply_signature::ReplySignature;
use super::request::ModbusRequest;
use super::wire::{ForeignFrame, ModbusWire};
use crate::clock::{Silence, WallTimeout};
use crate::fieldbus::error::{CallerFault, Fault, PeerFault};
use crate::fieldbus::port::{Port, Tapped, is_in_order};
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::{Answer, Boxed, Call, Ending, Request, Wire};
use isotherm_profile::Serial;

mod frame;
mod invalid;

use frame::{Frame, Reply};

/// Maximum number of received bytes that are kept and searched for an answer. Older bytes are dropped.
const MOST_KEPT: usize = 2 * frame::LONGEST;
/// Maximum number of frames of other masters that are recorded in one exchange.
const MOST_OVERHEARD: usize = 16;

/// Open line with RTU frames: a serial port, or a TCP connection to a simple Modbus gateway.
pub struct Rtu {
    port: Tapped,
    /// Settings of the serial port; `None` if the frames go through a TCP connection.
    serial: Option<Serial>,
    silence: Silence,
    patience: WallTimeout,
    received: Vec<u8>,
    /// Fault of input that was discarded since the last request: noise before the answer, or a frame of another unit.
    /// `None` if there was no such input.
    heard: Option<PeerFault>,
    /// Whether the serial adapter receives the gateway's own requests, because it has no echo suppression.
    echoes: bool,
    /// Whether the last request itself was received (an echo), but no answer to it.
    came_back: bool,
    /// Frame of the last request. Its echo may arrive even after the timeout of the answer.
    last_question: Vec<u8>,
    /// Frame of the request before the last request. Its echo may arrive late.
    question_before: Vec<u8>,
    /// Length in bytes of the answer to the last request.
    answer_length: usize,
    /// Discarded input since the last answer. The line searches this input for whole frames, because a whole frame is
    /// not noise.
    discarded: Vec<u8>,
    /// Unit and form (function and length) of each late answer that may still arrive. `late`: units whose late answers
    /// have arrived.
    pending: Vec<(u8, ReplySignature)>,
    late: Vec<u8>,
    /// Received frames of other masters. For each unit and form (function and length), only one frame is recorded.
    overheard: Vec<ForeignFrame>,
    ending: Ending,
}

impl Rtu {
    /// Returns an RTU line on this port. The pauses between frames follow from the settings `serial`. `tap` receives
    /// all bytes of the line.
    pub fn new(port: impl Port + 'static, serial: Option<Serial>, tap: &Tap) -> Rtu {
        Rtu {
            port: Tapped::new(port, tap),
            serial,
            silence: Silence::begin(),
            patience: WallTimeout::new(),
            received: Vec::new(),
            heard: None,
            echoes: false,
            came_back: false,
            last_question: Vec::new(),
            question_before: Vec::new(),
            answer_length: 0,
            discarded: Vec::new(),
            pending: Vec::new(),
            late: Vec::new(),
            overheard: Vec::new(),
            ending: Ending::Lost,
        }
    }

    /// Searches the received bytes for the answer to a request. Returns `None` until the answer has arrived. `question`
    /// is the frame of the request.
    fn find_answer(
        &mut self,
        unit: u8,
        request: ModbusRequest<'_>,
        question: &[u8],
    ) -> Option<Result<Answer, Fault>> {
        loop {
            match frame::find_answer(&self.received, unit, request) {
                Reply::Own { pdu, end }
                    if request.is_read() && self.received[pdu.start - 1..end] == *question =>
                {
                    self.received.drain(..end);
                    self.came_back = true;
                }
                Reply::Own { pdu, end } => {
                    let own = ReplySignature::of(Request::Modbus(request));
                    if self.is_pending_reply(unit, &self.received[pdu.clone()], Some(own)) {
                        self.late.push(unit);
                        self.received.drain(..end);
                        continue;
                    }
                    let behind = self.received.split_off(end);
                    let received = std::mem::take(&mut self.received);
                    self.is_unsolicited(&received[..pdu.start - 1], unit, question);
                    let answer = pdu::answer(request, &received[pdu.clone()]);
                    let has_other_form =
                        matches!(answer, Err(Fault::Peer(PeerFault::Function | PeerFault::Length)));
                    let is_own = |(speaker, pdu, _): (u8, std::ops::Range<usize>, usize)| {
                        speaker == unit && own.is_on(&behind[pdu])
                    };
                    // An answer of another form may be a mistake of the device, unless the correct one follows.
                    if has_other_form && frame::all(&behind).any(is_own) {
                        self.overhear(unit, ReplySignature::of_answer(&received[pdu]), false);
                        return Some(Err(Fault::UNASKED));
                    }
                    return Some(if self.is_unsolicited(&behind, unit, question) {
                        Err(Fault::UNASKED)
                    } else {
                        answer
                    });
                }
                Reply::Foreign { end } => {
                    let left = self.received.split_off(end);
                    let received = std::mem::replace(&mut self.received, left);
                    let foreign = frame::all(&received).last();
                    match foreign
                        .filter(|(unit, pdu, _)| self.is_pending_reply(*unit, &received[pdu.clone()], None))
                    {
                        Some((unit, ..)) => self.late.push(unit),
                        None => self.heard = Some(PeerFault::Foreign),
                    }
                    self.is_unsolicited(&received, unit, question);
                }
                Reply::Incomplete => {
                    // This is checked only if nothing else has arrived: inside an answer, other bytes may look like
                    // this frame.
                    if let Some(code) = invalid::long_exception(&self.received, unit, request.function()) {
                        self.received.clear();
                        return Some(Err(Fault::Peer(PeerFault::LongException(code))));
                    }
                    let surplus = self.received.len().saturating_sub(MOST_KEPT);
                    self.received.drain(..surplus);
                    return None;
                }
            }
        }
    }

    /// Waits for input, and appends it to `received`.
    async fn receive(&mut self) -> Result<(), Fault> {
        let mut bytes = [0; frame::LONGEST];
        match self.port.receive(&mut bytes).await {
            Ok(0) => Err(self.ended(None, Fault::BROKEN)),
            Err(error) => Err(self.ended(Some(&error), Fault::BROKEN)),
            Ok(count) => {
                self.silence = Silence::begin();
                self.received.extend(&bytes[..count]);
                Ok(())
            }
        }
    }

    /// Discards input until nothing has arrived on the line for the time `span`.
    async fn wait_for_silence(&mut self, span: Duration) -> Result<(), Fault> {
        self.received.clear();
        let mut bytes = [0; frame::LONGEST];
        loop {
            match self.port.take_waiting(&mut bytes) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Ok(0) => return Err(self.ended(None, Fault::CLOSED)),
                Err(error) => return Err(self.ended(Some(&error), Fault::CLOSED)),
                Ok(count) => {
                    self.discard(&bytes[..count]);
                    // An endless stream must not block the other tasks.
                    tokio::task::yield_now().await;
                    continue;
                }
            }
            let left = self.silence.left_of(span);
            if left.is_zero() {
                return Ok(());
            }
            self.discard_within(left).await?;
        }
    }

    /// Waits for input for at most `span`, and discards it. Returns whether any input arrived.
    async fn discard_within(&mut self, span: Duration) -> Result<bool, Fault> {
        let mut bytes = [0; frame::LONGEST];
        match self.patience.within(span, self.port.receive(&mut bytes)).await {
            None => Ok(false),
            Some(Ok(0)) => Err(self.ended(None, Fault::CLOSED)),
            Some(Err(error)) => Err(self.ended(Some(&error), Fault::CLOSED)),
            Some(Ok(count)) => {
                self.discard(&bytes[..count]);
                Ok(true)
            }
        }
    }

    /// Records whether the connection ended in an orderly way or with an error, and returns `fault`. A serial port
    /// never ends in an orderly way: its adapter was removed.
    fn ended(&mut self, error: Option<&io::Error>, fault: Fault) -> Fault {
        if self.serial.is_none() && self.received.is_empty() && is_in_order(error) {
            self.ending = Ending::Closed;
        }
        fault
    }

    /// Discards input that arrived without a request. A copy is kept in `discarded`.
    fn discard(&mut self, bytes: &[u8]) {
        self.silence = Silence::begin();
        self.heard = Some(PeerFault::Malformed);
        self.discarded.extend(bytes);
        let surplus = self.discarded.len().saturating_sub(MOST_KEPT);
        self.discarded.drain(..surplus);
    }

    /// Returns whether this message may be a late answer of the unit. An answer with the form `own`, which the present
    /// request expects, never counts as late.
    fn is_pending_reply(&self, unit: u8, pdu: &[u8], own: Option<ReplySignature>) -> bool {
        let pending = self.pending.iter().filter(|(owing, mark)| *owing == unit && Some(*mark) != own);
        pending.into_iter().any(|(_, mark)| mark.is_on(pdu) || mark.is_refused_by(pdu))
    }

    /// Searches discarded bytes for whole frames. Records late answers, and frames of other masters except exceptions.
    /// Returns whether the bytes contain an answer of `unit` that is not a late answer. `question` is the last sent
    /// frame, whose echo does not show another master.
    fn is_unsolicited(&mut self, bytes: &[u8], unit: u8, question: &[u8]) -> bool {
        let mut is_unsolicited = false;
        for Frame { unit: speaker, pdu, is_question } in frame::frames(bytes) {
            let content = &bytes[pdu.clone()];
            if is_question {
                if bytes[pdu.start - 1..pdu.end + 2] != *question {
                    self.overhear(speaker, ReplySignature::of_question(content), true);
                }
            } else if self.is_pending_reply(speaker, content, None) {
                self.late.push(speaker);
            } else {
                is_unsolicited |= speaker == unit;
                if !frame::is_exception(content) {
                    self.overhear(speaker, ReplySignature::of_answer(content), false);
                }
            }
        }
        is_unsolicited
    }

    /// Records a frame of another master, once for each unit and form (function and length).
    fn overhear(&mut self, unit: u8, form: Option<ReplySignature>, is_question: bool) {
        let overheard = ForeignFrame { unit, form, is_question };
        if self.overheard.len() < MOST_OVERHEARD && !self.overheard.contains(&overheard) {
            self.overheard.push(overheard);
        }
    }

    /// Returns whether the discarded input contains a whole frame of the unit. If so, the input is cleared, and the
    /// frame counts as a late answer.
    fn has_spoken(&mut self, unit: u8) -> bool {
        let has_spoken = matches!(frame::find(&self.discarded, unit), Reply::Own { .. });
        if has_spoken {
            self.discarded.clear();
            self.late.push(unit);
        }
        has_spoken
    }
}

impl Wire for Rtu {
    fn exchange<'a>(&'a mut self, unit: u8, request: Request<'a>, send_guard: &'a mut SendGuard) -> Call<'a> {
        Box::pin(async move {
            let Request::Modbus(request) = request else { return Err(Fault::Caller(CallerFault::Function)) };
            self.came_back = false;
            // If the serial line belongs to another device, that device keeps the silence.
            let silence = self.serial.map_or(Duration::ZERO, |serial| serial.silence());
            self.wait_for_silence(silence).await?;
            let discarded = std::mem::take(&mut self.discarded);
            let last_question = std::mem::take(&mut self.last_question);
            let is_unsolicited = self.is_unsolicited(&discarded, unit, &last_question);
            self.question_before = last_question;
            if is_unsolicited {
                return Err(Fault::UNASKED);
            }
            self.heard = None;
            let question = frame::request(unit, request);
            send_guard.leave()?;
            self.last_question.clone_from(&question);
            self.answer_length = frame::lengths(request).1;
            self.port.send(&question).await.map_err(|error| self.ended(Some(&error), Fault::BROKEN))?;
            // The port accepts all bytes at once, and sends them one after another.
            let sending = self.serial.map_or(Duration::ZERO, |serial| serial.bytes(question.len()));
            self.silence = Silence::begin_after(sending);
            let mut echo_is_due = self.echoes;
            loop {
                self.receive().await?;
                if self.received.starts_with(&question)
                    && (echo_is_due || !frame::is_like_its_answer(request))
                {
                    self.received.drain(..question.len());
                    self.echoes = true;
                    self.came_back = true;
                    echo_is_due = false;
                } else if echo_is_due && question.starts_with(&self.received) {
                    continue;
                }
                if let Some(answer) = self.find_answer(unit, request, &question) {
                    self.came_back = false;
                    return answer;
                }
            }
        })
    }

    fn time_under_way(&self, request: Request<'_>) -> Duration {
        let (Some(serial), Request::Modbus(request)) = (self.serial, request) else { return Duration::ZERO };
        let (question, answer) = frame::lengths(request);
        serial.exchange(question, answer)
    }

    fn missed(&mut self) -> Fault {
        self.port.discard_unsent();
        let received = std::mem::take(&mut self.received);
        let (question, before) = (&self.last_question, &self.question_before);
        let invalid = || invalid::assess(&received, question, before, self.answer_length);
        let fault = self.heard.take().or_else(invalid).map_or(Fault::Timeout, Fault::Peer);
        self.came_back &= fault == Fault::Timeout && received.is_empty();
        fault
    }

    fn ending(&mut self) -> Ending {
        self.ending
    }
}

impl ModbusWire for Rtu {
    fn has_transaction_id(&self) -> bool {
        false
    }

    fn has_come_back(&self) -> bool {
        self.came_back
    }

    fn pass_over(&mut self, pending: Vec<(u8, ReplySignature)>) {
        self.pending = pending;
    }

    fn received_late(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.late)
    }

    fn overheard(&mut self) -> Vec<ForeignFrame> {
        std::mem::take(&mut self.overheard)
    }

    fn listen(&mut self, unit: u8, span: Duration, quiet: Duration) -> Boxed<'_, Result<(), Fault>> {
        Box::pin(async move {
            let begun = Silence::begin();
            // This input arrived while no request was open. The time is limited, because a stream may be endless.
            let mut patience = WallTimeout::new();
            if let Some(Err(fault)) = patience.within(quiet, self.wait_for_silence(Duration::ZERO)).await {
                return Err(fault);
            }
            let mut spoken = self.has_spoken(unit).then(Silence::begin);
            loop {
                let pending = begun.left_of(span);
                let left = pending.max(spoken.map_or(Duration::ZERO, |last| last.left_of(quiet)));
                if left.is_zero() {
                    return Ok(());
                }
                if self.discard_within(left).await? && self.has_spoken(unit) {
                    // There were more frames than late answers. The next one could be accepted by mistake.
                    if pending.is_zero() {
                        return Err(Fault::UNASKED);
                    }
                    spoken = Some(Silence::begin());
                }
            }
        })
    }
}

#[cfg(test)]
mod tests;
