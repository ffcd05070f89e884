//! Wire (open connection) of a line with devices that send text.
//!
//! ```text
//! on request        discard ─► silence ─► send ─► lines until each value was found, or until the timeout
//! by itself         discard ─► the next whole lines
//! ```
//!
//! A new connection may begin with old text, or with the rest of an answer. The text is discarded, and no request is
//! sent before the answers to earlier requests can no longer arrive.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::pending::PendingAnswers;
use super::port::TextPort;
use super::request::TextRequest;
use super::search::Search;
use crate::clock::Silence;
use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::port::Port;
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::{Answer, Call, NodeReading, Request, Stamped, Wire};
use isotherm_core::codec::DataType;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::Serial;

/// Silence before a request, if text has arrived without a request.
const SILENCE: Duration = Duration::from_millis(20);
/// Pause after which an answer with several lines has ended.
const LAST_LINE: Duration = Duration::from_millis(200);
/// Time that this program may need in addition to the answer time of the device.
const OWN: Duration = Duration::from_millis(250);
/// Assumed length of an answer in characters, for its time on a serial line.
const ANSWER: usize = 80;
/// Number of discarded characters from which more old text may follow, because the system may deliver the text in
/// several parts. A port stores 4096 characters.
const BACKLOG: usize = 2048;
/// Time in which the rest of old text arrives from the buffers of the system or of a serial server.
const CATCH_UP: Duration = Duration::from_millis(50);

/// State of a connection, which decides whether old text may still arrive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LineState {
    /// The connection is new: a device may be sending, and old text may arrive.
    New,
    /// Old text was discarded. A device may be sending.
    CaughtUp,
    /// The line was silent before a request, so no old text can arrive.
    Silent,
}

/// Open line to devices that send text.
pub struct TextWire {
    port: TextPort,
    /// Settings of the serial port; `None` if the text goes through a TCP connection.
    serial: Option<Serial>,
    timeout: Duration,
    state: LineState,
    pending: Arc<Mutex<PendingAnswers>>,
}

impl TextWire {
    /// Returns a line on this port, whose bytes `tap` receives.
    pub fn new(port: impl Port + 'static, data_bits: u8, timeout: Duration, tap: &Tap) -> TextWire {
        TextWire::of(TextPort::new(port, data_bits, tap), None, timeout, Arc::default())
    }

    /// Returns a line on this port. `pending` contains the requests of earlier connections whose answers may still
    /// arrive.
    pub(super) fn of(
        port: TextPort,
        serial: Option<Serial>,
        timeout: Duration,
        pending: Arc<Mutex<PendingAnswers>>,
    ) -> TextWire {
        TextWire { port, serial, timeout, state: LineState::New, pending }
    }

    /// Locks the list of open requests. The lock is also used after a panic in another task.
    fn pending(&self) -> MutexGuard<'_, PendingAnswers> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn exchange(
        &mut self,
        request: TextRequest<'_>,
        send_guard: &mut SendGuard,
    ) -> Result<Answer, Fault> {
        let text = request.text();
        if text.is_empty() {
            let discarded = self.port.discard().await?;
            let is_new = self.state == LineState::New;
            if is_new || discarded.characters >= BACKLOG {
                self.port.discard_for(CATCH_UP).await?;
            }
            if is_new {
                self.state = LineState::CaughtUp;
            }
            send_guard.leave()?;
        } else {
            self.make_ready(text, send_guard.now()).await?;
            let now = send_guard.leave()?;
            self.pending().sent(text, now);
            self.port.send(text).await?;
        }
        let mut search = Search::new(request.0, text);
        self.receive(&mut search, text).await?;
        let has_begun = search.has_begun();
        let asked = if has_begun && !text.is_empty() { self.pending().answered() } else { None };
        let values = search.values()?;
        Ok(Answer::Nodes(values.into_iter().map(|value| reading(value, asked)).collect()))
    }

    /// Receives lines until each value was found, the answer has ended, or the timeout is over.
    async fn receive(&mut self, search: &mut Search<'_>, text: &str) -> Result<(), Fault> {
        let begun = Silence::begin();
        let span = self.timeout + self.under_way(text);
        while !search.is_complete() {
            let left = begun.left_of(span);
            let has_end = !text.is_empty() && search.has_begun();
            match self.port.next_line(if has_end { left.min(LAST_LINE) } else { left }).await? {
                Some(line) => search.take(&line),
                None => break,
            }
        }
        Ok(())
    }

    /// Waits until this request may be sent: the line must be silent. Answers to a request with another text, or to a
    /// request on an earlier connection, must no longer be expected.
    async fn make_ready(&mut self, text: &str, now: Moment) -> Result<(), Fault> {
        let discarded = self.port.discard().await?;
        let (span, is_new) = (2 * self.timeout + self.under_way(text), self.state != LineState::Silent);
        // Several lines may be one answer. On a new connection they may be older than all requests.
        if discarded.lines > 0 && !is_new {
            self.pending().answered();
        }
        let wait = if is_new {
            self.pending().wait_for_all(now, span)
        } else {
            self.pending().wait_before(text, now, span)
        };
        let begun = Silence::begin();
        let mut has_waited = false;
        while !begun.left_of(wait).is_zero() {
            has_waited = true;
            if self.port.next_line(begun.left_of(wait)).await?.is_none() {
                break;
            }
            let mut pending = self.pending();
            pending.answered();
            if !pending.is_open() {
                break;
            }
        }
        if has_waited {
            self.pending().expire();
        }
        if is_new || discarded.characters > 0 || has_waited {
            // Some characters more than a pause inside a line.
            let span = SILENCE + self.serial.map_or(Duration::ZERO, |serial| serial.bytes(4));
            if !self.port.wait_for_silence(span, self.timeout).await? {
                return Err(Fault::UNASKED);
            }
        }
        self.state = LineState::Silent;
        Ok(())
    }

    /// Returns the transmission time of a request and its answer on the serial line.
    fn under_way(&self, text: &str) -> Duration {
        self.serial.map_or(Duration::ZERO, |serial| serial.bytes(text.len() + ANSWER))
    }
}

/// Returns the number as a reading, or a reading with the reason why there is no number.
fn reading(value: Result<f64, Reason>, asked: Option<Moment>) -> NodeReading {
    let value = value.map(|number| DataType::F64.encode(number.to_bits()));
    NodeReading { value, stamped: Stamped::Unknown, asked }
}

impl Wire for TextWire {
    fn exchange<'a>(&'a mut self, _: u8, request: Request<'a>, send_guard: &'a mut SendGuard) -> Call<'a> {
        Box::pin(async move {
            let Request::Texts(request) = request else { return Err(Fault::Caller(CallerFault::Function)) };
            self.exchange(request, send_guard).await
        })
    }

    fn time_under_way(&self, request: Request<'_>) -> Duration {
        let Request::Texts(request) = request else { return Duration::ZERO };
        // Before the request, the line may wait for two late answers and for silence.
        3 * self.timeout + 2 * self.under_way(request.text()) + OWN
    }
}

#[cfg(test)]
mod tests;
