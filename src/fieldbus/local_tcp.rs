//! TCP stream that tries to read the answer at once, before it waits in the event queue.
//!
//! A control on the same computer (a software PLC, LinuxCNC) answers within microseconds once it gets the
//! processor. Waiting in the event queue takes longer than such an answer. The stream therefore reads at
//! once, yields the processor, and reads again. If the peer is another computer, such an attempt would waste
//! time, and the stream waits in the event queue at once. After [`IN_VAIN`] attempts in a row without an
//! answer, the stream makes an attempt only for one request in [`SELDOM`].

use std::io::{self, Read, Write};
use std::pin::Pin;
use std::task::{Context, Poll};

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

use super::port::Port;

/// Period, in requests, of the attempts to read at once, after [`IN_VAIN`] attempts in a row have found no answer.
const SELDOM: u32 = 64;
const IN_VAIN: u32 = 8;

/// TCP connection to a peer that may be on this computer.
#[derive(Debug)]
pub(super) struct LocalTcp {
    stream: TcpStream,
    is_local: bool,
    /// Number of consecutive attempts to read at once that found no answer. From [`IN_VAIN`] on, requests
    /// without an attempt are counted too.
    in_vain: u32,
    /// Whether the next read may be tried at once: a request was sent, and no such attempt was made for its answer.
    /// After one attempt the stream waits in the event queue, so that a peer that never stops sending blocks no other
    /// task.
    has_asked: bool,
}

impl LocalTcp {
    pub(super) fn new(stream: TcpStream) -> LocalTcp {
        let is_local = match (stream.peer_addr(), stream.local_addr()) {
            // A computer that connects to itself by its own name has the same address at both ends.
            (Ok(peer), Ok(own)) => peer.ip().is_loopback() || peer.ip() == own.ip(),
            _ => false,
        };
        LocalTcp { stream, is_local, in_vain: 0, has_asked: false }
    }

    /// Returns whether to try a read at once, before waiting. This is true at most once per request. After several
    /// attempts without an answer, it is rarely true.
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

/// Returns whether the error is temporary: the caller must wait or try again.
fn is_passing(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

impl Port for LocalTcp {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.stream.take_waiting(bytes)
    }
}

impl AsyncRead for LocalTcp {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.looks() {
            // Bypass tokio, which calls the system again only after an event.
            let mut look = || (&*SockRef::from(&self.stream)).read(buffer.initialize_unfilled());
            // The peer may already have run while the request was sent.
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

impl AsyncWrite for LocalTcp {
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
