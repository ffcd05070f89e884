//! What a run before this one has left, and whether it is accepted.

use std::path::Path;

use super::Options;
use super::log::outputs::ENDING;
use super::memory::{Memory, Recalled};
use super::storage::{keeping, newest_stamp, not_going_on};
use super::store::{self, Opened, WHAT};
use crate::clock::{Clock, Correction};
use crate::observe::events::{Event, Journal};
use isotherm_core::compensation::Stop;
use isotherm_profile::Profile;

#[derive(Default)]
pub(super) struct Left {
    pub(super) recalled: Recalled,
    /// The clock does not go on where the last run ended.
    pub(super) correction: Option<Correction>,
    /// The store, if there is a directory for it.
    pub(super) opened: Option<Opened>,
}

impl Left {
    pub(super) fn open(options: &Options, profile: &Profile, (journal, clock): (&Journal, &Clock)) -> Left {
        let Some(directory) = options.directory.as_deref() else { return Left::default() };
        let (machine, now) = (&profile.name, clock.now());
        // Without threads there is no log.
        let is_log = |log: &keeping::DayLog| log.name.ends_with(ENDING);
        let has_logs = options.has_threads && keeping::logs(directory, machine).iter().any(is_log);
        let mut opened = store::open(&options.disk, (directory, machine), has_logs, clock.stamp(now));
        if let Some((version, kept)) = opened.earlier.take() {
            journal.report(now, &Event::TakenFromEarlier { what: "saved state", version, kept });
        }
        let state = match &mut opened.found {
            Ok(content) => content.as_mut().and_then(|content| content.state.take()),
            Err(why) => {
                journal.report(now, &Event::NotBelieved { why: why.clone() });
                None
            }
        };
        // It is kept until there is a newer one.
        state.iter().for_each(|state| opened.file.set_state(state));
        let recalled = Memory::recall(state, profile).unwrap_or_else(|why| {
            opened.file.question().open();
            let why =
                format!("{WHAT} in {} is not believed: {why}", store::path(directory, machine).display());
            journal.report(now, &Event::NotBelieved { why });
            Recalled::default()
        });
        let mut left = Left { recalled, correction: None, opened: Some(opened) };
        left.correction = left.recalled.goes_on((directory, machine), (journal, clock));
        left
    }
}

impl Recalled {
    /// Bridges the stop, by the computer's clock where that may be.
    fn goes_on(
        &mut self,
        (directory, machine): (&Path, &str),
        (journal, clock): (&Journal, &Clock),
    ) -> Option<Correction> {
        let now = clock.now();
        let by_the_clock = clock.stamp(now);
        let logged = newest_stamp(directory, machine, by_the_clock);
        let correction = not_going_on(by_the_clock, self.at.max(logged));
        if let Some(Correction { from: last, .. }) = correction {
            journal.report(now, &Event::ClockDoubtful { last });
        }
        if let Some(at) = self.at {
            let stop = match correction {
                None => Stop::between(at, by_the_clock),
                Some(_) => Stop::default(),
            };
            self.remembered = std::mem::take(&mut self.remembered).going_on(at, now, stop);
        }
        correction
    }
}

/// Whether a gateway may start with what lies in its directory.
///
/// # Errors
/// A sentence with the remedy: a later version of the program has written it, or anybody may write to it.
pub fn may_start(options: &Options, profile: &Profile) -> Result<(), String> {
    let Some(directory) = options.directory.as_deref() else { return Ok(()) };
    store::may_start(&*options.disk, directory, &profile.name)
}
