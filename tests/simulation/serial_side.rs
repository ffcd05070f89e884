//! Serial side of a gateway from Modbus TCP, with one unit. It gives each answer to the question that is open when the answer arrives.
//!
//! The gateway gives up a slow unit. If another question is open when the late answer arrives, that question gets it. Its own answer
//! follows, and is late in turn. An answer that finds no open question is dropped.

use std::collections::VecDeque;
use std::time::Duration;

use crate::machine::Question;

/// The gateway waits so long for the unit.
pub(crate) const PATIENCE: Duration = Duration::from_millis(150);
/// Time on the serial line for a question and its answer.
const EXCHANGE: Duration = Duration::from_millis(5);

/// Answers that have not arrived at the gateway yet, in their order.
#[derive(Clone, Debug, Default)]
pub(crate) struct SerialSide {
    late: VecDeque<Late>,
    /// Exception by which the gateway says that it has given up; `None` if it says nothing.
    code: Option<u8>,
}

#[derive(Clone, Debug)]
struct Late {
    due: Duration,
    answer: Passed,
}

/// Answer of the gateway to a question.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Passed {
    /// When it comes.
    pub(crate) at: Duration,
    pub(crate) message: Vec<u8>,
    /// The question that it belongs to, and when that was asked.
    pub(crate) of: (Question, Duration),
}

/// The unit answers after so long, and the gateway gives up with this exception or silently.
pub(crate) type Delay = (Duration, Option<u8>);

impl SerialSide {
    /// Returns what the gateway answers to a question, which the unit answers with `message`. `None` if it gives up silently.
    pub(crate) fn pass(
        &mut self,
        asked: Question,
        message: Vec<u8>,
        delay: Option<Delay>,
        now: Duration,
    ) -> Option<Passed> {
        self.late.retain(|late| late.due > now);
        let own = Passed { at: now, message, of: (asked, now) };
        match (self.late.back().map(|last| last.due), delay) {
            (None, None) => return Some(own),
            (None, Some((after, code))) => {
                self.code = code;
                self.late.push_back(Late { due: now + after, answer: own });
            }
            (Some(last), _) => self.late.push_back(Late { due: last + EXCHANGE, answer: own }),
        }
        if let Some(Late { due, answer }) = self.late.pop_front_if(|first| first.due <= now + PATIENCE) {
            return Some(Passed { at: due, ..answer });
        }
        let (function, at) = (asked.function(), now + PATIENCE);
        self.code.map(|code| Passed { at, message: vec![function | 0x80, code], of: (asked, now) })
    }
}
