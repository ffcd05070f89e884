//! Breadth-first search of all reachable worlds, with the shortest way to each.

use std::collections::{HashSet, VecDeque};
use std::hash::{BuildHasher, BuildHasherDefault, DefaultHasher};

use isotherm_core::output::Settings;

use super::budget::Budget;
use super::moves::{self, Name};
use super::world::World;

/// Result of a search.
#[derive(Debug)]
pub(crate) struct Searched {
    pub(crate) states: usize,
    pub(crate) depth: usize,
    /// Whether every reachable world was visited.
    pub(crate) is_complete: bool,
    /// Number of worlds in which no event is left.
    pub(crate) spent: usize,
    /// Longest time until the register is correct after the last fault, s.
    pub(crate) longest: u64,
    /// Shortest way to a violation.
    pub(crate) broken: Option<Broken>,
}

/// A counterexample.
#[derive(Debug)]
pub(crate) struct Broken {
    pub(crate) why: String,
    #[allow(dead_code, reason = "printed")]
    pub(crate) way: Vec<Name>,
}

struct Seen {
    from: usize,
    name: Name,
}

/// Searches at most `most` worlds. For each `every`-th world, checks that it recovers without faults.
pub(crate) fn search(settings: &Settings, budget: Budget, most: usize, every: u64) -> Searched {
    let hasher = BuildHasherDefault::<DefaultHasher>::default();
    let mut known: HashSet<u64, BuildHasherDefault<DefaultHasher>> = HashSet::default();
    let mut seen = vec![Seen { from: 0, name: "begin" }];
    let mut layer = vec![(0, World::new(settings, budget))];
    let mut searched =
        Searched { states: 1, depth: 0, is_complete: true, spent: 0, longest: 0, broken: None };
    let mut broken: Option<(usize, Name, String)> = None;
    while !layer.is_empty() && broken.is_none() {
        searched.depth += 1;
        let mut next_layer = Vec::new();
        for (from, world) in &layer {
            if seen.len() >= most {
                searched.is_complete = false;
                break;
            }
            moves::each(world, settings, &mut |name, next, outcome| {
                if broken.is_some() {
                    return;
                }
                if let Err(why) = outcome {
                    broken = Some((*from, name, why));
                    return;
                }
                let next = next.canonical(settings);
                let hash = hasher.hash_one(&next);
                if !known.insert(hash) {
                    return;
                }
                searched.spent += usize::from(next.left.is_spent());
                if hash % every == 0 {
                    match next.runs_out(settings) {
                        Ok(seconds) => searched.longest = searched.longest.max(seconds),
                        Err(why) => {
                            broken = Some((*from, name, format!("{why}, when all runs out after this")))
                        }
                    }
                }
                seen.push(Seen { from: *from, name });
                next_layer.push((seen.len() - 1, next));
            });
        }
        layer = next_layer;
        if !searched.is_complete {
            break;
        }
    }
    searched.states = seen.len();
    searched.is_complete &= broken.is_none();
    searched.broken = broken.map(|(from, name, why)| Broken { why, way: way(&seen, from, name) });
    searched
}

/// Follows one long random way with unlimited events. Returns the violation, if there is one.
pub(crate) fn walk(settings: &Settings, budget: Budget, steps: u64) -> Option<String> {
    let mut world = World::new(settings, budget);
    let mut expired: VecDeque<Name> = VecDeque::new();
    // A linear congruential generator (Knuth's MMIX) is random enough for this purpose.
    let mut random = 0x5eed_u64;
    let mut draw = |below: u64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) % below
    };
    for place in 0..steps {
        let mut faults = Vec::new();
        let mut plain = Vec::new();
        moves::each(&world, settings, &mut |name, next, outcome| {
            let is_plain =
                ["read", "kept", "write done", "a second", "start", "a person decides"].contains(&name);
            if is_plain { &mut plain } else { &mut faults }.push((name, next, outcome));
        });
        let is_quiet = plain.is_empty() || (!faults.is_empty() && draw(4) == 0);
        let mut chosen = if is_quiet { faults } else { plain };
        let of = chosen.len() as u64;
        let (name, next, outcome) = chosen.swap_remove(usize::try_from(draw(of)).unwrap());
        expired.push_back(name);
        if expired.len() > 60 {
            expired.pop_front();
        }
        let rested = if place % 16 == 0 { next.runs_out(settings).map(|_| ()) } else { Ok(()) };
        if let Err(why) = outcome.and(rested) {
            return Some(format!("{why}, after {place} steps, the last of which are {expired:#?}"));
        }
        world = World { left: budget, ..next.canonical(settings) };
    }
    None
}

fn way(seen: &[Seen], mut from: usize, last: Name) -> Vec<Name> {
    let mut way = vec![last];
    while from != 0 {
        way.push(seen[from].name);
        from = seen[from].from;
    }
    way.reverse();
    way
}
