//! Two outputs of one axis. Each moves separately, and the guard of the axis stays near the one that is farthest
//! behind.

use std::collections::HashSet;
use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};

use isotherm_core::output::{Action, Mode, OutputHealth, Rule, Rules, Settings, farthest_behind};
use isotherm_core::quantity::Counts;

use super::budget::Budget;
use super::moves::{self, Name};
use super::world::{Broken, World, settings};

/// Outputs. The guard that they share is stored in the first.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Pair([World; 2]);

impl Pair {
    fn new(settings: &Settings, budget: Budget) -> Pair {
        Pair([World::new(settings, budget), World::new(settings, Budget { has_guard: true, ..Budget::NONE })])
    }

    /// Lets a second pass for both outputs, with a decision of the axis.
    fn second(&mut self, settings: &Settings) -> Broken {
        self.0.iter_mut().for_each(|world| world.pass(settings));
        let is_held = self.0.iter().any(|world| world.mode(settings, true) == Mode::Hold);
        let [guard, wanted] = [self.0[0].guard.unwrap_or_default(), self.0[0].wanted];
        let decided = if is_held { guard } else { self.decides(settings, guard, wanted) };
        let target = if is_held { guard } else { wanted };
        let mode = if is_held { Mode::Hold } else { Mode::Follow };
        for world in &mut self.0 {
            (world.guard, world.wanted) = (Some(decided), wanted);
            world.decided(settings, Some((decided, target)), (mode, true))?;
        }
        self.resumes();
        Ok(())
    }

    /// Returns the decision: one step towards the target, and at most one step from the output that is farthest behind.
    fn decides(&self, settings: &Settings, guard: Counts, wanted: Counts) -> Counts {
        let change = wanted.clamp(-settings.limit, settings.limit) - guard;
        let decided = guard + change.clamp(-settings.step, settings.step);
        let verified = self.0.iter().filter_map(|world| {
            let gateway = world.gateway?;
            let is_verified = gateway.health(settings, world.interlock) == Some(OutputHealth::Verified);
            let held = gateway.held(settings) - settings.bias;
            (is_verified && held != guard).then_some(held)
        });
        match farthest_behind(guard, verified).filter(|_| settings.rules.has(Rule::NoWindup)) {
            Some(behind) => decided.clamp(behind - settings.step, behind + settings.step),
            None => decided,
        }
    }

    /// Makes the axis resume from the first of its outputs.
    fn resumes(&mut self) {
        self.0[1].guard = self.0[0].guard;
    }

    fn each(&self, settings: &Settings, to: &mut impl FnMut(Name, Pair, Broken)) {
        const OF_BOTH: [Name; 3] = ["a second", "a second with stale readings", "another target"];
        for place in 0..2 {
            moves::each(&self.0[place], settings, &mut |name, world, broken| {
                if !OF_BOTH.contains(&name) {
                    let mut next = self.clone();
                    next.0[place] = world;
                    next.resumes();
                    to(name, next, broken);
                }
            });
        }
        let is_quiet =
            |world: &World| matches!(world.action(), Action::Nothing { .. }) && world.gateway.is_some();
        if self.0.iter().all(is_quiet) {
            let mut next = self.clone();
            let broken = next.second(settings);
            to("a second", next, broken);
            for target in [-settings.limit, settings.limit] {
                if self.0[0].left.targets > 0 && target != self.0[0].wanted {
                    let mut next = self.clone();
                    (next.0[0].left.targets, next.0[0].wanted) = (self.0[0].left.targets - 1, target);
                    let broken = next.second(settings);
                    to("another target", next, broken);
                }
            }
        }
    }
}

/// Searches at most `most` pairs, breadth first. Returns their number, and the shortest way to a violation.
fn search(settings: &Settings, budget: Budget, most: usize) -> (usize, Option<String>) {
    let hasher = BuildHasherDefault::<DefaultHasher>::default();
    let mut known: HashSet<u64, BuildHasherDefault<DefaultHasher>> = HashSet::default();
    let mut layer = vec![(Pair::new(settings, budget), Vec::<Name>::new())];
    let mut broken = None;
    while !layer.is_empty() && broken.is_none() && known.len() < most {
        let mut next_layer = Vec::new();
        for (pair, way) in &layer {
            pair.each(settings, &mut |name, next, outcome| {
                let mut way = way.clone();
                way.push(name);
                if let (Err(why), None) = (outcome, &broken) {
                    broken = Some(format!("{why}\n  {}", way.join("\n  ")));
                }
                let next = Pair(next.0.map(|world| world.canonical(settings)));
                if known.len() < most && known.insert(hasher.hash_one(&next)) {
                    next_layer.push((next, way));
                }
            });
        }
        layer = next_layer;
    }
    (known.len(), broken)
}

const STATES: usize = 15_000;
const FAULTS: Budget = Budget { holds: 1, losses: 1, targets: 2, has_guard: true, ..Budget::NONE };

fn both() -> Settings {
    settings(false, 3, 4)
}

#[test]
fn searched_two_outputs_of_one_axis_never_move_away_from_the_target() {
    let asked = std::env::var("SEARCH_STATES").ok().and_then(|most| most.parse().ok());
    let (states, broken) = search(&both(), FAULTS, asked.unwrap_or(STATES));
    println!("two outputs: {states} states");
    assert!(broken.is_none(), "{}", broken.unwrap());
}

#[test]
fn searched_without_the_eleventh_rule_one_of_two_outputs_moves_away_from_the_target() {
    let rules = Rules::without(Rule::NoWindup);
    let (states, broken) = search(&Settings { rules, ..both() }, FAULTS, 400_000);
    println!("two outputs without R11: {states} states, {broken:?}");
    assert!(broken.is_some(), "the search finds nothing in {states} states");
}
