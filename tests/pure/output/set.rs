//! Searches of sets. Whatever is lost, the control takes no incomplete set and no jump. The gateway knows what the
//! control has taken, and the control takes sets again after the faults.

use std::collections::HashSet;
use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};

use isotherm_core::output::{CommitTrigger, SetSettings, SetWords, StandaloneWrite};

use super::set_world::{Program, SetBudget, SetWorld, set_settings};

/// Searches at most `most` worlds, breadth first. For each fourth world, checks that it recovers without faults.
fn search(what: &str, settings: &SetSettings, program: Program, left: SetBudget) -> Result<(), String> {
    // A set has many more states than a register, and each is more expensive.
    let asked = std::env::var("SEARCH_STATES").ok().and_then(|most| most.parse::<usize>().ok());
    let most = asked.map_or(STATES, |most| most / 4);
    let hasher = BuildHasherDefault::<DefaultHasher>::default();
    let mut known: HashSet<u64, BuildHasherDefault<DefaultHasher>> = HashSet::default();
    let mut layer = vec![(SetWorld::new(settings, program, left), Vec::<&str>::new())];
    let (mut broken, mut depth, mut longest) = (None, 0, 0);
    while !layer.is_empty() && broken.is_none() && known.len() < most {
        depth += 1;
        let mut next_layer = Vec::new();
        for (world, way) in &layer {
            world.each(settings, &mut |name, next, outcome| {
                if broken.is_some() || known.len() >= most {
                    return;
                }
                let mut way = way.clone();
                way.push(name);
                let next = next.canonical(settings);
                let hash = hasher.hash_one(&next);
                let is_new = known.insert(hash);
                let ran_out =
                    if outcome.is_ok() && is_new && hash % 4 == 0 { next.runs_out(settings) } else { Ok(0) };
                match outcome.and(ran_out) {
                    Ok(seconds) => longest = longest.max(seconds),
                    Err(why) => broken = Some(format!("{what}: {why}\n  {}", way.join("\n  "))),
                }
                if is_new {
                    next_layer.push((next, way));
                }
            });
        }
        layer = next_layer;
    }
    println!("{what}: {} states, depth {depth}, at rest after {longest} s", known.len());
    broken.map_or(Ok(()), Err)
}

const STATES: usize = 8_000;
const LINK: SetBudget =
    SetBudget { losses: 2, holds: 1, wires: 0, kills: 0, targets: 1, restarts: 0, stale: 1 };
const TROUBLE: SetBudget =
    SetBudget { losses: 1, holds: 1, wires: 1, kills: 1, targets: 1, restarts: 1, stale: 0 };

fn holds(what: &str, settings: &SetSettings, program: Program) {
    for left in [LINK, TROUBLE] {
        search(what, settings, program, left).unwrap_or_else(|why| panic!("{why}"));
    }
}

#[test]
fn searched_a_set_that_is_taken_as_it_is_written() {
    let words = SetWords::Control(StandaloneWrite::Yes);
    holds("at once", &set_settings(CommitTrigger::AtOnce, false, words), Program::Another);
    let words = SetWords::Heartbeat(StandaloneWrite::No);
    holds("at once, with a number", &set_settings(CommitTrigger::AtOnce, true, words), Program::Another);
}

#[test]
fn searched_a_set_that_is_taken_when_its_number_changes() {
    holds("number", &set_settings(CommitTrigger::Number, true, SetWords::None), Program::Another);
}

#[test]
fn searched_a_set_that_is_taken_when_its_strobe_rises() {
    holds("strobe", &set_settings(CommitTrigger::Strobe, false, SetWords::None), Program::Another);
    holds("strobe and number", &set_settings(CommitTrigger::Strobe, true, SetWords::None), Program::Another);
    let words = SetWords::Control(StandaloneWrite::No);
    holds("strobe, number and words", &set_settings(CommitTrigger::Strobe, true, words), Program::Another);
}

#[test]
fn searched_a_set_whose_control_takes_nothing_but_the_next_number() {
    holds("next number", &set_settings(CommitTrigger::Strobe, true, SetWords::None), Program::NextOnly);
}
