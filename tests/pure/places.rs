//! Search over every order of up to eight events around the places of outputs. The gateway starts with a changed
//! profile and drives its outputs. The operator arms an axis or sets a register to zero.
//!
//! - The same Cz is never in two registers, unless the operator has confirmed the place of the output.
//! - A register that belongs to no output any more and keeps a value of the gateway is reported.
//! - An operator offset in a shared register becomes the gateway's only if the operator arms the axis.

use std::collections::{BTreeMap, HashSet};

use isotherm_core::place::{FormerPlace, KnownOutput, OutputPlace, Owner, PlaceComparison, compare};

const DEPTH: usize = 8;
const CZ_UM: f64 = 20.0;
const REGISTERS: usize = 2;

/// Name, axis, register and owner of the only output of a profile.
type Output = (&'static str, &'static str, usize, Owner);

const PROFILES: [Option<Output>; 7] = [
    Some(("a", "z", 0, Owner::Whole)),
    Some(("a", "z", 1, Owner::Whole)),
    None,
    Some(("renamed", "z", 0, Owner::Whole)),
    Some(("other", "z", 1, Owner::Whole)),
    Some(("a", "w", 0, Owner::Whole)),
    Some(("a", "z", 0, Owner::Ledger)),
];

/// Rule that the search can deactivate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rule {
    /// A former place waits for the operator over further starts.
    Open,
    /// An axis waits for the operator.
    Waits,
    /// An output that was driven is in doubt when it is moved.
    Driven,
    /// The operator offset of a shared register stays the operator's.
    Owner,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    Started(usize),
    Driven,
    Armed(&'static str),
    Zeroed(usize),
    /// The operator enters a value into a shared register.
    Entered,
}

const EVENTS: [Event; 13] = [
    Event::Started(0),
    Event::Started(1),
    Event::Started(2),
    Event::Started(3),
    Event::Started(4),
    Event::Started(5),
    Event::Started(6),
    Event::Driven,
    Event::Armed("z"),
    Event::Armed("w"),
    Event::Zeroed(0),
    Event::Zeroed(1),
    Event::Entered,
];

#[derive(Clone, Debug)]
struct World {
    without: Option<Rule>,
    profile: Option<Output>,
    /// Value of the gateway in each register that the operator has not accepted there, µm.
    ours: [f64; REGISTERS],
    /// Registers with an operator offset, as far as the state of the last run contains it.
    operators: [bool; REGISTERS],
    /// State of the last run.
    places: BTreeMap<String, OutputPlace>,
    held: Option<f64>,
    was_driven: bool,
    former: Vec<FormerPlace>,
}

impl World {
    fn new(without: Option<Rule>) -> World {
        World {
            without,
            profile: None,
            ours: [0.0; REGISTERS],
            operators: [false; REGISTERS],
            places: BTreeMap::new(),
            held: None,
            was_driven: false,
            former: Vec::new(),
        }
    }

