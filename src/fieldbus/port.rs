//! The streams that Modbus is spoken on. What has already come can be asked for past the runtime, which may not have heard
//! of it yet, and whatever passes can be listened to.

use std::io::{self, Read};
use std::pin::Pin;
use std::task::{Context, Poll, Waker};

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, DuplexStream, ReadBuf};
use tokio::net::TcpStream;

use super::trace::Tap;

/// What a line is spoken on.
pub trait Port: AsyncRead + AsyncWrite + Send + Unpin {
    /// Takes what waits in the system's buffer; by itself only as much of it as the runtime has heard of.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] where nothing waits, and whatever is wrong with the stream.
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut buffer = ReadBuf::new(bytes);
        // Whoever waits for the stream asks again himself.
        let mut context = Context::from_waker(Waker::noop());
        match Pin::new(self).poll_read(&mut context, &mut buffer) {
            Poll::Ready(done) => done.map(|()| buffer.filled().len()),
            Poll::Pending => Err(io::ErrorKind::WouldBlock.into()),
        }
    }

    /// Forgets what has been written and has not left this computer yet, where the system lets one.
    fn discard_unsent(&mut self) {}
}

impl Port for TcpStream {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        (&*SockRef::from(&*self)).read(bytes)
    }
}

impl Port for DuplexStream {}

/// Whether the other end of a stream that ended between two answers closed it in order. A device that is switched off does
/// not close its connections, and resets them when it is back.
pub(super) fn is_in_order(error: Option<&io::Error>) -> bool {
    // A reset after a close is a broken pipe. Many devices close TLS without its closing message, an unexpected end.
    error.is_none_or(|error| matches!(error.kind(), io::ErrorKind::BrokenPipe | io::ErrorKind::UnexpectedEof))
}

/// A port whose bytes pass a tap.
pub(super) struct Tapped {
    port: Box<dyn Port>,
    tap: Tap,
}

impl Tapped {
    pub(super) fn new(port: impl Port + 'static, tap: &Tap) -> Tapped {
        Tapped { port: Box::new(port), tap: tap.clone() }
    }

    /// Sends all of these bytes.
    pub(super) async fn send(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            let (sent, left) = match self.port.write(bytes).await? {
                0 => return Err(io::ErrorKind::WriteZero.into()),
                count => bytes.split_at(count),
            };
            self.tap.pass(sent, true);
            bytes = left;
        }
        self.port.flush().await
    }

    /// Waits for bytes; none: the stream is at its end.
    pub(super) async fn receive(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.port.read(bytes).await?;
        self.tap.pass(&bytes[..count], false);
        Ok(count)
    }

    /// As [`Port::take_waiting`]. What is taken to be discarded passes the tap too: a late answer is worth seeing.
    pub(super) fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.port.take_waiting(bytes)?;
        self.tap.pass(&bytes[..count], false);
        Ok(count)
    }

    /// As [`Port::discard_unsent`].
    pub(super) fn discard_unsent(&mut self) {
        self.port.discard_unsent();
    }
}
