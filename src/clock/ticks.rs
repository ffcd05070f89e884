//! Periodic ticks at moments that all tasks share. Tasks that check something regularly therefore wake together, and an
//! idle computer wakes once for all of them.

use std::time::Duration;

use super::BootClock;
use super::alarm::{Alarm, AlarmCount};

/// Ticks at the multiples of a period, counted from the start of the computer. Missed ticks are skipped.
#[derive(Debug)]
pub struct Ticks {
    period: Duration,
    /// Kernel timer; `None` if the kernel provides none. Without it, a timer of tokio is used.
    alarm: Option<Alarm>,
}

impl Ticks {
    /// Returns ticks with this period, which must not be zero. Must be called inside a tokio runtime.
    pub fn every(period: Duration) -> Ticks {
        Ticks { period, alarm: Alarm::new(&AlarmCount::default()) }
    }

    /// Waits for the next tick. The call can be cancelled; the next call waits for the next tick again.
    pub async fn next(&mut self) {
        let clock = BootClock::default();
        let now = clock.passed();
        let left = left_of(now, self.period);
        if let Some(alarm) = &mut self.alarm {
            alarm.after(left).await;
        }
        // An alarm that cannot be set returns at once.
        let left = left.saturating_sub(clock.passed().saturating_sub(now));
        if !left.is_zero() {
            tokio::time::sleep(left).await;
        }
    }
}

/// Returns the time from `passed` to the next multiple of `period`. It is never zero.
fn left_of(passed: Duration, period: Duration) -> Duration {
    let since = u64::try_from(passed.as_nanos() % period.as_nanos()).unwrap_or_default();
    period.saturating_sub(Duration::from_nanos(since))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_tick_is_the_next_multiple_of_the_period() {
        let milli = Duration::from_millis;
        for (passed, period, left) in
            [(0, 1000, 1000), (1, 1000, 999), (999, 1000, 1), (1000, 1000, 1000), (61_300, 2000, 700)]
        {
            assert_eq!(left_of(milli(passed), milli(period)), milli(left), "{passed} {period}");
        }
    }

    #[tokio::test]
    async fn a_wait_ends_at_a_tick_also_after_a_cancelled_one() {
        let period = Duration::from_millis(20);
        let number = || BootClock::default().passed().as_nanos() / period.as_nanos();
        // A process without a free file descriptor has no kernel timer.
        for mut ticks in [Ticks::every(period), Ticks { period, alarm: None }] {
            for _ in 0..3 {
                let before = number();
                let cancelled = tokio::time::timeout(Duration::ZERO, ticks.next()).await;
                assert!(cancelled.is_err() || number() > before);
                let before = number();
                ticks.next().await;
                assert!(number() > before);
            }
        }
    }
}
