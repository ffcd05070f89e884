//! The device's side of Modbus RTU: requests out of bytes, and a conversation on anything that carries bytes.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::task::JoinSet;

use super::fault::ReplyFault;
use super::modbus::Header;
use super::server::{Framing, Line, Mouth, Say};
use isotherm_core::codec::checksum;
use isotherm_profile::Serial;

/// Bytes that have not become a request after this silence never will.
const GAP: Duration = Duration::from_millis(20);
/// Between the bytes of an answer that comes one byte at a time.
const DRIBBLE: Duration = Duration::from_millis(1);

/// A frame around a protocol data unit.
pub(super) fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut bytes = [&[unit], pdu].concat();
    bytes.extend(checksum(&bytes).to_le_bytes());
    bytes
}

/// The length of the request at the beginning of these bytes, if it is whole and its checksum is right.
fn request(bytes: &[u8]) -> Option<usize> {
    let end = match *bytes.get(1)? {
        1..=6 => 8,
        15 | 16 => 9 + usize::from(*bytes.get(6)?),
        _ => return None,
    };
    let (body, sum) = bytes.get(..end)?.split_at(end - 2);
    (checksum(body).to_le_bytes() == *sum).then_some(end)
}

/// Answers requests until the stream ends. A serial line takes its time for each byte.
pub(super) async fn converse<S>(mut stream: S, line: &Arc<Line>, pace: Option<Serial>) -> io::Result<()>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let mut mouth = Mouth::new(Framing::Rtu);
    let mut received = Vec::new();
    let mut late = JoinSet::new();
    loop {
        let mut bytes = [0; 256];
        tokio::select! {
            read = stream.read(&mut bytes) => match read? {
                0 => return Ok(()),
                count => received.extend(&bytes[..count]),
            },
            Some(answer) = late.join_next() => {
                let answer: Vec<u8> = answer.map_err(io::Error::other)?;
                stream.write_all(&answer).await?;
            }
            () = tokio::time::sleep(GAP), if !received.is_empty() => received.clear(),
        }
        while let Some(end) = request(&received) {
            let asked: Vec<u8> = received.drain(..end).collect();
            let (unit, pdu) = (asked[0], &asked[1..end - 2]);
            let reply = line.answer(unit, pdu);
            let header = Header { transaction: 0, unit, pdu: pdu.len() };
            let bytes = match mouth.say(header, &reply) {
                Say::Bytes(bytes) => bytes,
                // A serial line has nothing that could be closed.
                Say::Goodbye if pace.is_none() => return Ok(()),
                Say::Nothing | Say::Goodbye => continue,
            };
            if let Some(serial) = pace {
                tokio::time::sleep(serial.bytes(asked.len() + bytes.len())).await;
            }
            match reply.fault {
                Some(ReplyFault::Late(delay)) => {
                    late.spawn(async move {
                        tokio::time::sleep(delay).await;
                        bytes
                    });
                }
                Some(ReplyFault::OneByteAtATime) => {
                    for byte in bytes {
                        stream.write_all(&[byte]).await?;
                        tokio::time::sleep(DRIBBLE).await;
                    }
                }
                _ => stream.write_all(&bytes).await?,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_request_is_whole_with_its_last_byte_and_its_checksum() {
        for pdu in [[3, 0, 107, 0, 3].as_slice(), &[16, 0, 1, 0, 2, 4, 0, 1, 0, 2], &[5, 0, 1, 255, 0]] {
            let bytes = frame(17, pdu);
            assert_eq!(request(&bytes), Some(bytes.len()));
            assert_eq!(request(&bytes[..bytes.len() - 1]), None);
            let mut wrong = bytes.clone();
            wrong[3] ^= 1;
            assert_eq!(request(&wrong), None);
        }
    }

    proptest! {
        #[test]
        fn no_bytes_make_the_device_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            prop_assert!(request(&bytes).is_none_or(|end| end <= bytes.len()));
        }
    }
}
