//! Modbus RTU, on a serial port or through a TCP connection.
//!
//! tokio-modbus decodes the answers here as it does for TCP, but its RTU client cannot serve: it keeps no silence
//! between frames, discards nothing that an older request left in the system's buffer, waits for ever on a wrong
//! checksum, and takes the first frame of the right unit and function for the answer. So framing is done here:
//!
//! - Before a request, whatever has come is discarded, and the line is silent for 3.5 characters (1.75 ms above
//!   19,200 baud).
//! - An answer is told by its unit, length and checksum. Noise before it and answers of other units are passed over.
//! - RTU has no transaction number: after a miss, [`super::line`] listens until a late answer has had its time, and
//!   only then asks that unit again.
//! - Where an adapter without echo suppression lets us hear ourselves, the first read shows it, and from then on every
//!   request is expected back before its answer.

use std::io::{self, Read};
use std::time::Duration;

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_modbus::bytes::Bytes;
use tokio_modbus::{ExceptionResponse, Response};

use super::error::{CallerFault, Fault, LinkFault, PeerFault};
use super::modbus::{check, dial_fault};
use super::trace::{Tap, Teed};
use super::wire::{Answer, Boxed, Connection, Dial, Request, Wire};
use crate::clock::{Patience, Silence};
use crate::profile::Serial;

mod frame;

use frame::Found;

/// No more than this is kept while an answer is looked for.
const MOST_KEPT: usize = 2 * frame::LONGEST;
/// Silence before a request where the line behind the connection is not ours: the other end keeps its own.
const SILENCE_OVER_TCP: Duration = Duration::ZERO;

/// Opens connections to a device that passes RTU frames on.
#[derive(Clone, Debug)]
pub struct RtuOverTcpDial {
    address: String,
    tap: Tap,
}

impl RtuOverTcpDial {
    /// To `host:port`.
    pub fn new(address: &str) -> RtuOverTcpDial {
        RtuOverTcpDial { address: address.to_owned(), tap: Tap::default() }
    }
}

impl Dial for RtuOverTcpDial {
    fn dial(&mut self) -> Boxed<'_, Result<Connection, Fault>> {
        Box::pin(async {
            let stream =
                TcpStream::connect(self.address.as_str()).await.map_err(|error| dial_fault(&error))?;
            stream.set_nodelay(true).map_err(|_| Fault::Link(LinkFault::Broken))?;
            Ok(Connection::Other(Box::new(Rtu::new(Teed::new(stream, self.tap.clone()), None))))
        })
    }

    fn tap(&mut self, tap: &Tap) {
        self.tap = tap.clone();
    }
}

/// A stream that can be asked for what has already come.
pub trait Port: AsyncRead + AsyncWrite + Send + Unpin {
    /// Takes what waits in the system's buffer, past the runtime, which may not have heard of it yet.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] where nothing waits, and whatever is wrong with the stream.
    fn take_waiting(&self, bytes: &mut [u8]) -> io::Result<usize>;
}

impl Port for TcpStream {
    fn take_waiting(&self, bytes: &mut [u8]) -> io::Result<usize> {
        (&*SockRef::from(self)).read(bytes)
    }
}

/// What is taken to be discarded passes the tap too: a late answer is worth seeing.
impl<T: Port> Port for Teed<T> {
    fn take_waiting(&self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.inner().take_waiting(bytes)?;
        self.pass(&bytes[..count], false);
        Ok(count)
    }
}

/// RTU over any stream.
pub struct Rtu<T> {
    stream: T,
    /// The settings of a serial port; `None` where there is none of ours.
    serial: Option<Serial>,
    silence: Silence,
    patience: Patience,
    received: Vec<u8>,
    /// What was wrong with what came since the last request.
    heard: Option<PeerFault>,
    /// We hear ourselves.
    echoes: bool,
}

impl<T: Port> Rtu<T> {
    /// RTU over this stream, which keeps the times of `serial`.
    pub fn new(stream: T, serial: Option<Serial>) -> Rtu<T> {
        Rtu {
            stream,
            serial,
            silence: Silence::begin(),
            patience: Patience::new(),
            received: Vec::new(),
            heard: None,
            echoes: false,
        }
    }

    async fn exchange(&mut self, unit: u8, request: Request<'_>) -> Result<Answer, Fault> {
        if matches!(request, Request::Can(_)) {
            return Err(Fault::Caller(CallerFault::Function));
        }
        let silence = self.serial.map_or(SILENCE_OVER_TCP, |serial| serial.silence());
        self.hush(silence).await?;
        self.heard = None;
        let question = frame::request(unit, request);
        self.stream.write_all(&question).await.map_err(|_| BROKEN)?;
        self.stream.flush().await.map_err(|_| BROKEN)?;
        // The port takes all bytes at once and sends them one after the other.
        let sending = self.serial.map_or(Duration::ZERO, |serial| serial.bytes(question.len()));
        self.silence = Silence::begin_after(sending);
        let mut echo_is_due = self.echoes;
        loop {
            self.receive().await?;
            if self.received.starts_with(&question) && (echo_is_due || !frame::is_like_its_answer(request)) {
                self.received.drain(..question.len());
                self.echoes = true;
                echo_is_due = false;
            } else if echo_is_due && question.starts_with(&self.received) {
                continue;
            }
            if let Some(answer) = self.look(unit, request) {
                return answer;
            }
        }
    }

