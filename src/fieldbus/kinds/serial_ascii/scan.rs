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
use isotherm_core::codec::{Quoted, TextPattern, with_sum, with_unit};
use isotherm_profile::{Bus, counted};

/// Time for which the scan listens before it sends a request.
const LISTEN: Duration = Duration::from_secs(2);
/// Maximum number of lines of text that the scan shows.
const MOST_LINES: usize = 4;
/// Time within which a device must answer, if the user has chosen no timeout.
const ANSWER: Duration = Duration::from_millis(200);
/// Usual requests of readouts and gauges: Ctrl-B (HEIDENHAIN), `?` (Sylvac), `1` and `GA00` (Mitutoyo), `Q` (GIVI).
const REQUESTS: [&str; 5] = ["\u{2}", "?\r", "1\r", "GA00\r\n", "Q\r\n"];
/// Last address at which the scan searches for a DCON module.
const LAST_ADDRESS: u8 = 0x1f;
/// Number of characters of the checksum of DCON.
const SUM_DIGITS: usize = 2;
/// Value of the key `text` for a profile, if the received line contains no number that a pattern could describe.
const NO_PATTERN: &str =
    "\"{number}\"   # no pattern was found for this text: write a pattern here, with {number} for the value";
/// Minimum length of a line in characters, from which the scan can detect a parity bit.
const LEAST_WITH_PARITY: usize = 4;

/// One result of a scan: a received line of text, or a DCON module.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Found {
    /// Line that arrived without a request.
    Sent { line: String },
    /// Line that followed a request, with the text of this request.
    Answered { request: String, line: String },
    /// DCON module with this name. `has_sum`: its checksum is switched on.
    Module {
        address: u8,
        name: String,
        #[serde(skip)]
        has_sum: bool,
    },
}

/// Scans the line of this bus. `timeout` is the time within which a device must answer; `None`: the default.
pub(super) fn report(bus: &Bus, timeout: Option<Duration>) -> Boxed<'_, Result<ScanReport, Fault>> {
    Box::pin(async move {
        let mut dial = TextDial::new(bus).ok_or(Fault::Caller(CallerFault::Function))?;
        let tap = Tap::default();
        let opened = WallTimeout::new().within(LISTEN.max(bus.timeout), dial.open(&tap)).await;
        let mut port = opened.unwrap_or(Err(Fault::Link(LinkFault::Unreachable)))?;
        let mut found = received(&mut port, LISTEN.max(timeout.unwrap_or_default())).await?;
        let is_endless = found.is_empty() && port.is_inside_line();
        if found.is_empty() {
            found = answers(&mut port, timeout.unwrap_or(ANSWER)).await?;
        }
        Ok(described(&bus.address, &found, is_endless))
    })
}

/// Returns the first lines that arrive without a request, within the time `span`.
async fn received(port: &mut TextPort, span: Duration) -> Result<Vec<Found>, Fault> {
    let found = lines(port, (MOST_LINES, span)).await?;
    Ok(found.into_iter().map(|line| Found::Sent { line }).collect())
}

/// Returns the next lines that arrive: at most `most` lines, within the time `span`.
async fn lines(port: &mut TextPort, (most, span): (usize, Duration)) -> Result<Vec<String>, Fault> {
    let (begun, mut found) = (Silence::begin(), Vec::new());
    while found.len() < most {
        let Some(line) = port.next_line(begun.left_of(span)).await? else { break };
        found.push(line);
    }
    Ok(found)
}

/// Sends usual requests until an answer contains a value. Returns all answers, including further lines of the
/// last answer. If no answer contains a value, the answers may be error texts. The function then also
/// searches for DCON modules, and returns them.
async fn answers(port: &mut TextPort, span: Duration) -> Result<Vec<Found>, Fault> {
    let mut found = Vec::new();
    for request in REQUESTS {
        let mut line = answer(port, request, span).await?;
        // A device may have received this request and the one before it as one.
        if line.as_deref().is_some_and(|line| !has_value(line)) {
            line = answer(port, request, span).await?.or(line);
        }
        let Some(line) = line else { continue };
        let is_last = has_value(&line);
        let answered = |line| Found::Answered { request: request.to_owned(), line };
        found.push(answered(line));
        if is_last {
            let more = lines(port, (MOST_LINES - 1, span)).await?;
            found.extend(more.into_iter().map(answered));
            return Ok(found);
        }
    }
    for address in 0..=LAST_ADDRESS {
        for has_sum in [false, true] {
            if let Some(name) = name_of_module(port, (address, has_sum), span).await? {
                found.push(Found::Module { address, name, has_sum });
                break;
            }
        }
    }
    Ok(found)
}

