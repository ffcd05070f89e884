//! A stream that can be asked for what has already come, past the runtime, which may not have heard of it yet.

use std::io::{self, Read};
use std::pin::Pin;
use std::task::{Context, Poll, Waker};

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

/// What a line is spoken on.
pub trait Port: AsyncRead + AsyncWrite + Send + Unpin {
    /// Takes what waits in the system's buffer.
    ///
    /// # Errors
    /// [`io::ErrorKind::WouldBlock`] where nothing waits, and whatever is wrong with the stream.
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize>;

    /// Forgets what has been written and has not left this computer yet, where the system lets one.
    fn discard_unsent(&mut self) {}
}

impl Port for TcpStream {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        (&*SockRef::from(&*self)).read(bytes)
    }
}

impl<T: Port + ?Sized> Port for Box<T> {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.as_mut().take_waiting(bytes)
    }

    fn discard_unsent(&mut self) {
        self.as_mut().discard_unsent();
    }
}

/// A stream of any kind: what the runtime has not heard of is not known of it.
#[derive(Debug)]
pub(super) struct Any<T>(pub(super) T);

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Port for Any<T> {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut buffer = ReadBuf::new(bytes);
        // Whoever waits for the stream asks again himself.
        let mut context = Context::from_waker(Waker::noop());
        match Pin::new(&mut self.0).poll_read(&mut context, &mut buffer) {
            Poll::Ready(done) => done.map(|()| buffer.filled().len()),
            Poll::Pending => Err(io::ErrorKind::WouldBlock.into()),
        }
    }
}

impl<T: AsyncRead + Unpin> AsyncRead for Any<T> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.0).poll_read(context, buffer)
    }
}

impl<T: AsyncWrite + Unpin> AsyncWrite for Any<T> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.0).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.0).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.0).poll_shutdown(context)
    }
}
