//! Serial side of a Modbus TCP gateway, with one unit. It uses each reply for the request that is open when the reply
//! arrives.
//!
//! The Modbus gateway gives up waiting for a slow unit. If another request is open when the late reply arrives, that
//! request gets it. The reply to that request is then late too. A reply without an open request is discarded.

use std::collections::VecDeque;
use std::time::Duration;

use crate::machine::Question;

/// Timeout of the Modbus gateway for the unit.
pub(crate) const PATIENCE: Duration = Duration::from_millis(150);
/// Time for a request and its reply on the serial line.
const EXCHANGE: Duration = Duration::from_millis(5);

/// Replies that have not arrived at the Modbus gateway yet, in their order.
#[derive(Clone, Debug, Default)]
pub(crate) struct SerialSide {
    late: VecDeque<Late>,
    /// Exception that the Modbus gateway sends after a timeout; `None` if it sends nothing.
    code: Option<u8>,
}

#[derive(Clone, Debug)]
struct Late {
    due: Duration,
    answer: Passed,
}

/// Reply of the Modbus gateway to a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Passed {
    /// Time of the reply.
    pub(crate) at: Duration,
    pub(crate) message: Vec<u8>,
    /// Request to which it belongs, with the time of that request.
    pub(crate) of: (Question, Duration),
}

/// Delay of the unit, and the exception that the Modbus gateway sends after its timeout, if any.
pub(crate) type Delay = (Duration, Option<u8>);

impl SerialSide {
    /// Returns the reply of the Modbus gateway to a request, which the unit answers with `message`. `None` if it sends
    /// nothing.
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
