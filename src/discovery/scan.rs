//! Search for the units that answer on a line. Each unit gets one read of one register. An exception is an answer too.

use std::ops::RangeInclusive;
use std::time::Duration;

use serde::Serialize;

use crate::discovery::bus::LineAddress;
use crate::discovery::unit_reader::{Trace, UnitReader};
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::Answer;
use isotherm_core::codec::Register;
use isotherm_profile::{Bus, Quirks};

/// Bytes of an RTU frame that reads one register, and of its answer.
const REQUEST: usize = 8;
const ANSWER: usize = 7;

/// Settings of a scan.
#[derive(Clone, Debug)]
pub struct Scan {
    /// Line to scan. A serial line is in the list once for each combination of settings to try.
    pub lines: Vec<LineAddress>,
    /// Timeout and quirks of the line.
    pub bus: Bus,
    /// Quirks of each unit.
    pub quirks: Quirks,
    /// Unit numbers to query.
    pub units: RangeInclusive<u8>,
    /// Registers to read. The scan reads the next register of a unit only if the unit did not answer the one before.
    pub registers: Vec<Register>,
    /// Callback that receives every exchange.
    pub trace: Option<Trace>,
}

/// Unit that has answered, and its answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Responder {
    /// Modbus unit number.
    pub unit: u8,
    /// Register that was read.
    pub register: String,
    /// Kind of the answer.
    #[serde(flatten)]
    pub how: AnswerKind,
}

/// Kind of an answer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "answer", content = "value")]
pub enum AnswerKind {
    /// Value of the register.
    Value(u16),
    /// Exception code. The unit exists, and does not have this register or function.
    Exception(u8),
    /// Description of an invalid answer.
    Garbled(String),
}

/// Progress of a scan.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The scan continues with these settings of the line.
    Line(LineAddress),
    /// This unit answers, on a line with these settings.
    Found(LineAddress, Responder),
    /// Number of requests so far.
    Asked(usize),
}

impl Scan {
    /// Returns the maximum number of requests.
    pub fn questions(&self) -> usize {
        self.lines.len() * self.units.len() * self.registers.len()
    }

    /// Returns the longest duration of the scan. Each request may wait for its answer until the timeout, and for the
    /// connection that is opened again after a timeout.
    pub fn at_worst(&self) -> Duration {
        let pauses = self.quirks.pause_between_requests + self.quirks.pause_after_connect;
        let each_line = self.lines.iter().map(|line| {
            let under_way = line.serial().map_or(Duration::ZERO, |serial| serial.exchange(REQUEST, ANSWER));
            self.bus.timeout * 2 + pauses + under_way
        });
        let questions = self.units.len() * self.registers.len();
        each_line.sum::<Duration>() * u32::try_from(questions).unwrap_or(u32::MAX)
    }

    /// Queries all units. The scan may be dropped at any time, because it leaves nothing to undo.
    ///
    /// # Errors
    /// The line cannot be connected, or the connection is lost and cannot be opened again.
    pub async fn run(&self, mut report: impl FnMut(Event)) -> Result<(), FailedScan> {
        let mut asked = 0;
        for line in &self.lines {
            report(Event::Line(line.clone()));
            let mut asker = self.asker(line);
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
                    if let Some(how) = how(&answer) {
                        let register = register.to_string();
                        report(Event::Found(line.clone(), Responder { unit, register, how }));
                        break;
                    }
                }
            }
        }
        Ok(())
    }

    /// Returns the requester for the units of one line.
    pub fn asker(&self, line: &LineAddress) -> UnitReader {
        UnitReader::new(line, &self.bus, self.quirks, self.trace)
    }
}

/// Scan that ended early because the line failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FailedScan {
    /// First unit without a result.
    pub unit: u8,
    /// Fault of the line.
    pub fault: Fault,
}

/// Classifies an answer; `None` if no such unit exists. A Modbus gateway to a serial line reports this with exception
/// 10 or
/// 11. Some devices close the connection for a unit number that is not their own.
fn how(answer: &Result<Answer, Fault>) -> Option<AnswerKind> {
    match answer {
        Ok(Answer::Registers(registers)) => registers.first().copied().map(AnswerKind::Value),
        Ok(Answer::Bits(bits)) => bits.first().map(|bit| AnswerKind::Value(u16::from(*bit))),
        Ok(Answer::Done | Answer::Nodes(_)) => None,
        Err(Fault::Exception(10 | 11)) => None,
        Err(Fault::Exception(code)) => Some(AnswerKind::Exception(*code)),
        Err(fault @ Fault::Peer(_)) => Some(AnswerKind::Garbled(fault.to_string())),
        Err(
            Fault::Timeout
            | Fault::Link(_)
            | Fault::Caller(_)
            | Fault::Aborted(_)
            | Fault::Status(_)
            | Fault::Part { .. }
            | Fault::Unreadable { .. },
        ) => None,
    }
}

/// Returns whether the device ignores the unit number: it answers to all of them in the same way. Many TCP devices do,
/// because they have one unit only.
pub fn heeds_no_number(found: &[&Responder], asked: usize) -> bool {
    asked > 3 && found.len() == asked && found.windows(2).all(|pair| pair[0].how == pair[1].how)
}
