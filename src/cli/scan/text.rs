//! Results of a scan as text, as a JSON document, and as lines for a profile.

use std::fmt::Write;
use std::time::Duration;

use serde_json::json;

use super::ScanResults;
use crate::cli::hints::Hints;
use crate::discovery::bus::{LineAddress, ScanKind};
use crate::discovery::register_search::RegisterRange;
use crate::discovery::scan::{AnswerKind, Responder, Scan, heeds_no_number};
use crate::discovery::{Fault, PeerFault};
use crate::fieldbus::explain::explain_on;
use isotherm_core::explained::Explained;
use isotherm_profile::duration_text;
use isotherm_profile::{BusId, Profile};

/// Registers at the beginning of a SunSpec map: `SunS`.
const SUNSPEC: [u16; 2] = [0x5375, 0x6e53];
/// Indentation of a hint below the line of its fault, in characters.
const UNDER: usize = 6;

/// Returns a sentence with the requests and the longest duration of the scan.
pub(super) fn plan(scan: &Scan) -> String {
    let registers: Vec<String> =
        scan.registers.iter().map(|address| format!("{address} ({})", address.modicon())).collect();
    let (first, last) = (scan.units.start(), scan.units.end());
    let units = if first == last { format!("unit {first}") } else { format!("units {first} to {last}") };
    let settings = match scan.lines.len() {
        1 => String::new(),
        count => format!(", in {count} settings"),
    };
    format!(
        "scanning {units} on {} by reading {}{settings}; at most {} for each answer, {} in total; Ctrl-C ends the scan",
        scan.lines[0],
        registers.join(", then "),
        duration_text(scan.bus.timeout),
        duration_text(Duration::from_secs(scan.at_worst().as_secs() + 1)),
    )
}

pub(super) fn found(line: &LineAddress, found: &Responder) -> String {
    let Responder { unit, register, how } = found;
    let serial = line.serial().map_or(String::new(), |_| format!(" on {line}"));
    match how {
        AnswerKind::Value(value) => {
            format!("unit {unit} answers{serial}: {register} = {value} (0x{value:04X})")
        }
        AnswerKind::Exception(code) => {
            format!("unit {unit} answers{serial} (exception {code}: {})", meaning(*code))
        }
        AnswerKind::Garbled(why) => format!("unit {unit}: invalid answer{serial}: {why}"),
    }
}

fn meaning(code: u8) -> &'static str {
    match code {
        1 => "no such function",
        2 => "no such register",
        3 => "number of registers not allowed",
        4 => "device failure",
        5 | 6 => "busy",
        _ => "the device's own code",
    }
}

pub(super) fn range(unit: u8, range: &RegisterRange) -> String {
    let RegisterRange { register, modicon, count, values, why } = range;
    match values {
        Some(values) => {
            let shown: Vec<String> = values.iter().map(u16::to_string).collect();
            let map = match values.windows(2).any(|pair| pair == SUNSPEC) {
                true => "  SunSpec: write the register of a scale factor as `scale_from` of the signal",
                false => "",
            };
            format!("unit {unit}  {register} ({modicon})  {}{map}", shown.join(" "))
        }
        None => {
            let registers = if *count == 1 { String::new() } else { format!(", {count} of them") };
            format!("unit {unit}  {register} ({modicon}){registers}: {why}")
        }
    }
}

/// Returns lines for a profile with the units that were found, and a hint if the device ignores the unit number.
pub(super) fn summary(
    scan: &Scan,
    found: &[(LineAddress, Responder)],
    known: Option<(&Profile, BusId)>,
) -> String {
    let mut answering: Vec<&(LineAddress, Responder)> =
        found.iter().filter(|(_, found)| !matches!(found.how, AnswerKind::Garbled(_))).collect();
    let all: Vec<&Responder> = answering.iter().map(|(_, found)| found).collect();
    let mut text = String::new();
    if scan.lines.len() == 1 && heeds_no_number(&all, scan.units.len()) {
        text.push_str(
            "\nEvery unit gave the same answer: this is one device that ignores the unit number. Use unit 1 \
             or 255.\n",
        );
        answering.truncate(1);
    }
    text + &profile_lines(&answering, known)
}

