//! Chunks (whole messages of OPC UA, or parts of them) that a server sends. This code processes each chunk before the
//! library.
//!
//! - The length of a chunk is limited. Without the limit, the library would allocate the length that a chunk header
//!   states, up to four gigabytes.
//! - The first reply of the server is recorded. The library reports every reply except an acknowledgement as a closed
//!   connection. The reason that the server states would be lost.
//! - An answer that opens a secured channel must be from the server. [`ChainOpener`] replaces such an answer
//!   if it contains the server's certificate with its chain.

use std::borrow::Cow;
use std::io::{Error, ErrorKind, Result};
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, ready};

use ::opcua::types::StatusCode;
use tokio::io::{AsyncRead, ReadBuf};

use super::chain::ChainOpener;

/// Length in bytes of a chunk header: message type (three bytes), whether another chunk follows (one byte), total
/// length of the chunk (32 bits, lowest byte first).
const HEADER: usize = 8;

/// Reply of a server to the opening of a connection, as far as it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Reply {
    /// No complete chunk has arrived.
    #[default]
    None,
    /// The server has accepted the connection.
    Acknowledged,
    /// The server has sent an error message with this status. The server then closes the connection.
    Error(StatusCode),
    /// The data that arrived is not OPC UA.
    Foreign,
    /// The answer to the opening of a secured channel is not signed with the trusted certificate.
    NotSigned,
}

/// State of the other end of a connection: its first reply, and the opener of its secured answers.
#[derive(Default)]
pub(super) struct Peer {
    reply: Mutex<Reply>,
    opener: Option<ChainOpener>,
}

impl Peer {
    /// Returns the state before any input has arrived. `opener` opens the secured answers; `None` without security.
    pub(super) fn new(opener: Option<ChainOpener>) -> Peer {
        Peer { reply: Mutex::default(), opener }
    }

    /// Returns the reply of the server to the opening of the connection, as far as it has arrived.
    pub(super) fn reply(&self) -> Reply {
        *self.reply.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn replies(&self, reply: Reply) {
        *self.reply.lock().unwrap_or_else(PoisonError::into_inner) = reply;
    }

    /// Records a complete chunk if it is a reply. Returns the chunk that the library reads.
    ///
    /// # Errors
    /// The chunk opens a secured channel, but is not from the server.
    fn receives<'c>(&self, chunk: &'c [u8]) -> Result<Cow<'c, [u8]>> {
        match (chunk.first_chunk::<3>(), self.reply()) {
            (Some(b"MSG" | b"CLO"), _) => {}
            (Some(b"OPN"), _) => {
                if let Some(opener) = &self.opener {
                    return opener.open(chunk).ok_or_else(|| {
                        self.replies(Reply::NotSigned);
                        Error::new(
                            ErrorKind::InvalidData,
                            "an answer does not have the signature of the server",
                        )
                    });
                }
            }
            (Some(b"ACK"), Reply::None) => self.replies(Reply::Acknowledged),
            (Some(b"ERR"), _) => {
                let status = chunk.get(HEADER..).and_then(<[u8]>::first_chunk::<4>);
                let status = status.map_or(0, |status| u32::from_le_bytes(*status));
                self.replies(Reply::Error(StatusCode::from(status)));
            }
            (_, Reply::None) => self.replies(Reply::Foreign),
            _ => {}
        }
        Ok(Cow::Borrowed(chunk))
    }
}

/// Reader that returns its input one complete chunk after the other. A chunk longer than `longest` is an error.
pub(super) struct Chunks<R> {
    inner: R,
    longest: usize,
    peer: Arc<Peer>,
    /// Received bytes of a chunk that is not complete yet.
    incomplete: Vec<u8>,
    /// Bytes of complete chunks. `passed`: number of these bytes that the library has read.
    complete: Vec<u8>,
    passed: usize,
}

impl<R> Chunks<R> {
    pub(super) fn new(inner: R, longest: usize, peer: Arc<Peer>) -> Chunks<R> {
        Chunks { inner, longest, peer, incomplete: Vec::new(), complete: Vec::new(), passed: 0 }
    }

    /// Adds received bytes to `incomplete`, and moves the chunks that are now complete to `complete`.
    fn take(&mut self, bytes: &[u8]) -> Result<()> {
        self.incomplete.extend_from_slice(bytes);
        let mut begin = 0;
        while let Some(header) = self.incomplete.get(begin..).and_then(<[u8]>::first_chunk::<HEADER>) {
            let [.., a, b, c, d] = *header;
            let length = usize::try_from(u32::from_le_bytes([a, b, c, d])).unwrap_or(usize::MAX);
            if !(HEADER..=self.longest).contains(&length) {
                self.peer.replies(Reply::Foreign);
                return Err(Error::new(ErrorKind::InvalidData, "a chunk has a length that is not allowed"));
            }
            let Some(chunk) = self.incomplete.get(begin..begin + length) else { break };
            self.complete.extend_from_slice(&self.peer.receives(chunk)?);
            begin += length;
        }
        self.incomplete.drain(..begin);
        Ok(())
    }

    /// Copies bytes of complete chunks into the buffer. Returns false if no bytes were left to copy.
    fn fill(&mut self, buffer: &mut ReadBuf<'_>) -> bool {
        let rest = &self.complete[self.passed..];
        let count = rest.len().min(buffer.remaining());
        buffer.put_slice(&rest[..count]);
        self.passed += count;
        if self.passed == self.complete.len() {
            self.complete.clear();
            self.passed = 0;
        }
        count > 0
    }
}

