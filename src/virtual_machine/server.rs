//! The sockets: one listener per line, any number of connections, one request after the other on each.

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rand::RngExt;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::{JoinError, JoinSet};

use super::UnknownUnit;
use super::fault::ReplyFault;
use super::hardware::{Hardware, Reply};
use super::modbus::{HEADER, Header, NO_SUCH_UNIT, exception, frame};
use super::plant::stream;
use crate::clock::Clock;
use isotherm_profile::DeviceId;

/// What every connection shares.
#[derive(Clone, Debug)]
pub(super) struct Shared {
    hardware: Arc<Mutex<Hardware>>,
    pub(super) clock: Clock,
}

/// One listener with the units behind it.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub(super) units: Vec<(u8, DeviceId)>,
    pub(super) framing: Framing,
    /// What is answered for a unit that is not there.
    pub(super) unknown_unit: UnknownUnit,
    pub(super) shared: Shared,
}

/// What is around a protocol data unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Framing {
    /// Transaction, length, unit.
    Tcp,
    /// Unit, checksum.
    Rtu,
}

/// Told to a listener; it answers when it has done so.
#[derive(Debug)]
pub(super) enum Door {
    /// Close the listener and every connection.
    Shut(oneshot::Sender<()>),
    /// Listen again.
    Open(oneshot::Sender<()>),
}

impl Shared {
    pub(super) fn new(hardware: Hardware, clock: Clock) -> Shared {
        Shared { hardware: Arc::new(Mutex::new(hardware)), clock }
    }

    /// A panic while it was locked ends its task, which ends the machine; until then its numbers are still numbers.
    pub(super) fn hardware(&self) -> MutexGuard<'_, Hardware> {
        self.hardware.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Serves a line until `stop` changes or its sender is gone.
pub(super) async fn serve(
    listener: TcpListener,
    line: Arc<Line>,
    mut doors: mpsc::Receiver<Door>,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
    let address = listener.local_addr()?;
    let mut listener = Some(listener);
    // A socket that is bound and does not listen refuses, and keeps the port from everybody else.
    let mut closed: Option<TcpSocket> = None;
    let mut connections = JoinSet::new();
    loop {
        tokio::select! {
            _ = stop.changed() => return Ok(()),
            door = doors.recv() => match door {
                Some(Door::Shut(done)) => {
                    if listener.take().is_some() {
                        closed = Some(bound(address)?);
                    }
                    connections.shutdown().await;
                    let _ = done.send(());
                }
                Some(Door::Open(done)) => {
                    if let Some(socket) = closed.take() {
                        listener = Some(socket.listen(1024)?);
                    }
                    let _ = done.send(());
                }
                None => return Ok(()),
            },
            accepted = accept(listener.as_ref()) => {
                let (stream, peer) = accepted?;
                tracing::debug!(%address, %peer, "connected");
                connections.spawn(converse(stream, peer, line.clone()));
            }
            Some(ended) = connections.join_next() => report(ended)?,
        }
    }
}

/// A socket at this address that does not listen yet.
fn bound(address: SocketAddr) -> io::Result<TcpSocket> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    Ok(socket)
}

/// The next connection; never, where nothing listens.
async fn accept(listener: Option<&TcpListener>) -> io::Result<(TcpStream, SocketAddr)> {
    match listener {
        Some(listener) => listener.accept().await,
        None => std::future::pending().await,
    }
}

/// A client may go as it likes; a panic ends the machine.
fn report(ended: Result<io::Result<()>, JoinError>) -> io::Result<()> {
    match ended {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => {
            tracing::debug!(%error, "a connection ended");
            Ok(())
        }
        Err(error) if error.is_cancelled() => Ok(()),
        Err(error) => Err(io::Error::other(error)),
    }
}

