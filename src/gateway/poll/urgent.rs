//! What must not wait for a slow device on the same line: between two of its requests it goes first.

use std::time::Duration;

use super::{LineTask, count_late};
use crate::quantity::Moment;

/// On a line that is quicker than this nothing waits long enough to go before its turn.
const SLOW: Duration = Duration::from_millis(20);

impl LineTask {
    /// Between two requests of a round: heartbeat, positions with their correction, an axis that is due, and what is
    /// decided and not yet written. So each of them waits for one request at most, or for one write with its
    /// verification. Gives the present moment.
    pub(super) async fn let_pass(&mut self, asked: usize, taken: Moment) -> Moment {
        if taken.since(self.passed) < SLOW {
            return taken;
        }
        self.beat(taken).await;
        let mut now = self.shared.clock.now();
        let mut has_read = false;
        for place in 0..self.polls.len() {
            let poll = &self.polls[place];
            if poll.reads_position && place != asked && now >= poll.due {
                count_late(&mut self.shared.core().buses[self.bus.0], now.since(poll.due));
                self.polls[place].due = now.next_tick(poll.due, poll.every);
                now = self.capture(place, now).await;
                for request in 0..self.polls[place].requests.len() {
                    now = self.ask(place, request, now).await;
                }
                has_read = true;
            }
        }
        self.shared.look_for_restarts(now);
        // Before the first round is over, what an axis needs has not been read.
        let is_due = self.steps_axes && self.has_been_round;
        if is_due && self.shared.core().compensation.next_due().is_some_and(|due| now >= due) {
            self.shared.advance(self.bus, now);
        }
        if has_read && self.feeds_others {
            self.shared.ring_others(self.bus);
        }
        self.write(now).await;
        self.passed = self.shared.clock.now();
        self.passed
    }
}
