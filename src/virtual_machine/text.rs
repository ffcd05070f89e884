//! Virtual devices that send lines of text: readouts, gauges, and DCON modules.
//!
//! The hardware of the virtual machine has registers. Each value of a text is therefore stored in registers, at an
//! address of this module, and plant, faults and counters of requests apply to it as to any other value. The answer of
//! the registers, with its fault, then becomes text.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use super::server::{OpenOrClose, Shared};
use crate::clock::Silence;
use answer::{Content, Sender, TextAnswer};
use isotherm_core::codec::{Address, Register, Table, TextPattern};
use isotherm_profile::plan::ReadTarget;
use isotherm_profile::{BusId, DeviceId, Profile, Serial};

mod answer;
pub(super) mod terminal;

/// Registers of one value, which is a 64-bit float.
const WIDTH: u16 = 4;
/// Largest number of values in one read of registers.
const MOST_VALUES: usize = 30;
/// Read of input registers.
const READ: u8 = 4;
/// Limits of the interval at which a device sends without a request.
const SHORTEST_INTERVAL: Duration = Duration::from_millis(20);
const LONGEST_INTERVAL: Duration = Duration::from_secs(1);
/// Longest request that a device recognises.
const LONGEST_REQUEST: usize = 128;

/// Values that a device sends in answer to one request, or without a request.
#[derive(Clone, Debug)]
pub(super) struct TextGroup {
    bus: BusId,
    device: DeviceId,
    unit: u8,
    /// Empty if the device sends without a request.
    request: String,
    patterns: Vec<TextPattern>,
    /// First register of the first value.
    first: u16,
    every: Duration,
}

/// One line with its devices.
#[derive(Debug)]
pub(super) struct TextLine {
    groups: Vec<TextGroup>,
    shared: Shared,
}

/// Returns the profile with an address in registers for each text, and the groups of texts with these addresses.
pub(super) fn in_registers(profile: &Profile) -> (Profile, Vec<TextGroup>) {
    let (mut changed, mut groups, mut next) = (profile.clone(), Vec::new(), 0_u16);
    for (index, device) in profile.devices.iter().enumerate() {
        for request in profile.requests(DeviceId(index)) {
            let ReadTarget::Texts(texts) = &request.asks else { continue };
            let first = next;
            for field in &request.fields {
                let register = Register { table: Table::Input, offset: next };
                changed.signals[field.signal.0].address = Address::Modbus(register);
                next = next.saturating_add(WIDTH);
            }
            groups.push(TextGroup {
                bus: device.bus,
                device: DeviceId(index),
                unit: device.unit,
                request: texts.first().map(|text| text.request.clone()).unwrap_or_default(),
                patterns: texts.iter().map(|text| text.pattern.clone()).collect(),
                first,
                every: device.every,
            });
        }
    }
    (changed, groups)
}

impl TextGroup {
    /// Returns whether the device is a DCON module.
    fn is_dcon(&self) -> bool {
        self.request.starts_with('#')
    }
}

impl TextLine {
    /// Returns the line of the buses with the address of this bus.
    pub(super) fn of(profile: &Profile, bus: usize, groups: &[TextGroup], shared: Shared) -> TextLine {
        let address = &profile.buses[bus].address;
        let is_on_line = |group: &&TextGroup| profile.bus(group.bus).address == *address;
        TextLine { groups: groups.iter().filter(is_on_line).cloned().collect(), shared }
    }

    /// Interval at which devices send without a request. `None` if each waits for a request.
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
            let reply = self.shared.hardware().serve(group.device, &pdu, self.shared.clock.now());
            answer.add(reply);
            from = from.saturating_add(count);
        }
        answer
    }
}

/// Sends and answers until the stream ends. With `pace`, each byte takes as long as on a serial line with these
/// settings.
async fn converse<S>(mut stream: S, line: &TextLine, pace: Option<Serial>) -> io::Result<()>
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
        let mut names: Vec<u8> = Vec::new();
        for byte in &bytes[..count] {
            received.push(byte & 0x7f);
            let is_asked = |group: &&TextGroup| {
                !group.request.is_empty() && received.ends_with(group.request.as_bytes())
            };
            let longest = line.groups.iter().filter(is_asked).max_by_key(|group| group.request.len());
            let is_named =
                |group: &&TextGroup| received.ends_with(answer::name_request(group.unit).as_bytes());
            let name = line.groups.iter().filter(|group| group.is_dcon()).find(is_named);
            names.extend(name.map(|group| group.unit));
            let is_over = longest.is_some() || name.is_some() || received.ends_with(b"\r");
            if is_over || received.len() > LONGEST_REQUEST {
                received.clear();
            }
            due.extend(longest);
        }
        for unit in names {
            stream.write_all(answer::name(unit).as_bytes()).await?;
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

/// Serves the devices of a line on a listener, until `stop` changes or its sender is dropped.
pub(super) async fn serve(
    listener: TcpListener,
    line: Arc<TextLine>,
    mut switched: mpsc::Receiver<OpenOrClose>,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
    let address = listener.local_addr()?;
    let mut listener = Some(listener);
    let mut connections: JoinSet<io::Result<()>> = JoinSet::new();
    loop {
        tokio::select! {
            _ = stop.changed() => return Ok(()),
            switch = switched.recv() => {
                let Some(OpenOrClose { is_open, done }) = switch else { return Ok(()) };
                listener = None;
                if is_open {
                    listener = Some(TcpListener::bind(address).await?);
                } else {
                    connections.shutdown().await;
                }
                let _ = done.send(());
            }
            accepted = accept(listener.as_ref()) => {
                let line = line.clone();
                let stream = accepted?;
                connections.spawn(async move {
                    stream.set_nodelay(true)?;
                    converse(stream, &line, None).await
                });
            }
            Some(ended) = connections.join_next() => {
                if let Err(error) = ended && error.is_panic() {
                    return Err(io::Error::other(error));
                }
            }
        }
    }
}

/// Waits for the next connection. Never returns without a listener.
async fn accept(listener: Option<&TcpListener>) -> io::Result<TcpStream> {
    match listener {
        Some(listener) => Ok(listener.accept().await?.0),
        None => std::future::pending().await,
    }
}

#[cfg(test)]
mod tests;