/// Returns the name of the DCON module with this address; `None` if no module answers with a name. A module whose
/// checksum is switched on ignores requests without a checksum.
async fn name_of_module(
    port: &mut TextPort,
    (address, has_sum): (u8, bool),
    span: Duration,
) -> Result<Option<String>, Fault> {
    let request = with_unit(if has_sum { "${unit}M{sum}\r" } else { "${unit}M\r" }, address);
    // The request contains no other words in braces.
    let request = with_sum(&request).map_err(|_| Fault::Caller(CallerFault::Function))?;
    let line = answer(port, &request, span).await?;
    let name = line.as_deref().and_then(|line| line.strip_prefix(with_unit("!{unit}", address).as_str()));
    let sum = if has_sum { SUM_DIGITS } else { 0 };
    Ok(name.and_then(|name| name.get(..name.len().checked_sub(sum)?)).map(str::to_owned))
}

/// Returns whether a line contains a number with decimals. Error texts often contain a number without decimals.
fn has_value(line: &str) -> bool {
    TextPattern::like(line).is_some_and(|pattern| pattern.has_decimals())
}

/// Returns the line that follows a request; `None` if no line arrives within `span`. An echo of the request is skipped.
async fn answer(port: &mut TextPort, request: &str, span: Duration) -> Result<Option<String>, Fault> {
    port.discard().await?;
    port.wait_for_silence(Duration::from_millis(20), span).await?;
    port.send(request).await?;
    let (begun, echo) = (Silence::begin(), request.trim_end_matches(['\r', '\n']));
    loop {
        match port.next_line(begun.left_of(span)).await? {
            Some(line) if line == echo => {}
            line => return Ok(line),
        }
    }
}

/// Describes the results of the scan, also as lines of a profile. `is_endless`: characters have arrived, but no end of
/// a text line.
fn described(address: &str, found: &[Found], is_endless: bool) -> ScanReport {
    let mut text = String::new();
    let lines: Vec<String> = found.iter().map(Found::to_line).collect();
    if !found.is_empty() {
        text = format!("{} at {address}:\n{}", counted(found.len(), "line"), lines.concat());
    }
    let seconds = LISTEN.as_secs();
    let profile = match found.iter().rev().max_by_key(|found| found.rank()) {
        Some(best) => match found.iter().find_map(Found::parity) {
            Some(parity) => Err(format!(
                "the eighth bit of the characters at {address} is a parity bit: the device sends seven data bits with \
                 {parity} parity. Set data_bits = 7 and parity = \"{parity}\" for a port of this computer, or make \
                 the same settings at the serial server"
            )),
            None => Ok(("text", best.profile())),
        },
        None if is_endless => Err(format!(
            "characters arrived from {address}, but no end of a line (carriage return or line feed) in {seconds} s. \
             Do baud rate, data bits and parity match the device? Texts without such an end cannot be read"
        )),
        None => Err(format!(
            "no text arrived from {address} in {seconds} s, and no device answered. Do baud rate, data bits and \
             parity match the device? Is the device set to send, for example by a key or a parameter? The scan sends \
             Ctrl-B, `?`, `1`, `GA00` and `Q`, and searches for DCON modules at the addresses 00 to {LAST_ADDRESS:02X}",
        )),
    };
    let json = serde_json::json!({ "address": address, "found": found });
    ScanReport { is_empty: found.is_empty(), json, text, profile }
}

impl Found {
    /// Formats the result as one line of text for the user.
    fn to_line(&self) -> String {
        match self {
            Found::Sent { line } => format!("  {} without a request\n", Quoted(line)),
            Found::Answered { request, line } => format!("  {} after {}\n", Quoted(line), Quoted(request)),
            Found::Module { address, name, has_sum } => {
                let sum = if *has_sum { ", with checksum" } else { "" };
                format!("  DCON module {name} at address {address:02X}{sum}\n")
            }
        }
    }

    /// Returns the received line of a readout or a gauge; `None` for a DCON module.
    fn line(&self) -> Option<&str> {
        match self {
            Found::Sent { line } | Found::Answered { line, .. } => Some(line),
            Found::Module { .. } => None,
        }
    }

    /// Returns the rank of the result: the result with the highest rank becomes the example for a profile.
    fn rank(&self) -> u8 {
        match self.line() {
            Some(line) if has_value(line) => 3,
            None => 2,
            Some(line) => u8::from(TextPattern::like(line).is_some()),
        }
    }

    /// Returns the parity, if the eighth bit of the received characters is a parity bit; otherwise `None`.
    fn parity(&self) -> Option<&'static str> {
        let characters: Vec<u32> = self.line()?.chars().map(u32::from).collect();
        let has_eighth_bit = characters.iter().any(|character| (0x80..0x100).contains(character));
        if !has_eighth_bit || characters.len() < LEAST_WITH_PARITY {
            return None;
        }
        let odd = characters.iter().filter(|character| character.count_ones() % 2 == 1).count();
        match odd {
            0 => Some("even"),
            _ if odd == characters.len() => Some("odd"),
            _ => None,
        }
    }

    /// Returns the lines that describe the found device in a profile.
    fn profile(&self) -> String {
        let (unit, text, request) = match self {
            Found::Sent { line } => (None, like(line), String::new()),
            Found::Answered { request, line } => (None, like(line), request.clone()),
            Found::Module { address, has_sum, .. } => {
                let sum = if *has_sum { "{sum}" } else { "" };
                let pattern = Quoted(&format!(">{{number 7}}{{any}}{sum}")).to_string();
                (Some(*address), pattern, format!("#{{unit}}{sum}\r"))
            }
        };
        let mut profile = "\n[device.DEVICE]\nbus = \"text\"\n".to_owned();
        if let Some(unit) = unit {
            let _ = writeln!(profile, "unit = {unit}");
        }
        let _ = write!(profile, "\n[signal.NAME]\ndevice = \"DEVICE\"\ntext = {text}\n");
        if !request.is_empty() {
            let _ = writeln!(profile, "request = {}", Quoted(&request));
        }
        profile
    }
}

