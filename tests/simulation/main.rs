//! Simulation of whole gateways on simulated machines, by seed. `script.rs` contains the events, `laws.rs` and
//! `people.rs` the checks.
//!
//! `cargo run --release --example simulate -- --seeds 1..1000 --for 8h` runs longer simulations.

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

/// Type of the line with another master.
const RTU: &str = "modbus-rtu-over-tcp";
const HOUR: Duration = Duration::from_secs(3600);
const DAY: Duration = Duration::from_secs(8 * 3600);

/// Seeds that once found a defect, which is corrected:
/// - 22: after a control had refused a change, the gateway sent it again while its axis kept its value. The reading was
///   slightly too old.
/// - 621073451707: a refused change was no longer requested. The gateway never reported that the register with an
///   operator offset accepted writes again.
/// - 754: a delayed strobe rose after it had been given up, and its acknowledgement stayed high.
/// - 914: a late set restored an old number. The control ignored the next set, because it had that number already.
/// - 1795833836: the registers contained half of a set. The gateway began and gave it up in each turn, which also
///   delayed the next attempt.
/// - 1795872391: a module that refused all requests for a time also refused its checks. The gateway concluded that its
///   settings had changed, and moved the axes back to their earlier values without readings.
/// - 900004: a computer slept until the end of the storm, and the script began no calm after it. Another client wrote
///   to a register in the calm.
/// - 520651131193: a write arrived late at a PLC that had been restarted meanwhile, and the gateway sent its values with
///   the next set. The law did not treat that jump as one of a late write, as it does for other registers.
const MENDED: [u64; 8] =
    [22, 754, 914, 900_004, 1_795_833_836, 1_795_872_391, 520_651_131_193, 621_073_451_707];

/// Seeds that once found a defect with changes at a panel:
/// - 43: a control refused a change. The axis kept that value after the change at the panel was found, and the gateway
///   requested it from the control again.
/// - 59: a check read another value. When all checks were read after that, the module refused it. The readings were
///   used as before.
/// - 7024: an operator armed an axis while the check was being read. The axis returned to a Cz from before it was off.
/// - 7125: the machine was switched on during the first round of checks. No axis returned, although no reference is
///   captured then.
/// - 7141: the module refused its checks before one of them returned another value. No axis returned, because the
///   module was already doubtful.
/// - 1795898153: a control refused the return, and received its current register value meanwhile. The law treated the
///   next attempt as a new change.
/// - 400067: the module was silent for two poll periods before its check was read. The law did not count that as lost
///   contact.
const MENDED_AT_A_PANEL: [u64; 7] = [43, 59, 7024, 7125, 7141, 400_067, 1_795_898_153];

/// Seeds with another master that once found a defect:
/// - 844025432318: after a start, the gateway had no good reading, and two replies of the other master in a row were used
///   as readings.
/// - 5000865: a write of the gateway arrived late, and the operator entered a value before the gateway had read the
///   register. The laws saw two changes, the gateway one.
const MENDED_WITH_A_SECOND_MASTER: [u64; 2] = [844_025_432_318, 5_000_865];

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

/// Number in an environment variable, with which `tests/run` and its stage `depth` select seeds.
fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name)
        .map_or(otherwise, |text| text.parse().unwrap_or_else(|_| panic!("{name}={text}: say 50")))
}

/// Simulates ten new seeds for three hours each. `TEST_SEEDS=50` runs more seeds, `TEST_SEED_HOURS=8` longer ones.
/// `TEST_FRESH_SEEDS_FROM` repeats the seeds of a run.
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
    // Two seeds for three hours; in the stage `depth`, more seeds for a longer time.
    let seeds: Vec<u64> = (1..=number("TEST_SEEDS", 10) / 5).collect();
    let hours = number("TEST_SEED_HOURS", 3);
    let (scene, span) = (Scene::usual(day::profile_of_nodes()), HOUR * u32::try_from(hours).unwrap());
    let many = Many::run(&scene, &seeds, span, 2, Without::Nothing);
    assert_eq!(many.broken, [], "{many}");
    let count = seeds.len() as u64;
    assert!(many.counts.faults > 25 * hours * count && many.changes > 250 * hours * count, "{many}");
}

/// Another module replaces the thermocouple module. Without a check, its readings move the machine.
#[test]
fn without_checks_the_simulation_finds_readings_of_another_module() {
    let scene = Scene::usual(day::profile_without_checks());
    let many = Many::run(&scene, &[1, 2], DAY, 2, Without::Nothing);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R3")), "{many}");
}

/// Without this rule, a reading is as old as its reply, and none is too old. The gateway then sends changes that are
/// based on old readings.
#[test]
fn without_the_age_that_begins_with_the_question_the_simulation_finds_old_readings() {
    // Seed 4 finds such a change soon.
    let seeds: Vec<u64> = std::iter::once(4).chain(1..=40).collect();
    let many = Many::run(&Scene::usual(day::profile()), &seeds, DAY, 1, Without::Age);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R3")), "{many}");
}

/// A restarted server has its namespaces in another order. By index alone, the gateway would read and write another
/// machine.
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
    // One hour for each seed; up to three hours in the stage `depth`.
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
    a_second_master_moves_nothing(RTU);
}

#[test]
fn a_second_master_on_a_line_with_modbus_ascii_moves_nothing_once_it_was_noticed() {
    a_second_master_moves_nothing("modbus-ascii");
}

#[track_caller]
fn a_second_master_moves_nothing(kind: &str) {
    let mut seeds = seeds_beyond();
    let first = seeds[0];
    seeds.extend(MENDED_WITH_A_SECOND_MASTER);
    let many = Many::run(&Scene::second_master(kind, true), &seeds, HOUR, 2, Without::Nothing);
    assert_eq!(many.broken, [], "TEST_FRESH_SEEDS_FROM={first}: {many}");
    let count = seeds.len() as u64;
    assert!(many.counts.foreign_answers > 5 * count && many.counts.noticed > count / 2, "{many}");
}

/// Replies of the other master are consistent with each other. Only the last good reading shows that they are wrong.
#[test]
fn without_a_limit_of_their_rate_the_simulation_finds_readings_of_another_master() {
    let many = Many::run(&Scene::second_master(RTU, false), &[1, 2, 3, 4, 5, 6], HOUR, 2, Without::Nothing);
    assert!(many.broken.iter().any(|(_, story)| story.contains("R11")), "{many}");
}
