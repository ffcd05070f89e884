//! Modbus TCP through tokio-modbus; beside this only [`super::rtu`] knows the library, for its decoder.
//!
//! The library compares transaction, unit and function of an answer, but not the length of a read nor the echo of a
//! write (in release builds; in debug builds its typed calls panic), and it has no timeout and no reconnect. So the
//! untyped `call` is used, everything is checked here, and [`super::line`] does the rest.

use std::borrow::Cow;
use std::fmt;
use std::io;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_modbus::client::{Client, tcp};
use tokio_modbus::{Error, ProtocolError, Request as Pdu, Response, Slave};

use super::eager::Eager;
use super::error::{CallerFault, Fault, LinkFault, PeerFault};
use super::tls;
use super::trace::{Tap, Teed};
use super::wire::{Answer, Boxed, Connection, Dial, Request, Wire};
use crate::codec::Table;

/// Opens TCP connections to one address.
#[derive(Clone, Debug)]
pub struct TcpDial {
    address: String,
    tap: Tap,
}

impl TcpDial {
    /// To `host:port`.
    pub fn new(address: &str) -> TcpDial {
        TcpDial { address: address.to_owned(), tap: Tap::default() }
    }
}

impl Dial for TcpDial {
    fn dial(&mut self) -> Boxed<'_, Result<Connection, Fault>> {
        Box::pin(async {
            let stream = connected(&self.address).await?;
            Ok(Connection::Modbus(attach(Teed::new(Eager::new(stream), self.tap.clone()))))
        })
    }

    fn tap(&mut self, tap: &Tap) {
        self.tap = tap.clone();
    }
}

/// A TCP connection to `host:port`.
pub(super) async fn connected(address: &str) -> Result<TcpStream, Fault> {
    let stream = TcpStream::connect(address).await.map_err(|error| dial_fault(&error))?;
    // A small request must not wait for the answer to the last one.
    stream.set_nodelay(true).map_err(|_| Fault::Link(LinkFault::Broken))?;
    Ok(stream)
}

/// Modbus TCP over any stream.
pub fn attach<T>(stream: T) -> ModbusTcp
where
    T: AsyncRead + AsyncWrite + Send + Unpin + fmt::Debug + 'static,
{
    ModbusTcp { client: tcp::attach(stream).into() }
}

/// An open Modbus TCP connection.
pub struct ModbusTcp {
    client: Box<dyn Client>,
}

impl ModbusTcp {
    pub(super) async fn exchange(&mut self, unit: u8, request: Request<'_>) -> Result<Answer, Fault> {
        self.client.set_slave(Slave(unit));
        let pdu = pdu(request).ok_or(Fault::Caller(CallerFault::Function))?;
        match self.client.call(pdu).await {
            Ok(Ok(response)) => check(request, response),
            Ok(Err(exception)) => Err(Fault::Exception(exception.into())),
            Err(Error::Protocol(ProtocolError::HeaderMismatch { .. })) => {
                Err(Fault::Peer(PeerFault::Foreign))
            }
            Err(Error::Protocol(ProtocolError::FunctionCodeMismatch { .. })) => {
                Err(Fault::Peer(PeerFault::Function))
            }
            Err(Error::Transport(error)) => Err(transport_fault(&error)),
        }
    }
}

impl Wire for ModbusTcp {
    fn call<'a>(&'a mut self, unit: u8, request: Request<'a>) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(self.exchange(unit, request))
    }
}

fn pdu(request: Request<'_>) -> Option<Pdu<'_>> {
    Some(match request {
        Request::Read { from, count } => match from.table {
            Table::Coil => Pdu::ReadCoils(from.offset, count),
            Table::Discrete => Pdu::ReadDiscreteInputs(from.offset, count),
            Table::Input => Pdu::ReadInputRegisters(from.offset, count),
            Table::Holding => Pdu::ReadHoldingRegisters(from.offset, count),
            Table::Object | Table::Process => return None,
        },
        Request::WriteCoil { at, value } => Pdu::WriteSingleCoil(at, value),
        Request::WriteSingle { at, word } => Pdu::WriteSingleRegister(at, word),
        Request::WriteMultiple { at, words } => Pdu::WriteMultipleRegisters(at, Cow::Borrowed(words)),
        Request::Can(_) => return None,
    })
}

/// Whether this is the answer to that question, in every part the protocol repeats.
pub(super) fn check(request: Request<'_>, response: Response) -> Result<Answer, Fault> {
    match (request, response) {
        (
            Request::Read { count, .. },
            Response::ReadInputRegisters(words) | Response::ReadHoldingRegisters(words),
        ) => {
            if words.len() == usize::from(count) {
                Ok(Answer::Words(words))
            } else {
                Err(length())
            }
        }
        (
            Request::Read { count, .. },
            Response::ReadCoils(mut bits) | Response::ReadDiscreteInputs(mut bits),
        ) => {
            // Bits travel in whole bytes.
            if bits.len() != usize::from(count).next_multiple_of(8) && bits.len() != usize::from(count) {
                return Err(length());
            }
            bits.truncate(usize::from(count));
            Ok(Answer::Bits(bits))
        }
        (Request::WriteCoil { at, value }, Response::WriteSingleCoil(echoed, to)) => {
            echo(at == echoed && value == to)
        }
        (Request::WriteSingle { at, word }, Response::WriteSingleRegister(echoed, to)) => {
            echo(at == echoed && word == to)
        }
        (Request::WriteMultiple { at, words }, Response::WriteMultipleRegisters(echoed, count)) => {
            echo(at == echoed && words.len() == usize::from(count))
        }
        _ => Err(Fault::Peer(PeerFault::Function)),
    }
}

const fn length() -> Fault {
    Fault::Peer(PeerFault::Length)
}

fn echo(repeated: bool) -> Result<Answer, Fault> {
    if repeated { Ok(Answer::Done) } else { Err(Fault::Peer(PeerFault::Echo)) }
}

pub(super) fn dial_fault(error: &io::Error) -> Fault {
    match error.kind() {
        io::ErrorKind::ConnectionRefused => Fault::Link(LinkFault::Refused),
        io::ErrorKind::TimedOut => Fault::Timeout,
        _ => Fault::Link(LinkFault::Unreachable),
    }
}

/// Where the stream ends in the middle the library reports whatever error the system had last, "Success" included.
fn transport_fault(error: &io::Error) -> Fault {
    if let Some(fault) = tls::told(error) {
        return fault;
    }
    match error.kind() {
        io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => Fault::Peer(PeerFault::Malformed),
        _ => Fault::Link(LinkFault::Broken),
    }
}

#[cfg(test)]
mod tests;
