//! Scan of a line with text: text that arrives without a request, answers to usual requests, and DCON modules.
//!
//! The scan sends requests that only read.

use std::fmt::Write;
use std::time::Duration;

use serde::Serialize;

use super::dial::TextDial;
use super::port::TextPort;
use crate::clock::{Silence, WallTimeout};
use crate::fieldbus::error::{CallerFault, Fault, LinkFault};
use crate::fieldbus::kinds::kind::ScanReport;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::Boxed;
use isotherm_core::codec::{Quoted, TextPattern};
use isotherm_profile::{Bus, counted};

/// Time for which the scan listens before it sends a request.
const LISTEN: Duration = Duration::from_secs(2);
/// Largest number of lines that the scan shows.
const MOST_LINES: usize = 4;
/// Time within which a device answers, if the user chooses no other.
const ANSWER: Duration = Duration::from_millis(200);
/// Usual requests of readouts and gauges: Ctrl-B (HEIDENHAIN), `?` (Sylvac), `1` (Mitutoyo).
const REQUESTS: [&str; 3] = ["\u{2}", "?\r", "1\r"];
/// Last address at which the scan searches for a DCON module.
const LAST_ADDRESS: u8 = 0x1f;

/// Result of the scan of one line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Found {
    /// Line that arrived without a request.
    Sent { line: String },
    /// Line that followed a request.
    Answered { request: String, line: String },
    /// DCON module with this name.
    Module { address: u8, name: String },
}

/// Scans the line of this bus.
pub(super) fn report(bus: &Bus, timeout: Option<Duration>) -> Boxed<'_, Result<ScanReport, Fault>> {
    Box::pin(async move {
        let mut dial = TextDial::new(bus).ok_or(Fault::Caller(CallerFault::Function))?;
        let tap = Tap::default();
        let opened = WallTimeout::new().within(LISTEN.max(bus.timeout), dial.open(&tap)).await;
        let mut port = opened.unwrap_or(Err(Fault::Link(LinkFault::Unreachable)))?;
        let mut found = received(&mut port, LISTEN.max(timeout.unwrap_or_default())).await?;
        if found.is_empty() {
            found = answers(&mut port, timeout.unwrap_or(ANSWER)).await?;
        }
        Ok(described(&bus.address, &found))
    })
}

/// Returns the lines that arrive without a request.
async fn received(port: &mut TextPort, span: Duration) -> Result<Vec<Found>, Fault> {
    let (begun, mut found) = (Silence::begin(), Vec::new());
    while found.len() < MOST_LINES {
        let Some(line) = port.next_line(begun.left_of(span)).await? else { break };
        found.push(Found::Sent { line });
    }
    Ok(found)
}

/// Returns the answers to usual requests, or else the DCON modules.
async fn answers(port: &mut TextPort, span: Duration) -> Result<Vec<Found>, Fault> {
    for request in REQUESTS {
        if let Some(line) = answer(port, request, span).await? {
            return Ok(vec![Found::Answered { request: request.to_owned(), line }]);
        }
    }
    let mut found = Vec::new();
    for address in 0..=LAST_ADDRESS {
        let line = answer(port, &format!("${address:02X}M\r"), span).await?;
        let name = line.as_deref().and_then(|line| line.strip_prefix(format!("!{address:02X}").as_str()));
        if let Some(name) = name {
            found.push(Found::Module { address, name: name.to_owned() });
        }
    }
    Ok(found)
}

/// Returns the line that follows a request. An echo of the request is skipped.
async fn answer(port: &mut TextPort, request: &str, span: Duration) -> Result<Option<String>, Fault> {
    port.discard().await?;
    port.wait_for_silence(Duration::from_millis(20), span).await?;
    port.send(request).await?;
    let (begun, echo) = (Silence::begin(), request.trim_end_matches('\r'));
    loop {
        match port.next_line(begun.left_of(span)).await? {
            Some(line) if line == echo => {}
            line => return Ok(line),
        }
    }
}

