//! Requests whose answers may still arrive. The time is an argument of the functions, so the module needs no clock.
//!
//! An answer does not show to which request it belongs. The next request with the same text may therefore
//! receive a late answer. Answers arrive in the order of their requests, so the age of a value counts from
//! the oldest open request. A request with another text waits until no earlier answer can arrive any more.
//!
//! The first request on a new connection waits in the same way. The beginning of an answer may have arrived
//! on the old connection, and the rest alone would be another number. After the start of the program, an
//! answer to a request of the previous run may arrive.

use std::collections::VecDeque;
use std::time::Duration;

use isotherm_core::quantity::Moment;

/// Open requests of a line, all with the same text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PendingAnswers {
    request: String,
    asked: VecDeque<Moment>,
    /// Whether this run has waited long enough at its start. Answers to requests of the previous run then no
    /// longer arrive.
    has_begun: bool,
}

impl PendingAnswers {
    /// Returns how long a request with this text must wait for earlier answers. An answer can arrive until `span` after
    /// its request.
    pub fn wait_before(&mut self, request: &str, now: Moment, span: Duration) -> Duration {
        let wait = self.wait_for_all(now, span);
        if self.request == request { Duration::ZERO } else { wait }
    }

    /// Returns how much longer answers may arrive. An answer can arrive until `span` after its request. For answers to
    /// an earlier run of the program, half of `span` is used, because the start of the program also takes time.
    pub fn wait_for_all(&mut self, now: Moment, span: Duration) -> Duration {
        self.asked.retain(|asked| now.since(*asked) < span);
        let least = if self.has_begun { Duration::ZERO } else { span / 2 };
        self.asked.back().map_or(least, |last| last.after(span).since(now))
    }

    /// Records that the line has waited until no answer can arrive any more.
    pub fn expire(&mut self) {
        self.has_begun = true;
        self.asked.clear();
    }

    /// Records a request that is sent now. If its text differs from the text of the open requests, these are
    /// removed: the caller has waited until their answers can no longer arrive.
    pub fn sent(&mut self, request: &str, now: Moment) {
        if self.request != request {
            request.clone_into(&mut self.request);
            self.asked.clear();
        }
        self.has_begun = true;
        self.asked.push_back(now);
    }

    /// Records an answer. Returns the time of the oldest open request, to which the answer may belong; `None`
    /// if no request is open.
    pub fn answered(&mut self) -> Option<Moment> {
        self.asked.pop_front()
    }

    /// Returns whether a request is open, so that its answer may still arrive.
    pub fn is_open(&self) -> bool {
        !self.asked.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPAN: Duration = Duration::from_secs(2);

    /// Returns the state after the first wait.
    fn begun() -> PendingAnswers {
        let mut pending = PendingAnswers::default();
        pending.expire();
        pending
    }

    fn at(millis: u64) -> Moment {
        Moment::from_nanos(millis * 1_000_000)
    }

    #[test]
    fn the_age_counts_from_the_oldest_open_request() {
        let mut pending = begun();
        for sent in [1000, 2000, 2500] {
            assert_eq!(pending.wait_before("#01\r", at(sent), SPAN), Duration::ZERO);
            pending.sent("#01\r", at(sent));
        }
        assert_eq!(pending.answered(), Some(at(1000)), "the late answer to the first request");
        assert_eq!((pending.answered(), pending.answered()), (Some(at(2000)), Some(at(2500))));
        assert_eq!((pending.answered(), pending.is_open()), (None, false));
    }

    #[test]
    fn another_request_waits_until_no_answer_can_arrive() {
        let mut pending = begun();
        pending.sent("#01\r", at(1500));
        assert_eq!(pending.wait_before("#02\r", at(2000), SPAN), Duration::from_millis(1500));
        assert_eq!(pending.wait_before("#02\r", at(3400), SPAN), Duration::from_millis(100));
        assert_eq!(pending.answered(), Some(at(1500)), "the first one is no longer expected");
        assert_eq!(pending.wait_before("#02\r", at(3400), SPAN), Duration::ZERO);
        pending.sent("#01\r", at(4000));
        pending.sent("#02\r", at(4100));
        assert_eq!(pending.answered(), Some(at(4100)));
        assert!(!pending.is_open());
    }

    #[test]
    fn a_new_connection_waits_until_no_answer_can_arrive() {
        let mut pending = PendingAnswers::default();
        assert_eq!(pending.wait_for_all(at(1000), SPAN), Duration::from_secs(1), "answers to the last run");
        pending.expire();
        assert_eq!(pending.wait_for_all(at(1000), SPAN), Duration::ZERO);
        pending.sent("#01\r", at(1000));
        assert_eq!(pending.wait_for_all(at(2500), SPAN), Duration::from_millis(500));
        assert_eq!(pending.wait_before("#01\r", at(2500), SPAN), Duration::ZERO);
        pending.expire();
        pending.sent("#01\r", at(3000));
        assert_eq!(pending.answered(), Some(at(3000)), "the age counts from the only request");
    }
}