    fn apply(&mut self, event: Event) -> Result<(), &'static str> {
        match event {
            Event::Started(profile) => self.starts(PROFILES[profile]),
            Event::Driven => self.drives()?,
            Event::Armed(axis) => self.is_armed(axis),
            Event::Zeroed(register) => (self.ours[register], self.operators[register]) = (0.0, false),
            Event::Entered => {
                // The operator sees the value of a register whose place is in doubt.
                if let Some((_, axis, register, Owner::Ledger)) = self.profile
                    && !self.waits(axis)
                {
                    self.operators[register] = true;
                }
            }
        }
        self.is_right()
    }

    fn starts(&mut self, profile: Option<Output>) {
        let now: BTreeMap<String, OutputPlace> =
            profile.iter().map(|output| (output.0.to_owned(), place(*output))).collect();
        let found = compare(&self.places, &now);
        let new_name = found.iter().find_map(|(name, found)| match found {
            PlaceComparison::Renamed(former) => Some((former.clone(), name.clone())),
            _ => None,
        });
        let names: BTreeMap<String, String> = new_name.into_iter().collect();
        let former = std::mem::take(&mut self.former).into_iter().map(|former| former.renamed(&names));
        let open: Vec<FormerPlace> = former.filter(|_| self.without != Some(Rule::Open)).collect();
        let was_driven = self.was_driven && self.without != Some(Rule::Driven);
        let remembered = std::mem::take(&mut self.places).into_iter().map(|(name, mut place)| {
            if self.without == Some(Rule::Owner) {
                place.share = now.get(&name).map_or(place.share, |is| is.share);
            }
            let held_um = self.held.filter(|_| was_driven);
            (names.get(&name).cloned().unwrap_or(name), KnownOutput { place, held_um, was_driven })
        });
        let remembered: BTreeMap<String, KnownOutput> = remembered.collect();
        self.was_driven = now.iter().any(|(name, is)| match found.get(name) {
            Some(PlaceComparison::Same | PlaceComparison::Renamed(_)) => self.was_driven,
            _ => open.iter().any(|former| is.is_at(&former.place)),
        });
        // The register is read directly after the start.
        let read = profile.map(|(_, _, register, _)| self.ours[register]);
        self.held = read.filter(|_| self.was_driven);
        let shared =
            remembered.values().map(|known| &known.place).chain(open.iter().map(|former| &former.place));
        let shared = shared.filter(|place| place.share == Owner::Ledger || self.without == Some(Rule::Owner));
        let shared: HashSet<String> = shared.map(|place| place.address.clone()).collect();
        for (register, is_operators) in self.operators.iter_mut().enumerate() {
            *is_operators &= shared.contains(&address(register));
        }
        self.former = FormerPlace::after(open, &remembered, &now);
        if self.without == Some(Rule::Waits) {
            self.former.iter_mut().for_each(|former| former.axes.clear());
        }
        (self.profile, self.places) = (profile, now);
    }

    fn waits(&self, axis: &str) -> bool {
        self.former.iter().any(|former| former.axes.contains(axis))
    }

    /// Arms the axis automatically, unless it waits for the operator, and drives its output.
    fn drives(&mut self) -> Result<(), &'static str> {
        let Some((_, axis, register, owner)) = self.profile else { return Ok(()) };
        if self.waits(axis) {
            return Ok(());
        }
        if owner == Owner::Whole && self.operators[register] {
            return Err("what an operator has in a register becomes ours");
        }
        (self.ours[register], self.held, self.was_driven) = (CZ_UM, Some(CZ_UM), true);
        Ok(())
    }

    /// Arms an axis. The operator accepts the values in the reported former registers.
    fn is_armed(&mut self, armed: &str) {
        let profile = self.profile;
        let present = profile.map(|(_, _, register, _)| register);
        let may_arm = |axis: &str| profile.is_some_and(|(_, known, ..)| known == axis);
        if !may_arm(armed) {
            return;
        }
        let mut former = std::mem::take(&mut self.former);
        former.retain_mut(|former| {
            let is_open = former.confirm(armed, may_arm);
            let register = (0..REGISTERS).find(|register| former.place.address == address(*register));
            if let Some(register) = register.filter(|_| !is_open) {
                self.operators[register] &= Some(register) != present;
                if Some(register) != present {
                    self.ours[register] = 0.0;
                }
            }
            is_open
        });
        self.former = former;
        // An output whose axis is armed may write at any time.
        self.was_driven = true;
        self.held = present.map(|register| self.ours[register]);
    }

    fn is_right(&self) -> Result<(), &'static str> {
        if self.ours.iter().sum::<f64>() > CZ_UM {
            return Err("the same Cz is in two registers");
        }
        let present = self.profile.map(|(_, _, register, _)| register);
        let is_named = |register: usize| {
            let mut former = self.former.iter().filter(|former| former.place.address == address(register));
            former.any(|former| former.is_left_behind(&self.places))
        };
        let left = (0..REGISTERS).filter(|register| self.ours[*register] > 0.0 && Some(*register) != present);
        match left.into_iter().all(is_named) {
            true => Ok(()),
            false => Err("a register keeps a value of ours, and is not named"),
        }
    }
}

fn address(register: usize) -> String {
    format!("holding:{register}")
}

fn place((_, axis, register, share): Output) -> OutputPlace {
    OutputPlace {
        bus: "10.0.0.7:502".to_owned(),
        unit: 1,
        address: address(register),
        layout: "i16".to_owned(),
        scale: 0.1,
        bias: 0,
        share,
        writes: "offset".to_owned(),
        axis: axis.to_owned(),
        diameter: false,
    }
}

/// Returns the shortest counterexample, if there is one, and the number of worlds.
fn search(without: Option<Rule>) -> (Option<(Vec<Event>, &'static str)>, usize) {
    let mut layer = vec![(Vec::new(), World::new(without))];
    // Two ways may lead to the same world.
    let mut known: HashSet<String> = layer.iter().map(|(_, world)| format!("{world:?}")).collect();
    for _ in 0..DEPTH {
        let mut next = Vec::new();
        for (way, world) in &layer {
            for event in EVENTS {
                let (mut way, mut world) = (way.clone(), world.clone());
                way.push(event);
                if let Err(why) = world.apply(event) {
                    return (Some((way, why)), known.len());
                }
                if known.insert(format!("{world:?}")) {
                    next.push((way, world));
                }
            }
        }
        layer = next;
    }
    (None, known.len())
}

#[test]
fn no_order_of_profiles_doubles_an_offset_or_hides_one() {
    let (broken, worlds) = search(None);
    assert_eq!(broken, None);
    println!("{worlds} worlds");
}

#[test]
fn without_each_rule_a_profile_doubles_an_offset_or_hides_one() {
    let found = [Rule::Open, Rule::Waits, Rule::Driven, Rule::Owner].map(|rule| (rule, search(Some(rule)).0));
    for (rule, broken) in found {
        let (way, why) = broken.unwrap_or_else(|| panic!("without {rule:?}: nothing is found"));
        println!("without {rule:?}: {way:?}: {why}");
    }
}
