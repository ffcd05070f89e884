//! Search for the units that answer on a line. The scan requests one register from each unit number. An
//! exception counts as an answer too.

use std::ops::RangeInclusive;
use std::time::Duration;

use serde::Serialize;

use crate::discovery::bus::LineAddress;
use crate::discovery::new_connection::{LONGEST_PAUSE, NewConnection, examine};
use crate::discovery::unit_reader::{Trace, UnitReader};
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::wire::Answer;
use isotherm_core::codec::Register;
use isotherm_profile::{Bus, Quirks, Transport};

/// Length in bytes of an RTU frame that reads one register. `ANSWER` is the length of the answer to this frame.
const REQUEST: usize = 8;
const ANSWER: usize = 7;
/// Maximum number of units that are tested with a pause after connecting, if no unit has answered the scan.
const UNITS: usize = 8;

/// Settings of a scan.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Lines to scan, one after another. A serial line is in the list once for each combination of settings to try.
    pub lines: Vec<LineAddress>,
    /// Bus settings for the scan: timeout and quirks.
    pub bus: Bus,
    /// Quirks (profile settings for peculiar devices), which apply to each unit of the lines.
    pub quirks: Quirks,
    /// Unit numbers to query.
    pub units: RangeInclusive<u8>,
    /// Registers to read. The scan reads the next register of a unit only if the read of the previous register got no
    /// answer.
    pub registers: Vec<Register>,
    /// Callback that receives every exchange, for a log; `None`: no log.
    pub trace: Option<Trace>,
}

/// Modbus unit that has answered during a scan, and its answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Responder {
    /// Modbus unit number.
    pub unit: u8,
    /// Address of the register that was read.
    pub register: String,
    /// Kind of the answer: a register value, an exception, or an invalid answer.
    #[serde(flatten)]
    pub how: AnswerKind,
}

/// Kind of an answer that shows that a unit exists.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "answer", content = "value")]
pub enum AnswerKind {
    /// Value of the register.
    Value(u16),
    /// Exception with this code. The unit exists, but does not have this register or function.
    Exception(u8),
    /// Invalid answer, with a description of it.
    Garbled(String),
}

/// Progress of a scan, reported while the scan runs.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The scan continues with this line and these settings.
    Line(LineAddress),
    /// This unit answered on this line.
    Found(LineAddress, Responder),
    /// The line received input that does not show a unit with the requested number: an echo, text, or an answer with
    /// another unit number.
    Noticed(LineAddress, Fault),
    /// Number of requests sent so far.
    Asked(usize),
}

impl Scan {
    /// Returns the maximum number of requests of the scan.
    pub fn questions(&self) -> usize {
        self.lines.len() * self.units.len() * self.registers.len()
    }

    /// Returns the longest possible duration of the scan. In the worst case each request takes the full timeout, and
    /// then a new connection must be opened.
    pub fn at_worst(&self) -> Duration {
        let pauses = self.quirks.pause_between_requests + self.quirks.pause_after_connect;
        let each_line = self.lines.iter().map(|line| {
            let under_way = line.serial().map_or(Duration::ZERO, |serial| serial.exchange(REQUEST, ANSWER));
            self.bus.timeout * 2 + pauses + under_way
        });
        let questions = self.units.len() * self.registers.len();
        each_line.sum::<Duration>() * u32::try_from(questions).unwrap_or(u32::MAX)
    }

    /// Reads from all units, and calls `report` with the progress. The caller may drop the future at any time, because
    /// a scan only reads.
    ///
    /// # Errors
    /// The line cannot be connected, or the connection is lost and cannot be opened again.
    pub async fn run(&self, mut report: impl FnMut(Event)) -> Result<(), FailedScan> {
        let mut asked = 0;
        for line in &self.lines {
            report(Event::Line(line.clone()));
            let mut asker = self.asker(line);
            let (mut is_echoed, mut is_answered) = (false, false);
            for unit in self.units.clone() {
                for register in &self.registers {
                    let answer = asker.read(unit, *register, 1).await;
                    asked += 1;
                    if let Err(fault) = answer
                        && fault.is_of_the_line()
                    {
                        return Err(FailedScan { unit, fault });
                    }
                    report(Event::Asked(asked));
                    is_echoed |= asker.has_come_back();
                    if let Err(fault) = answer
                        && is_of_no_unit(fault, line.transport)
                    {
                        report(Event::Noticed(line.clone(), fault));
                        continue;
                    }
                    if let Some(how) = how(&answer) {
                        let register = register.to_string();
                        report(Event::Found(line.clone(), Responder { unit, register, how }));
                        is_answered = true;
                        break;
                    }
                }
            }
            // An echo before an answer is normal on some adapters.
            if is_echoed && !is_answered {
                report(Event::Noticed(line.clone(), Fault::Peer(PeerFault::Echoed)));
            }
        }
        Ok(())
    }

