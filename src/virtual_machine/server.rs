//! Sockets of the virtual machine: one listener for each line, any number of connections, and one request at a time on
//! each connection.

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rand::RngExt;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::{JoinError, JoinSet};

use super::UnknownUnit;
use super::fault::ReplyFault;
use super::hardware::{Hardware, Reply};
use super::listener::TcpPort;
use super::modbus::{Framing, Header, NO_SUCH_UNIT, exception};
use super::random::stream;
use super::serial_side::SerialSide;
use crate::clock::{BootClock, Clock};
use isotherm_core::codec::{AsciiFrames, ascii_frame};
use isotherm_profile::{DeviceId, Serial};

/// Hardware and clock of the virtual machine, which all connections share.
#[derive(Clone, Debug)]
pub(super) struct Shared {
    hardware: Arc<Mutex<Hardware>>,
    pub(super) clock: Clock,
}

/// One bus line with its Modbus units, which one listener serves.
#[derive(Debug)]
pub(super) struct Line {
    pub(super) units: Vec<(u8, DeviceId)>,
    pub(super) framing: Framing,
    /// Whether the line uses Modbus ASCII instead of Modbus RTU.
    pub(super) is_ascii: bool,
    /// Answer for a unit that does not exist.
    pub(super) unknown_unit: UnknownUnit,
    /// Length of the slices into which the delay of a late answer is divided. A client in the same process divides its
    /// timeout in the same way, so that a busy computer delays the answer and the timeout equally.
    pub(super) slice: Duration,
    /// Serial side of a Modbus gateway in front of the units. It is used only for Modbus TCP.
    pub(super) serial_side: SerialSide,
    pub(super) shared: Shared,
}

/// Command to listen, or to close the listener and all its connections. `done` is signalled when the command is
/// executed.
#[derive(Debug)]
pub(super) struct OpenOrClose {
    pub(super) is_open: bool,
    pub(super) done: oneshot::Sender<()>,
}

/// Time without input after which an incomplete RTU request is discarded.
const GAP: Duration = Duration::from_millis(20);
/// Minimum time between two log lines about clients that do not speak Modbus.
const AT_MOST_EVERY: Duration = Duration::from_secs(60);
/// Pause between two bytes of an answer, for the fault in which an answer is sent byte by byte.
const DRIBBLE: Duration = Duration::from_millis(1);

impl Shared {
    pub(super) fn new(hardware: Hardware, clock: Clock) -> Shared {
        Shared { hardware: Arc::new(Mutex::new(hardware)), clock }
    }

    /// Returns the hardware and its clock, for lines that lock the hardware themselves.
    #[cfg(feature = "opcua")]
    pub(super) fn parts(&self) -> (Arc<Mutex<Hardware>>, Clock) {
        (self.hardware.clone(), self.clock.clone())
    }

