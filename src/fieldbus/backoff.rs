//! Back-off between failed attempts. The pause doubles with each failure up to a maximum length, and has random jitter.
//! A success ends the back-off.

use std::time::Duration;

use isotherm_core::quantity::Moment;

/// Longest pause between two attempts.
const LONGEST: Duration = Duration::from_secs(30);

/// Pause after failed attempts. Until the pause is over, requests fail at once without being sent.
#[derive(Clone, Debug)]
pub struct Backoff {
    shortest: Duration,
    failures: u32,
    not_before: Option<Moment>,
    jitter: u64,
}

impl Backoff {
    /// Returns a back-off that begins with a pause of `shortest`. The jitter depends only on `seed`, so that a
    /// simulation can be repeated exactly.
    pub fn new(shortest: Duration, seed: u64) -> Backoff {
        Backoff { shortest: shortest.min(LONGEST), failures: 0, not_before: None, jitter: seed }
    }

    /// Returns whether an attempt is allowed at `now`: the pause after the last failure is over, or the last attempt
    /// succeeded.
    pub fn allows(&self, now: Moment) -> bool {
        self.not_before.is_none_or(|moment| now >= moment)
    }

    /// Returns the end of the pause after the last failure; `None` after a success.
    pub fn not_before(&self) -> Option<Moment> {
        self.not_before
    }

    /// Records a failed attempt at `now`. The pause after the first failure is the shortest one, and doubles
    /// with each further failure, up to 30 seconds. A random part of up to a quarter is subtracted from each
    /// pause.
    pub fn fail(&mut self, now: Moment) {
        let doubled = self.shortest.saturating_mul(1 << self.failures.min(16)).min(LONGEST);
        self.failures = self.failures.saturating_add(1);
        self.jitter =
            self.jitter.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let quarter = doubled / 4;
        let less =
            quarter.mul_f64(f64::from(u32::try_from(self.jitter >> 32).unwrap_or(0)) / f64::from(u32::MAX));
        self.not_before = Some(now.after(doubled.saturating_sub(less)));
    }

    /// Extends the pause: the next attempt is not allowed before `moment`.
    pub fn not_before_either(&mut self, moment: Moment) {
        self.not_before = self.not_before.max(Some(moment));
    }

    /// Records a successful attempt, which ends the back-off.
    pub fn succeed(&mut self) {
        self.failures = 0;
        self.not_before = None;
    }

    /// Returns the number of failed attempts since the last success.
    pub fn failures(&self) -> u32 {
        self.failures
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_double_up_to_thirty_seconds_and_begin_anew_after_success() {
        let mut backoff = Backoff::new(Duration::from_secs(1), 7);
        let mut now = Moment::from_nanos(0);
        let mut pauses = Vec::new();
        for _ in 0..8 {
            backoff.fail(now);
            let next = backoff.not_before().unwrap();
            assert!(!backoff.allows(now) && backoff.allows(next));
            pauses.push(next.since(now).as_secs_f64());
            now = next;
        }
        for (pause, full) in pauses.iter().zip([1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]) {
            assert!(*pause <= full && *pause >= 0.75 * full, "{pauses:?}");
        }
        backoff.succeed();
        assert!(backoff.allows(now));
        backoff.fail(now);
        assert!(backoff.not_before().unwrap().since(now) <= Duration::from_secs(1));
    }
}
