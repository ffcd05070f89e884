//! Whose turn it is. Pure: what is due, and when the line may sleep.

use std::time::Duration;

use super::LineTask;
use isotherm_core::quantity::Moment;

/// On a line that is quicker than this nothing waits long enough to go before its turn.
const SLOW: Duration = Duration::from_millis(20);
/// So often in a row something that presses goes before what was due earlier.
const PRESSED: u32 = 8;

/// What a line does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// Nothing, until then.
    Sleep(Moment),
    /// The heartbeat.
    Beat,
    /// Looks at how devices are set that are not known to be fit.
    Inspect,
    /// One request of the device at this place.
    Read(usize),
    /// The axes.
    Step,
    /// The output or set at this place.
    Output(usize),
}

impl LineTask {
    pub(super) fn next(&self, now: Moment) -> Turn {
        if self.pulse.as_ref().is_some_and(|pulse| pulse.due <= now) {
            return Turn::Beat;
        }
        let polls = self.polls.iter().enumerate().map(|(place, poll)| (poll.due(), place));
        let read = polls.min();
        if self.may_step(now) {
            return Turn::Step;
        }
        let jobs = || self.jobs.iter().enumerate().map(|(place, job)| (job.due, place));
        if let Some((_, place)) =
            jobs().filter(|(due, place)| *due <= now && self.jobs[*place].corrects()).min()
        {
            return Turn::Output(place);
        }
        if self.inspects && !self.inspector.is_empty() {
            return Turn::Inspect;
        }
        let output = jobs().min();
        let read = read.filter(|(due, _)| *due <= now);
        match (read, output.filter(|(due, _)| *due <= now)) {
            (None, None) => Turn::Sleep(self.rests_until()),
            (None, Some((_, output))) => Turn::Output(output),
            (Some((due, first)), output) => {
                let others_wait =
                    output.is_some_and(|(since, _)| since < due) || self.polls[first].is_under_way();
                match self.pressing(now).filter(|_| others_wait && self.pressed < PRESSED) {
                    Some(pressing) => Turn::Read(pressing),
                    None => match output {
                        Some((since, output)) if since < due => Turn::Output(output),
                        _ => Turn::Read(first),
                    },
                }
            }
        }
    }

    /// The axes are looked at when a round of reads is over. One that is due waits for what it rests on, but not for
    /// a device that is slow, nor for one that is due again as soon as it has been read.
    fn may_step(&self, now: Moment) -> bool {
        let is_outstanding = |by: Moment| self.polls.iter().any(|poll| poll.is_outstanding(by));
        let is_due = self.step_due.filter(|due| self.steps_axes && *due <= now);
        let is_late =
            |due: &Moment| now.since(*due) >= SLOW && self.polls.iter().all(|poll| poll.has_been_read);
        is_due.is_some_and(|due| !is_outstanding(due) || is_late(&due))
            || (self.has_news && !is_outstanding(now))
    }

    /// A read that waits for nobody: of a position that is corrected, or of readings that are half way to being stale.
    fn pressing(&self, now: Moment) -> Option<usize> {
        let polls = self.polls.iter().enumerate().filter(|(_, poll)| poll.due() <= now);
        let pressing = polls.filter(|(_, poll)| {
            (poll.reads_position && now.since(poll.due()) >= SLOW) || poll.grows_stale(now)
        });
        pressing.map(|(place, poll)| (!poll.reads_position, poll.due(), place)).min().map(|(.., place)| place)
    }

    /// When there is something to do again.
    fn rests_until(&self) -> Moment {
        let polls = self.polls.iter().map(|poll| poll.due());
        let jobs = self.jobs.iter().map(|job| job.due);
        let pulse = self.pulse.iter().map(|pulse| pulse.due);
        let step = self.step_due.filter(|_| self.steps_axes);
        polls.chain(jobs).chain(pulse).chain(step).min().unwrap_or(Moment::END)
    }
}