    /// Locks the hardware. The lock is also used after a panic in another task: that panic ends the virtual machine,
    /// and until then the values are usable.
    pub(super) fn hardware(&self) -> MutexGuard<'_, Hardware> {
        self.hardware.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Serves the units of a line on a listener, until `stop` changes or its sender is dropped.
pub(super) async fn serve(
    listener: TcpListener,
    line: Arc<Line>,
    mut switched: mpsc::Receiver<OpenOrClose>,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
    let address = listener.local_addr()?;
    let mut port = TcpPort::Open(listener);
    let mut connections = JoinSet::new();
    let mut strangers = NonModbusClients::default();
    loop {
        tokio::select! {
            _ = stop.changed() => break,
            switch = switched.recv() => {
                let Some(OpenOrClose { is_open, done }) = switch else { break };
                port = port.switched(is_open)?;
                if !is_open {
                    connections.shutdown().await;
                }
                let _ = done.send(());
            }
            accepted = port.accept() => {
                let (stream, peer) = accepted?;
                tracing::debug!(%address, %peer, "connected");
                connections.spawn(serve_client(stream, peer, line.clone()));
            }
            Some(ended) = connections.join_next() => {
                if let Some(line) = report(ended)?.and_then(|peer| strangers.came(peer)) {
                    tracing::warn!("{line}");
                }
            }
            () = tokio::time::sleep(AT_MOST_EVERY), if strangers.unreported > 0 => {
                tracing::warn!("{}", strangers.reported());
            }
        }
    }
    while let Some(ended) = connections.try_join_next() {
        let _ = report(ended)?.and_then(|peer| strangers.came(peer));
    }
    if strangers.unreported > 0 {
        tracing::warn!("{}", strangers.reported());
    }
    Ok(())
}

/// Evaluates how a connection ended. Returns the address of a client that did not send Modbus. Returns an error after a
/// panic, which ends the virtual machine.
fn report(ended: Result<(SocketAddr, io::Result<()>), JoinError>) -> io::Result<Option<SocketAddr>> {
    match ended {
        Ok((_, Ok(()))) => Ok(None),
        Ok((peer, Err(error))) => {
            tracing::debug!(%error, "a connection ended");
            Ok((error.kind() == io::ErrorKind::InvalidData).then_some(peer))
        }
        Err(error) if error.is_cancelled() => Ok(None),
        Err(error) => Err(io::Error::other(error)),
    }
}

/// Counter of clients that did not send Modbus. The first one is logged at once; later ones are counted, and logged
/// once a minute. Such clients therefore cannot fill the log.
#[derive(Debug, Default)]
struct NonModbusClients {
    boot_clock: BootClock,
    reported_at: Option<Duration>,
    unreported: u64,
    last: Option<SocketAddr>,
}

impl NonModbusClients {
    /// Counts a client that did not send Modbus. Returns the text to log now; `None` if nothing is to be logged.
    fn came(&mut self, peer: SocketAddr) -> Option<String> {
        self.unreported += 1;
        self.last = Some(peer);
        let now = self.boot_clock.passed();
        let is_due = self.reported_at.is_none_or(|reported| now.saturating_sub(reported) >= AT_MOST_EVERY);
        is_due.then(|| self.reported())
    }

