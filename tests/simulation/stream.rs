//! A connection of the gateway to a simulated device.

use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use isotherm::fieldbus::connection::{Connection, Dial};
use isotherm::fieldbus::error::{Fault, LinkFault};
use isotherm::fieldbus::modbus::ModbusTcp;
use isotherm::fieldbus::port::Port;
use isotherm::fieldbus::trace::Tap;
use isotherm::fieldbus::wire::Boxed;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::Sleep;

use crate::link::{Heard, World};
use crate::nodes::Nodes;

/// The world, as everybody shares it.
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
    /// The device is a server of OPC UA.
    pub(crate) has_nodes: bool,
}

impl Dial for SimulatedDial {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        let number = self.shared.world().dial(self.line);
        let stream =
            number.map(|number| Stream { shared: self.shared.clone(), line: self.line, number, timer: None });
        let connection = stream.map(|stream| match (ModbusTcp::new(stream, tap), self.has_nodes) {
            (below, true) => Connection::Other(Box::new(Nodes(below))),
            (below, false) => Connection::Modbus(below),
        });
        Box::pin(std::future::ready(connection.ok_or(Fault::Link(LinkFault::Refused))))
    }
}

struct Stream {
    shared: Shared,
    line: usize,
    number: u64,
    /// When there may be something to be read.
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