fn profile_lines(found: &[&(LineAddress, Responder)], known: Option<(&Profile, BusId)>) -> String {
    let mut text = String::new();
    let mut lines: Vec<&LineAddress> = Vec::new();
    for (line, Responder { unit, .. }) in found.iter().copied() {
        let own = known.and_then(|(profile, bus)| {
            profile.devices.iter().find(|device| device.bus == bus && device.unit == *unit)
        });
        if let Some(device) = own {
            let _ = writeln!(text, "# unit {unit} is the profile's device {}", device.name);
            continue;
        }
        let place = lines.iter().position(|seen| *seen == line);
        let number = place.unwrap_or(lines.len());
        let bus = match (known, number) {
            (Some((profile, bus)), _) => profile.bus(bus).name.clone(),
            (None, 0) => "line".to_owned(),
            (None, number) => format!("line{}", number + 1),
        };
        if place.is_none() {
            lines.push(line);
            if known.is_none() {
                let _ = write!(text, "\n[bus.{bus}]\n{}", line.profile_lines());
            }
        }
        let name = if number == 0 { format!("unit{unit}") } else { format!("unit{unit}_{bus}") };
        let _ = write!(text, "\n[device.{name}]\nbus = \"{bus}\"\nunit = {unit}\nevery = \"1s\"\n");
    }
    if text.is_empty() { text } else { format!("\n# for a profile:\n{text}") }
}

/// Describes a fault which shows that something is connected to a line. A remedy that was not printed yet
/// follows on the next line.
pub(super) fn noticed((line, fault): &(LineAddress, Fault), hints: &mut Hints) -> String {
    let Explained { cause, hint } = explain_on(line.transport, *fault);
    let said = format!("{line}: {cause}\n") + &hints.line(UNDER, hint.as_deref());
    said.trim_end().to_owned()
}

pub(super) fn nobody(scan: &Scan, noticed: &[(LineAddress, Fault)]) -> String {
    let other = noticed.iter().find_map(|(_, fault)| match fault {
        Fault::Peer(PeerFault::Unit(unit)) => Some(unit),
        _ => None,
    });
    if let Some(unit) = other {
        return format!("no requested unit answered, but unit {unit} did. Try --units {unit}");
    }
    if !noticed.is_empty() {
        return "no unit answered. First correct the fault that is shown above".to_owned();
    }
    match scan.lines[0].kind().scan {
        ScanKind::Units { unanswered, .. } => format!("no unit answered. {unanswered}"),
        _ => "no unit answered".to_owned(),
    }
}

pub(super) fn document(scan: &Scan, seen: &ScanResults, stopped: Option<&str>) -> serde_json::Value {
    let noticed = seen.noticed.iter().map(
        |(line, fault)| json!({ "line": line.to_string(), "fault": explain_on(line.transport, *fault) }),
    );
    let units = seen.found.iter().map(|(line, found)| json!({ "line": line.to_string(), "found": found }));
    let registers = seen.ranges.iter().map(|(unit, range)| json!({ "unit": unit, "stretch": range }));
    json!({
        "questions": scan.questions(),
        "units": units.collect::<Vec<_>>(),
        "noticed": noticed.collect::<Vec<_>>(),
        "registers": registers.collect::<Vec<_>>(),
        "stopped": stopped,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_of_sunspec_is_named_with_its_scale_factors() {
        let shown = |values: &[u16]| {
            let (register, modicon) = ("holding:40000".to_owned(), "440001".to_owned());
            let count = u16::try_from(values.len()).unwrap();
            range(
                1,
                &RegisterRange {
                    register,
                    modicon,
                    count,
                    values: Some(values.to_vec()),
                    why: String::new(),
                },
            )
        };
        let map = shown(&[0x5375, 0x6e53, 1]);
        assert!(map.starts_with("unit 1  holding:40000 (440001)  21365 28243 1  SunSpec: "), "{map}");
        assert!(map.contains("`scale_from`"), "{map}");
        assert_eq!(shown(&[0x5375, 1]), "unit 1  holding:40000 (440001)  21365 1");
    }

    #[test]
    fn the_hint_of_a_fault_is_printed_once_for_all_lines() {
        let mut hints = Hints::default();
        let mut said =
            |line: &str| noticed(&(line.parse().unwrap(), Fault::Peer(PeerFault::Echoed)), &mut hints);
        let [first, second] = ["rtu+tcp://10.0.0.7:4001", "rtu+tcp://10.0.0.7:4002"].map(&mut said);
        let cause = "the request itself comes back instead of a reply";
        let (line, hint) = first.split_once('\n').unwrap();
        assert_eq!(line, format!("rtu+tcp://10.0.0.7:4001: {cause}"));
        assert!(hint.starts_with("      to do: "), "{hint}");
        assert_eq!(second, format!("rtu+tcp://10.0.0.7:4002: {cause}"));
    }
}
