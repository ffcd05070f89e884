//! Test of a device on which a planned read fails. A planned read is one request for the registers of several
//! values. The test divides the failed read into other reads, with other quirks (profile settings for
//! peculiar devices). It finds the quirks with which the device returns all values. The test only reads.

use serde::Serialize;

use crate::discovery::bus::{LineAddress, ScanKind};
use crate::discovery::unit_reader::UnitReader;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::explain::explain_on;
use crate::fieldbus::seen::{Asked, Others, Seen};
use isotherm_profile::plan::{ReadRequest, plan};
use isotherm_profile::{Device, DeviceId, Profile, Quirks};

/// Lengths, in registers, that the test tries one after another if a longer read fails.
const LENGTHS: [u16; 7] = [64, 32, 16, 8, 4, 2, 1];

/// Device on which a planned read fails, and which returns the same values with other quirks.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MergedReadTest {
    /// Name of the device in the profile.
    pub device: String,
    /// First planned read that fails, as text.
    pub read: String,
    /// Fault of the failed read as text, with the advice to the user.
    pub fault: String,
    /// Quirks, as written in a profile, with which the device serves all its values.
    pub quirks: String,
}

/// Tests the planned reads of these devices. Returns each device that serves the values only with other quirks,
/// together with the first quirks that help. Reads without gaps (unused registers between the values) are tried first,
/// then shorter reads, then one read for each value.
pub async fn tried(profile: &Profile, devices: &[DeviceId]) -> Vec<MergedReadTest> {
    let mut found = Vec::new();
    for id in devices {
        let device = profile.device(*id);
        let bus = profile.bus(device.bus);
        let line = LineAddress::of(bus);
        let planned = profile.requests(*id);
        if !matches!(line.kind().scan, ScanKind::Units { .. }) || planned.iter().all(is_single) {
            continue;
        }
        let mut reader = UnitReader::new(&line, bus, device.quirks, None);
        let Some((failed, fault)) = first_failure(&mut reader, device, &planned).await else { continue };
        if is_single(&planned[failed]) || !may_depend_on_quirks(fault) {
            continue;
        }
        let with = |quirks: Quirks| {
            let device = Device { quirks, ..device.clone() };
            plan(&device, profile.signals_of(*id))
        };
        // If a value cannot be read alone, no quirk helps.
        let alone = with(Quirks { one_request_per_field: true, ..device.quirks });
        if first_failure(&mut reader, device, &alone).await.is_some() {
            continue;
        }
        let mut helps = "one_request_per_field = true".to_owned();
        let longest = planned.iter().flat_map(|read| &read.fields).map(|field| field.len).max();
        let mut failing = vec![planned.clone()];
        for (quirks, text) in variants(device.quirks, longest.unwrap_or(1)) {
            let reads = with(quirks);
            if failing.contains(&reads) {
                continue;
            }
            if reads == alone || first_failure(&mut reader, device, &reads).await.is_none() {
                helps = text;
                break;
            }
            failing.push(reads);
        }
        let read = &planned[failed];
        let asked = without_wrong_gap(Asked::of(read), &helps);
        let seen = Seen { fault, asked, others: Others::Answered };
        found.push(MergedReadTest {
            device: device.name.clone(),
            read: read.to_string(),
            fault: explain_on(bus.transport, seen).to_string(),
            quirks: format!("quirks = {{ {helps} }}"),
        });
    }
    found
}

/// Sends these reads one after another. Returns the index and the fault of the first read that fails; `None` if all
/// reads succeed.
async fn first_failure(
    reader: &mut UnitReader,
    device: &Device,
    reads: &[ReadRequest],
) -> Option<(usize, Fault)> {
    for (place, read) in reads.iter().enumerate() {
        let Some((from, count)) = read.span() else { continue };
        if let Err(fault) = reader.read(device.unit, from, count).await {
            return Some((place, fault));
        }
    }
    None
}

fn is_single(read: &ReadRequest) -> bool {
    read.fields.len() < 2
}

