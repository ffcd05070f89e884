//! Numbers of an output set (outputs that are written together) whose control acknowledges each set that it takes.
//!
//! Some controls take a set only if its number follows the number of the last set that they took. If an answer is lost,
//! the gateway does not know whether the control took the set. The number therefore advances only when the control has
//! acknowledged the set. Until then, the gateway tries the possible next numbers in turn, highest first, always with
//! the same values:
//!
//! | result of an attempt | meaning | next attempt |
//! |---|---|---|
//! | acknowledged | the control has this number | the number after it |
//! | unknown: the set, the strobe signal or an answer was lost | none | the same number |
//! | not acknowledged, although the control answers | the control has another number, or its acknowledge signal is broken | the next number in turn |
//!
//! If every number was refused, one more number becomes possible: the control may have taken the highest without
//! acknowledging it. After a killed run, a lower number becomes possible too: the control may have refused the numbers
//! of that run.

use serde::{Deserialize, Serialize};

/// A number that is at most this far from the last acknowledged number may come from an earlier run. A number farther
/// away can only come from the control itself.
const REACH: u16 = 200;
/// Count of possible set numbers: 1 to 65535. Zero is reserved for a control that has just been started.
const ALL: u16 = u16::MAX;

/// Possible numbers of the next output set. The control accepts one of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Numbers {
    /// Last number of an output set that the control has acknowledged.
    taken: u16,
    /// Count of possible numbers after `taken`. An hour of refusals increases this count to 69, a week to about 900.
    count: u16,
    /// Count of possible numbers that were refused in the present round of attempts. The attempts begin with the
    /// highest number.
    refused: u16,
    values: Values,
    floor: Floor,
}

/// Whether the number that the control took last may be lower than `Numbers::taken`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Floor {
    /// The number that the control took last is not lower than `Numbers::taken`.
    Known,
    /// The number that the control took last may be lower than `Numbers::taken`: an earlier run may have sent numbers
    /// that the control refused.
    Open,
}

/// Whether all attempts since the control last acknowledged a set had the same values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Values {
    /// All attempts since the control last acknowledged a set sent the same values.
    Same,
    /// The attempts since the control last acknowledged a set may have sent different values. An acknowledge signal
    /// then does not show which values the control has taken.
    Changed,
}

/// Result of an attempt to send an output set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Attempt {
    /// The control has acknowledged the output set.
    Acknowledged,
    /// The control answered each request, but has not acknowledged the output set in time.
    Refused,
    /// The result is unknown, because a request or an answer was lost.
    Unknown,
}

impl Numbers {
    /// Creates the numbers for a control that has taken `number`, which its register holds.
    pub(super) fn after(number: u16) -> Numbers {
        Numbers { taken: number, count: 1, refused: 0, values: Values::Same, floor: Floor::Known }
    }

    /// Creates the numbers for a control that has perhaps not taken `number`, which an earlier run wrote to its
    /// register.
    pub(super) fn perhaps(number: u16) -> Numbers {
        let (values, floor) = (Values::Changed, Floor::Open);
        Numbers { taken: number.saturating_sub(1), count: 1, refused: 0, values, floor }
    }

    /// Returns the number to send with the next attempt.
    pub(super) fn next(&self) -> u16 {
        later(self.taken, self.count - self.refused)
    }

    /// Returns whether this number is the last acknowledged number, or a number that was tried since.
    pub(super) fn contains(&self, number: u16) -> bool {
        distance(self.taken, number).is_some_and(|place| place <= self.count)
    }

    /// Returns whether different values may have been sent with these numbers.
    pub(super) fn is_unsure(&self) -> bool {
        self.values == Values::Changed
    }

    /// Returns whether `number` is near enough to the last acknowledged number to come from an earlier run.
    pub(super) fn reaches(&self, number: u16) -> bool {
        distance(self.taken, number).is_some_and(|place| place < REACH)
    }

    /// Extends the possible numbers up to the number after `number`. An earlier run has sent `number`, perhaps with
    /// other values.
    pub(super) fn with(self, number: u16) -> Numbers {
        let place = distance(self.taken, number).filter(|place| *place < REACH).unwrap_or_default();
        Numbers { count: self.count.max(place + 1), refused: 0, values: Values::Changed, ..self }
    }

