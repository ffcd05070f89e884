//! Whole gateways on simulated machines, by seed. What happens to one: `script.rs`; what it is held to: `laws.rs` and
//! `people.rs`.
//!
//! `cargo run --release --example simulate -- --seeds 1..1000 --for 8h` does the same for longer.

#![allow(clippy::unwrap_used, reason = "these are tests")]

mod day;
mod disk;
mod laws;
mod link;
mod machine;
mod many;
mod nodes;
mod people;
mod script;
mod stream;
mod time;

use std::time::Duration;

use day::Without;
use many::Many;

const HOUR: Duration = Duration::from_secs(3600);
const DAY: Duration = Duration::from_secs(8 * 3600);

/// Seeds that once showed a defect which is mended:
/// - 22: a change that a control had refused went out again while its axis held, on a reading that was just too old.
/// - 621073451707: what a control refused was wanted no more, and the register of an operator was never said to take
///   anything again.
/// - 754: a strobe that was kept on the way rose after it had been given up, and its acknowledge stood for ever.
/// - 914: a late set put the number back, and the control passed over the next set, which bore a number that it knew.
/// - 1795833836: a set that the registers held by half was begun and given up in each turn, and with that the next attempt put off.
/// - 1795872391: a module that refused everything for a while also refused its checks. That was taken for changed settings, and the
///   axes moved back to what they had held before, without readings.
const MENDED: [u64; 6] = [22, 754, 914, 1_795_833_836, 1_795_872_391, 621_073_451_707];

#[test]
fn a_seed_repeats_its_day_bit_for_bit() {
    let profile = day::profile();
    let first = day::run(&profile, 1, 2 * HOUR, Without::Nothing);
    assert_eq!(first, day::run(&profile, 1, 2 * HOUR, Without::Nothing));
}

#[test]
fn every_seed_whose_defect_is_mended_holds_the_laws() {
    let many = Many::run(&day::profile(), &MENDED, DAY, 2, Without::Nothing);
    assert_eq!(many.broken, [], "{many}");
}

/// A number in the environment, by which `tests/run` and its stage `depth` choose seeds.
fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name)
        .map_or(otherwise, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text}: say 50")))
}

/// Ten seeds that no run had before, half a day each. `TEST_SEEDS=50` takes more, `TEST_SEED_HOURS=8` a whole day, and
/// `TEST_FRESH_SEEDS_FROM` repeats those of a run.
#[test]
fn fresh_seeds_hold_the_laws() {
    let (first, count) = (number("TEST_FRESH_SEEDS_FROM", 1), number("TEST_SEEDS", 10));
    let hours = number("TEST_SEED_HOURS", 4);
    let seeds: Vec<u64> = (first..first + count).collect();
    let many = Many::run(&day::profile(), &seeds, HOUR * u32::try_from(hours).unwrap(), 2, Without::Nothing);
    assert_eq!(many.broken, [], "TEST_FRESH_SEEDS_FROM={first} TEST_SEED_HOURS={hours}: {many}");
    assert!(many.counts.faults > 25 * hours * count && many.changes > 250 * hours * count, "{many}");
}

#[test]
fn sensors_and_control_that_are_servers_of_nodes_hold_the_same_laws() {
    // Two, and six in depth.
    let seeds: Vec<u64> = (1..=number("TEST_SEEDS", 10) / 5).collect();
    let many = Many::run(&day::profile_of_nodes(), &seeds, DAY, 2, Without::Nothing);
    assert_eq!(many.broken, [], "{many}");
    let count = seeds.len() as u64;
    assert!(many.counts.faults > 200 * count && many.changes > 2000 * count, "{many}");
}

/// Another module is put in the place of that with the thermocouples. Without a check its readings move the machine.
#[test]
fn without_checks_the_simulation_finds_readings_of_another_module() {
    let many = Many::run(&day::profile_without_checks(), &[1, 2], DAY, 2, Without::Nothing);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R3")), "{many}");
}

/// An answer as old as itself, and none too late: changes go out on readings that are too old.
#[test]
fn without_the_age_that_begins_with_the_question_the_simulation_finds_old_readings() {
    // The fourth finds some soon.
    let seeds: Vec<u64> = std::iter::once(4).chain(1..=40).collect();
    let many = Many::run(&day::profile(), &seeds, DAY, 1, Without::Age);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R3")), "{many}");
}

/// A server that is restarted has its namespaces in another order. By their indices alone, another machine is read and written.
#[test]
fn without_the_uris_behind_the_indices_the_simulation_finds_writes_to_another_machine() {
    let many = Many::run(&day::profile_of_nodes(), &[1, 2], DAY, 1, Without::Uris);
    assert!(many.broken.iter().any(|(_, story)| story.contains("another machine")), "{many}");
}