/// Removes the gap (unused registers between the values) from the description of a failed read, if `max_gap` does not
/// help. Otherwise the advice would name a key that was tried without success.
fn without_wrong_gap(asked: Asked, helps: &str) -> Asked {
    match asked {
        Asked::Read { values, .. } if !helps.contains("max_gap") => Asked::Read { values, gap: 0 },
        asked => asked,
    }
}

/// Returns whether other reads of the same values may succeed after this fault, so that a test of other quirks is
/// useful.
fn may_depend_on_quirks(fault: Fault) -> bool {
    let is_refused = fault.exception_code().is_some() && !fault.is_of_a_gateway();
    is_refused || matches!(fault, Fault::Timeout | Fault::Peer(PeerFault::Length))
}

/// Returns quirks to try, with their text in a profile: reads without gaps first, then shorter reads, then both. A read
/// is at least as long as the `longest` value, because a value is never divided.
fn variants(quirks: Quirks, longest: u16) -> Vec<(Quirks, String)> {
    let without_gaps = Quirks { max_gap: 0, ..quirks };
    let mut variants = vec![(without_gaps, "max_gap = 0".to_owned())];
    let shorter = |quirks: Quirks, more: &str| {
        let allowed = longest..quirks.max_registers_per_request;
        let lengths = LENGTHS.into_iter().filter(|length| allowed.contains(length));
        let variant = |length: u16| {
            let quirks = Quirks { max_registers_per_request: length, ..quirks };
            (quirks, format!("{more}max_registers_per_request = {length}"))
        };
        lengths.map(variant).collect::<Vec<_>>()
    };
    variants.extend(shorter(quirks, ""));
    variants.extend(shorter(without_gaps, "max_gap = 0, "));
    variants
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_begin_with_gaps_and_then_become_shorter() {
        let texts = |quirks: Quirks, longest: u16| {
            variants(quirks, longest).into_iter().map(|(_, text)| text).collect::<Vec<_>>()
        };
        let all = texts(Quirks::default(), 1);
        assert_eq!(all.len(), 1 + 2 * LENGTHS.len());
        assert_eq!(all[..2], ["max_gap = 0", "max_registers_per_request = 64"]);
        assert_eq!(all[LENGTHS.len() + 1], "max_gap = 0, max_registers_per_request = 64");
        let short = Quirks { max_registers_per_request: 4, ..Quirks::default() };
        assert_eq!(
            texts(short, 1),
            [
                "max_gap = 0",
                "max_registers_per_request = 2",
                "max_registers_per_request = 1",
                "max_gap = 0, max_registers_per_request = 2",
                "max_gap = 0, max_registers_per_request = 1",
            ]
        );
        assert_eq!(texts(short, 4), ["max_gap = 0"], "a value has four registers");
    }

    #[test]
    fn the_advice_does_not_name_a_quirk_that_was_tried_without_success() {
        for (helps, names_gap) in [
            ("max_gap = 0", true),
            ("max_gap = 0, max_registers_per_request = 8", true),
            ("max_registers_per_request = 8", false),
            ("one_request_per_field = true", false),
        ] {
            let asked = without_wrong_gap(Asked::Read { values: 3, gap: 5 }, helps);
            let seen = Seen { fault: Fault::Exception(2), asked, others: Others::Answered };
            let said = explain_on(isotherm_profile::Transport::Tcp, seen).to_string();
            assert_eq!(said.contains("max_gap"), names_gap, "{helps}: {said}");
        }
    }

    #[test]
    fn faults_of_the_line_and_of_a_gateway_do_not_depend_on_quirks() {
        for (fault, may) in [
            (Fault::Timeout, true),
            (Fault::Exception(2), true),
            (Fault::Exception(3), true),
            (Fault::Peer(PeerFault::LongException(2)), true),
            (Fault::Peer(PeerFault::Length), true),
            (Fault::Exception(11), false),
            (Fault::Peer(PeerFault::Unit(7)), false),
            (Fault::Peer(PeerFault::Malformed), false),
            (Fault::Link(crate::fieldbus::error::LinkFault::Refused), false),
        ] {
            assert_eq!(may_depend_on_quirks(fault), may, "{fault:?}");
        }
    }
}