/// Returns the value of the key `text` in a profile: a pattern for lines of the same form as `line`.
fn like(line: &str) -> String {
    match TextPattern::like(line) {
        Some(pattern) => Quoted(&pattern.to_string()).to_string(),
        None => NO_PATTERN.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_text_becomes_a_signal_of_a_profile() {
        let found = [Found::Answered { request: "\u{2}".to_owned(), line: "+     12.345  R".to_owned() }];
        let report = described("192.168.0.20:4001", &found, false);
        assert_eq!(report.text, "1 line at 192.168.0.20:4001:\n  \"+     12.345  R\" after \"\\u0002\"\n");
        let (name, more) = report.profile.unwrap();
        assert_eq!(name, "text");
        assert!(more.contains("text = \"{number.3}  R\"\nrequest = \"\\u0002\"\n"), "{more}");
        assert_eq!(report.json["found"][0]["answered"]["line"], "+     12.345  R");
    }

    fn sent(line: &str) -> Found {
        Found::Sent { line: line.to_owned() }
    }

    fn answered(request: &str, line: &str) -> Found {
        Found::Answered { request: request.to_owned(), line: line.to_owned() }
    }

    /// Returns the lines of a profile for the results of a scan.
    fn profile(found: &[Found]) -> String {
        described("server:4001", found, false).profile.unwrap().1
    }

    #[test]
    fn the_profile_is_for_the_line_with_a_value() {
        let error = answered("?\r", "ERR1");
        let more = profile(&[error.clone(), answered("1\r", "01A+0012.345")]);
        assert!(more.contains("text = \"01A{number.3}\"\nrequest = \"1\\r\"\n"), "{more}");
        let more = profile(&[sent("Z+1.000"), sent("X+2.000")]);
        assert!(more.contains("text = \"Z{number.3}\"\n"), "the first one: {more}");
        let module = Found::Module { address: 4, name: "7018".to_owned(), has_sum: false };
        assert!(profile(&[error, module]).contains("unit = 4\n"));
        let more = profile(&[sent("{\"t\":21.5}")]);
        assert!(more.contains("text = \"{number}\"   # no pattern was found"), "{more}");
    }

    #[test]
    fn a_parity_bit_is_reported_and_makes_no_pattern() {
        let with_parity = |line: &str, is_odd: bool| -> Found {
            let of = |byte: u8| if (byte.count_ones() % 2 == 1) == is_odd { byte } else { byte | 0x80 };
            sent(&line.bytes().map(|byte| char::from(of(byte))).collect::<String>())
        };
        for (is_odd, parity) in [(false, "even"), (true, "odd")] {
            let report = described("server:4001", &[with_parity("+001.250 mm", is_odd)], false);
            let why = report.profile.unwrap_err();
            assert!(!report.is_empty && why.contains(&format!("{parity} parity")), "{why}");
        }
        for line in ["21.5 °C", "+001.250 mm", "°"] {
            assert_eq!(sent(line).parity(), None, "{line}");
        }
    }

    #[test]
    fn a_dcon_module_is_read_by_its_address() {
        let found = [Found::Module { address: 0x1a, name: "7018".to_owned(), has_sum: false }];
        let report = described("/dev/ttyUSB0", &found, false);
        assert!(report.text.contains("DCON module 7018 at address 1A"), "{}", report.text);
        let (_, more) = report.profile.unwrap();
        assert!(more.contains("unit = 26\n") && more.contains("request = \"#{unit}\\r\"\n"), "{more}");
        let more = profile(&[Found::Module { address: 1, name: "7018".to_owned(), has_sum: true }]);
        assert!(more.contains("text = \">{number 7}{any}{sum}\"\nrequest = \"#{unit}{sum}\\r\"\n"), "{more}");
    }

    #[test]
    fn a_silent_line_is_reported_with_what_to_do() {
        for (is_endless, words) in [(false, "no text arrived"), (true, "no end of a line")] {
            let report = described("/dev/ttyUSB0", &[], is_endless);
            assert!(report.is_empty && report.text.is_empty());
            let why = report.profile.unwrap_err();
            assert!(why.contains(words) && why.contains("data bits and parity"), "{why}");
        }
    }
}
