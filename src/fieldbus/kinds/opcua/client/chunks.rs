//! Limit on the length of the chunks that a server sends. Without it, the library would allocate the length that a
//! chunk header states, up to four gigabytes.

use std::io::{Error, ErrorKind, Result};
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, ReadBuf};

/// Length in bytes of a chunk header: message type (three bytes), whether another chunk follows (one byte), total
/// length of the chunk (32 bits, lowest byte first).
const HEADER: usize = 8;

/// Reader that returns the bytes of its input unchanged, and fails at a chunk longer than `longest`.
pub(super) struct Chunks<R> {
    inner: R,
    longest: usize,
    header: [u8; HEADER],
    /// Number of header bytes read so far.
    known: usize,
    /// Number of bytes of the present chunk that are still to be read.
    rest: usize,
}

impl<R> Chunks<R> {
    pub(super) fn new(inner: R, longest: usize) -> Chunks<R> {
        Chunks { inner, longest, header: [0; HEADER], known: 0, rest: 0 }
    }

    fn check(&mut self, mut bytes: &[u8]) -> Result<()> {
        while !bytes.is_empty() {
            let passed = self.rest.min(bytes.len());
            (self.rest, bytes) = (self.rest - passed, &bytes[passed..]);
            let taken = bytes.len().min(HEADER - self.known);
            self.header[self.known..self.known + taken].copy_from_slice(&bytes[..taken]);
            (self.known, bytes) = (self.known + taken, &bytes[taken..]);
            if self.known == HEADER {
                let [.., a, b, c, d] = self.header;
                let length = usize::try_from(u32::from_le_bytes([a, b, c, d])).unwrap_or(usize::MAX);
                if !(HEADER..=self.longest).contains(&length) {
                    return Err(Error::new(
                        ErrorKind::InvalidData,
                        "a chunk has a length that is not allowed",
                    ));
                }
                (self.known, self.rest) = (0, length - HEADER);
            }
        }
        Ok(())
    }
}

impl<R: AsyncRead + Unpin> AsyncRead for Chunks<R> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<Result<()>> {
        let before = buffer.filled().len();
        ready!(Pin::new(&mut self.inner).poll_read(context, buffer))?;
        Poll::Ready(self.check(&buffer.filled()[before..]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(length: u32, bytes: usize) -> Vec<u8> {
        [b"MSGF".as_slice(), &length.to_le_bytes(), &vec![7; bytes]].concat()
    }

    #[test]
    fn a_chunk_that_says_it_is_longer_than_any_may_be_ends_it_however_it_is_cut() {
        let (right, short) = (chunk(108, 100), chunk(8, 0));
        for (last, is_taken) in [(chunk(1000, 992), true), (chunk(1001, 993), false), (chunk(7, 0), false)] {
            let bytes = [&right, &short, &right, &last].map(Vec::as_slice).concat();
            for size in 1..bytes.len() {
                let mut chunks = Chunks::new((), 1000);
                let taken = bytes.chunks(size).try_for_each(|part| chunks.check(part));
                assert_eq!(taken.is_ok(), is_taken, "{size}");
            }
        }
    }
}
