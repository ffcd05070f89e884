//! Detection of gaps between clock samples, in which the computer was stopped, suspended or overloaded.

use std::time::Duration;

use isotherm_core::quantity::Moment;

/// Longest gap between two clock samples that is not reported. If `max_age`, the greatest permitted age of a reading,
/// is shorter, `max_age` is used instead.
const SHORTEST: Duration = Duration::from_secs(1);

/// Detector of gaps between clock samples. It stores the last sample, and the planned time until the next one.
#[derive(Clone, Copy, Debug)]
pub struct StallDetector {
    /// Longest gap that is not reported: the smaller of `max_age` and one second.
    shortest: Duration,
    last: Moment,
    meant: Duration,
}

impl StallDetector {
    /// Returns a detector with a first sample at `now`. `max_age` is the greatest permitted age of a reading. A gap is
    /// reported only if it is longer than the smaller of `max_age` and one second.
    pub fn begin(now: Moment, max_age: Duration) -> StallDetector {
        StallDetector { shortest: SHORTEST.min(max_age), last: now, meant: Duration::ZERO }
    }

    /// Returns the time of the last sample.
    pub fn last(&self) -> Moment {
        self.last
    }

    /// Sets the planned time until the next sample. A gap of up to twice this time is not reported.
    pub fn away_for(&mut self, span: Duration) {
        self.meant = span;
    }

    /// Records a sample. Returns the time of the previous sample, if the gap is longer than twice the planned time and
    /// than the shortest gap.
    pub fn sample(&mut self, now: Moment) -> Option<Moment> {
        let (last, meant) = (self.last, std::mem::take(&mut self.meant));
        self.last = now;
        let away = now.since(last);
        (away > self.shortest && away > meant.saturating_mul(2)).then_some(last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLI: Duration = Duration::from_millis(1);

    #[test]
    fn a_gap_is_longer_than_twice_what_was_meant_and_than_a_second_or_the_shortest_age() {
        for (meant, away, max_age, is_gap) in [
            (500, 900, 5000, false),
            (500, 1001, 5000, true),
            (500, 1000, 5000, false),
            (600, 1100, 5000, false),
            (2000, 4000, 5000, false),
            (2000, 4001, 5000, true),
            (0, 301, 300, true),
            (100, 301, 300, true),
            (200, 301, 300, false),
            (0, 300, 300, false),
        ] {
            let begun = Moment::default().after(1000 * MILLI);
            let mut stall_detector = StallDetector::begin(begun, max_age * MILLI);
            stall_detector.away_for(meant * MILLI);
            let now = begun.after(away * MILLI);
            let found = stall_detector.sample(now);
            assert_eq!(found, is_gap.then_some(begun), "{meant} {away} {max_age}");
            assert_eq!(stall_detector.sample(now), None, "one gap is one");
        }
    }
}
