//! Searches with their expected results.

use isotherm_core::quantity::Counts;
use std::time::Duration;

use isotherm_core::output::{AppliedSettings, Rule, Rules, Settings, Verify};

use super::budget::Budget;
use super::search::{Searched, search, walk};
use super::world::settings;

fn run(what: &str, settings: &Settings, budget: Budget, most: usize) -> Searched {
    let searched = search(settings, budget, most, 4);
    let Searched { states, depth, is_complete, longest, .. } = searched;
    let spent = searched.spent;
    println!(
        "{what}: {states} states, depth {depth}, complete: {is_complete}, {spent} with every fault together, \
         at rest after {longest} s"
    );
    if let Some(broken) = &searched.broken {
        println!("{what}: {}\n  {}", broken.why, broken.way.join("\n  "));
    }
    searched
}

fn holds(what: &str, settings: &Settings, budget: Budget) {
    let asked = std::env::var("SEARCH_STATES").ok().and_then(|most| most.parse().ok());
    let searched = run(what, settings, budget, asked.unwrap_or(STATES));
    assert!(searched.broken.is_none(), "{what}");
}

/// Number of states of a search that must find nothing. For more states, and more steps of a walk:
/// `SEARCH_STATES=2000000 WALK_STEPS=5000000 cargo nextest run --workspace --features full --test pure searched
/// --no-capture`.
const STATES: usize = 15_000;
/// Largest number of states of a search that must find a violation, at which it ends.
const MOST: usize = 200_000;

/// Unsigned register with a bias of 5. An offset without the bias may be outside of its range.
fn biased(is_shared: bool) -> Settings {
    Settings { bias: Counts(5), range: (Counts(0), Counts(200)), ..settings(is_shared, 3, 3) }
}

#[test]
fn a_whole_register_never_jumps() {
    let none = Budget::NONE;
    let link = Budget { holds: 2, losses: 2, refusals: 1, targets: 2, ..none };
    holds("whole, link", &settings(false, 3, 3), link);
    let kills = Budget { holds: 2, losses: 1, kills: 2, pauses: 1, disk: 1, targets: 1, ..none };
    holds("whole, kills", &settings(false, 3, 3), kills);
    let control =
        Budget { holds: 2, losses: 1, restarts: 1, edits: 1, pauses: 1, targets: 1, offs: 1, ..none };
    holds("whole, CNC and persons", &settings(false, 2, 3), control);
    let readings = Budget { holds: 1, losses: 1, ignored: 2, stale: 2, pauses: 1, targets: 2, ..none };
    holds("whole, readings", &settings(false, 3, 3), readings);
    let refresh = Settings { refresh: Some(Duration::from_secs(1)), ..settings(false, 2, 3) };
    let repeats = Budget { holds: 2, losses: 2, restarts: 1, targets: 1, kills: 1, ..none };
    holds("whole, refreshed", &refresh, repeats);
    let all = Budget { holds: 2, edits: 1, kills: 1, pauses: 1, restarts: 1, ..none };
    holds("whole, everything", &settings(false, 2, 3), all);
    holds("whole, with a bias, link", &biased(false), link);
    holds("whole, with a bias, CNC and persons", &biased(false), control);
}

#[test]
fn a_register_that_goes_along_with_others_never_jumps_in_any_state() {
    let none = Budget::NONE;
    let link = Budget { holds: 2, losses: 2, targets: 1, beats: 3, ..none };
    holds("in a set, link", &settings(false, 3, 3), link);
    let kills = Budget { holds: 2, kills: 2, offs: 1, targets: 1, beats: 2, ..none };
    holds("in a set, kills", &settings(false, 3, 3), kills);
    let control = Budget { holds: 1, losses: 1, restarts: 1, edits: 1, offs: 1, beats: 2, ..none };
    holds("in a set, CNC and persons", &settings(false, 2, 3), control);
}

