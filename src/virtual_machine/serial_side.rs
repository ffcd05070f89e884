//! Serial side of a virtual Modbus gateway from TCP to a serial line. The virtual Modbus gateway sends each answer with
//! the transaction number of the open request.
//!
//! The Modbus gateway stops waiting for a slow unit before its answer arrives. If another request to that unit is open
//! when the late answer arrives, the Modbus gateway sends the late answer for that request. The true answer to that
//! request is then late, too. Without an open request, the late answer is dropped, or kept until the next request.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use super::fault::ReplyFault;
use super::hardware::Reply;
use super::modbus::exception;
use crate::clock::Silence;

/// Time that a request and its answer take on the serial line.
const EXCHANGE: Duration = Duration::from_millis(5);

/// Late and kept answers of all units behind a Modbus gateway.
#[derive(Debug, Default)]
pub(super) struct SerialSide(Mutex<Answers>);

#[derive(Debug, Default)]
struct Answers {
    /// Answers that have not arrived at the Modbus gateway yet.
    late: Vec<Late>,
    /// Answers that the Modbus gateway keeps, at most one for each unit.
    kept: Vec<(u8, Vec<u8>)>,
}

#[derive(Debug)]
struct Late {
    unit: u8,
    pdu: Vec<u8>,
    asked: Silence,
    /// Time from the request, `asked`, until the answer arrives at the Modbus gateway.
    delay: Duration,
}

impl SerialSide {
    /// Returns the answer of the Modbus gateway to a new request, and its delay. `reply` is the answer of the unit
    /// itself.
    pub(super) fn pass(&self, unit: u8, pdu: &[u8], reply: Reply) -> (Reply, Duration) {
        let mut answers = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Answers { late, kept } = &mut *answers;
        let before = kept.iter().position(|(kept, _)| *kept == unit).map(|place| kept.remove(place).1);
        if let (Some(own), Some(ReplyFault::Keep { delay, code })) = (&reply.pdu, reply.fault) {
            kept.push((unit, own.clone()));
            return match before {
                Some(before) => (Reply { pdu: Some(before), fault: None }, EXCHANGE),
                None => given_up(pdu, delay, code),
            };
        }
        late.retain(|late| !late.asked.left_of(late.delay).is_zero());
        let own = reply.pdu.clone().map(|pdu| (pdu, reply.fault));
        if let Some(place) = late.iter().position(|late| late.unit == unit) {
            let shifted = late.remove(place);
            let left = shifted.asked.left_of(shifted.delay);
            if let Some((pdu, _)) = own {
                late.push(Late { unit, pdu, asked: Silence::begin(), delay: left + EXCHANGE });
            }
            return (Reply { pdu: Some(shifted.pdu), fault: None }, left);
        }
        match own {
            Some((own, Some(ReplyFault::Shift { delay, code }))) => {
                late.push(Late { unit, pdu: own, asked: Silence::begin(), delay });
                given_up(pdu, delay, code)
            }
            _ => (reply, Duration::ZERO),
        }
    }
}

/// Returns the answer of a Modbus gateway that times out before the unit answers, and its delay. The answer
/// is an exception with the code `code`; with `None`, the Modbus gateway does not answer.
fn given_up(pdu: &[u8], delay: Duration, code: Option<u8>) -> (Reply, Duration) {
    (Reply { pdu: code.map(|code| exception(pdu, code)), fault: None }, delay / 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BED: [u8; 5] = [4, 0, 0, 0, 1];
    const OIL: [u8; 5] = [4, 0, 100, 0, 1];
    const DELAY: Duration = Duration::from_millis(40);

    fn reads(value: u8, fault: Option<ReplyFault>) -> Reply {
        Reply { pdu: Some(vec![4, 2, 0, value]), fault }
    }

    #[tokio::test(start_paused = true)]
    async fn a_late_answer_is_stamped_with_the_open_question_and_dropped_without_one() {
        let shift = Some(ReplyFault::Shift { delay: DELAY, code: Some(11) });
        let refusal = Reply { pdu: Some(vec![0x84, 11]), fault: None };
        let side = SerialSide::default();
        assert_eq!(side.pass(1, &BED, reads(25, shift)), (refusal.clone(), DELAY / 2));
        tokio::time::sleep(DELAY / 2).await;
        assert_eq!(side.pass(2, &OIL, reads(7, None)), (reads(7, None), Duration::ZERO), "another unit");
        assert_eq!(side.pass(1, &OIL, reads(41, None)), (reads(25, None), DELAY / 2));
        tokio::time::sleep(DELAY / 2).await;
        assert_eq!(
            side.pass(1, &BED, reads(25, None)),
            (reads(41, None), EXCHANGE),
            "for as long as one watches"
        );
        tokio::time::sleep(2 * EXCHANGE).await;
        assert_eq!(side.pass(1, &OIL, reads(41, None)), (reads(41, None), Duration::ZERO));
        let silent = Some(ReplyFault::Shift { delay: DELAY, code: None });
        assert_eq!(side.pass(1, &BED, reads(25, silent)).0.pdu, None);
        tokio::time::sleep(DELAY).await;
        assert_eq!(side.pass(1, &OIL, reads(41, None)), (reads(41, None), Duration::ZERO));
    }

    #[test]
    fn a_kept_answer_is_given_to_the_next_question_and_forgotten_with_the_fault() {
        let keep = Some(ReplyFault::Keep { delay: DELAY, code: Some(11) });
        let side = SerialSide::default();
        let refusal = Reply { pdu: Some(vec![0x84, 11]), fault: None };
        assert_eq!(side.pass(1, &BED, reads(25, keep)), (refusal, DELAY / 2));
        assert_eq!(side.pass(2, &BED, reads(7, None)), (reads(7, None), Duration::ZERO), "another unit");
        assert_eq!(side.pass(1, &OIL, reads(41, keep)), (reads(25, None), EXCHANGE));
        assert_eq!(side.pass(1, &BED, reads(25, keep)), (reads(41, None), EXCHANGE));
        assert_eq!(side.pass(1, &OIL, reads(41, None)), (reads(41, None), Duration::ZERO));
        let silent = Some(ReplyFault::Keep { delay: DELAY, code: None });
        assert_eq!(side.pass(1, &BED, reads(25, silent)), (Reply { pdu: None, fault: None }, DELAY / 2));
    }
}