    /// The answer, if it has come.
    fn look(&mut self, unit: u8, request: Request<'_>) -> Option<Result<Answer, Fault>> {
        loop {
            match frame::find(&self.received, unit) {
                Found::Own { pdu, .. } => {
                    let answer = decode(request, &self.received[pdu]);
                    self.received.clear();
                    return Some(answer);
                }
                Found::Foreign { end } => {
                    self.heard = Some(PeerFault::Foreign);
                    self.received.drain(..end);
                }
                Found::Nothing => {
                    let (_, answer) = frame::lengths(request);
                    if self.received.len() >= answer && self.heard.is_none() {
                        self.heard = Some(PeerFault::Malformed);
                    }
                    let surplus = self.received.len().saturating_sub(MOST_KEPT);
                    self.received.drain(..surplus);
                    return None;
                }
            }
        }
    }

    /// Waits for bytes and keeps them.
    async fn receive(&mut self) -> Result<(), Fault> {
        let mut bytes = [0; frame::LONGEST];
        match self.stream.read(&mut bytes).await {
            Ok(0) | Err(_) => Err(BROKEN),
            Ok(count) => {
                self.silence = Silence::begin();
                self.received.extend(&bytes[..count]);
                Ok(())
            }
        }
    }

    /// Discards what has come and what still comes, until the line has been silent for `span`.
    async fn hush(&mut self, span: Duration) -> Result<(), Fault> {
        self.received.clear();
        let mut bytes = [0; frame::LONGEST];
        loop {
            match self.stream.take_waiting(&mut bytes) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Ok(0) | Err(_) => return Err(CLOSED),
                Ok(_) => {
                    self.disturbed();
                    // One that never stops must not keep everybody else from their turn.
                    tokio::task::yield_now().await;
                    continue;
                }
            }
            let left = self.silence.left_of(span);
            if left.is_zero() {
                return Ok(());
            }
            match self.patience.within(left, self.stream.read(&mut bytes)).await {
                None => {}
                Some(Ok(0) | Err(_)) => return Err(CLOSED),
                Some(Ok(_)) => self.disturbed(),
            }
        }
    }

    /// Something came that nobody asked for.
    fn disturbed(&mut self) {
        self.silence = Silence::begin();
        self.heard = Some(PeerFault::Malformed);
    }
}

impl<T: Port> Wire for Rtu<T> {
    fn call<'a>(&'a mut self, unit: u8, request: Request<'a>) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(self.exchange(unit, request))
    }

    fn names_its_question(&self) -> bool {
        false
    }

    fn time_under_way(&self, request: Request<'_>) -> Duration {
        let (question, answer) = frame::lengths(request);
        self.serial.map_or(Duration::ZERO, |serial| serial.exchange(question, answer))
    }

    fn missed(&mut self) -> Fault {
        self.heard.take().map_or(Fault::Timeout, Fault::Peer)
    }

    fn listen(&mut self, span: Duration) -> Boxed<'_, Result<(), Fault>> {
        Box::pin(async move {
            let end = Silence::begin();
            loop {
                let mut bytes = [0; frame::LONGEST];
                let left = end.left_of(span);
                // One that never stops talking would be heard for ever.
                if left.is_zero() {
                    return Ok(());
                }
                match self.patience.within(left, self.stream.read(&mut bytes)).await {
                    None => return Ok(()),
                    Some(Ok(0) | Err(_)) => return Err(CLOSED),
                    Some(Ok(_)) => self.disturbed(),
                }
            }
        })
    }
}

const BROKEN: Fault = Fault::Link(LinkFault::Broken);
const CLOSED: Fault = Fault::Link(LinkFault::Closed);

/// The answer in a frame whose checksum is right.
fn decode(request: Request<'_>, pdu: &[u8]) -> Result<Answer, Fault> {
    let function = pdu.first().copied().unwrap_or_default();
    if function & 0x7f != request.function() {
        return Err(Fault::Peer(PeerFault::Function));
    }
    let malformed = |_: io::Error| Fault::Peer(PeerFault::Malformed);
    let bytes = Bytes::copy_from_slice(pdu);
    if function == request.function() {
        return check(request, Response::try_from(bytes).map_err(malformed)?);
    }
    let refusal = ExceptionResponse::try_from(bytes).map_err(malformed)?;
    Err(Fault::Exception(refusal.exception.into()))
}

#[cfg(test)]
mod tests;
