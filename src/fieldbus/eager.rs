//! A TCP stream that looks for its answer once more before it waits.
//!
//! A control that runs on the same computer (a software PLC, LinuxCNC) answers within microseconds of getting the
//! processor. Waiting for it through the event queue costs more than the answer itself, so it is first given one turn
//! of the processor. Towards another computer that turn would be wasted, and the stream is left as it is.

use std::io::{self, Read, Write};
use std::pin::Pin;
use std::task::{Context, Poll};

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

/// A whole answer: header and the longest of Modbus's messages.
const LONGEST_FRAME: usize = 260;

/// A connection to a peer that may be on this computer.
#[derive(Debug)]
pub(super) struct Eager {
    stream: TcpStream,
    is_local: bool,
    /// The answer has begun to come. What follows it comes by the event queue, so that a peer who never ends keeps nobody
    /// else from his turn.
    has_read: bool,
}

impl Eager {
    pub(super) fn new(stream: TcpStream) -> Eager {
        let is_local = match (stream.peer_addr(), stream.local_addr()) {
            // A computer that speaks to itself by its own name has the same address at both ends.
            (Ok(peer), Ok(own)) => peer.ip().is_loopback() || peer.ip() == own.ip(),
            _ => false,
        };
        Eager { stream, is_local, has_read: false }
    }
}

/// Waiting, or trying again, is all that it asks for.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

impl AsyncRead for Eager {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.is_local && !self.has_read {
            std::thread::yield_now();
            // Past tokio, which only asks the system again after its event queue has spoken.
            let mut frame = [0; LONGEST_FRAME];
            let room = frame.len().min(buffer.remaining());
            match (&*SockRef::from(&self.stream)).read(&mut frame[..room]) {
                Err(error) if is_passing(&error) => {}
                Err(error) => return Poll::Ready(Err(error)),
                Ok(length) => {
                    self.has_read = true;
                    buffer.put_slice(&frame[..length]);
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
        self.has_read = false;
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
