//! Sensors that freeze while an axis runs, and days on which none does. The gateway's step runs with the block from
//! `identify`. The machines are synthetic: eight sensors at three sources of heat, with random speeds and coolant.

use std::path::Path;
use std::time::Duration;

use isotherm_core::compensation::model::Outside;
use isotherm_core::compensation::settings::{AxisSettings, MachineSettings};
use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reading;
use isotherm_identify::identify;
use isotherm_identify::method::Settings;
use isotherm_identify::setup::{Choice, ready};
use isotherm_identify::written::written;
use isotherm_profile::Profile;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::rig::{self, Day, dataset};

const SENSORS: usize = 8;
const MINUTES: usize = 480;
/// Number of readings in a minute.
const OFTEN: usize = 6;
/// Number of days for learning.
const TRAINING: u64 = 8;
/// Number of healthy days of each kind, and of days on which a sensor freezes.
const DAYS: u64 = 50;

/// Kind of readings in a log.
#[derive(Clone, Copy, Debug)]
struct Kind {
    /// Size of one count, °C.
    count: f64,
    /// One row every ten seconds; else the mean of each minute.
    is_raw: bool,
}

const KINDS: [Kind; 4] = [
    Kind { count: 0.05, is_raw: true },
    Kind { count: 0.1, is_raw: true },
    Kind { count: 0.05, is_raw: false },
    Kind { count: 0.1, is_raw: false },
];

/// Time constants of a machine, in minutes.
#[derive(Clone, Copy, Debug)]
struct Machine {
    nose: f64,
    bearing: f64,
    head: f64,
    column: f64,
    bend: f64,
}

/// Use of spindle and coolant on a day.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Duty {
    /// Both change at random, about once an hour.
    Changing,
    /// The spindle rests. After five hours, coolant comes that is 5 °C colder than the machine.
    ColdCoolant,
}

/// Value that lasts for some readings.
#[derive(Clone, Copy, Debug, Default)]
struct Spell {
    value: f64,
    left: usize,
}

impl Spell {
    /// Returns the value at the next reading. A new value is drawn when the old one has lasted long enough.
    fn advance(
        &mut self,
        chance: &mut Pcg64Mcg,
        minutes: (usize, usize),
        draw: impl Fn(&mut Pcg64Mcg) -> f64,
    ) -> f64 {
        if self.left == 0 {
            let left = chance.random_range(minutes.0 * OFTEN..minutes.1 * OFTEN);
            *self = Spell { value: draw(chance), left };
        }
        self.left -= 1;
        self.value
    }
}

impl Machine {
    fn new(seed: u64) -> Machine {
        let mut chance = Pcg64Mcg::seed_from_u64(seed);
        Machine {
            nose: chance.random_range(6.0..12.0),
            bearing: chance.random_range(12.0..25.0),
            head: chance.random_range(35.0..70.0),
            column: chance.random_range(120.0..250.0),
            bend: chance.random_range(10.0..30.0),
        }
    }

