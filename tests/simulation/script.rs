//! Events of a machine, drawn by seed. A storm has on average one fault per minute for 24 minutes; then a calm of six
//! minutes has none.

use std::time::Duration;

use rand::RngExt;
use rand_pcg::Pcg32;

use crate::link::{Fate, LATE, Weather, World};
use crate::machine::{CNC, LINES, PLC, SCALE, SENSORS};
use crate::scene::Beyond;
use crate::second_master::{self, Habit};

const SECOND: Duration = Duration::from_secs(1);
const MILLI: Duration = Duration::from_millis(1);
/// Duration of a storm with its calm.
pub(crate) const ROUND: Duration = Duration::from_secs(1800);
const STORM: Duration = Duration::from_secs(1440);
/// Time in the round at which the state is checked. The calm before it is long enough to recover from the last fault.
pub(crate) const LOOKED_AT: Duration = Duration::from_secs(1795);

/// One event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Happening {
    Weather(usize, Weather, Duration),
    /// Fate of the next write on a line.
    Next(usize, Fate),
    OpenWire(usize, Duration),
    /// Another module replaces the thermocouple module.
    OtherModule(Duration),
    /// The module is set at its panel to this number of counts per °C.
    Panel(u16, Duration),
    /// Another master sends requests to the thermocouple module.
    SecondMaster(Habit, Duration),
    Restart(usize, bool),
    Deaf(Duration),
    /// The operator adds these counts to the register with an operator offset.
    Edit(i64),
    /// Another client writes to a register that only the gateway uses.
    Foreign(i64),
    FullDisk(Duration),
    /// The computer is suspended.
    Sleep(Duration),
    Kill,
    Stop,
    Calm,
    Look,
}

/// Next event after this time and the last event, with its time.
pub(crate) fn next(
    random: &mut Pcg32,
    beyond: Beyond,
    last: Happening,
    now: Duration,
) -> (Duration, Happening) {
    let round = ROUND * u32::try_from(now.as_secs() / ROUND.as_secs()).unwrap_or_default();
    let gap = exponential(random, 60.0);
    let at = now + gap;
    if now < round + STORM {
        if at < round + STORM {
            return (at, draw(random, beyond, round + STORM - at));
        }
        return (round + STORM, Happening::Calm);
    }
    if now < round + LOOKED_AT {
        // If a computer slept to the end of the storm, its last fault was then.
        let is_calm = last == Happening::Calm;
        return if is_calm { (round + LOOKED_AT, Happening::Look) } else { (now, Happening::Calm) };
    }
    (round + ROUND + gap, draw(random, beyond, STORM))
}

/// Remaining time of the storm. Faults of a storm must end before its calm.
pub(crate) fn left_of_storm(now: Duration) -> Duration {
    let round = ROUND * u32::try_from(now.as_secs() / ROUND.as_secs()).unwrap_or_default();
    (round + STORM).saturating_sub(now)
}

fn exponential(random: &mut Pcg32, mean: f64) -> Duration {
    let share: f64 = random.random_range(1e-9..1.0);
    Duration::from_secs_f64(-mean * share.ln()).max(MILLI)
}

/// Draws an event; `left` is the remaining time of the storm.
fn draw(random: &mut Pcg32, beyond: Beyond, left: Duration) -> Happening {
    if let Some(happening) = draw_beyond(random, beyond, left) {
        return happening;
    }
    let line = random.random_range(0..LINES.len());
    let control = [CNC, PLC][random.random_range(0..2)];
    let seconds = |random: &mut Pcg32, most: u32| SECOND * random.random_range(1..=most);
    match random.random_range(0..100u32) {
        0..=44 => {
            let weather = match random.random_range(0..9) {
                0 => Weather::Silent,
                1 => Weather::Lossy(random.random_range(3..60)),
                2 => Weather::Jammed,
                3 => Weather::Slow(MILLI * random.random_range(10..900)),
                4 => Weather::Denying(
                    random.random_range(10..100),
                    [4, 5, 6, 11, 200][random.random_range(0..5)],
                ),
                5 => Weather::Garbling(random.random_range(10..80)),
                6 => Weather::Refusing(random.random_range(1..4)),
                7 => Weather::Closing(random.random_range(10..80)),
                _ => Weather::Unreachable,
            };
            let most = if weather == Weather::Jammed { 29 } else { 90 };
            Happening::Weather(line, weather, seconds(random, most).min(left))
        }
        45..=64 => {
            let fate = match random.random_range(0..12) {
                0..=3 => Fate::Held(LATE * random.random_range(1..=100u32) / 100),
                4 => Fate::AnswerLost,
                5 => Fate::DoneAndDenied([4, 5, 6, 11, 200][random.random_range(0..5)]),
                6 => Fate::CutAfter,
                7 => Fate::Asleep(MILLI * random.random_range(100..90_000)),
                8 => Fate::KilledBefore,
                9 => Fate::KilledAfter,
                10 => Fate::Garbled,
                _ => Fate::Lost,
            };
            Happening::Next(control, fate)
        }
        65 => Happening::OtherModule(seconds(random, 120).min(left)),
        66..=69 => Happening::OpenWire(random.random_range(0..2), seconds(random, 60).min(left)),
        70..=74 => Happening::Restart(control, random.random_range(0..2) == 0),
        75..=76 => Happening::Deaf(seconds(random, 20).min(left)),
        77..=81 => {
            Happening::Edit(random.random_range(11..60) * if random.random_range(0..2) == 0 { 1 } else { -1 })
        }
        82..=83 => Happening::Foreign(random.random_range(-70..70)),
        84..=87 => Happening::FullDisk(seconds(random, 90).min(left)),
        88..=92 => {
            let span = MILLI * [300, 2_000, 5_000, 31_000, 60_000, 600_000][random.random_range(0..6)];
            match random.random_range(0..4) {
                0 => Happening::Next(SENSORS, Fate::Asleep(span)),
                1 => Happening::Next(SCALE, Fate::Asleep(span)),
                _ => Happening::Sleep(span),
            }
        }
        93..=95 => Happening::Kill,
        96..=97 => Happening::Stop,
        _ => Happening::Weather(
            [SENSORS, SCALE][random.random_range(0..2)],
            Weather::Slow(MILLI * 190),
            seconds(random, 90).min(left),
        ),
    }
}