    /// Records that the next attempt sends other values than the attempts before.
    pub(super) fn change_values(&mut self) {
        self.values = Values::Changed;
    }

    /// Records the result of an attempt. Returns true only if the control has certainly taken the values that were
    /// sent.
    pub(super) fn result(&mut self, attempt: Attempt) -> bool {
        match attempt {
            Attempt::Acknowledged => {
                let is_taken = self.values == Values::Same;
                *self = Numbers::after(self.next());
                is_taken
            }
            Attempt::Refused => {
                self.refused += 1;
                if self.refused == self.count {
                    // The range grows at both ends until it contains every number.
                    if self.floor == Floor::Open && self.count < ALL - 1 {
                        (self.taken, self.count) = (earlier(self.taken), self.count + 1);
                    }
                    (self.count, self.refused) = (self.count.saturating_add(1), 0);
                }
                false
            }
            Attempt::Unknown => false,
        }
    }
}

/// Returns the number `count` places after `number`. The numbers continue with 1 after 65535.
fn later(number: u16, count: u16) -> u16 {
    match (u32::from(number), u32::from(count)) {
        (_, 0) => number,
        (number, count) => u16::try_from((number + count - 1) % u32::from(ALL) + 1).unwrap_or(ALL),
    }
}

/// Returns the number before `number`. The number before 1 is 65535.
fn earlier(number: u16) -> u16 {
    if number <= 1 { ALL } else { number - 1 }
}

