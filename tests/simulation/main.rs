//! Whole gateways on simulated machines, by seed. What happens to one: `script.rs`; what it is held to: `laws.rs` and
//! `people.rs`.
//!
//! `cargo run --release --example simulate -- --seeds 1..1000 --for 8h` does the same for longer.

#![allow(clippy::unwrap_used, reason = "these are tests")]

mod day;
mod disk;
mod framing;
mod laws;
mod link;
mod machine;
mod many;
mod nodes;
mod panel;
mod people;
mod scene;
mod script;
mod second_master;
mod serial_side;
mod stream;
mod time;

use std::time::Duration;

use day::Without;
use many::Many;
use scene::Scene;

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
/// - 900004: a computer slept to the end of the storm, and the script began no calm after that. Somebody wrote to a register in it.
const MENDED: [u64; 7] = [22, 754, 914, 900_004, 1_795_833_836, 1_795_872_391, 621_073_451_707];

/// The same of changes at a panel:
/// - 43: a control refused a change. The axis kept that value after the change at the panel was found, and the control was asked for it again.
/// - 59: the check read another value, and was refused when all checks were read after that. The readings were used as before.
/// - 7024: a person armed an axis in the moment in which the check was read. It went back to a Cz from before it was off.
/// - 7125: the machine was switched on in the first round of checks. Nothing went back, although no reference is captured then.
/// - 7141: the module refused its checks before one brought another value. Nothing went back, because the module was in doubt already.
/// - 1795898153: a control refused the way back, and was sent what it held in between. The law took the next attempt for a new change.
/// - 400067: the module was silent for two poll periods before its check was read. The law did not count that as lost contact.
const MENDED_AT_A_PANEL: [u64; 7] = [43, 59, 7024, 7125, 7141, 400_067, 1_795_898_153];

#[test]
fn a_seed_repeats_its_day_bit_for_bit() {
    let scene = Scene::usual(day::profile());
    let first = day::run(&scene, 1, 2 * HOUR, Without::Nothing);
    assert_eq!(first, day::run(&scene, 1, 2 * HOUR, Without::Nothing));
}

#[test]
fn every_seed_whose_defect_is_mended_holds_the_laws() {
    let many = Many::run(&Scene::usual(day::profile()), &MENDED, DAY, 2, Without::Nothing);
    assert_eq!(many.broken, [], "{many}");
}

#[test]
fn every_seed_with_a_panel_whose_defect_is_mended_holds_the_laws() {
    let many = Many::run(&Scene::panel(day::TEXT), &MENDED_AT_A_PANEL, 3 * HOUR, 2, Without::Nothing);
    assert_eq!(many.broken, [], "{many}");
}

/// A number in the environment, by which `tests/run` and its stage `depth` choose seeds.
fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name)
        .map_or(otherwise, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text}: say 50")))
}

/// Ten seeds that no run had before, three hours each. `TEST_SEEDS=50` takes more, `TEST_SEED_HOURS=8` a whole day, and
/// `TEST_FRESH_SEEDS_FROM` repeats those of a run.
#[test]
fn fresh_seeds_hold_the_laws() {
    let (first, count) = (number("TEST_FRESH_SEEDS_FROM", 1), number("TEST_SEEDS", 10));
    let hours = number("TEST_SEED_HOURS", 3);
    let seeds: Vec<u64> = (first..first + count).collect();
    let (scene, span) = (Scene::usual(day::profile()), HOUR * u32::try_from(hours).unwrap());
    let many = Many::run(&scene, &seeds, span, 2, Without::Nothing);
    assert_eq!(many.broken, [], "TEST_FRESH_SEEDS_FROM={first} TEST_SEED_HOURS={hours}: {many}");
    assert!(many.counts.faults > 25 * hours * count && many.changes > 250 * hours * count, "{many}");
}

#[test]
fn sensors_and_control_that_are_servers_of_nodes_hold_the_same_laws() {
    // Two for three hours, and six for a day in depth.
    let seeds: Vec<u64> = (1..=number("TEST_SEEDS", 10) / 5).collect();
    let hours = number("TEST_SEED_HOURS", 3);
    let (scene, span) = (Scene::usual(day::profile_of_nodes()), HOUR * u32::try_from(hours).unwrap());
    let many = Many::run(&scene, &seeds, span, 2, Without::Nothing);
    assert_eq!(many.broken, [], "{many}");
    let count = seeds.len() as u64;
    assert!(many.counts.faults > 25 * hours * count && many.changes > 250 * hours * count, "{many}");
}