/// Draws an additional event; `None` without one. Machines without additional events draw no random number here, so
/// that their days do not change.
fn draw_beyond(random: &mut Pcg32, beyond: Beyond, left: Duration) -> Option<Happening> {
    if beyond == Beyond::Nothing || random.random_range(0..100) >= beyond.share() {
        return None;
    }
    match beyond {
        Beyond::Nothing => None,
        Beyond::Panel => {
            // Whole degrees, tenths, and two scales that are harder to detect.
            let counts = [1, 10, 80, 120][random.random_range(0..4)];
            // The settings are restored before the end of the storm.
            Some(Happening::Panel(counts, (SECOND * random.random_range(10..240)).min(left)))
        }
        Beyond::Shifts => {
            let code = [None, Some(10), Some(11)][random.random_range(0..3)];
            let weather = Weather::Shifting(random.random_range(3..50), code);
            Some(Happening::Weather(SENSORS, weather, (SECOND * random.random_range(1..=90)).min(left)))
        }
        Beyond::SecondMaster => {
            let (habit, span) = second_master::draw(random);
            Some(Happening::SecondMaster(habit, span.min(left)))
        }
    }
}

/// Executes an event of a line, a device or the computer.
pub(crate) fn befalls(world: &mut World, what: Happening, now: Duration) {
    match what {
        Happening::Weather(line, weather, span) => world.turns(line, weather, now, span),
        Happening::Next(line, fate) => world.lines[line].next = Some(fate),
        Happening::OpenWire(channel, span) => {
            world.machine.open_until[channel] = now + span;
            world.did(now, "a thermocouple breaks for s", span.as_secs());
        }
        Happening::Restart(line, forgets) => {
            world.machine.restarts(line, forgets, now);
            world.cut(line);
            if world.servers.are_there && line == CNC {
                world.servers.starts += 1;
                world.cut(SENSORS);
            }
            world.turns(line, Weather::Unreachable, now, 3 * SECOND);
            world.did(now, "a control restarts, and forgets everything: 1", u64::from(forgets));
        }
        Happening::OtherModule(span) => {
            // The removal of the module is part of the storm.
            let span = span.min(left_of_storm(now).saturating_sub(4 * SECOND));
            world.machine.other_module = (now, now + span);
            world.did(now, "another module is put in for s", span.as_secs());
        }
        Happening::Panel(counts, span) if !world.machine.has_other_settings(now) => {
            let span = span.min(left_of_storm(now));
            world.machine.sets(counts, now, span);
            world.counts.settings += 1;
            world.did(now, "the module is set to other counts for a degree", u64::from(counts));
        }
        Happening::SecondMaster(habit, span) => {
            let span = span.min(left_of_storm(now));
            world.other.comes(habit, now, span);
            world.did(now, "another master asks the module for s", span.as_secs());
        }
        Happening::Deaf(span) => {
            world.machine.deaf_until = now + span;
            world.keeps_waiting(PLC, now + span);
        }
        Happening::Sleep(span) => {
            let span = span.min(left_of_storm(now));
            world.did(now, "the computer sleeps for s", span.as_secs());
            world.passage.suspend(span);
        }
        Happening::Calm => {
            world.lines.iter_mut().for_each(|line| (line.next, line.until) = (None, now));
            world.machine.deaf_until = now;
            world.machine.open_until = [now; 2];
            world.did(now, "a calm begins", 0);
        }
        _ => {}
    }
}