/// Returns the number of places from `from` to `number`. `None` for zero, which never follows another number.
fn distance(from: u16, number: u16) -> Option<u16> {
    match (from, number) {
        (from, number) if from == number => Some(0),
        (_, 0) => None,
        (0, number) => Some(number),
        (from, number) if number > from => Some(number - from),
        (from, number) => Some(ALL - from + number),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rule by which a control takes an output set.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Kind {
        /// The control takes each output set with a number other than the last, and acknowledges every set.
        Another,
        /// The control takes only the set with the next number. It acknowledges also a repetition of the last one.
        NextAndLast,
        /// The control takes and acknowledges only the set with the next number.
        NextOnly,
    }

    #[derive(Clone, Copy, Debug)]
    struct Control {
        kind: Kind,
        number: u16,
        values: u32,
    }

    impl Control {
        /// Raises the strobe signal. Returns whether the control acknowledges the output set.
        fn sees(&mut self, number: u16, values: u32) -> bool {
            let takes = match self.kind {
                Kind::Another => number != self.number,
                Kind::NextAndLast | Kind::NextOnly => number == later(self.number, 1),
            };
            if takes {
                (self.number, self.values) = (number, values);
            }
            takes || (self.kind != Kind::NextOnly && number == self.number)
        }
    }

    /// Outcome of an attempt on the line.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Fate {
        Good,
        /// The output set or the strobe signal does not arrive.
        Lost,
        /// The answer of the control does not arrive.
        AnswerLost,
        /// The wire of the acknowledge signal is broken.
        NoAcknowledge,
    }

    const FATES: [Fate; 4] = [Fate::Good, Fate::Lost, Fate::AnswerLost, Fate::NoAcknowledge];

    /// Gateway and control.
    #[derive(Clone, Copy, Debug)]
    struct World {
        numbers: Numbers,
        control: Control,
        values: u32,
    }

    impl World {
        /// Makes an attempt. Returns whether the gateway knows that its values are taken.
        fn attempt(&mut self, fate: Fate) -> bool {
            let number = self.numbers.next();
            let acknowledges = fate != Fate::Lost && self.control.sees(number, self.values);
            let attempt = match fate {
                Fate::Lost | Fate::AnswerLost => Attempt::Unknown,
                Fate::Good if acknowledges => Attempt::Acknowledged,
                Fate::Good | Fate::NoAcknowledge => Attempt::Refused,
            };
            let is_taken = self.numbers.result(attempt);
            assert!(!is_taken || self.control.values == self.values, "{self:?} after {fate:?}");
            is_taken
        }

        /// Returns the number of faultless attempts until the values are known to be taken.
        fn recovers(mut self) -> u32 {
            (1..100).find(|_| self.attempt(Fate::Good)).unwrap_or_else(|| panic!("{self:?} is stuck"))
        }
    }

    fn each_way(world: World, left: u32, visit: &mut impl FnMut(World)) {
        visit(world);
        if left == 0 {
            return;
        }
        for fate in FATES {
            for changes in [false, true] {
                let mut next = world;
                if changes {
                    next.values += 1;
                    next.numbers.change_values();
                }
                if next.attempt(fate) {
                    next.values += 1;
                }
                each_way(next, left - 1, visit);
            }
        }
    }

    fn worlds() -> impl Iterator<Item = World> {
        [Kind::Another, Kind::NextAndLast, Kind::NextOnly].into_iter().flat_map(|kind| {
            let in_order = World {
                numbers: Numbers::after(6),
                control: Control { kind, number: 6, values: 0 },
                values: 1,
            };
            // A killed run has sent number 6, with these values or others.
            let killed = [5, 6].map(|number| World {
                numbers: Numbers::perhaps(6),
                control: Control { kind, number, values: 0 },
                values: 1,
            });
            killed.into_iter().chain([in_order])
        })
    }

    #[test]
    fn whatever_was_lost_the_control_takes_a_set_again_and_the_gateway_knows_what_it_took() {
        let (mut count, mut longest) = (0, 0);
        for world in worlds() {
            each_way(world, 6, &mut |world| {
                count += 1;
                longest = longest.max(world.recovers());
            });
        }
        println!("{count} ways, recovered after {longest} attempts at most");
        assert!(longest <= 7, "{longest}");
    }

    #[test]
    fn after_losses_on_the_network_a_control_takes_the_second_attempt() {
        for mut world in worlds().filter(|world| world.numbers == Numbers::after(6)) {
            for fate in [Fate::Lost, Fate::AnswerLost].into_iter().cycle().take(70) {
                assert!(!world.attempt(fate));
            }
            let attempts = world.recovers();
            assert!(attempts <= 2, "{world:?}: {attempts}");
        }
    }

    /// Shows why the number must not advance with each attempt: the control then never accepts a set again.
    #[test]
    fn a_number_that_advances_with_each_attempt_leaves_a_control_behind_for_good() {
        let mut control = Control { kind: Kind::NextOnly, number: 6, values: 0 };
        let sent = 6 + 65;
        assert!((sent..sent + 1000).all(|number| !control.sees(number + 1, 1)));
    }

    /// Simulates one attempt every 1.5 s.
    #[test]
    fn an_acknowledge_that_is_missing_for_an_hour_brings_69_numbers() {
        let mut numbers = Numbers::after(6);
        for _ in 0..2400 {
            let _ = numbers.result(Attempt::Refused);
        }
        assert_eq!(numbers.count, 69);
    }

    /// Simulates days on which the control refuses every set, and days without its acknowledge signal.
    #[test]
    fn after_days_of_refusals_the_number_of_the_control_is_still_in_turn() {
        for (mut world, kind) in worlds().map(|world| (world, world.control.kind)) {
            let is_wire = world.control.number == 6;
            for _ in 0..100_000 {
                let number = world.numbers.next();
                if is_wire {
                    world.control.sees(number, world.values);
                }
                assert!(!world.numbers.result(Attempt::Refused));
            }
            // Two rounds, the second one with one number more.
            let most = 2 * u32::from(world.numbers.count) + 2;
            let attempts = (1..=most).find(|_| world.attempt(Fate::Good));
            assert!(attempts.is_some(), "{kind:?}, {is_wire}: {world:?} is stuck");
        }
    }

    #[test]
    fn zero_is_no_number_of_a_set() {
        assert_eq!((later(65535, 1), later(0, 1), later(65534, 3)), (1, 1, 2));
        assert_eq!((earlier(1), earlier(0), earlier(65535)), (65535, 65535, 65534));
        assert_eq!(Numbers::perhaps(0).next(), 1);
        for (from, count) in [(0, 0), (0, 3), (1, 65534), (6, 200), (65535, 1), (65000, 1000)] {
            assert_eq!(distance(from, later(from, count)), Some(count), "{from} {count}");
        }
        assert_eq!(distance(7, 0), None);
    }

    #[test]
    fn a_control_that_waits_for_the_last_number_before_one_is_reached() {
        let control = Control { kind: Kind::NextOnly, number: 65534, values: 0 };
        World { numbers: Numbers::perhaps(1), control, values: 1 }.recovers();
    }
}
