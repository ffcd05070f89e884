//! Which units of a line answer. Each is asked once, for one register; an exception is an answer too.

use std::ops::RangeInclusive;
use std::time::Duration;

use serde::Serialize;

use crate::discovery::ask::{Asker, Trace};
use crate::discovery::bus::{LineAddress, Transport};
use crate::fieldbus::error::Fault;
use crate::fieldbus::wire::Answer;
use isotherm_core::codec::Register;
use isotherm_profile::{Bus, Quirks};

/// Bytes of an RTU frame that asks for one register, and of the one that answers.
const REQUEST: usize = 8;
const ANSWER: usize = 7;

/// What is to be asked.
#[derive(Clone, Debug)]
pub struct Scan {
    /// The line; a serial one in each of the settings that are to be tried, one after the other.
    pub lines: Vec<LineAddress>,
    /// Its timeout and quirks.
    pub bus: Bus,
    /// How each of its units is to be treated.
    pub quirks: Quirks,
    /// Which units.
    pub units: RangeInclusive<u8>,
    /// What each of them is asked for: the first of these registers, and the next only where nothing came.
    pub registers: Vec<Register>,
    /// Is given every exchange.
    pub trace: Option<Trace>,
}

/// A unit that answers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Responder {
    /// Its number.
    pub unit: u8,
    /// What it was asked for.
    pub register: String,
    /// How it answered.
    #[serde(flatten)]
    pub how: How,
}

/// How a unit answers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "answer", content = "value")]
pub enum How {
    /// With the register's value.
    Value(u16),
    /// With this exception: it is there, and has no such register or function.
    Exception(u8),
    /// With something that is no proper answer.
    Garbled(String),
}

/// What happens meanwhile.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// The line in these settings, from now on.
    Line(LineAddress),
    /// This unit answers.
    Found(LineAddress, Responder),
    /// So many of all questions have been put.
    Asked(usize),
}

impl Scan {
    /// How many questions there are at most.
    pub fn questions(&self) -> usize {
        self.lines.len() * self.units.len() * self.registers.len()
    }

    /// How long it can take: for every question the answer, and the connection that is made anew after a miss, are waited
    /// for in vain.
    pub fn at_worst(&self) -> Duration {
        let pauses = self.quirks.pause_between_requests + self.quirks.pause_after_connect;
        let each_line = self.lines.iter().map(|line| {
            let under_way = match line.transport {
                Transport::Serial(serial) => serial.exchange(REQUEST, ANSWER),
                _ => Duration::ZERO,
            };
            self.bus.timeout * 2 + pauses + under_way
        });
        let questions = self.units.len() * self.registers.len();
        each_line.sum::<Duration>() * u32::try_from(questions).unwrap_or(u32::MAX)
    }

    /// Asks them all. Dropping it ends it: nothing is under way that would have to be taken back.
    ///
    /// # Errors
    /// The line cannot be connected, or not any more.
    pub async fn run(&self, mut report: impl FnMut(Event)) -> Result<(), Stopped> {
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
                        return Err(Stopped { unit, fault });
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

    /// What asks the units of one of the lines.
    pub fn asker(&self, line: &LineAddress) -> Asker {
        Asker::new(line, &self.bus, self.quirks, self.trace)
    }
}

/// The line was gone when this unit was to be asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stopped {
    /// The first that was not asked.
    pub unit: u8,
    /// What is wrong.
    pub fault: Fault,
}

/// `None`: nobody is there. A gateway to a serial line says so with exception 10 or 11; a device that closes the
/// connection for a number that is not its own says it in that way.
fn how(answer: &Result<Answer, Fault>) -> Option<How> {
    match answer {
        Ok(Answer::Registers(registers)) => registers.first().copied().map(How::Value),
        Ok(Answer::Bits(bits)) => bits.first().map(|bit| How::Value(u16::from(*bit))),
        Ok(Answer::Done | Answer::Nodes(_)) => None,
        Err(Fault::Exception(10 | 11)) => None,
        Err(Fault::Exception(code)) => Some(How::Exception(*code)),
        Err(fault @ Fault::Peer(_)) => Some(How::Garbled(fault.to_string())),
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

/// A device that heeds no unit number answers to all of them: many TCP devices do, as their one unit needs none.
pub fn heeds_no_number(found: &[&Responder], asked: usize) -> bool {
    asked > 3 && found.len() == asked && found.windows(2).all(|pair| pair[0].how == pair[1].how)
}