    fn day(&self, kind: Kind, duty: Duty, seed: u64) -> Day {
        let mut chance = Pcg64Mcg::seed_from_u64(seed);
        // Share of the remaining difference that disappears between two readings.
        let gone = |minutes: f64| 1.0 - (-1.0 / (OFTEN as f64 * minutes)).exp();
        let phase = chance.random_range(0.0..std::f64::consts::TAU);
        let (amplitude, drift) = (chance.random_range(0.6..1.6), chance.random_range(-0.15..0.25));
        let (mut speeds, mut coolants) = (Spell::default(), Spell::default());
        let (mut nose, mut bearing, mut head, mut column, mut bend) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut gate, mut outlet, mut cabinet) = (0.0, 0.0, 0.0);
        let mut day = Day { times: Vec::new(), temperatures: vec![Vec::new(); SENSORS], error: Vec::new() };
        let mut sums = [0.0; SENSORS];
        for reading in 0..MINUTES * OFTEN {
            let second = (60 / OFTEN * reading) as f64;
            let hours = second / 3600.0;
            let (heat, coolant) = match duty {
                Duty::ColdCoolant => (0.0, if hours < 5.0 { 0.0 } else { -5.0 }),
                Duty::Changing if reading < 10 * OFTEN => (0.0, 0.0),
                Duty::Changing => (
                    speeds.advance(&mut chance, (20, 120), |chance| match chance.random_range(0..3_u8) {
                        0 => 0.0,
                        _ => chance.random_range(0.2..1.0),
                    }),
                    coolants.advance(&mut chance, (40, 160), |chance| match chance.random_range(0..2_u8) {
                        0 => 0.0,
                        _ => chance.random_range(-2.5..2.5),
                    }),
                ),
            };
            let turn = std::f64::consts::TAU * hours / 16.0;
            let hall: f64 = amplitude * ((turn + phase).sin() - phase.sin()) + drift * hours;
            gate += gone(3.0) * (coolant + 0.6 * heat + 0.3 * hall - gate);
            outlet += gone(6.0) * (gate + 1.5 * heat - outlet);
            nose += gone(self.nose) * (9.0 * heat + 0.5 * gate + 0.3 * hall - nose);
            bearing += gone(self.bearing) * (6.0 * heat + 0.4 * gate + 0.3 * hall - bearing);
            head += gone(self.head) * (0.3 * nose + 0.3 * bearing + 0.4 * hall - head);
            column += gone(self.column) * (0.5 * head + 0.6 * hall - column);
            cabinet += gone(25.0) * (hall + 0.8 * heat - cabinet);
            bend += gone(self.bend) * (nose - bend);
            // The sum of four uniform numbers is nearly normal.
            let mut noise =
                |size: f64| size * (0..4).map(|_| chance.random_range(-1.0..1.0)).sum::<f64>() * 0.866;
            let rises = [nose, bearing, head, column, gate, outlet, hall, cabinet];
            let readings = rises.map(|rise| ((20.03 + rise + noise(0.02)) / kind.count).round() * kind.count);
            sums.iter_mut().zip(readings).for_each(|(sum, reading)| *sum += reading);
            let is_whole = (reading + 1).is_multiple_of(OFTEN);
            if kind.is_raw || is_whole {
                let rows = if kind.is_raw { readings } else { sums.map(|sum| sum / OFTEN as f64) };
                day.times.push(second);
                day.temperatures.iter_mut().zip(rows).for_each(|(sensor, row)| sensor.push(row));
                day.error.push(1.5 * bend + 2.5 * head - 2.0 * column + 0.3 * outlet + noise(0.1));
            }
            if is_whole {
                sums = [0.0; SENSORS];
            }
        }
        day
    }
}

/// Profile with this model and this largest step, µm.
fn profile_text(kind: Kind, step: f64, model: &str) -> String {
    let fine = "type = \"f32\"\nword_order = \"msw-first\"\nunit";
    let counts = format!("type = \"i16\"\nscale = {}\nunit", kind.count);
    let text = rig::profile_with(SENSORS, model).replace(fine, &counts);
    text.replace("step = 500.0", &format!("step = {step:.1}"))
}

/// Profile with the model that `identify` finds on some days of this machine.
fn learned(machine: &Machine, kind: Kind, step: f64) -> Profile {
    let days: Vec<String> = (0..TRAINING).map(|seed| machine.day(kind, Duty::Changing, seed).log()).collect();
    let dataset = dataset(&days).unwrap();
    let profile = rig::parsed(Path::new("bench.toml"), &profile_text(kind, step, rig::NO_MODEL));
    let keep = (0..SENSORS).map(|sensor| format!("s{sensor}")).collect();
    let ready = ready(&profile, &dataset, &Choice { keep, ..rig::choice() }).unwrap();
    let found = identify(&ready, &Settings::default(), None, true, &|_, _| {}).unwrap();
    let block = written(&found, "z", Outside::Agree);
    rig::pasted(&profile_text(kind, step, &block.block), &block.files)
}

/// Result of an axis on one day.
#[derive(Clone, Debug, Default)]
struct Seen {
    /// Suspected sensors, each with its time, s.
    suspected: Vec<(usize, f64)>,
    /// At least one of them had a stand-in.
    is_replaced: bool,
    /// Error with the target of the axis in each row, µm.
    left: Vec<f64>,
}