    fn reported(&mut self) -> String {
        let last = self.last.map_or_else(String::new, |peer| format!(" of {peer}"));
        let is_first = self.reported_at.replace(self.boot_clock.passed()).is_none();
        match std::mem::take(&mut self.unreported) {
            _ if is_first => {
                format!(
                    "closed a connection{last}: this is not Modbus TCP; further such connections are counted, and \
                     logged once a minute"
                )
            }
            count => {
                format!("closed {count} more connections: this is not Modbus TCP; the last one was{last}")
            }
        }
    }
}

/// Serves one connection until the client closes it or sends data that is not Modbus. Returns the address of
/// the client, and the result.
async fn serve_client(stream: TcpStream, peer: SocketAddr, line: Arc<Line>) -> (SocketAddr, io::Result<()>) {
    let ended = async {
        stream.set_nodelay(true)?;
        converse(stream, &line, None).await
    };
    (peer, ended.await)
}

/// Answers requests until the stream ends or contains data that is not Modbus. With `pace`, each byte takes as long as
/// on a serial line with these settings.
pub(super) async fn converse<S>(mut stream: S, line: &Line, pace: Option<Serial>) -> io::Result<()>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let framing = line.framing;
    let mut responder = Responder::new(framing);
    let mut received = Vec::new();
    let mut frames = AsciiFrames::default();
    let mut late: JoinSet<Vec<u8>> = JoinSet::new();
    loop {
        let mut bytes = [0; 512];
        tokio::select! {
            read = stream.read(&mut bytes) => match read? {
                0 => return Ok(()),
                count if line.is_ascii => frames.push(&bytes[..count], &mut received),
                count => received.extend(&bytes[..count]),
            },
            Some(answer) = late.join_next() => stream.write_all(&answer.map_err(io::Error::other)?).await?,
            () = tokio::time::sleep(GAP), if framing == Framing::Rtu && !received.is_empty() => received.clear(),
        }
        while let Some((header, pdu)) = framing.request(&received).map_err(|_| io::ErrorKind::InvalidData)? {
            let reply = line.answer(header.unit, &received[pdu.clone()]);
            let (reply, wait) = match framing {
                Framing::Tcp => line.serial_side.pass(header.unit, &received[pdu.clone()], reply),
                Framing::Rtu => (reply, Duration::ZERO),
            };
            if !wait.is_zero() {
                sleep_in_slices(wait, line.slice).await;
            }
            let asked = received.drain(..pdu.end + framing.trailer()).len();
            let bytes = match responder.say(header, &reply) {
                ServerReply::Bytes(bytes) if line.is_ascii => ascii_frame(&bytes),
                ServerReply::Bytes(bytes) => bytes,
                // A serial line has no connection to close.
                ServerReply::Goodbye if pace.is_none() => return Ok(()),
                ServerReply::Nothing | ServerReply::Goodbye => continue,
            };
            if let Some(serial) = pace {
                tokio::time::sleep(serial.bytes(asked + bytes.len())).await;
            }
            match reply.fault {
                // A serial line continues meanwhile; a TCP connection waits.
                Some(ReplyFault::Late(delay)) if framing == Framing::Rtu => {
                    let slice = line.slice;
                    late.spawn(async move {
                        sleep_in_slices(delay, slice).await;
                        bytes
                    });
                }
                Some(ReplyFault::Late(delay)) => {
                    sleep_in_slices(delay, line.slice).await;
                    stream.write_all(&bytes).await?;
                }
                Some(ReplyFault::OneByteAtATime) => {
                    for byte in bytes {
                        stream.write_all(&[byte]).await?;
                        tokio::time::sleep(DRIBBLE).await;
                    }
                }
                _ => stream.write_all(&bytes).await?,
            }
        }
    }
}

async fn sleep_in_slices(delay: Duration, slice: Duration) {
    let slices = delay.as_nanos().div_ceil(slice.as_nanos().max(1)).clamp(1, 1000);
    let slices = u32::try_from(slices).unwrap_or(1);
    for _ in 0..slices {
        tokio::time::sleep(delay / slices).await;
    }
}

impl Line {
    pub(super) fn answer(&self, unit: u8, pdu: &[u8]) -> Reply {
        let Some((_, device)) = self.units.iter().find(|(known, _)| *known == unit) else {
            let refusal = exception(pdu, NO_SUCH_UNIT);
            let pdu = (self.unknown_unit == UnknownUnit::Exception).then_some(refusal);
            return Reply { pdu, fault: None };
        };
        let mut hardware = self.shared.hardware();
        hardware.serve(*device, pdu, self.shared.clock.now())
    }
}

/// Sender of the answers on one connection. It changes or suppresses an answer as the fault of the answer requires.
#[derive(Debug)]
pub(super) struct Responder {
    framing: Framing,
    is_mute: bool,
    /// Correct answer to the previous request: its transaction number and its protocol data unit.
    before: Option<(u16, Vec<u8>)>,
}

pub(super) enum ServerReply {
    Bytes(Vec<u8>),
    Nothing,
    Goodbye,
}

impl Responder {
    pub(super) fn new(framing: Framing) -> Responder {
        Responder { framing, is_mute: false, before: None }
    }