    /// Tests whether the devices on the first line need a pause after connecting, or lose the first request of each
    /// connection. The caller uses this after a scan in which no unit answered. Returns the first unit with such a
    /// behaviour, and the behaviour.
    pub async fn examine(&self) -> Option<(u8, NewConnection)> {
        let (line, register) = (self.lines.first()?, *self.registers.first()?);
        // Over Modbus TCP, transaction numbers distinguish the answers of the units, so one connection is enough for
        // all.
        let most = if line.transport == Transport::Tcp { UNITS } else { 1 };
        let pause = self.quirks.pause_after_connect.max(LONGEST_PAUSE);
        let quirks = Quirks { pause_after_connect: pause, loses_first_request: true, ..self.quirks };
        let mut reader = UnitReader::new(line, &self.bus, quirks, self.trace).keeping();
        for unit in self.units.clone().take(most) {
            if how(&reader.read(unit, register, 1).await).is_some() {
                reader.hang_up();
                let found = examine(line, &self.bus, self.quirks, unit, (register, 1)).await?;
                return Some((unit, found));
            }
        }
        None
    }

    /// Returns the reader that sends the requests of this scan to the units of one line.
    pub fn asker(&self, line: &LineAddress) -> UnitReader {
        UnitReader::new(line, &self.bus, self.quirks, self.trace)
    }
}

/// Error of a scan that ended early because the line failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FailedScan {
    /// Number of the first unit that was not completely scanned.
    pub unit: u8,
    /// Fault of the line.
    pub fault: Fault,
}

/// Returns whether the fault shows that something on the line sends data, but not the unit with the requested number.
/// Without transaction numbers, a frame of another unit is a late answer of that unit, or an answer to another master.
fn is_of_no_unit(fault: Fault, transport: Transport) -> bool {
    match fault {
        Fault::Peer(PeerFault::Unit(_) | PeerFault::Text(_) | PeerFault::Echoed) => true,
        Fault::Peer(PeerFault::Foreign) => transport != Transport::Tcp,
        _ => false,
    }
}

/// Returns the kind of an answer. `None` if the unit did not answer, or if the answer shows that no such unit
/// exists. A Modbus gateway to a serial line reports a missing unit with exception 10 or 11. Some devices
/// close the connection if the unit number is not their own.
fn how(answer: &Result<Answer, Fault>) -> Option<AnswerKind> {
    if let Some(code) = answer.as_ref().err().and_then(|fault| fault.exception_code()) {
        return (!matches!(code, 10 | 11)).then_some(AnswerKind::Exception(code));
    }
    match answer {
        Ok(Answer::Registers(registers)) => registers.first().copied().map(AnswerKind::Value),
        Ok(Answer::Bits(bits)) => bits.first().map(|bit| AnswerKind::Value(u16::from(*bit))),
        Ok(Answer::Done | Answer::Nodes(_)) => None,
        Err(fault @ Fault::Peer(_)) => Some(AnswerKind::Garbled(fault.to_string())),
        Err(
            Fault::Timeout
            | Fault::Exception(_)
            | Fault::Link(_)
            | Fault::Caller(_)
            | Fault::Aborted(_)
            | Fault::Status(_)
            | Fault::Part { .. }
            | Fault::Unreadable { .. },
        ) => None,
    }
}

/// Returns whether the device seems to ignore the unit number: all `asked` unit numbers gave the same answer. Many TCP
/// devices ignore it, because they have only one unit.
pub fn heeds_no_number(found: &[&Responder], asked: usize) -> bool {
    asked > 3 && found.len() == asked && found.windows(2).all(|pair| pair[0].how == pair[1].how)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fieldbus::error::LinkFault;
    use crate::fieldbus::kinds::modbus::text::TextProtocol;

    const TCP: Transport = Transport::Tcp;
    const RTU: Transport = Transport::RtuOverTcp;

    /// Rows: answer, kind of line, whether the answer is noticed, and the kind of answer of the unit.
    #[test]
    fn only_an_answer_of_the_unit_shows_that_the_unit_exists() {
        let peer = |fault| Err(Fault::Peer(fault));
        let garbled = |fault: PeerFault| Some(AnswerKind::Garbled(fault.to_string()));
        for (answer, transport, is_noticed, unit) in [
            (Ok(Answer::Registers(vec![7])), TCP, false, Some(AnswerKind::Value(7))),
            (Ok(Answer::Bits(vec![true])), TCP, false, Some(AnswerKind::Value(1))),
            (Err(Fault::Exception(2)), RTU, false, Some(AnswerKind::Exception(2))),
            (peer(PeerFault::LongException(2)), RTU, false, Some(AnswerKind::Exception(2))),
            (Err(Fault::Exception(11)), TCP, false, None),
            (peer(PeerFault::LongException(11)), TCP, false, None),
            (Err(Fault::Timeout), RTU, false, None),
            (Err(Fault::Link(LinkFault::Broken)), TCP, false, None),
            (peer(PeerFault::Malformed), RTU, false, garbled(PeerFault::Malformed)),
            (peer(PeerFault::Length), RTU, false, garbled(PeerFault::Length)),
            (peer(PeerFault::Foreign), TCP, false, garbled(PeerFault::Foreign)),
            (peer(PeerFault::Foreign), RTU, true, None),
            (peer(PeerFault::Unit(1)), TCP, true, None),
            (peer(PeerFault::Echoed), TCP, true, None),
            (peer(PeerFault::Text(TextProtocol::Dcon)), RTU, true, None),
        ] {
            let noticed = answer.as_ref().err().is_some_and(|fault| is_of_no_unit(*fault, transport));
            assert_eq!(noticed, is_noticed, "{answer:?}");
            if !noticed {
                assert_eq!(how(&answer), unit, "{answer:?}");
            }
        }
    }
}
