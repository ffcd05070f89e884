//! Elapsed time since the boot of the computer, including the time in which the computer is suspended. The monotonic
//! clock stops during that time, although the temperatures of the machine continue to change.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

type Source = Arc<dyn Fn() -> Duration + Send + Sync>;

/// Counter of elapsed time. Only differences between its values have a meaning.
#[derive(Clone, Default)]
pub struct BootClock(Option<Source>);

impl BootClock {
    /// Returns a counter that takes elapsed time from `source`. Tests simulate a suspended computer with it.
    pub fn by(source: impl Fn() -> Duration + Send + Sync + 'static) -> BootClock {
        BootClock(Some(Arc::new(source)))
    }

    pub(super) fn is_of_the_system(&self) -> bool {
        self.0.is_none()
    }

    /// Returns the time since the computer was started (`CLOCK_BOOTTIME`), suspension included.
    pub fn passed(&self) -> Duration {
        if let Some(source) = &self.0 {
            return source();
        }
        let since_boot = clock_gettime(ClockId::Boottime);
        // A clock that counts from boot is never negative.
        let seconds = u64::try_from(since_boot.tv_sec).unwrap_or_default();
        Duration::new(seconds, u32::try_from(since_boot.tv_nsec).unwrap_or_default())
    }
}

impl fmt::Debug for BootClock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "BootClock(given)" } else { "BootClock(since boot)" })
    }
}