/// Another module is put in the place of that with the thermocouples. Without a check its readings move the machine.
#[test]
fn without_checks_the_simulation_finds_readings_of_another_module() {
    let scene = Scene::usual(day::profile_without_checks());
    let many = Many::run(&scene, &[1, 2], DAY, 2, Without::Nothing);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R3")), "{many}");
}

/// An answer as old as itself, and none too late: changes go out on readings that are too old.
#[test]
fn without_the_age_that_begins_with_the_question_the_simulation_finds_old_readings() {
    // The fourth finds some soon.
    let seeds: Vec<u64> = std::iter::once(4).chain(1..=40).collect();
    let many = Many::run(&Scene::usual(day::profile()), &seeds, DAY, 1, Without::Age);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R3")), "{many}");
}

/// A server that is restarted has its namespaces in another order. By their indices alone, another machine is read and written.
#[test]
fn without_the_uris_behind_the_indices_the_simulation_finds_writes_to_another_machine() {
    let many = Many::run(&Scene::usual(day::profile_of_nodes()), &[1, 2], DAY, 1, Without::Uris);
    assert!(many.broken.iter().any(|(_, story)| story.contains("another machine")), "{many}");
}

/// Seeds for the events that only some machines have.
fn seeds_beyond() -> Vec<u64> {
    let (first, count) = (number("TEST_FRESH_SEEDS_FROM", 1), number("TEST_SEEDS", 10));
    (first..first + count).collect()
}

#[test]
fn changes_at_a_panel_move_nothing_for_longer_than_a_period_of_the_check_and_are_walked_back() {
    // An hour each, and three in depth.
    let (seeds, hours) = (seeds_beyond(), number("TEST_SEED_HOURS", 1).min(3));
    let span = HOUR * u32::try_from(hours).unwrap();
    let many = Many::run(&Scene::panel(day::TEXT), &seeds, span, 2, Without::Nothing);
    assert_eq!(many.broken, [], "TEST_FRESH_SEEDS_FROM={} TEST_SEED_HOURS={hours}: {many}", seeds[0]);
    assert!(many.counts.settings > 0 && many.went_back > 0, "{many}");
}

#[test]
fn without_checks_the_simulation_finds_values_in_other_settings() {
    let scene = Scene::panel(&day::text_without_checks());
    let many = Many::run(&scene, &[1, 2, 3], HOUR, 2, Without::Nothing);
    let is_found = |story: &str| story.contains("R3") && story.contains("after the settings were changed");
    assert!(many.broken.iter().any(|(_, story)| is_found(story)), "{many}");
}

#[test]
fn answers_that_a_gateway_shifts_move_nothing() {
    let seeds = seeds_beyond();
    let many = Many::run(&Scene::gateway(true), &seeds, HOUR, 2, Without::Nothing);
    assert_eq!(many.broken, [], "TEST_FRESH_SEEDS_FROM={}: {many}", seeds[0]);
    assert!(many.counts.late_answers > 10 * seeds.len() as u64, "{many}");
}

#[test]
fn without_the_wait_for_late_answers_the_simulation_finds_exchanged_values() {
    let many = Many::run(&Scene::gateway(false), &[1, 3], HOUR, 2, Without::Nothing);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R11")), "{many}");
}

#[test]
fn a_second_master_moves_nothing_once_it_was_noticed() {
    let seeds = seeds_beyond();
    let many = Many::run(&Scene::second_master(true), &seeds, HOUR, 2, Without::Nothing);
    assert_eq!(many.broken, [], "TEST_FRESH_SEEDS_FROM={}: {many}", seeds[0]);
    let count = seeds.len() as u64;
    assert!(many.counts.foreign_answers > 5 * count && many.counts.noticed > count / 2, "{many}");
}

/// Two answers of the other master in a row agree with each other. Only the last good reading speaks against them.
#[test]
fn without_a_limit_of_their_rate_the_simulation_finds_readings_of_another_master() {
    let many = Many::run(&Scene::second_master(false), &[1, 2, 3, 4, 5, 6], HOUR, 2, Without::Nothing);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R11")), "{many}");
}