#[test]
fn a_shared_register_never_jumps_and_the_operators_part_stays() {
    let none = Budget::NONE;
    let link = Budget { holds: 2, losses: 2, refusals: 1, edits: 1, targets: 1, ..none };
    holds("shared, link", &settings(true, 3, 3), link);
    let kills = Budget { holds: 2, losses: 1, kills: 2, edits: 1, targets: 1, ..none };
    holds("shared, kills", &settings(true, 3, 3), kills);
    let control = Budget { holds: 1, losses: 1, restarts: 1, edits: 2, targets: 1, offs: 1, ..none };
    holds("shared, CNC and persons", &settings(true, 3, 3), control);
    let readings =
        Budget { losses: 1, ignored: 2, stale: 2, pauses: 1, edits: 1, disk: 1, targets: 1, ..none };
    holds("shared, readings", &settings(true, 3, 3), readings);
    let all = Budget { holds: 2, edits: 1, kills: 1, pauses: 1, restarts: 1, ..none };
    holds("shared, everything", &settings(true, 2, 3), all);
    holds("shared, with a bias, link", &biased(true), link);
    holds("shared, with a bias, CNC and persons", &biased(true), control);
}

#[test]
fn an_output_that_cannot_be_read_never_jumps() {
    let none = Budget::NONE;
    let echo = Settings { verify: Verify::Echo, ..settings(false, 3, 3) };
    let link = Budget { holds: 2, losses: 2, refusals: 1, targets: 2, pauses: 1, ..none };
    holds("unread, link", &echo, link);
    let kills = Budget { holds: 2, losses: 1, kills: 2, pauses: 1, disk: 1, targets: 1, ..none };
    holds("unread, kills", &echo, kills);
    let refresh = Settings { refresh: Some(Duration::from_secs(1)), ..echo };
    let repeats = Budget { holds: 2, losses: 2, targets: 2, kills: 1, ..none };
    holds("unread, refreshed", &refresh, repeats);
}

/// Includes an interlock, a line that is too late, and an axis that is frozen while its output is in trouble.
#[test]
fn an_output_with_an_interlock_never_jumps_and_resumes_from_its_register() {
    let none = Budget { has_guard: true, ..Budget::NONE };
    let locked = Budget { holds: 1, losses: 1, interlocks: 2, edits: 1, targets: 1, ..none };
    holds("whole, interlock", &settings(false, 3, 3), locked);
    holds("shared, interlock", &settings(true, 3, 3), locked);
    let late = Budget { late: 2, holds: 1, losses: 1, stale: 1, targets: 2, ..none };
    holds("whole, late", &settings(false, 3, 3), late);
    let trouble =
        Budget { late: 1, interlocks: 1, refusals: 1, ignored: 1, restarts: 1, disk: 1, targets: 1, ..none };
    holds("whole, trouble", &settings(false, 3, 3), trouble);
    holds("shared, trouble", &settings(true, 3, 3), trouble);
}

/// The control reports the applied value in another register, and applies it late.
#[test]
fn an_output_whose_control_applies_late_is_sent_nothing_new_before_that() {
    let applied = Some(AppliedSettings { tolerance: 0, settle: Duration::from_secs(1) });
    let applied = Settings { applied, ..settings(false, 3, 3) };
    let none = Budget { has_guard: true, ..Budget::NONE };
    holds("applied, link", &applied, Budget { lags: 2, holds: 1, losses: 1, targets: 2, ..none });
    let trouble = Budget { lags: 2, losses: 1, restarts: 1, interlocks: 1, stale: 1, targets: 1, ..none };
    holds("applied, trouble", &applied, trouble);
    let refused = Budget { lags: 1, refusals: 1, ignored: 1, targets: 2, ..none };
    holds("applied, refused", &applied, refused);
}

/// Checks that the search finds a violation without one of the rules.
fn breaks(what: &str, settings: &Settings, budget: Budget, rules: Rules) {
    let searched = run(what, &Settings { rules, ..*settings }, budget, MOST);
    assert!(searched.broken.is_some(), "{what}: the search finds nothing");
}

const LINK: Budget = Budget { holds: 2, losses: 1, targets: 2, edits: 1, pauses: 1, ..Budget::NONE };

