//! The other end of a connection of which a fuzzer chooses the bytes.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};

use isotherm::fieldbus::port::Port;
use isotherm_core::codec::checksum;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

/// Bit of `how` for frames of RTU.
pub(crate) const RTU: u8 = 32;

/// Answers with the given bytes, in pieces, and closes the connection.
#[derive(Debug)]
pub(crate) struct Peer {
    pub(crate) asked: Vec<u8>,
    pub(crate) answer: Vec<u8>,
    pub(crate) at: usize,
    /// Kind of answer. Bit 3: it has the correct header, or in RTU the correct checksum. Bit 4: one byte at a time. Bit
    /// 5: RTU.
    pub(crate) how: u8,
    pub(crate) calls: u32,
}

impl Port for Peer {
    fn take_waiting(&mut self, _: &mut [u8]) -> io::Result<usize> {
        Err(io::ErrorKind::WouldBlock.into())
    }
}

impl AsyncRead for Peer {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.calls == 0 && self.how & 8 != 0 && self.how & RTU != 0 {
            let sum = checksum(&self.answer).to_le_bytes();
            self.answer.extend_from_slice(&sum);
        } else if self.calls == 0 && self.how & 8 != 0 && self.asked.len() >= 7 {
            // Transaction, protocol, length and unit, so that the rest of the answer is parsed.
            let length = u16::try_from(self.answer.len() + 1).unwrap_or(u16::MAX).to_be_bytes();
            let header = [self.asked[0], self.asked[1], 0, 0, length[0], length[1], self.asked[6]];
            self.answer.splice(0..0, header);
        }
        self.calls += 1;
        if self.calls.is_multiple_of(2) {
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        let piece = if self.how & 16 == 0 { 64 } else { 1 };
        let end = self.answer.len().min(self.at + piece.min(buffer.remaining()));
        buffer.put_slice(&self.answer[self.at..end]);
        self.at = end;
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for Peer {
    fn poll_write(mut self: Pin<&mut Self>, _: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        self.asked.extend_from_slice(bytes);
        Poll::Ready(Ok(bytes.len()))
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}
