//! One command a second of each axis and verb, whichever way it comes: a program gone wild moves nothing faster than a person.
//!
//! The time is an argument.

use std::collections::HashMap;
use std::time::Duration;

use isotherm_core::quantity::Moment;

const SPAN: Duration = Duration::from_secs(1);
/// More than that are looked through for what is over.
const MANY: usize = 256;

/// What a command is about.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum About {
    /// An axis, by its place.
    Axis(usize),
    /// A device, by its place.
    Device(usize),
    /// An alarm that stands, by its name.
    Alarm(String),
    /// Nothing that there is.
    Nothing,
}

/// Now, by the machine's time and by what passes for people: in a demo they differ. A second of either is enough.
#[derive(Clone, Copy, Debug)]
pub(super) struct Now {
    pub(super) machine: Moment,
    pub(super) passed: Duration,
}

impl Now {
    fn is_later_by(self, span: Duration, before: Now) -> bool {
        self.machine >= before.machine.after(span) || self.passed >= before.passed + span
    }
}

/// When each was asked for last.
#[derive(Debug, Default)]
pub(super) struct Rates(HashMap<(About, &'static str), Now>);

impl Rates {
    /// Whether a command may be begun. It counts for everything that it is about; one that may not counts for nothing.
    pub(super) fn take(&mut self, verb: &'static str, about: &[About], now: Now) -> bool {
        let is_too_soon = |about: &About| {
            let last = self.0.get(&(about.clone(), verb));
            last.is_some_and(|last| !now.is_later_by(SPAN, *last))
        };
        if about.iter().any(is_too_soon) {
            return false;
        }
        self.note(verb, about, now);
        true
    }

    /// It is begun, whenever the one before was.
    pub(super) fn note(&mut self, verb: &'static str, about: &[About], now: Now) {
        if self.0.len() > MANY {
            self.0.retain(|_, last| !now.is_later_by(SPAN, *last));
        }
        self.0.extend(about.iter().map(|about| ((about.clone(), verb), now)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use About::{Alarm, Axis, Nothing};

    fn at(machine_ms: u64, passed_ms: u64) -> Now {
        let machine = Moment::from_nanos(machine_ms * 1_000_000);
        Now { machine, passed: Duration::from_millis(passed_ms) }
    }

    #[test]
    fn each_axis_takes_one_command_of_a_verb_a_second() {
        let mut rates = Rates::default();
        for (milliseconds, verb, about, taken) in [
            (0, "measured", &[Axis(0)][..], true),
            (999, "measured", &[Axis(0)], false),
            (999, "measured", &[Axis(1)], true),
            (999, "zero", &[Axis(0)], true),
            (1000, "measured", &[Axis(0)], true),
            (1500, "measured", &[Axis(0)], false),
            // All of them: one of them was a moment ago, so that it counts for none.
            (1600, "measured", &[Axis(0), Axis(1), Axis(2)], false),
            (1600, "measured", &[Axis(2)], true),
            (2600, "measured", &[Axis(0), Axis(1), Axis(2)], true),
            (3599, "measured", &[Axis(1)], false),
            (3600, "measured", &[Nothing], true),
            (3600, "measured", &[Nothing], false),
            (3600, "acknowledge", &[Alarm("signal bed".to_owned())], true),
            (3600, "acknowledge", &[Alarm("signal oil".to_owned())], true),
            (3700, "acknowledge", &[Alarm("signal oil".to_owned())], false),
        ] {
            let found = rates.take(verb, about, at(milliseconds, milliseconds));
            assert_eq!(found, taken, "{milliseconds} {verb} {about:?}");
        }
    }

    #[test]
    fn a_second_of_either_clock_is_enough() {
        for (machine, passed, taken) in [(999, 999, false), (1000, 2, true), (0, 1000, true)] {
            let mut rates = Rates::default();
            assert!(rates.take("arm", &[Axis(0)], at(0, 0)));
            assert_eq!(rates.take("arm", &[Axis(0)], at(machine, passed)), taken);
        }
    }

    #[test]
    fn memory_is_bounded_whatever_is_asked_for() {
        let mut rates = Rates::default();
        for number in 0..100_000_u64 {
            rates.take("acknowledge", &[Alarm(number.to_string())], at(number * 10, number * 10));
            assert!(rates.0.len() <= MANY + 1);
        }
    }
}