#[test]
fn without_the_first_rule_a_late_write_makes_it_jump() {
    let rules = Rules::without(Rule::NearCopies);
    breaks("whole without R1", &settings(false, 3, 3), LINK, rules);
    breaks("shared without R1", &settings(true, 3, 3), LINK, rules);
    let echo = Settings { verify: Verify::Echo, ..settings(false, 3, 3) };
    breaks("unread without R1", &echo, LINK, rules);
}

#[test]
fn without_the_second_rule_others_are_blamed_for_our_own_writes() {
    let rules = Rules::without(Rule::OwnWrites);
    breaks("whole without R2", &settings(false, 3, 3), LINK, rules);
    breaks("shared without R2", &settings(true, 3, 3), LINK, rules);
}

#[test]
fn without_the_third_rule_a_change_is_sent_on_old_readings() {
    let rules = Rules::without(Rule::LastMoment);
    breaks("whole without R3", &settings(false, 3, 3), LINK, rules);
    breaks("shared without R3", &settings(true, 3, 3), LINK, rules);
}

#[test]
fn without_the_sixth_rule_the_limit_and_the_operators_part_are_lost() {
    let rules = Rules::without(Rule::Limit);
    breaks("whole without the limit", &settings(false, 3, 3), LINK, rules);
    breaks("shared without the limit", &settings(true, 3, 3), LINK, rules);
    let rules = Rules::without(Rule::Doubt);
    breaks("shared without doubt", &settings(true, 3, 3), LINK, rules);
}

const GUARDED: Budget =
    Budget { holds: 2, losses: 1, targets: 2, pauses: 1, has_guard: true, ..Budget::NONE };

/// The guard of the axis approaches the target by one step per second.
#[test]
fn a_register_behind_its_guard_never_moves_away_from_the_target() {
    holds("whole, behind a guard", &settings(false, 3, 3), GUARDED);
    holds("shared, behind a guard", &settings(true, 3, 3), GUARDED);
    let echo = Settings { verify: Verify::Echo, ..settings(false, 3, 3) };
    holds("unread, behind a guard", &echo, GUARDED);
    let beside = Budget { beats: 2, holds: 1, ..GUARDED };
    holds("in a set, behind a guard", &settings(false, 3, 3), beside);
}

#[test]
fn without_the_eleventh_rule_a_guard_that_went_on_moves_the_register_away_from_the_target() {
    let rules = Rules::without(Rule::NoWindup);
    let one = Budget { holds: 1, ..GUARDED };
    breaks("whole without R11", &settings(false, 2, 2), one, rules);
    breaks("shared without R11", &settings(true, 3, 2), one, rules);
}

#[test]
fn a_long_walk_among_all_faults_at_once_breaks_nothing() {
    let refresh = Some(Duration::from_secs(1));
    let kinds = [
        ("whole", settings(false, 3, 4)),
        ("in a set", settings(false, 3, 4)),
        ("whole, refreshed", Settings { refresh, bias: Counts(5), ..settings(false, 3, 4) }),
        ("whole, steps of 2", Settings { step: Counts(2), ..settings(false, 5, 4) }),
        ("shared", settings(true, 3, 4)),
        ("shared, steps of 3", Settings { step: Counts(3), ..settings(true, 5, 4) }),
        ("shared, with a bias", Settings { bias: Counts(5), ..settings(true, 3, 4) }),
        ("unread", Settings { verify: Verify::Echo, ..settings(false, 3, 4) }),
        ("unread, refreshed", Settings { verify: Verify::Echo, refresh, ..settings(false, 3, 4) }),
    ];
    for (what, settings) in kinds {
        let asked = std::env::var("WALK_STEPS").ok().and_then(|steps| steps.parse().ok());
        let beats = u8::from(what == "in a set");
        let broken = walk(&settings, Budget { beats, ..Budget::ALL }, asked.unwrap_or(20_000));
        assert!(broken.is_none(), "{what}: {}", broken.unwrap());
    }
}
