//! One line with virtual devices that send text: the conversation with a client.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};

use super::answer::{self, Content, Sender, TextAnswer};
use super::group::{TextGroup, WIDTH};
use crate::clock::Silence;
use crate::virtual_machine::hardware::Reply;
use isotherm_profile::{DeviceId, Profile, Serial};

/// Largest number of values in one read of registers.
const MOST_VALUES: usize = 30;
/// Modbus function code that reads input registers.
const READ: u8 = 4;
/// Limits of the interval at which a device sends without a request.
const SHORTEST_INTERVAL: Duration = Duration::from_millis(20);
const LONGEST_INTERVAL: Duration = Duration::from_secs(1);
/// Length in bytes of the longest request that a device recognises.
const LONGEST_REQUEST: usize = 128;

/// Function that executes a Modbus read on a device now. Its second argument is the protocol data unit (request without
/// its frame).
pub(in crate::virtual_machine) type Ask = Arc<dyn Fn(DeviceId, &[u8]) -> Reply + Send + Sync>;

/// One bus line, with the virtual devices on it that send text.
pub(in crate::virtual_machine) struct TextLine {
    groups: Vec<TextGroup>,
    ask: Ask,
}

impl TextLine {
    /// Returns the line with the devices of all buses that have the address of this bus.
    pub(in crate::virtual_machine) fn of(
        profile: &Profile,
        bus: usize,
        groups: &[TextGroup],
        ask: Ask,
    ) -> TextLine {
        let address = &profile.buses[bus].address;
        let is_on_line = |group: &&TextGroup| profile.bus(group.bus).address == *address;
        TextLine { groups: groups.iter().filter(is_on_line).cloned().collect(), ask }
    }

    /// Returns the interval at which the devices send without a request. Returns `None` if every device waits for a
    /// request.
    fn interval(&self) -> Option<Duration> {
        let by_themselves = self.groups.iter().filter(|group| group.request.is_empty());
        let shortest = by_themselves.map(|group| group.every / 2).min()?;
        Some(shortest.clamp(SHORTEST_INTERVAL, LONGEST_INTERVAL))
    }

    /// Returns the answer of a device to the request of this group.
    fn answer(&self, group: &TextGroup) -> TextAnswer {
        let mut answer = TextAnswer { content: Content::Values(Vec::new()), fault: None };
        let mut from = group.first;
        for patterns in group.patterns.chunks(MOST_VALUES) {
            let count = u16::try_from(patterns.len()).unwrap_or(u16::MAX).saturating_mul(WIDTH);
            let ([high, low], [more, less]) = (from.to_be_bytes(), count.to_be_bytes());
            let pdu = [READ, high, low, more, less];
            answer.add((self.ask)(group.device, &pdu));
            from = from.saturating_add(count);
        }
        answer
    }
}

/// Sends values and answers requests until the stream ends. With `pace`, each byte takes as long as on a serial line
/// with these settings.
pub(super) async fn converse<S>(mut stream: S, line: &TextLine, pace: Option<Serial>) -> io::Result<()>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let interval = line.interval();
    let mut sent_at = Silence::begin();
    let mut received = Vec::new();
    let mut sender = Sender::default();
    loop {
        let mut bytes = [0; 64];
        let count = tokio::select! {
            read = stream.read(&mut bytes) => match read? {
                0 => return Ok(()),
                count => count,
            },
            () = tokio::time::sleep(sent_at.left_of(interval.unwrap_or(LONGEST_INTERVAL))), if interval.is_some() => 0,
        };
        let mut due: Vec<&TextGroup> = Vec::new();
        if count == 0 {
            due.extend(line.groups.iter().filter(|group| group.request.is_empty()));
            sent_at = Silence::begin();
        }
        let mut names: Vec<&TextGroup> = Vec::new();
        for byte in &bytes[..count] {
            received.push(byte & 0x7f);
            let is_asked = |group: &&TextGroup| {
                !group.request.is_empty() && received.ends_with(group.request.as_bytes())
            };
            let longest = line.groups.iter().filter(is_asked).max_by_key(|group| group.request.len());
            let is_named = |group: &&TextGroup| received.ends_with(answer::name_request(group).as_bytes());
            let name = line.groups.iter().filter(|group| group.is_dcon()).find(is_named);
            names.extend(name);
            if longest.is_some() || name.is_some() {
                received.clear();
            } else if received.len() > LONGEST_REQUEST {
                received.remove(0);
            }
            due.extend(longest);
        }
        for group in names {
            stream.write_all(answer::name(group).as_bytes()).await?;
        }
        for group in due {
            let answer = line.answer(group);
            let sent = sender.send(group, &answer);
            if let Some(serial) = pace {
                tokio::time::sleep(serial.bytes(sent.bytes.len())).await;
            }
            tokio::time::sleep(sent.delay).await;
            match sent.pause {
                None => stream.write_all(&sent.bytes).await?,
                Some(pause) => {
                    for byte in sent.bytes {
                        stream.write_all(&[byte]).await?;
                        tokio::time::sleep(pause).await;
                    }
                }
            }
            // A serial line has no connection to close.
            if sent.closes && pace.is_none() {
                return Ok(());
            }
        }
    }
}
