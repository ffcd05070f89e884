//! `pipeline = 2`: whether a line's questions may go out two at a time, and when that is given up.
//!
//! Some devices answer one question and lose the other, or close the connection. A wrong answer ends it at once. What is
//! lost may have been lost on the way: that ends it where it happens [`IN_A_ROW`] times with nothing good in between.

use super::error::Fault;
use super::request::{Answer, Request};

/// A pair of questions that is lost so often in a row is not lost on the way.
const IN_A_ROW: u32 = 3;

/// Of one line.
#[derive(Debug, Default)]
pub(super) struct Pipeline {
    is_on: bool,
    lost: u32,
    /// Goes out behind the next question.
    read: Option<(u8, Request<'static>)>,
}

impl Pipeline {
    pub(super) fn new(is_on: bool) -> Pipeline {
        Pipeline { is_on, ..Pipeline::default() }
    }

    pub(super) fn is_on(&self) -> bool {
        self.is_on
    }

    pub(super) fn ask(&mut self, read: Option<(u8, Request<'static>)>) {
        self.read = read.filter(|_| self.is_on);
    }

    pub(super) fn take(&mut self) -> Option<(u8, Request<'static>)> {
        self.read.take()
    }

    /// What came to the first of two questions, or to the second. Whether they go out one at a time from now on.
    pub(super) fn judge(&mut self, is_second: bool, answer: &Result<Answer, Fault>) -> bool {
        match answer {
            Err(Fault::Peer(_)) => self.lost = IN_A_ROW,
            Err(Fault::Timeout | Fault::Link(_)) => self.lost += 1,
            // One that did not leave says nothing.
            Err(Fault::Caller(_)) => {}
            // The first one is answered by a device that loses the second, too.
            _ if is_second => self.lost = 0,
            _ => {}
        }
        let is_over = self.is_on && self.lost >= IN_A_ROW;
        self.is_on &= !is_over;
        is_over
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fieldbus::error::PeerFault;

    #[test]
    fn a_wrong_answer_ends_it_at_once_and_lost_ones_where_nothing_good_comes_between() {
        let good = (true, Ok(Answer::Done));
        let first = (false, Ok(Answer::Done));
        let foreign = (false, Err(Fault::Peer(PeerFault::Foreign)));
        let lost = (true, Err(Fault::Timeout));
        let broken = (false, Err(Fault::BROKEN));
        for (answers, ends) in [
            (vec![&foreign], true),
            (vec![&lost, &broken], false),
            (vec![&lost, &broken, &lost], true),
            (vec![&first, &lost, &first, &lost, &first, &lost], true),
            (vec![&lost, &lost, &good, &lost], false),
            (vec![&(true, Err(Fault::Exception(4))); 5], false),
        ] {
            let mut pipeline = Pipeline::new(true);
            let ended = answers.iter().filter(|(second, answer)| pipeline.judge(*second, answer)).count();
            assert_eq!((ended, pipeline.is_on()), (usize::from(ends), !ends), "{answers:?}");
        }
        assert!(!Pipeline::new(false).judge(false, &foreign.1), "what was never on is not given up");
    }
}
