//! The wall's time: what the computer's clock says, right or wrong, and what has passed since the start, suspension
//! included.

#![allow(clippy::disallowed_types, reason = "this is where time comes from")]

use std::fmt;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use super::Passing;
use super::alarm::{Alarm, Given};
use isotherm_core::quantity::Moment;

/// Counting begins no earlier than 2020, whatever the clock says: a computer without a battery starts in 1970, and what
/// is remembered of a machine reaches back for longer than that.
const EARLIEST: Moment = Moment::from_nanos(1_577_836_800_000_000_000);

type Source = Arc<dyn Fn() -> Moment + Send + Sync>;

/// What says the time of day; it may be set at any moment.
#[derive(Clone, Default)]
pub struct TimeOfDay(Option<Source>);

impl TimeOfDay {
    /// As this says: what a test takes the place of a computer with whose clock is wrong.
    pub fn by(source: impl Fn() -> Moment + Send + Sync + 'static) -> TimeOfDay {
        TimeOfDay(Some(Arc::new(source)))
    }

    pub(super) fn now(&self) -> Moment {
        match &self.0 {
            Some(source) => source(),
            None => {
                let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                Moment::default().after(since_epoch)
            }
        }
    }
}

impl fmt::Debug for TimeOfDay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "TimeOfDay(given)" } else { "TimeOfDay(the computer's)" })
    }
}

/// Counts from the time of day at its start.
#[derive(Debug)]
pub(super) struct Wall {
    /// When what passes was zero.
    beginning: Moment,
    passing: Passing,
    pub(super) time_of_day: TimeOfDay,
    alarms: Given,
}

impl Wall {
    pub(super) fn start(passing: Passing, time_of_day: TimeOfDay) -> Wall {
        let beginning = time_of_day.now().max(EARLIEST).before(passing.passed());
        Wall { beginning, passing, time_of_day, alarms: Given::default() }
    }

    /// None where time is counted by what a test has put in the system's place, which goes at a pace of its own.
    pub(super) fn alarm(&self) -> Option<Alarm> {
        self.passing.is_of_the_system().then(|| Alarm::new(&self.alarms)).flatten()
    }

    pub(super) fn now(&self) -> Moment {
        self.beginning.after(self.passing.passed())
    }
}