fn run(machine: &MachineSettings, axis: &AxisSettings, day: &Day) -> Seen {
    let mut compensation = Compensation::new(machine.clone(), vec![axis.clone()], Remembered::default());
    let control = Control { permit: Permit::Armed, ..Control::default() };
    let begin = Moment::from_nanos(1_000_000_000_000);
    let mut seen = Seen::default();
    for (row, second) in day.times.iter().enumerate() {
        let now = begin.after(Duration::from_secs_f64(*second));
        let readings = day.temperatures.iter().map(|sensor| Reading::good(sensor[row], now));
        let readings: Vec<Reading> = readings.collect();
        compensation.step(&Snapshot::new(now, &readings), &[control]);
        for found in compensation.rejected(0) {
            let sensor = found.signal.0;
            if !seen.suspected.iter().any(|(known, _)| *known == sensor) {
                seen.suspected.push((sensor, *second));
            }
            seen.is_replaced |= found.others.is_some();
        }
        let target = compensation.decision(0).and_then(|decision| decision.raw);
        seen.left.push(day.error[row] + target.map_or(0.0, |target| target.get()));
    }
    seen
}

fn range(values: &[f64]) -> f64 {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    values.iter().copied().fold(f64::NEG_INFINITY, f64::max) - least
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn no_healthy_day_has_an_alarm_and_four_of_five_frozen_sensors_are_found() {
    let (mut alarms, mut others, mut replaced) = (0, 0, 0);
    // Minutes until the sensor was found, and growth of the range.
    let (mut found, mut growth) = (Vec::new(), Vec::new());
    for (number, kind) in (0..).zip(KINDS) {
        let machine = Machine::new(number);
        let profile = learned(&machine, kind, 1.0);
        let run = |day: &Day| run(&profile.machine, &profile.axes[0].settings, day);
        let mut chance = Pcg64Mcg::seed_from_u64(number);
        for seed in 0..DAYS {
            let day = machine.day(kind, Duty::Changing, 1000 + seed);
            let healthy = run(&day);
            alarms += healthy.suspected.len();
            let rows = day.times.len();
            let sensor = chance.random_range(0..SENSORS);
            let at = chance.random_range(rows / 20..rows * 2 / 5);
            let mut frozen = day.clone();
            let stays = day.temperatures[sensor][at];
            frozen.temperatures[sensor][at..].fill(stays);
            let seen = run(&frozen);
            let own = seen.suspected.iter().find(|(suspected, _)| *suspected == sensor);
            found.push(own.map_or(f64::INFINITY, |(_, second)| (second - day.times[at]) / 60.0));
            others += seen.suspected.len() - usize::from(own.is_some());
            replaced += usize::from(seen.is_replaced);
            growth.push(range(&seen.left) / range(&healthy.left));
        }
    }
    found.sort_by(f64::total_cmp);
    let cases = found.len();
    let share = found.iter().filter(|minutes| minutes.is_finite()).count() as f64 / cases as f64;
    let median = found[cases / 2];
    println!(
        "{cases} healthy days: {alarms} alarms. {cases} frozen sensors: {:.1} % found, half of them within {median:.0} min; {replaced} \
         replaced, {others} times another one was suspected; the range grows by {:.1} %",
        100.0 * share,
        100.0 * (mean(&growth) - 1.0)
    );
    assert_eq!(alarms, 0);
    assert!(share >= 0.8, "{share}");
    assert!(median < 240.0, "{median} min");
}

#[test]
fn on_a_day_whose_coolant_is_colder_than_ever_stand_ins_make_nothing_worse() {
    for kind in [KINDS[1], KINDS[3]] {
        let machine = Machine::new(9);
        // In this test, no step limits the effect of a stand-in.
        let profile = learned(&machine, kind, 500.0);
        let with = &profile.axes[0].settings;
        let mut without = with.clone();
        without.models.iter_mut().for_each(|model| model.stand_ins = None);
        for seed in 0..3 {
            let day = machine.day(kind, Duty::ColdCoolant, 2000 + seed);
            let seen = run(&profile.machine, with, &day);
            let (range_with, range_without) =
                (range(&seen.left), range(&run(&profile.machine, &without, &day).left));
            println!(
                "{kind:?}: {range_with:.1} µm with stand-ins, {range_without:.1} µm without, {:.1} µm uncompensated",
                range(&day.error)
            );
            assert!(seen.suspected.is_empty(), "{kind:?}: {:?}", seen.suspected);
            assert!(range_with <= 1.1 * range_without, "{kind:?}: {range_with} and {range_without} µm");
        }
    }
}
