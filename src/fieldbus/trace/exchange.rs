//! One request and its answer, as readable text (two lines) and as a JSON object.

use std::fmt;
use std::time::Duration;

use serde::{Serialize, Serializer};

use crate::fieldbus::error::Fault;
use crate::fieldbus::listed::Listed;
use crate::fieldbus::request::{Answer, NodeReading};
use isotherm_core::codec::{Frame, Quoted};
use isotherm_core::quantity::Moment;
use isotherm_profile::counted;

/// Request with its answer or its fault, and the bytes of both.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exchange {
    /// Wall-clock time at which the request was sent.
    #[serde(serialize_with = "stamp")]
    pub asked_at: Moment,
    /// Time from the sending of the request to the answer or the timeout.
    #[serde(rename = "took_ms", serialize_with = "millis")]
    pub took: Duration,
    /// Modbus unit or CANopen node of the device.
    pub unit: u8,
    /// Request as readable text; empty for a message that a device sent without a request.
    pub asked: String,
    /// Sent bytes; empty if there was no connection.
    #[serde(serialize_with = "hex")]
    pub sent: Vec<u8>,
    /// Received bytes, valid or not.
    #[serde(serialize_with = "hex")]
    pub received: Vec<u8>,
    /// Number of further sent or received bytes, which were not stored because the exchange was too long.
    pub more: usize,
    /// Answer as readable text, or the fault of the request.
    pub answered: String,
    /// Whether the answer is valid.
    pub is_good: bool,
}

impl Exchange {
    /// Returns the record of a CAN frame that a device sent without a request.
    pub(super) fn heard(unit: u8, frame: &Frame, at: Moment) -> Exchange {
        Exchange {
            asked_at: at,
            took: Duration::ZERO,
            unit,
            asked: String::new(),
            sent: Vec::new(),
            received: frame.data().to_vec(),
            more: 0,
            answered: format!("frame {}", frame.id()),
            is_good: true,
        }
    }
}

pub(super) fn answered(answer: &Result<Answer, Fault>) -> String {
    match answer {
        Ok(Answer::Registers(registers)) => {
            format!("{}:{}", counted(registers.len(), "register"), Listed(registers))
        }
        Ok(Answer::Bits(bits)) => {
            let digits: Vec<u8> = bits.iter().map(|bit| u8::from(*bit)).collect();
            format!("{}:{}", counted(bits.len(), "bit"), Listed(&digits))
        }
        Ok(Answer::Nodes(nodes)) => nodes.iter().map(node).collect::<Vec<_>>().join("; "),
        Ok(Answer::Done) => "done".to_owned(),
        Err(fault) => fault.to_string(),
    }
}

/// Formats the answer to a request for lines of text: the received text, and its numbers or the fault of the request.
pub(super) fn answered_text(received: &[u8], answer: &Result<Answer, Fault>) -> String {
    let result = match answer {
        Ok(Answer::Nodes(nodes)) => nodes.iter().map(number).collect::<Vec<_>>().join("; "),
        other => answered(other),
    };
    if received.is_empty() {
        return result;
    }
    let text: String = received.iter().map(|byte| char::from(*byte)).collect();
    format!("{}: {result}", Quoted(&text))
}

/// Formats the number that was found in a text (a 64-bit float), or the reason why no number was found.
fn number(reading: &NodeReading) -> String {
    match &reading.value {
        Ok(value) => f64::from_bits(value.bits()).to_string(),
        Err(reason) => reason.to_string(),
    }
}

/// Formats the reading of a node: its registers, for example `17395 4660`, or the reason why it has no value.
fn node(node: &NodeReading) -> String {
    match &node.value {
        Ok(value) => Listed(value.registers()).to_string().trim_start().to_owned(),
        Err(reason) => reason.to_string(),
    }
}

/// Formats bytes as hexadecimal digits: `00 01 00 00 00 06`.
fn bytes(bytes: &[u8]) -> String {
    let pairs: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    pairs.join(" ")
}

fn hex<S: Serializer>(shown: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&bytes(shown))
}

fn stamp<S: Serializer>(moment: &Moment, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&moment.to_string())
}

fn millis<S: Serializer>(span: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(span.as_secs_f64() * 1000.0)
}

/// Two lines: `12:00:01.234 → 00 01 …   unit 1 read input:0..7`, and `← …   8 registers: 251 249 …, 3.2 ms`. The time
/// is UTC. A message without a request has only one line.
impl fmt::Display for Exchange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stamp = format!("{:.3}", jiff_stamp(self.asked_at));
        let time = stamp.get(11..23).unwrap_or(&stamp);
        if self.asked.is_empty() {
            return write!(f, "{time} ← {}   {}", bytes(&self.received), self.answered);
        }
        let sent = if self.sent.is_empty() { "nothing sent".to_owned() } else { bytes(&self.sent) };
        writeln!(f, "{time} → {sent}   unit {} {}", self.unit, self.asked)?;
        let received = if self.received.is_empty() { "nothing".to_owned() } else { bytes(&self.received) };
        let more = if self.more == 0 { String::new() } else { format!(" … {} more bytes", self.more) };
        let took = self.took.as_secs_f64() * 1000.0;
        write!(f, "{:12} ← {received}{more}   {}, {took:.1} ms", "", self.answered)
    }
}

fn jiff_stamp(moment: Moment) -> jiff::Timestamp {
    jiff::Timestamp::from_nanosecond(i128::from(moment.as_nanos())).unwrap_or_default()
}
