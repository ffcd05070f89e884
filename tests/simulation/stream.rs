//! Connection of the gateway to a simulated device.

use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use isotherm::fieldbus::connection::{Connection, Dial};
use isotherm::fieldbus::error::{Fault, LinkFault};
use isotherm::fieldbus::kinds::modbus::ascii::AsciiPort;
use isotherm::fieldbus::kinds::modbus::rtu::Rtu;
use isotherm::fieldbus::kinds::modbus::tcp::ModbusTcp;
use isotherm::fieldbus::kinds::opcua::namespaces::NamespaceTable;
use isotherm::fieldbus::port::Port;
use isotherm::fieldbus::trace::Tap;
use isotherm::fieldbus::wire::Boxed;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::Sleep;

use crate::framing::Framing;
use crate::link::{Heard, World};
use crate::nodes::Nodes;

/// The simulated world, shared by all connections and the script.
#[derive(Clone)]
pub(crate) struct Shared(pub(crate) Arc<Mutex<World>>);

impl Shared {
    pub(crate) fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Opens connections on one line.
pub(crate) struct SimulatedDial {
    pub(crate) shared: Shared,
    pub(crate) line: usize,
    /// Whether the device is an OPC UA server.
    pub(crate) has_nodes: bool,
    /// Current namespaces of the server. `None` if the gateway does not check them.
    pub(crate) namespaces: Option<NamespaceTable>,
    /// Start counts of the server at the last two connections.
    pub(crate) starts: [Option<u64>; 2],
}

impl Dial for SimulatedDial {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        let number = self.shared.world().dial(self.line);
        let stream =
            number.map(|number| Stream { shared: self.shared.clone(), line: self.line, number, timer: None });
        let (servers, framing) = {
            let world = self.shared.world();
            (world.servers, world.lines[self.line].framing)
        };
        if stream.is_some() {
            self.starts = [self.starts[1], Some(servers.starts)];
            self.namespaces.iter().for_each(|table| table.connected(servers.array()));
        }
        let connection = stream.map(|stream| match (framing, self.has_nodes) {
            (Framing::Rtu, _) => Connection::Modbus(Box::new(Rtu::new(stream, None, tap))),
            (Framing::Ascii, _) => Connection::Modbus(Box::new(Rtu::new(AsciiPort::new(stream), None, tap))),
            (Framing::Tcp, true) => {
                let below = ModbusTcp::new(stream, tap);
                let (shared, namespaces) = (self.shared.clone(), self.namespaces.clone());
                Connection::Other(Box::new(Nodes { below, shared, namespaces, servers }))
            }
            (Framing::Tcp, false) => Connection::ModbusTcp(ModbusTcp::new(stream, tap)),
        });
        Box::pin(std::future::ready(connection.ok_or(Fault::Link(LinkFault::Refused))))
    }

    /// Returns whether the connection can be resumed. A restarted server does not know the gateway.
    fn resumes(&self) -> bool {
        !self.has_nodes || self.starts[0].is_none() || self.starts[0] == self.starts[1]
    }

    fn namespaces(&self) -> Option<NamespaceTable> {
        self.namespaces.clone()
    }
}

struct Stream {
    shared: Shared,
    line: usize,
    number: u64,
    /// Time at which there may be data to read.
    timer: Option<(Duration, Pin<Box<Sleep>>)>,
}

impl Port for Stream {}

impl AsyncRead for Stream {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        loop {
            let mut world = this.shared.world();
            match world.hears(this.line, this.number) {
                Heard::Bytes(bytes) => {
                    buffer.put_slice(&bytes);
                    return Poll::Ready(Ok(()));
                }
                Heard::End => return Poll::Ready(Ok(())),
                Heard::Nothing(None) => return Poll::Pending,
                Heard::Nothing(Some(at)) => {
                    if this.timer.as_ref().is_none_or(|(known, _)| *known != at) {
                        this.timer = Some((at, Box::pin(world.passage.timer(at))));
                    }
                    drop(world);
                    let Some((_, timer)) = &mut this.timer else { return Poll::Pending };
                    if timer.as_mut().poll(context).is_pending() {
                        return Poll::Pending;
                    }
                    this.timer = None;
                }
            }
        }
    }
}

impl AsyncWrite for Stream {
    fn poll_write(self: Pin<&mut Self>, _: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        self.shared.world().asks(self.line, self.number, bytes);
        Poll::Ready(Ok(bytes.len()))
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}
