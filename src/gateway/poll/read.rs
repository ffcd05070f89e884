//! One device is read, one request at a time.

use super::{LineTask, call};
use crate::quantity::Moment;
use crate::reading::Reason;

impl LineTask {
    /// Asks a device for all that is read of it, from `now` on; the moment after that. The last of a round need not let
    /// anything pass: the round's end does.
    pub(super) async fn poll(&mut self, place: usize, round: Moment, now: Moment, is_last: bool) -> Moment {
        let poll = &mut self.polls[place];
        poll.due = round.next_tick(poll.due, poll.every);
        let requests = poll.requests.len();
        let mut now = self.capture(place, now).await;
        for request in 0..requests {
            now = self.ask(place, request, now).await;
            if !is_last || request + 1 < requests {
                now = self.let_pass(place, now).await;
            }
        }
        now
    }

    /// What a device must be told before it is read; the moment after that.
    pub(super) async fn capture(&mut self, place: usize, now: Moment) -> Moment {
        let poll = &mut self.polls[place];
        poll.captures.send(&mut self.line, &self.shared, poll.device, now).await
    }

    /// One request of a poll and what it brings; the moment after that.
    pub(super) async fn ask(&mut self, place: usize, request: usize, now: Moment) -> Moment {
        let poll = &self.polls[place];
        let read = &poll.requests[request];
        let answer = call(&mut self.line, &self.shared, poll.device, read.request(), now).await;
        let taken = self.shared.clock.now();
        let mut core = self.shared.core();
        let is_fit = core.commissioning.is_fit(poll.device);
        for field in &read.fields {
            let capture = self.shared.profile.signal(field.signal).capture;
            if let Some(fault) = poll.captures.failed(capture) {
                core.board.fail(field.signal, fault.reason());
                continue;
            }
            match &answer {
                Ok(answer) => {
                    let encoding = &self.shared.profile.signal(field.signal).encoding;
                    let value = field.decode(encoding, answer);
                    let value = value.and_then(|value| is_fit.then_some(value).ok_or(Reason::NotAsExpected));
                    core.board.store(&self.shared.profile, field.signal, value, taken);
                }
                Err(fault) => core.board.fail(field.signal, fault.reason()),
            }
        }
        taken
    }
}
