//! What a run before this one has left: its state and its ledger, and whether they are believed.

use std::path::Path;
use std::sync::Arc;

use super::Options;
use super::disk::{Disk, refuse_what_others_may_write};
use super::memory::{Memory, Recalled};
use super::sealed::pair::{Opened, open_both, refuse_later};
use super::sealed::{Pair, SealedFile, Which, named};
use super::storage::{newest_stamp, not_going_on};
use crate::clock::{Clock, Correction};
use crate::observe::events::{Event, Journal};
use isotherm_core::compensation::Stop;
use isotherm_profile::Profile;

#[derive(Default)]
pub(super) struct Left {
    pub(super) recalled: Recalled,
    /// The clock does not go on where the last run ended.
    pub(super) correction: Option<Correction>,
    /// Where the state is kept, if it is.
    pub(super) state: Option<SealedFile>,
    pub(super) ledger: Option<Opened>,
    /// No run has left anything here.
    pub(super) is_first: bool,
    pub(super) pair: Option<Arc<Pair>>,
}

impl Left {
    pub(super) fn open(options: &Options, profile: &Profile, (journal, clock): (&Journal, &Clock)) -> Left {
        let Some(directory) = options.directory.as_deref() else { return Left::default() };
        let (machine, now) = (&profile.name, clock.now());
        // Where there are no threads, there is no log.
        let named = options.has_threads.then(|| named::newest(directory, machine)).flatten();
        let [state, ledger] = open_both(&options.disk, directory, machine, named, clock.stamp(now));
        for (opened, which) in [(&state, Which::State), (&ledger, Which::Ledger)] {
            if let Some((version, aside)) = &opened.earlier {
                let kept = format!("before it is replaced it is kept as {}", aside.display());
                let (what, version) = (which.name(), *version);
                journal.report(now, &Event::TakenFromEarlier { what, version, kept });
            }
        }
        let is_first = named.is_none() && matches!((&state.found, &ledger.found), (Ok(None), Ok(None)));
        let Opened { found, file, .. } = state;
        let recalled =
            found.and_then(|found| Memory::recall(found, profile).map_err(|why| file.is_not_believed(&why)));
        let mut recalled = recalled.unwrap_or_else(|why| {
            journal.report(now, &Event::NotBelieved { why });
            Recalled::default()
        });
        let correction = recalled.goes_on((directory, machine), (journal, clock));
        let pair = Some(Arc::clone(file.pair()));
        Left { recalled, correction, state: Some(file), ledger: Some(ledger), is_first, pair }
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
    refuse_what_others_may_write(directory)?;
    for which in [Which::State, Which::Ledger] {
        refuse_what_others_may_write(&which.path(directory, &profile.name))?;
    }
    let disk: &dyn Disk = &*options.disk;
    refuse_later(disk, directory, &profile.name)
}
