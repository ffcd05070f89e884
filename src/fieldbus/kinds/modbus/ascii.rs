//! Port that converts RTU frames to Modbus ASCII frames, and received Modbus ASCII frames to RTU frames.
//!
//! The code for RTU uses this port like the port of an RTU line. Late answers, echoes, other masters and
//! unanswered writes are therefore handled as on an RTU line. Each write to the port is one whole frame,
//! followed by a flush.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use crate::fieldbus::port::Port;
use isotherm_core::codec::{AsciiFrames, ascii_frame};

/// Maximum number of characters that one read of the port returns.
const PIECE: usize = 512;

/// Port on which frames are sent and received as Modbus ASCII.
#[derive(Debug)]
pub struct AsciiPort<P> {
    port: P,
    frames: AsciiFrames,
    /// Received frames, converted to the bytes of RTU frames.
    received: Vec<u8>,
    /// Characters that still have to be written to the port.
    unsent: Vec<u8>,
}

impl<P: Port> AsciiPort<P> {
    /// Returns a port for RTU frames that sends and receives these frames as Modbus ASCII through `port`.
    pub fn new(port: P) -> AsciiPort<P> {
        AsciiPort { port, frames: AsciiFrames::default(), received: Vec::new(), unsent: Vec::new() }
    }

    fn poll_send(&mut self, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        while !self.unsent.is_empty() {
            match ready!(Pin::new(&mut self.port).poll_write(context, &self.unsent))? {
                0 => return Poll::Ready(Err(io::ErrorKind::WriteZero.into())),
                count => drop(self.unsent.drain(..count)),
            }
        }
        Poll::Ready(Ok(()))
    }

    /// Removes at most `most` bytes from `received`, and returns the removed bytes.
    fn take(&mut self, most: usize) -> Vec<u8> {
        let count = most.min(self.received.len());
        self.received.drain(..count).collect()
    }
}

impl<P: Port> Port for AsciiPort<P> {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut piece = [0; PIECE];
        while self.received.is_empty() {
            match self.port.take_waiting(&mut piece)? {
                0 => return Ok(0),
                count => self.frames.push(&piece[..count], &mut self.received),
            }
        }
        let taken = self.take(bytes.len());
        bytes[..taken.len()].copy_from_slice(&taken);
        Ok(taken.len())
    }

    fn discard_unsent(&mut self) {
        self.unsent.clear();
        self.port.discard_unsent();
    }
}

impl<P: Port> AsyncRead for AsciiPort<P> {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        let mut piece = [0; PIECE];
        while this.received.is_empty() {
            let mut characters = ReadBuf::new(&mut piece);
            ready!(Pin::new(&mut this.port).poll_read(context, &mut characters))?;
            if characters.filled().is_empty() {
                return Poll::Ready(Ok(()));
            }
            this.frames.push(characters.filled(), &mut this.received);
        }
        buffer.put_slice(&this.take(buffer.remaining()));
        Poll::Ready(Ok(()))
    }
}

impl<P: Port> AsyncWrite for AsciiPort<P> {
    /// Accepts one RTU frame. The flush after it sends the frame as characters. If an earlier frame was not sent
    /// completely, the rest of that frame is dropped. The device discards the incomplete frame when it receives the
    /// colon of the new one.
    fn poll_write(self: Pin<&mut Self>, _: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let this = self.get_mut();
        this.unsent = ascii_frame(bytes);
        Poll::Ready(Ok(bytes.len()))
    }

    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        ready!(this.poll_send(context))?;
        Pin::new(&mut this.port).poll_flush(context)
    }

    /// Closes the port. A frame that is still unsent is discarded.
    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let this = self.get_mut();
        this.unsent.clear();
        Pin::new(&mut this.port).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests;
