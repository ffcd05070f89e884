//! A TCP stream that looks for its answer once more before it waits.
//!
//! A control that runs on the same computer (a software PLC, LinuxCNC) answers within microseconds of getting the
//! processor. Waiting for it through the event queue costs more than the answer itself, so it is first given one turn
//! of the processor. Towards another computer that turn would be wasted, and the stream is left as it is; so is one whose
//! answers did not come within that turn, but for a try now and then.

use std::io::{self, Read, Write};
use std::pin::Pin;
use std::task::{Context, Poll};

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

use super::port::Port;

/// After as many looks in vain as are remembered here, one is made every so many answers.
const SELDOM: u32 = 64;
const IN_VAIN: u32 = 8;

/// A connection to a peer that may be on this computer.
#[derive(Debug)]
pub(super) struct Eager {
    stream: TcpStream,
    is_local: bool,
    /// Looks in vain since the last that was not.
    in_vain: u32,
    /// A request was sent and has not been looked after. What follows the look comes by the event queue, so that a peer
    /// who never ends keeps nobody else from his turn.
    has_asked: bool,
}

impl Eager {
    pub(super) fn new(stream: TcpStream) -> Eager {
        let is_local = match (stream.peer_addr(), stream.local_addr()) {
            // A computer that speaks to itself by its own name has the same address at both ends.
            (Ok(peer), Ok(own)) => peer.ip().is_loopback() || peer.ip() == own.ip(),
            _ => false,
        };
        Eager { stream, is_local, in_vain: 0, has_asked: false }
    }

    /// Whether to look before waiting: once a request, while that pays.
    fn looks(&mut self) -> bool {
        if !self.is_local || !std::mem::take(&mut self.has_asked) {
            return false;
        }
        if self.in_vain >= IN_VAIN && !self.in_vain.is_multiple_of(SELDOM) {
            self.in_vain = self.in_vain.wrapping_add(1).max(IN_VAIN);
            return false;
        }
        true
    }
}

/// Waiting, or trying again, is all that it asks for.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

impl Port for Eager {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.stream.take_waiting(bytes)
    }
}

impl AsyncRead for Eager {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.looks() {
            // Past tokio, which only asks the system again after its event queue has spoken.
            let mut look = || (&*SockRef::from(&self.stream)).read(buffer.initialize_unfilled());
            // Sending may have given the other end its turn already.
            let looked = match look() {
                Err(error) if is_passing(&error) => {
                    std::thread::yield_now();
                    look()
                }
                looked => looked,
            };
            match looked {
                Err(error) if is_passing(&error) => self.in_vain = self.in_vain.saturating_add(1),
                Err(error) => return Poll::Ready(Err(error)),
                Ok(length) => {
                    self.in_vain = 0;
                    buffer.advance(length);
                    return Poll::Ready(Ok(()));
                }
            }
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Eager {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.has_asked = true;
        if self.is_local {
            match (&*SockRef::from(&self.stream)).write(bytes) {
                Err(error) if is_passing(&error) => {}
                done => return Poll::Ready(done),
            }
        }
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}