/// One connection, until the client closes it or sends what is no Modbus.
async fn converse(mut stream: TcpStream, peer: SocketAddr, line: Arc<Line>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    if line.framing == Framing::Rtu {
        return super::rtu::converse(stream, &line, None).await;
    }
    let mut mouth = Mouth::new(Framing::Tcp);
    let mut pdu = Vec::new();
    loop {
        let mut bytes = [0; HEADER];
        if let Err(error) = stream.read_exact(&mut bytes).await {
            return if error.kind() == io::ErrorKind::UnexpectedEof { Ok(()) } else { Err(error) };
        }
        let Some(header) = Header::decode(bytes) else {
            tracing::warn!(%peer, ?bytes, "closed: this is no Modbus TCP");
            return Ok(());
        };
        pdu.resize(header.pdu, 0);
        stream.read_exact(&mut pdu).await?;
        let reply = line.answer(header.unit, &pdu);
        if let Some(ReplyFault::Late(delay)) = reply.fault {
            tokio::time::sleep(delay).await;
        }
        match mouth.say(header, &reply) {
            Say::Bytes(bytes) if reply.fault == Some(ReplyFault::OneByteAtATime) => {
                for byte in bytes {
                    stream.write_all(&[byte]).await?;
                    tokio::time::sleep(Duration::from_millis(1)).await;
                }
            }
            Say::Bytes(bytes) => stream.write_all(&bytes).await?,
            Say::Nothing => {}
            Say::Goodbye => return Ok(()),
        }
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

/// What goes out on one connection.
#[derive(Debug)]
pub(super) struct Mouth {
    framing: Framing,
    is_mute: bool,
    /// The honest answer to the request before: its transaction and protocol data unit.
    before: Option<(u16, Vec<u8>)>,
}

pub(super) enum Say {
    Bytes(Vec<u8>),
    Nothing,
    Goodbye,
}

impl Mouth {
    pub(super) fn new(framing: Framing) -> Mouth {
        Mouth { framing, is_mute: false, before: None }
    }

    fn frame(&self, transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
        match self.framing {
            Framing::Tcp => frame(transaction, unit, pdu),
            Framing::Rtu => super::rtu::frame(unit, pdu),
        }
    }

    pub(super) fn say(&mut self, header: Header, reply: &Reply) -> Say {
        self.is_mute |= reply.fault == Some(ReplyFault::HalfOpen);
        let Some(pdu) = &reply.pdu else { return Say::Nothing };
        let before = self.before.replace((header.transaction, pdu.clone()));
        if self.is_mute {
            return Say::Nothing;
        }
        let plain = |pdu: &[u8]| Say::Bytes(self.frame(header.transaction, header.unit, pdu));
        match reply.fault {
            Some(ReplyFault::Close) => Say::Goodbye,
            Some(ReplyFault::Garbage) => {
                let mut random = stream(u64::from(header.transaction), "garbage");
                Say::Bytes((0..16).map(|_| random.random()).collect())
            }
            Some(ReplyFault::WrongUnit) => {
                Say::Bytes(self.frame(header.transaction, header.unit.wrapping_add(1), pdu))
            }
            Some(ReplyFault::WrongTransaction) => {
                Say::Bytes(self.frame(header.transaction.wrapping_add(1), header.unit, pdu))
            }
            Some(ReplyFault::WrongChecksum) => {
                let mut bytes = self.frame(header.transaction, header.unit, pdu);
                bytes.last_mut().into_iter().for_each(|last| *last ^= 1);
                Say::Bytes(bytes)
            }
            Some(ReplyFault::WrongFunction) => plain(&changed(pdu, 0, |function| function ^ 1)),
            Some(ReplyFault::WrongEcho) => plain(&changed(pdu, pdu.len() - 1, |low| low.wrapping_add(1))),
            Some(ReplyFault::ShortRead) => plain(&resized(pdu, -2)),
            Some(ReplyFault::LongRead) => plain(&resized(pdu, 2)),
            Some(ReplyFault::OneBehind { stale_transaction }) => match before {
                Some((transaction, pdu)) if stale_transaction => {
                    Say::Bytes(self.frame(transaction, header.unit, &pdu))
                }
                Some((_, pdu)) => plain(&pdu),
                None => Say::Nothing,
            },
            _ => plain(pdu),
        }
    }
}

/// The same bytes, but one.
fn changed(pdu: &[u8], at: usize, change: impl Fn(u8) -> u8) -> Vec<u8> {
    let mut bytes = pdu.to_vec();
    if let Some(byte) = bytes.get_mut(at) {
        *byte = change(*byte);
    }
    bytes
}

/// The answer to a read with this many bytes more, in agreement with its own byte count. Exceptions stay as they are.
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
