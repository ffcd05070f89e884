//! Requests of a connection that were given up after their timeout, and their late answers.
//!
//! Transaction numbers are random, and a given up number is not used again while its answer is expected. Therefore, a
//! frame with the number and unit of a given up request is the late answer to it. The server must return transaction
//! numbers correctly. A second answer with the same number does not count as a late answer.

use super::First;
use crate::fieldbus::kinds::modbus::wire::LateReply;
use isotherm_core::quantity::Moment;

/// Maximum number of given up requests of a connection. A further request replaces the oldest request in the list. If
/// the answer to the replaced request arrives, the connection is closed.
const MOST: usize = 16;

/// Request that was sent to a unit. The answer to it has the same transaction number and unit number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SentRequest {
    pub(super) transaction: u16,
    pub(super) unit: u8,
    pub(super) asked: Moment,
}

/// Given up requests of one connection that are still unanswered, and the late answers that were discarded.
#[derive(Debug, Default)]
pub(super) struct GivenUp {
    requests: Vec<SentRequest>,
    replies: Vec<LateReply>,
}

impl GivenUp {
    /// Adds a request to the list of given up requests; `None` changes nothing.
    pub(super) fn extend(&mut self, request: Option<SentRequest>) {
        if request.is_some() && self.requests.len() == MOST {
            self.requests.remove(0);
        }
        self.requests.extend(request);
    }

    /// Returns whether the late answer to any given up request may still arrive.
    pub(super) fn is_expected(&self) -> bool {
        !self.requests.is_empty()
    }

    /// Returns whether the list contains the request that was sent to this unit at `asked`.
    pub(super) fn contains(&self, unit: u8, asked: Moment) -> bool {
        self.requests.iter().any(|request| (request.unit, request.asked) == (unit, asked))
    }

    /// Returns whether a given up request has this transaction number.
    pub(super) fn has(&self, transaction: u16) -> bool {
        self.requests.iter().any(|request| request.transaction == transaction)
    }

    /// Returns whether a frame is the late answer to a given up request. If the unit number of the frame has not
    /// arrived yet, only the transaction number is compared.
    pub(super) fn expects(&self, first: &First) -> bool {
        self.requests.iter().any(|request| first.answers(request.transaction, request.unit))
    }

    /// Records that the late answer with this header and this message has arrived. `received` is the time of its
    /// arrival, if it is known.
    pub(super) fn answered(&mut self, first: &First, message: &[u8], received: Option<Moment>) {
        let is_its = |request: &SentRequest| first.answers(request.transaction, request.unit);
        let Some(place) = self.requests.iter().position(is_its) else { return };
        let SentRequest { unit, asked, .. } = self.requests.remove(place);
        let is_of_a_gateway = matches!(message, [function, 10 | 11] if function & 0x80 != 0);
        self.replies.push(LateReply { unit, asked, received, is_of_a_gateway });
    }

    /// Returns the late answers that were discarded since the last call.
    pub(super) fn take_replies(&mut self) -> Vec<LateReply> {
        std::mem::take(&mut self.replies)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(transaction: u16, unit: u8) -> SentRequest {
        SentRequest { transaction, unit, asked: Moment::from_nanos(u64::from(transaction)) }
    }

    fn frame(transaction: u16, unit: u8) -> First {
        First { transaction, unit: Some(unit), end: None }
    }

    #[test]
    fn one_answer_to_each_given_up_request_is_late_and_nothing_else() {
        let mut given_up = GivenUp::default();
        given_up.extend(None);
        assert!(!given_up.is_expected());
        given_up.extend(Some(sent(7, 1)));
        given_up.extend(Some(sent(9, 2)));
        assert!(given_up.has(7) && given_up.has(9) && !given_up.has(8));
        for (transaction, unit, is_late) in [(7, 1, true), (9, 2, true), (7, 2, false), (8, 1, false)] {
            assert_eq!(given_up.expects(&frame(transaction, unit)), is_late, "{transaction} of unit {unit}");
        }
        assert!(given_up.expects(&First { transaction: 7, unit: None, end: None }));
        given_up.answered(&frame(7, 1), &[3, 2, 0, 10], None);
        assert!(!given_up.expects(&frame(7, 1)), "a second answer");
        let received = Some(Moment::from_nanos(99));
        given_up.answered(&frame(9, 2), &[0x83, 11], received);
        assert!(!given_up.is_expected());
        let asked = Moment::from_nanos;
        let late =
            |unit, asked, received, is_of_a_gateway| LateReply { unit, asked, received, is_of_a_gateway };
        let replies = [late(1, asked(7), None, false), late(2, asked(9), received, true)];
        assert_eq!(given_up.take_replies(), replies);
        assert_eq!(given_up.take_replies(), []);
    }

    #[test]
    fn the_oldest_of_too_many_given_up_requests_is_forgotten() {
        let mut given_up = GivenUp::default();
        (0..17).for_each(|transaction| given_up.extend(Some(sent(transaction, 1))));
        assert!(!given_up.has(0) && given_up.has(1) && given_up.has(16));
    }
}