/// Describes the results, also as lines of a profile.
fn described(address: &str, found: &[Found]) -> ScanReport {
    let mut text = String::new();
    let lines: Vec<String> = found.iter().map(Found::to_line).collect();
    if !found.is_empty() {
        text = format!("{} at {address}:\n{}", counted(found.len(), "line"), lines.concat());
    }
    let profile = match found.first() {
        Some(first) => Ok(("text", first.profile())),
        None => Err(format!(
            "no text arrived from {address} in {} s, and no device answered. Are baud rate, data bits and parity those \
             of the device? Is the device set to send, for example by a key or a parameter? The scan sends Ctrl-B, \
             `?` and `1`, and searches for DCON modules at the addresses 00 to {LAST_ADDRESS:02X}",
            LISTEN.as_secs()
        )),
    };
    let json = serde_json::json!({ "address": address, "found": found });
    ScanReport { is_empty: found.is_empty(), json, text, profile }
}

impl Found {
    /// Line of text for the user.
    fn to_line(&self) -> String {
        match self {
            Found::Sent { line } => format!("  {} without a request\n", Quoted(line)),
            Found::Answered { request, line } => format!("  {} after {}\n", Quoted(line), Quoted(request)),
            Found::Module { address, name } => format!("  DCON module {name} at address {address:02X}\n"),
        }
    }

    /// Lines of a profile for a device like this one.
    fn profile(&self) -> String {
        let (unit, pattern, request) = match self {
            Found::Sent { line } => (None, like(line), String::new()),
            Found::Answered { request, line } => (None, like(line), request.clone()),
            Found::Module { address, .. } => {
                (Some(*address), ">{number}{any}".to_owned(), "#{unit}\r".to_owned())
            }
        };
        let mut profile = "\n[device.DEVICE]\nbus = \"text\"\n".to_owned();
        if let Some(unit) = unit {
            let _ = writeln!(profile, "unit = {unit}");
        }
        let _ = write!(profile, "\n[signal.NAME]\ndevice = \"DEVICE\"\ntext = {}\n", Quoted(&pattern));
        if !request.is_empty() {
            let _ = writeln!(profile, "request = {}", Quoted(&request));
        }
        profile
    }
}

/// Returns a pattern for a line like this one.
fn like(line: &str) -> String {
    TextPattern::like(line).map_or_else(|| "{number}".to_owned(), |pattern| pattern.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_text_becomes_a_signal_of_a_profile() {
        let found = [Found::Answered { request: "\u{2}".to_owned(), line: "+     12.345  R".to_owned() }];
        let report = described("192.168.0.20:4001", &found);
        assert_eq!(report.text, "1 line at 192.168.0.20:4001:\n  \"+     12.345  R\" after \"\\u0002\"\n");
        let (name, more) = report.profile.unwrap();
        assert_eq!(name, "text");
        assert!(more.contains("text = \"{number.3}  R\"\nrequest = \"\\u0002\"\n"), "{more}");
        assert_eq!(report.json["found"][0]["answered"]["line"], "+     12.345  R");
    }

    #[test]
    fn a_dcon_module_is_read_by_its_address() {
        let found = [Found::Module { address: 0x1a, name: "7018".to_owned() }];
        let report = described("/dev/ttyUSB0", &found);
        assert!(report.text.contains("DCON module 7018 at address 1A"), "{}", report.text);
        let (_, more) = report.profile.unwrap();
        assert!(more.contains("unit = 26\n") && more.contains("request = \"#{unit}\\r\"\n"), "{more}");
    }

    #[test]
    fn a_silent_line_is_reported_with_what_to_do() {
        let report = described("/dev/ttyUSB0", &[]);
        assert!(report.is_empty && report.text.is_empty());
        assert!(report.profile.unwrap_err().contains("data bits and parity"));
    }
}
