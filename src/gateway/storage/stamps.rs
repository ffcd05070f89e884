//! Which file a row belongs to, and how its moments are stamped.
//!
//! All rows of a file are stamped alike, so that the spans in it are the counted ones and it can be replayed bit for bit.
//! Where the computer's clock was set, a new file begins whose first row says from when to when.

use crate::clock::{Clock, Correction, SMALLEST_CORRECTION};
use isotherm_core::quantity::{Moment, Shift, Shifted};

/// How the rows of one log are stamped.
#[derive(Debug, Default)]
pub(super) struct Stamps {
    clock: Option<Clock>,
    of: Stamped,
    /// To be said at the first row of the file.
    correction: Option<Correction>,
}

/// A file's number in this run, and what brings counted moments to those in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) struct Stamped {
    pub(super) file: u64,
    pub(super) shift: Shift,
}

impl Stamps {
    /// As this clock has it; `correction`: it does not go on where the last run ended.
    pub(super) fn by(clock: &Clock, correction: Option<Correction>) -> Stamps {
        // Then the first file of the run is one of its own, whose first row says so.
        let of = Stamped { file: u64::from(correction.is_some()), shift: clock.shift() };
        Stamps { clock: Some(clock.clone()), of, correction }
    }

    /// Those of a row that is written now.
    pub(super) fn look(&mut self, now: Moment) -> Stamped {
        let shift = self.of_the_clock();
        if shift != self.of.shift {
            let (from, to) = (now.shifted(self.of.shift), now.shifted(shift));
            // A clock that is only held to its rate goes on in the same file, until that has come to something.
            if from.since(to).max(to.since(from)) > SMALLEST_CORRECTION {
                self.of = Stamped { file: self.of.file + 1, shift };
                self.correction = Some(Correction { from, to });
            }
        }
        self.of
    }

    /// What brings counted moments to the time of day, whatever file is being written.
    pub(super) fn of_the_clock(&self) -> Shift {
        self.clock.as_ref().map_or(self.of.shift, Clock::shift)
    }

    /// What the first row of a file says of the clock, until that is queued.
    pub(super) fn correction(&self) -> Option<Correction> {
        self.correction
    }

    pub(super) fn said(&mut self) {
        self.correction = None;
    }
}
