//! Text that a virtual device sends, with its faults. The module uses no socket and no clock.

use std::time::Duration;

use rand::RngExt;

use super::group::TextGroup;
use crate::virtual_machine::fault::ReplyFault;
use crate::virtual_machine::hardware::Reply;
use crate::virtual_machine::random::stream;
use isotherm_core::codec::{with_sum, with_unit};

/// Millimetres per inch.
const INCH: f64 = 25.4;
/// Pause between two bytes, for the fault in which text is sent byte by byte.
const DRIBBLE: Duration = Duration::from_millis(1);
/// Number of bytes before the values of a Modbus answer: function code and byte count.
const HEADER: usize = 2;

/// Answer of a device: the values in its registers, and the fault of the answer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TextAnswer {
    pub(super) content: Content,
    pub(super) fault: Option<ReplyFault>,
}

/// Content of an answer: values, an error code, or nothing.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Content {
    Values(Vec<f64>),
    /// The device refuses the request with this code.
    Refused(u8),
    Nothing,
}

/// Bytes to send, with their delay, the pause between bytes, and the end of the connection.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct SentText {
    pub(super) bytes: Vec<u8>,
    pub(super) delay: Duration,
    /// Pause after each byte; `None` if all bytes are sent at once.
    pub(super) pause: Option<Duration>,
    /// Whether the connection is closed after these bytes.
    pub(super) closes: bool,
}

/// Sender of the text answers on one connection. It changes or suppresses an answer as the fault of the answer
/// requires.
#[derive(Debug, Default)]
pub(super) struct Sender {
    /// Correct text of the last answer, before faults changed it.
    before: Vec<u8>,
    sent: u64,
    is_mute: bool,
}

impl TextAnswer {
    /// Adds the result of one read of registers to this answer.
    pub(super) fn add(&mut self, reply: Reply) {
        self.fault = self.fault.or(reply.fault);
        let Some(pdu) = reply.pdu else { return self.content = Content::Nothing };
        if pdu.first().is_some_and(|function| function & 0x80 != 0) {
            return self.content = Content::Refused(pdu.get(1).copied().unwrap_or_default());
        }
        let Content::Values(values) = &mut self.content else { return };
        let bytes = pdu.get(HEADER..).unwrap_or_default();
        let numbers =
            bytes.chunks_exact(8).filter_map(|bytes| Some(f64::from_be_bytes(*bytes.first_chunk()?)));
        values.extend(numbers);
    }
}

impl Sender {
    /// Returns the bytes to send for an answer, as its fault requires.
    pub(super) fn send(&mut self, group: &TextGroup, answer: &TextAnswer) -> SentText {
        let fault = answer.fault;
        self.is_mute |= fault == Some(ReplyFault::HalfOpen);
        self.sent += 1;
        let end = if group.request.ends_with('\r') { "\r" } else { "\r\n" };
        let mut lines = match &answer.content {
            Content::Nothing => return SentText::default(),
            Content::Refused(code) => vec![refusal(group, *code)],
            Content::Values(values) if fault == Some(ReplyFault::WrongUnit) => in_inch(group, values),
            Content::Values(values) => lines(group, values),
        };
        if self.is_mute {
            return SentText::default();
        }
        let whole = bytes(&lines, end);
        let before = std::mem::replace(&mut self.before, whole);
        match fault {
            Some(ReplyFault::WrongChecksum | ReplyFault::WrongFunction) => {
                lines.iter_mut().for_each(|line| *line = with_wrong_end(line))
            }
            Some(ReplyFault::ShortRead) => lines.iter_mut().for_each(|line| *line = first_half(line)),
            Some(ReplyFault::LongRead) => lines.iter_mut().for_each(|line| *line = line.repeat(2)),
            _ => {}
        }
        let bytes = match fault {
            Some(ReplyFault::Close) => Vec::new(),
            Some(ReplyFault::OneBehind { .. }) => before,
            Some(ReplyFault::Garbage) => {
                let mut random = stream(self.sent, "garbage");
                (0..16).map(|_| random.random()).collect()
            }
            _ => bytes(&lines, end),
        };
        SentText {
            bytes,
            delay: if let Some(ReplyFault::Late(delay)) = fault { delay } else { Duration::ZERO },
            pause: (fault == Some(ReplyFault::OneByteAtATime)).then_some(DRIBBLE),
            closes: fault == Some(ReplyFault::Close),
        }
    }
}

/// Returns the text lines with these values. For a DCON module, all values of one answer are in one text line.
fn lines(group: &TextGroup, values: &[f64]) -> Vec<String> {
    let places: Vec<usize> = group.patterns.iter().map(|pattern| pattern.skipped()).collect();
    if let Some(pattern) = group.patterns.first()
        && places.iter().any(|place| *place > 0)
    {
        let mut all = vec![0.0; places.iter().max().map_or(0, |last| last + 1)];
        places.iter().zip(values).for_each(|(place, value)| all[*place] = *value);
        if let Some(line) = pattern.line_of_all(&all) {
            return vec![line];
        }
    }
    group.patterns.iter().zip(values).map(|(pattern, value)| pattern.line(*value)).collect()
}

/// Returns the text lines of a readout that was switched to inches: each value in inches, followed by `"`.
fn in_inch(group: &TextGroup, values: &[f64]) -> Vec<String> {
    let values: Vec<f64> = values.iter().map(|value| value / INCH).collect();
    lines(group, &values).into_iter().map(|line| line + "\"").collect()
}

/// Returns the text with which a device refuses a request: `?01` of a DCON module, or an error of a gauge.
fn refusal(group: &TextGroup, code: u8) -> String {
    if group.is_dcon() { format!("?{:02X}", group.unit) } else { format!("ERR{code}") }
}

/// Returns the line with a wrong last character. In a line with a checksum, this is a digit of the checksum.
fn with_wrong_end(line: &str) -> String {
    let mut characters: Vec<char> = line.chars().collect();
    if let Some(last) = characters.last_mut() {
        *last = if *last == '0' { '1' } else { '0' };
    }
    characters.into_iter().collect()
}

fn first_half(line: &str) -> String {
    line.chars().take(line.chars().count() / 2).collect()
}

/// Returns the lines as bytes in Latin-1, each followed by `end`. A character that Latin-1 does not have becomes `?`.
fn bytes(lines: &[String], end: &str) -> Vec<u8> {
    let characters = lines.iter().flat_map(|line| line.chars().chain(end.chars()));
    characters.map(|character| u8::try_from(u32::from(character)).unwrap_or(b'?')).collect()
}

/// Returns the request for the name of a DCON module. A module with a checksum ignores requests without a checksum.
pub(super) fn name_request(group: &TextGroup) -> String {
    of_module(group, "${unit}M")
}

/// Returns the answer of a DCON module to the request for its name.
pub(super) fn name(group: &TextGroup) -> String {
    of_module(group, "!{unit}7018")
}

/// Returns a text with the address of a DCON module, and with a checksum if the module uses checksums.
fn of_module(group: &TextGroup, text: &str) -> String {
    let sum = if group.has_sum() { "{sum}" } else { "" };
    let text = with_unit(&format!("{text}{sum}\r"), group.unit);
    with_sum(&text).unwrap_or(text)
}
