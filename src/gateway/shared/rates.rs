//! Rate limit of commands: one per second for each axis and verb, over all channels. Therefore a faulty program
//! cannot move the machine faster than an operator could.
//!
//! The present time is an argument of the functions.

use std::collections::HashMap;
use std::time::Duration;

use isotherm_core::quantity::Moment;

const SPAN: Duration = Duration::from_secs(1);
/// Number of entries in the table [`Rates`] above which a new command removes the expired entries.
const MANY: usize = 256;

/// Subject of a command: the axis, device or alarm for which the rate of commands is limited.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(in crate::gateway) enum RateSubject {
    /// Axis, by its index.
    Axis(usize),
    /// Device, by its index.
    Device(usize),
    /// Active alarm, by its name.
    Alarm(String),
    /// Subject that does not exist, for example an unknown axis. All commands for such subjects share one limit.
    Nothing,
}

/// Present time by two clocks: `machine` is the time of the machine, and `passed` is real time. In a demo, the
/// simulated machine time differs from real time. A command is allowed if one second has passed by one of the clocks.
#[derive(Clone, Copy, Debug)]
pub(in crate::gateway) struct PresentTime {
    pub(in crate::gateway) machine: Moment,
    pub(in crate::gateway) passed: Duration,
}

impl PresentTime {
    fn is_later_by(self, span: Duration, before: PresentTime) -> bool {
        self.machine >= before.machine.after(span) || self.passed >= before.passed + span
    }
}

/// Time of the last command for each subject and verb.
#[derive(Debug, Default)]
pub(in crate::gateway) struct Rates(HashMap<(RateSubject, &'static str), PresentTime>);

impl Rates {
    /// Returns whether a command is allowed. If so, records the time for all subjects of the command. If not, records
    /// nothing.
    pub(in crate::gateway) fn take(
        &mut self,
        verb: &'static str,
        about: &[RateSubject],
        now: PresentTime,
    ) -> bool {
        let is_too_soon = |about: &RateSubject| {
            let last = self.0.get(&(about.clone(), verb));
            last.is_some_and(|last| !now.is_later_by(SPAN, *last))
        };
        if about.iter().any(is_too_soon) {
            return false;
        }
        self.note(verb, about, now);
        true
    }

    /// Records the time of a command without a check of the rate limit.
    pub(in crate::gateway) fn note(&mut self, verb: &'static str, about: &[RateSubject], now: PresentTime) {
        if self.0.len() > MANY {
            self.0.retain(|_, last| !now.is_later_by(SPAN, *last));
        }
        self.0.extend(about.iter().map(|about| ((about.clone(), verb), now)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use RateSubject::{Alarm, Axis, Nothing};

    fn at(machine_ms: u64, passed_ms: u64) -> PresentTime {
        let machine = Moment::from_nanos(machine_ms * 1_000_000);
        PresentTime { machine, passed: Duration::from_millis(passed_ms) }
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
            // The command is about all three axes. One of them had a command recently, so the command is recorded for
            // no axis.
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