impl<R: AsyncRead + Unpin> AsyncRead for Chunks<R> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<Result<()>> {
        let before = buffer.filled().len();
        loop {
            if self.fill(buffer) {
                return Poll::Ready(Ok(()));
            }
            ready!(Pin::new(&mut self.inner).poll_read(context, buffer))?;
            let read = &buffer.filled()[before..];
            // The input has ended.
            if read.is_empty() {
                return Poll::Ready(Ok(()));
            }
            self.take(read)?;
            buffer.set_filled(before);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fieldbus::kinds::opcua::client::certificate::{NewCertificate, make};
    use ::opcua::crypto::{PrivateKey, SecurityPolicy, X509};
    use isotherm_core::quantity::Moment;
    use std::time::Duration;

    fn message(kind: &[u8], body: &[u8]) -> Vec<u8> {
        let length = u32::try_from(HEADER + body.len()).unwrap();
        [kind, &length.to_le_bytes(), body].concat()
    }

    fn chunks(longest: usize) -> Chunks<()> {
        Chunks::new((), longest, Arc::default())
    }

    #[test]
    fn a_chunk_that_says_it_is_longer_than_any_may_be_ends_it_however_it_is_cut() {
        let chunk =
            |length: u32, bytes: usize| [b"MSGF".as_slice(), &length.to_le_bytes(), &vec![7; bytes]].concat();
        let (right, short) = (chunk(108, 100), chunk(8, 0));
        let before = [&right, &short, &right].map(Vec::as_slice).concat();
        for (last, is_taken) in [(chunk(1000, 992), true), (chunk(1001, 993), false), (chunk(7, 0), false)] {
            let bytes = [&right, &short, &right, &last].map(Vec::as_slice).concat();
            for size in 1..bytes.len() {
                let mut chunks = chunks(1000);
                let taken = bytes.chunks(size).try_for_each(|part| chunks.take(part));
                assert_eq!(taken.is_ok(), is_taken, "{size}");
                assert_eq!(chunks.complete, if is_taken { &*bytes } else { &*before }, "{size}");
            }
        }
    }

    #[tokio::test]
    async fn what_arrives_is_passed_on_however_small_the_reads_are() {
        use tokio::io::AsyncReadExt;
        let bytes =
            [message(b"ACKF", &[0; 20]), message(b"MSGC", &[1; 300]), message(b"MSGF", &[2; 5])].concat();
        for size in [1, 7, 4096] {
            let peer: Arc<Peer> = Arc::default();
            let mut chunks = Chunks::new(bytes.as_slice(), 1000, peer.clone());
            let mut found = Vec::new();
            let mut part = vec![0; size];
            loop {
                match chunks.read(&mut part).await.unwrap() {
                    0 => break,
                    count => found.extend_from_slice(&part[..count]),
                }
            }
            assert_eq!((found, peer.reply()), (bytes.clone(), Reply::Acknowledged), "{size}");
        }
    }

    /// The library would accept the message, whatever its content.
    #[test]
    fn a_message_without_security_that_opens_a_channel_ends_a_secured_channel() {
        let now = Moment::from_nanos(1_900_000_000_000_000_000);
        let NewCertificate { cert, key } =
            make("gateway", "urn:test", "press-7", now, Duration::from_hours(24)).unwrap();
        let own = (X509::from_der(&cert).unwrap(), PrivateKey::from_pem(key.as_bytes()).unwrap());
        let opener = ChainOpener::new(&own, &cert, SecurityPolicy::Basic256Sha256);
        let none = SecurityPolicy::None.to_uri().as_bytes();
        let body = [&[7, 0, 0, 0, 47, 0, 0, 0][..], none, &[0xff; 8], &[0; 40]].concat();
        let (ack, open) = (message(b"ACKF", &[0; 20]), message(b"OPNF", &body));
        for (opener, is_taken, reply) in
            [(None, true, Reply::Acknowledged), (Some(opener), false, Reply::NotSigned)]
        {
            let mut chunks = Chunks::new((), 1000, Arc::new(Peer::new(opener)));
            assert!(chunks.take(&ack).is_ok());
            assert_eq!((chunks.take(&open).is_ok(), chunks.peer.reply()), (is_taken, reply));
            let expected = if is_taken { [ack.as_slice(), &open].concat() } else { ack.clone() };
            assert_eq!(chunks.complete, expected);
        }
    }

    #[test]
    fn the_reply_of_a_server_is_known_after_the_library_has_forgotten_it() {
        let error = |code: u32| message(b"ERRF", &[&code.to_le_bytes()[..], &[0xff; 4]].concat());
        let busy = Reply::Error(StatusCode::BadTcpServerTooBusy);
        let ack = message(b"ACKF", &[0; 20]);
        let cases = [
            (Vec::new(), Reply::None),
            (b"ACKF".to_vec(), Reply::None),
            (ack.clone(), Reply::Acknowledged),
            (error(0x807d_0000), busy),
            ([ack.clone(), error(0x807d_0000)].concat(), busy),
            ([ack.clone(), message(b"MSGF", &[7; 90])].concat(), Reply::Acknowledged),
            (b"HTTP/1.1 400 Bad Request\r\n".to_vec(), Reply::Foreign),
            (b"SSH-2.0-OpenSSH_9.2\r\n".to_vec(), Reply::Foreign),
            ([ack, b"OPNF\xff\xff\xff\xff".to_vec()].concat(), Reply::Foreign),
            (message(b"HELF", &[0; 20]), Reply::Foreign),
        ];
        for (bytes, expected) in cases {
            let mut chunks = chunks(1000);
            let _ = chunks.take(&bytes);
            assert_eq!(chunks.peer.reply(), expected, "{bytes:?}");
        }
    }
}
