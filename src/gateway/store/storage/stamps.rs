//! File of a row, and the stamps of its moments.
//!
//! All rows of a file are stamped with one shift. Therefore the spans in it are the counted ones, and it can be
//! replayed bit for bit. If the computer's clock was set, a new file begins, whose first row contains the old and the
//! new time.

use crate::clock::{Clock, Correction, SMALLEST_CORRECTION};
use isotherm_core::quantity::{Moment, Shift, Shifted};

/// Stamps of the rows of one log.
#[derive(Debug, Default)]
pub(super) struct Stamps {
    clock: Option<Clock>,
    of: Stamped,
    /// Correction for the first row of the file.
    correction: Option<Correction>,
}

/// Number of a file in this run, and the shift from counted moments to its stamps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) struct Stamped {
    pub(super) file: u64,
    pub(super) shift: Shift,
}

impl Stamps {
    /// Creates the stamps of a clock. `correction`: its time does not continue from the end of the last run.
    pub(super) fn by(clock: &Clock, correction: Option<Correction>) -> Stamps {
        // The first file of the run is then a new one, whose first row contains the correction.
        let of = Stamped { file: u64::from(correction.is_some()), shift: clock.shift() };
        Stamps { clock: Some(clock.clone()), of, correction }
    }

    /// File and shift of a row that is written now.
    pub(super) fn check(&mut self, now: Moment) -> Stamped {
        let shift = self.of_the_clock();
        if shift != self.of.shift {
            let (from, to) = (now.shifted(self.of.shift), now.shifted(shift));
            // A clock that is only slewed continues in the same file, until the difference is large enough.
            if from.since(to).max(to.since(from)) > SMALLEST_CORRECTION {
                self.of = Stamped { file: self.of.file + 1, shift };
                self.correction = Some(Correction { from, to });
            }
        }
        self.of
    }

    /// Shift from counted moments to the time of day, whatever file is being written.
    pub(super) fn of_the_clock(&self) -> Shift {
        self.clock.as_ref().map_or(self.of.shift, Clock::shift)
    }

    /// Correction for the first row of a file, until that row is queued.
    pub(super) fn correction(&self) -> Option<Correction> {
        self.correction
    }

    pub(super) fn said(&mut self) {
        self.correction = None;
    }
}
