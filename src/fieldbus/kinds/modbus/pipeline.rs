//! `pipeline = 2`: decision whether a line sends two requests at a time, and when it stops doing so.
//!
//! Some devices answer one request and lose the other, or close the connection. A wrong answer therefore ends
//! the pipeline at once. A missing answer may have been lost in transmission, so the pipeline ends only after
//! [`IN_A_ROW`] missing answers. An answer to the second of two requests resets this count.

use crate::fieldbus::error::Fault;
use crate::fieldbus::request::{Answer, Request};

/// Number of missing answers that ends the pipeline, if no second request is answered in between. So many
/// lost answers are unlikely to be chance.
const IN_A_ROW: u32 = 3;

/// State of the pipeline of one line: whether the line sends two requests at a time.
#[derive(Debug, Default)]
pub(in crate::fieldbus) struct Pipeline {
    is_on: bool,
    lost: u32,
    /// Unit and read that are sent together with the next request; `None` if the line sends no such read.
    read: Option<(u8, Request<'static>)>,
}

impl Pipeline {
    pub(in crate::fieldbus) fn new(is_on: bool) -> Pipeline {
        Pipeline { is_on, ..Pipeline::default() }
    }

    pub(in crate::fieldbus) fn is_on(&self) -> bool {
        self.is_on
    }

    pub(in crate::fieldbus) fn ask(&mut self, read: Option<(u8, Request<'static>)>) {
        self.read = read.filter(|_| self.is_on);
    }

    pub(in crate::fieldbus) fn take(&mut self) -> Option<(u8, Request<'static>)> {
        self.read.take()
    }

    /// Assesses the answer to the first or the second (`is_second`) of two requests that were sent together. Returns
    /// true if the line must stop sending two requests because of this answer.
    pub(in crate::fieldbus) fn assess(&mut self, is_second: bool, answer: &Result<Answer, Fault>) -> bool {
        match answer {
            Err(Fault::Peer(_)) => self.lost = IN_A_ROW,
            Err(Fault::Timeout | Fault::Link(_)) => self.lost += 1,
            // A request that was not sent proves nothing.
            Err(Fault::Caller(_)) => {}
            // A device that loses the second request answers the first one, too.
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
            let ended = answers.iter().filter(|(second, answer)| pipeline.assess(*second, answer)).count();
            assert_eq!((ended, pipeline.is_on()), (usize::from(ends), !ends), "{answers:?}");
        }
        assert!(!Pipeline::new(false).assess(false, &foreign.1), "what was never on is not given up");
    }
}
