//! A scan in words, as a document, and as lines of a profile.

use std::fmt::Write;
use std::time::Duration;

use crate::discovery::bus::{Place, Transport};
use crate::discovery::scan::{Found, How, Scan, heeds_no_number};
use crate::discovery::walk::Stretch;
use isotherm_profile::{BusId, Profile};

/// What is about to be asked, and how long that can take.
pub(super) fn plan(scan: &Scan) -> String {
    let registers: Vec<String> =
        scan.registers.iter().map(|address| format!("{address} ({})", address.modicon())).collect();
    let (first, last) = (scan.units.start(), scan.units.end());
    let units = if first == last { format!("unit {first}") } else { format!("units {first} to {last}") };
    let settings = match scan.places.len() {
        1 => String::new(),
        count => format!(", in {count} settings"),
    };
    format!(
        "asking {units} on {} for {}, reading only{settings}; {} for each answer, {} at worst; Ctrl-C ends it",
        scan.places[0],
        registers.join(", then "),
        humantime::format_duration(scan.bus.timeout),
        humantime::format_duration(Duration::from_secs(scan.at_worst().as_secs() + 1)),
    )
}

pub(super) fn found(place: &Place, found: &Found) -> String {
    let Found { unit, register, how } = found;
    let serial = match place.transport {
        Transport::Serial(_) => format!(" on {place}"),
        _ => String::new(),
    };
    match how {
        How::Value(value) => format!("unit {unit} answers{serial}: {register} = {value} (0x{value:04X})"),
        How::Exception(code) => format!("unit {unit} answers{serial} (exception {code}: {})", meaning(*code)),
        How::Garbled(why) => format!("unit {unit}: something answers{serial}, but not properly: {why}"),
    }
}

fn meaning(code: u8) -> &'static str {
    match code {
        1 => "no such function",
        2 => "no such register",
        3 => "not in this number",
        4 => "device failure",
        5 | 6 => "busy",
        _ => "of its own kind",
    }
}

pub(super) fn stretch(unit: u8, stretch: &Stretch) -> String {
    let Stretch { register, modicon, count, values, why } = stretch;
    let registers = if *count == 1 { String::new() } else { format!(", {count} of them") };
    match values {
        Some(values) => {
            let values: Vec<String> = values.iter().map(u16::to_string).collect();
            format!("unit {unit}  {register} ({modicon})  {}", values.join(" "))
        }
        None => format!("unit {unit}  {register} ({modicon}){registers}: {why}"),
    }
}

/// What can be pasted into a profile, and what is to be known about it.
pub(super) fn summary(scan: &Scan, found: &[(Place, Found)], known: Option<(&Profile, BusId)>) -> String {
    let mut text = String::new();
    let answering: Vec<&(Place, Found)> =
        found.iter().filter(|(_, found)| !matches!(found.how, How::Garbled(_))).collect();
    let all: Vec<Found> = answering.iter().map(|(_, found)| found.clone()).collect();
    if scan.places.len() == 1 && heeds_no_number(&all, scan.units.len()) {
        let _ = writeln!(
            text,
            "\nEvery unit gave the same answer: this is one device that heeds no unit number. Use 1, or 255."
        );
        return text + &lines(&answering[..1], known);
    }
    text + &lines(&answering, known)
}

fn lines(found: &[&(Place, Found)], known: Option<(&Profile, BusId)>) -> String {
    let mut text = String::new();
    let mut places: Vec<&Place> = Vec::new();
    for (place, found) in found.iter().copied() {
        let own = known.and_then(|(profile, bus)| {
            profile.devices.iter().find(|device| device.bus == bus && device.unit == found.unit)
        });
        if let Some(device) = own {
            let _ = writeln!(text, "# unit {} is the profile's device {}", found.unit, device.name);
            continue;
        }
        let number = places.iter().position(|seen| *seen == place).unwrap_or_else(|| {
            places.push(place);
            places.len() - 1
        });
        let bus = match (known, number) {
            (Some((profile, bus)), _) => profile.bus(bus).name.clone(),
            (None, 0) => "line".to_owned(),
            (None, number) => format!("line{}", number + 1),
        };
        let is_new = known.is_none() && !text.contains(&format!("[bus.{bus}]"));
        if is_new {
            let _ = write!(text, "\n[bus.{bus}]\n{}", place.profile_lines());
        }
        let name =
            if number == 0 { format!("unit{}", found.unit) } else { format!("unit{}_{bus}", found.unit) };
        let _ = write!(text, "\n[device.{name}]\nbus = \"{bus}\"\nunit = {}\nevery = \"1s\"\n", found.unit);
    }
    if text.is_empty() { text } else { format!("\n# for a profile:\n{text}") }
}

pub(super) fn nobody(scan: &Scan) -> String {
    let wiring = match scan.places[0].transport {
        Transport::Tcp => {
            "Is it another port, or another --register? Behind a gateway: its baud rate, parity and wiring"
        }
        _ => {
            "Try --baud 1200,9600,19200,38400 --parity none,even; A and B exchanged; is it powered; another --register"
        }
    };
    format!("no unit answered. {wiring}")
}

pub(super) fn document(
    scan: &Scan,
    found: &[(Place, Found)],
    stretches: &[(u8, Stretch)],
    stopped: Option<&str>,
) -> serde_json::Value {
    let units: Vec<serde_json::Value> = found
        .iter()
        .map(|(place, found)| serde_json::json!({ "line": place.to_string(), "found": found }))
        .collect();
    let registers: Vec<serde_json::Value> = stretches
        .iter()
        .map(|(unit, stretch)| serde_json::json!({ "unit": unit, "stretch": stretch }))
        .collect();
    serde_json::json!({
        "questions": scan.questions(), "units": units, "registers": registers, "stopped": stopped,
    })
}
