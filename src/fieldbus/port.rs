//! Byte streams to devices. Input in the system's buffer can be read directly, even if the async runtime was not
//! notified of it yet. A tap (recorder) can log all bytes.

use std::io::{self, Read};
use std::pin::Pin;
use std::task::{Context, Poll, Waker};

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, DuplexStream, ReadBuf};
use tokio::net::TcpStream;

use super::trace::Tap;

/// Stream of bytes to and from a device.
pub trait Port: AsyncRead + AsyncWrite + Send + Unpin {
    /// Reads input that is in the system's buffer, without waiting. The default implementation reads only input of
    /// which the async runtime was notified.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] if there is no input, or any other error of the stream.
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut buffer = ReadBuf::new(bytes);
        // The caller polls the stream again if it waits.
        let mut context = Context::from_waker(Waker::noop());
        match Pin::new(self).poll_read(&mut context, &mut buffer) {
            Poll::Ready(done) => done.map(|()| buffer.filled().len()),
            Poll::Pending => Err(io::ErrorKind::WouldBlock.into()),
        }
    }

    /// Discards output that has not left this computer yet. Does nothing if the system does not support that.
    fn discard_unsent(&mut self) {}
}

impl Port for TcpStream {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        (&*SockRef::from(&*self)).read(bytes)
    }
}

impl Port for DuplexStream {}

/// Returns whether the other end closed an idle stream in an orderly way. `error` is the error of the stream;
/// `None` if the stream ended without an error. A device that is switched off does not close its connections,
/// and resets them when it runs again.
pub(super) fn is_in_order(error: Option<&io::Error>) -> bool {
    // A reset after a close is a broken pipe. Many devices close TLS without its closing message, an unexpected end.
    error.is_none_or(|error| matches!(error.kind(), io::ErrorKind::BrokenPipe | io::ErrorKind::UnexpectedEof))
}

/// Port whose bytes are copied to a tap (recorder of the frames on a line).
pub(super) struct Tapped {
    port: Box<dyn Port>,
    tap: Tap,
}

impl Tapped {
    pub(super) fn new(port: impl Port + 'static, tap: &Tap) -> Tapped {
        Tapped { port: Box::new(port), tap: tap.clone() }
    }

    /// Sends all of these bytes, and copies the sent bytes to the tap.
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

    /// Waits for input, and stores it in `bytes`. Returns the number of received bytes; 0 at the end of the stream.
    pub(super) async fn receive(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.port.read(bytes).await?;
        self.tap.pass(&bytes[..count], false);
        Ok(count)
    }

    /// Reads input without waiting, see [`Port::take_waiting`]. The tap (recorder of the line) also gets input that is
    /// then discarded, because a user who reads the log can find late answers in it.
    pub(super) fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.port.take_waiting(bytes)?;
        self.tap.pass(&bytes[..count], false);
        Ok(count)
    }

    /// Discards unsent output, see [`Port::discard_unsent`].
    pub(super) fn discard_unsent(&mut self) {
        self.port.discard_unsent();
    }
}
