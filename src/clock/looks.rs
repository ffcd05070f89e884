//! Looks at the clock, and the gaps between them: a computer that was stopped, suspended or starved.

use std::time::Duration;

use isotherm_core::quantity::Moment;

/// No gap that is shorter than this is worth a word, however little was asked for.
const SHORTEST: Duration = Duration::from_secs(1);

/// When somebody looked last, and for how long he meant to be away.
#[derive(Clone, Copy, Debug)]
pub struct Looks {
    /// A gap is longer than this.
    shortest: Duration,
    last: Moment,
    meant: Duration,
}

impl Looks {
    /// Looks that begin now. Whatever is used is no older than `max_age`: a gap that is longer is one, as is any of a
    /// second.
    pub fn begin(now: Moment, max_age: Duration) -> Looks {
        Looks { shortest: SHORTEST.min(max_age), last: now, meant: Duration::ZERO }
    }

    /// The last look.
    pub fn last(&self) -> Moment {
        self.last
    }

    /// What comes next takes as long as this.
    pub fn away_for(&mut self, span: Duration) {
        self.meant = span;
    }

    /// Looks. The moment of the look before, where the time between the two is a gap: more than twice what was meant.
    pub fn look(&mut self, now: Moment) -> Option<Moment> {
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
            let mut looks = Looks::begin(begun, max_age * MILLI);
            looks.away_for(meant * MILLI);
            let now = begun.after(away * MILLI);
            let found = looks.look(now);
            assert_eq!(found, is_gap.then_some(begun), "{meant} {away} {max_age}");
            assert_eq!(looks.look(now), None, "one gap is one");
        }
    }
}