    pub(super) fn say(&mut self, header: Header, reply: &Reply) -> ServerReply {
        self.is_mute |= reply.fault == Some(ReplyFault::HalfOpen);
        let Some(pdu) = &reply.pdu else { return ServerReply::Nothing };
        let before = self.before.replace((header.transaction, pdu.clone()));
        if self.is_mute {
            return ServerReply::Nothing;
        }
        let plain = |pdu: &[u8]| ServerReply::Bytes(self.framing.frame(header.transaction, header.unit, pdu));
        match reply.fault {
            Some(ReplyFault::Close) => ServerReply::Goodbye,
            Some(ReplyFault::Garbage) => {
                let mut random = stream(u64::from(header.transaction), "garbage");
                ServerReply::Bytes((0..16).map(|_| random.random()).collect())
            }
            Some(ReplyFault::WrongUnit) => {
                ServerReply::Bytes(self.framing.frame(header.transaction, header.unit.wrapping_add(1), pdu))
            }
            Some(ReplyFault::WrongTransaction) => {
                ServerReply::Bytes(self.framing.frame(header.transaction.wrapping_add(1), header.unit, pdu))
            }
            Some(ReplyFault::WrongChecksum) => {
                let mut bytes = self.framing.frame(header.transaction, header.unit, pdu);
                bytes.last_mut().into_iter().for_each(|last| *last ^= 1);
                ServerReply::Bytes(bytes)
            }
            Some(ReplyFault::WrongFunction) => plain(&changed(pdu, 0, |function| function ^ 1)),
            Some(ReplyFault::WrongEcho) => plain(&changed(pdu, pdu.len() - 1, |low| low.wrapping_add(1))),
            Some(ReplyFault::ShortRead) => plain(&resized(pdu, -2)),
            Some(ReplyFault::LongRead) => plain(&resized(pdu, 2)),
            Some(ReplyFault::OneBehind { stale_transaction }) => match before {
                Some((transaction, pdu)) if stale_transaction => {
                    ServerReply::Bytes(self.framing.frame(transaction, header.unit, &pdu))
                }
                Some((_, pdu)) => plain(&pdu),
                None => ServerReply::Nothing,
            },
            _ => plain(pdu),
        }
    }
}

/// Returns the bytes with the byte at position `at` changed.
fn changed(pdu: &[u8], at: usize, change: impl Fn(u8) -> u8) -> Vec<u8> {
    let mut bytes = pdu.to_vec();
    if let Some(byte) = bytes.get_mut(at) {
        *byte = change(*byte);
    }
    bytes
}

/// Returns the answer to a read with `by` bytes added or removed, and a matching byte count. Exceptions are returned
/// unchanged.
fn resized(pdu: &[u8], by: isize) -> Vec<u8> {
    let is_exception = pdu.first().is_none_or(|function| function & 0x80 != 0);
    let wanted = pdu.len().saturating_add_signed(by).max(2);
    let mut bytes = pdu.to_vec();
    if !is_exception && let Ok(count) = u8::try_from(wanted - 2) {
        bytes.resize(wanted, 0);
        bytes[1] = count;
    }
    bytes
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn clients_that_speak_no_modbus_are_told_of_once_and_then_counted_once_a_minute() {
        let seconds = Arc::new(AtomicU64::new(1000));
        let shown = seconds.clone();
        let boot_clock = BootClock::by(move || Duration::from_secs(shown.load(Ordering::Relaxed)));
        let mut strangers = NonModbusClients { boot_clock, ..NonModbusClients::default() };
        let peer: SocketAddr = "127.0.0.1:40000".parse().unwrap();
        assert!(
            strangers
                .came(peer)
                .unwrap()
                .starts_with("closed a connection of 127.0.0.1:40000: this is not Modbus")
        );
        assert!((0..100_000).all(|_| strangers.came(peer).is_none()));
        seconds.store(1059, Ordering::Relaxed);
        assert_eq!(strangers.came(peer), None);
        seconds.store(1060, Ordering::Relaxed);
        let line = strangers.came(peer).unwrap();
        assert!(line.starts_with("closed 100002 more connections: this is not Modbus TCP"), "{line}");
        assert_eq!((strangers.came(peer), strangers.unreported), (None, 1));
    }
}
