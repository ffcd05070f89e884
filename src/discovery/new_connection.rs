//! Test of a device that does not answer: whether it ignores requests for a time after connecting, or loses the first
//! request of each connection. Also detects a bus line that returns each request (an echo). The test only reads.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

use crate::discovery::bus::LineAddress;
use crate::discovery::unit_reader::UnitReader;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::explain::explain_on;
use crate::fieldbus::wire::{ModbusRequest, Request};
use isotherm_core::codec::Register;
use isotherm_profile::{Bus, BusId, Device, Profile, Quirks, duration_text};

/// Pauses after connecting that are tried, the shortest first.
const PAUSES: [Duration; 2] = [Duration::from_millis(500), LONGEST_PAUSE];
/// Longest pause after connecting that is tried.
pub const LONGEST_PAUSE: Duration = Duration::from_secs(2);
/// Maximum number of devices of a bus to which one read is sent before the test. If all these reads stay unanswered,
/// the first device is tested.
const DEVICES: usize = 4;

/// Peculiar behaviour of a device on a new connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NewConnection {
    /// Device that ignores requests during this time after connecting.
    Deaf(Duration),
    /// Device that loses the first request of each connection.
    LosesFirst,
}

/// Device of a profile that ignores or loses requests on a new connection, or whose line returns each request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct NewConnectionAdvice {
    /// Name of the bus in the profile.
    pub bus: String,
    /// Name of the device in the profile.
    pub device: String,
    /// Description of the behaviour, and what to do.
    pub advice: String,
}

/// Result of a read on a new connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ReadResult {
    /// The unit answers, with data or with an exception.
    Answered,
    Silent,
    /// The line returned the request itself, and the unit did not answer.
    Echoed,
}

/// Describes the behaviour, and names the profile key that adapts the gateway to it.
impl fmt::Display for NewConnection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NewConnection::Deaf(pause) => write!(
                f,
                "the device ignores requests directly after connecting: write quirks = {{ pause_after_connect = \"{}\" }}",
                duration_text(*pause)
            ),
            NewConnection::LosesFirst => f.write_str(
                "the device loses the first request of each connection: write quirks = { loses_first_request = true }",
            ),
        }
    }
}

/// Tests a unit that has not answered a read of these registers. Returns the behaviour that explains the missing answer.
/// Returns `None` if the unit answers with the present settings, or if no tested setting helps. The caller must have
/// closed its own connection.
pub async fn examine(
    line: &LineAddress,
    bus: &Bus,
    quirks: Quirks,
    unit: u8,
    read: (Register, u16),
) -> Option<NewConnection> {
    // A single lost answer shows nothing about the device.
    if is_answered(line, bus, quirks, unit, read).await {
        return None;
    }
    let [short, long] = PAUSES.map(NewConnection::Deaf);
    for found in [short, long, NewConnection::LosesFirst] {
        let changed = match found {
            NewConnection::Deaf(pause) => Quirks { pause_after_connect: pause, ..quirks },
            NewConnection::LosesFirst => Quirks { loses_first_request: true, ..quirks },
        };
        let is_new = match found {
            NewConnection::Deaf(pause) => pause > quirks.pause_after_connect,
            NewConnection::LosesFirst => !quirks.loses_first_request,
        };
        if is_new && is_answered(line, bus, changed, unit, read).await {
            // A device that sometimes answers without the setting does not need it.
            let is_needed = !is_answered(line, bus, quirks, unit, read).await;
            return is_needed.then_some(found);
        }
    }
    None
}

/// Returns whether the unit answers a read on a new connection.
async fn is_answered(line: &LineAddress, bus: &Bus, quirks: Quirks, unit: u8, read: (Register, u16)) -> bool {
    send(line, bus, quirks, unit, read).await == ReadResult::Answered
}

/// Sends a read on a new connection. Returns whether the unit answered, the line returned the request itself (an echo),
/// or the read failed.
async fn send(
    line: &LineAddress,
    bus: &Bus,
    quirks: Quirks,
    unit: u8,
    (from, count): (Register, u16),
) -> ReadResult {
    let mut reader = UnitReader::new(line, bus, quirks, None);
    let answer = reader.read(unit, from, count).await;
    match answer {
        Ok(_) => ReadResult::Answered,
        Err(fault) if fault.is_refusal() && !fault.is_of_a_gateway() => ReadResult::Answered,
        Err(Fault::Timeout) if reader.has_come_back() => ReadResult::Echoed,
        Err(_) => ReadResult::Silent,
    }
}

/// Tests the Modbus buses of a profile on which no device answers. Calls `begins` with the bus and the device before
/// each test that takes long. Returns the devices that need a quirk in the profile, and the devices on a bus line that
/// returns each request.
pub async fn examined(profile: &Profile, begins: impl Fn(&Bus, &Device)) -> Vec<NewConnectionAdvice> {
    let mut found = Vec::new();
    for (place, bus) in profile.buses.iter().enumerate() {
        let reads = profile.devices_on(BusId(place)).filter_map(|(id, device)| {
            let request = profile.requests(id).into_iter().next()?;
            let Request::Modbus(ModbusRequest::Read { from, count }) = Request::in_registers(&request.asks)?
            else {
                return None;
            };
            Some((device, (from, count)))
        });
        let reads: Vec<_> = reads.take(DEVICES).collect();
        let Some((first, read)) = reads.first().copied() else { continue };
        let line = LineAddress::of(bus);
        let (mut does_answer, mut is_echoed) = (false, false);
        for (device, read) in &reads {
            let result = send(&line, bus, device.quirks, device.unit, *read).await;
            does_answer = result == ReadResult::Answered;
            is_echoed |= result == ReadResult::Echoed;
            if does_answer {
                break;
            }
        }
        if does_answer {
            continue;
        }
        begins(bus, first);
        let behaviour = examine(&line, bus, first.quirks, first.unit, read).await;
        let echo = || explain_on(bus.transport, Fault::Peer(PeerFault::Echoed)).to_string();
        let advice = behaviour.map(|behaviour| behaviour.to_string()).or_else(|| is_echoed.then(echo));
        if let Some(advice) = advice {
            found.push(NewConnectionAdvice { bus: bus.name.clone(), device: first.name.clone(), advice });
        }
    }
    found
}

#[cfg(test)]
mod tests;
