//! Wall-clock time: the time of day at the start, even if it is not correct, plus elapsed time including suspension.

#![allow(clippy::disallowed_types, reason = "this is where time comes from")]

use std::fmt;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use super::BootClock;
use super::alarm::{Alarm, AlarmCount};
use isotherm_core::quantity::Moment;

/// Earliest moment at which counting starts: the year 2020. A computer without a clock battery starts in 1970. Moments
/// before the start, for example in a saved state, could then be before 1970, which a [`Moment`] cannot represent.
const EARLIEST: Moment = Moment::from_nanos(1_577_836_800_000_000_000);

type Source = Arc<dyn Fn() -> Moment + Send + Sync>;

/// Source of the time of day. The time of day may jump, because the computer's clock can be set at any moment.
#[derive(Clone, Default)]
pub struct TimeOfDay(Option<Source>);

impl TimeOfDay {
    /// Returns a source that takes the time of day from `source`. Tests simulate a wrong computer clock with it.
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

/// Clock that begins with the time of day at its start, and then counts elapsed time. Later changes of the computer's
/// clock have no effect on it.
#[derive(Debug)]
pub(super) struct Wall {
    /// Moment at which the counter of elapsed time, `boot_clock`, was zero.
    beginning: Moment,
    boot_clock: BootClock,
    pub(super) time_of_day: TimeOfDay,
    alarms: AlarmCount,
}

impl Wall {
    pub(super) fn start(boot_clock: BootClock, time_of_day: TimeOfDay) -> Wall {
        let beginning = time_of_day.now().max(EARLIEST).before(boot_clock.passed());
        Wall { beginning, boot_clock, time_of_day, alarms: AlarmCount::default() }
    }

    /// Returns a kernel timer. Returns `None` if the clock has its own source of elapsed time, as in tests, because the
    /// kernel timer does not follow that source.
    pub(super) fn alarm(&self) -> Option<Alarm> {
        self.boot_clock.is_of_the_system().then(|| Alarm::new(&self.alarms)).flatten()
    }

    pub(super) fn is_busy(&self) -> bool {
        self.alarms.is_used_up()
    }

    pub(super) fn now(&self) -> Moment {
        self.beginning.after(self.boot_clock.passed())
    }
}
