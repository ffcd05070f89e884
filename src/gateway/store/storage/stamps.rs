//! Choice of the log file for a row, and conversion of the times in the row to time stamps.
//!
//! All rows of a file use the same shift, which is the difference between time stamps and monotonic time. Therefore
//! differences between time stamps are exact, and a replay gives exactly the same values. If the computer's clock was
//! set, a new file begins, whose first row contains the old and the new time.

use crate::clock::{Clock, Correction, SMALLEST_CORRECTION};
use isotherm_core::quantity::{Moment, Shift, Shifted};

/// Conversion of monotonic time to time stamps for the rows of one log.
#[derive(Debug, Default)]
pub(super) struct Stamps {
    clock: Option<Clock>,
    of: Stamped,
    /// Correction of the clock that the first row of the file must contain; `None` after this row was queued.
    correction: Option<Correction>,
}

/// Identity of a log file: its number in this run, and the shift from monotonic time to the time stamps in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) struct Stamped {
    pub(super) file: u64,
    pub(super) shift: Shift,
}

impl Stamps {
    /// Creates the time stamps by a clock. `correction` is `None` if the clock has continued correctly since the last
    /// run.
    pub(super) fn by(clock: &Clock, correction: Option<Correction>) -> Stamps {
        // The first file of the run is then a new one, whose first row contains the correction.
        let of = Stamped { file: u64::from(correction.is_some()), shift: clock.shift() };
        Stamps { clock: Some(clock.clone()), of, correction }
    }

    /// Returns the log file for a row that is written now, and the shift of its time stamps. Begins a new file if the
    /// computer's clock was set.
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

    /// Returns the shift from monotonic time to the time of the computer's clock now. The shift of the present log
    /// file may differ.
    pub(super) fn of_the_clock(&self) -> Shift {
        self.clock.as_ref().map_or(self.of.shift, Clock::shift)
    }

    /// Returns the correction of the clock that the first row of a file must contain; `None` after this row was
    /// queued.
    pub(super) fn correction(&self) -> Option<Correction> {
        self.correction
    }

    pub(super) fn said(&mut self) {
        self.correction = None;
    }
}
