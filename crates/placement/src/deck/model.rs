//! Nodes, elements, sets and surfaces.

use super::Fault;
use super::card::{Card, Place};
use super::fields::Fields;
use super::raw::{Member, Members, Raw, Target};
use crate::mesh::Kind;

pub(super) const KEYS: [&str; 5] = ["NODE", "ELEMENT", "NSET", "ELSET", "SURFACE"];

/// The longest name of a set, as CalculiX has it.
const LONGEST: usize = 80;

pub(super) fn card(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) {
    match card.key.as_str() {
        "NODE" => nodes(raw, card, faults),
        "ELEMENT" => elements(raw, card, faults),
        "NSET" => set(&mut raw.node_sets, card, "NSET", faults),
        "ELSET" => set(&mut raw.element_sets, card, "ELSET", faults),
        _ => surface(raw, card, faults),
    }
}

fn nodes(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) {
    card.only(&["NSET"], faults);
    let first = raw.nodes.len();
    for line in &card.lines {
        match node(&Fields::of(line)) {
            Ok(node) => raw.nodes.push(node),
            Err(fault) => {
                raw.spoiled_nodes = true;
                faults.push(fault);
            }
        }
    }
    let ids = raw.nodes[first..].iter().map(|(id, _, _)| *id).collect();
    grow(&mut raw.node_sets, card, "NSET", ids, faults);
}

fn node(fields: &Fields<'_>) -> Result<(u32, [f64; 3], Place), Fault> {
    fields.exactly(&["number", "x", "y", "z"])?;
    let id = fields.whole(0, "number of the node")?;
    let xyz = [fields.number(1, "x")?, fields.number(2, "y")?, fields.number(3, "z")?];
    Ok((id, xyz, fields.place().clone()))
}

/// What an element is to a structure of tetrahedra.
enum Role {
    Solid(Kind),
    /// A line or a surface of the geometry, with so many nodes: it names a place and carries nothing.
    Outline(usize),
}

const OUTLINES: [(&str, usize); 6] =
    [("T3D2", 2), ("T3D3", 3), ("CPS3", 3), ("CPS6", 6), ("CPE3", 3), ("CPE6", 6)];

impl Role {
    fn of(card: &Card) -> Result<Self, Fault> {
        let Some(kind) = card.value("TYPE") else {
            return Err(card.place.fault("names no TYPE: C3D4 and C3D10 are read"));
        };
        let outline = OUTLINES.iter().find(|(name, _)| *name == kind);
        match (kind.as_str(), outline) {
            ("C3D4", _) => Ok(Self::Solid(Kind::Tet4)),
            ("C3D10", _) => Ok(Self::Solid(Kind::Tet10)),
            (_, Some((_, nodes))) => Ok(Self::Outline(*nodes)),
            _ => {
                let remedy = "mesh the structure with tetrahedra, C3D4 or C3D10";
                Err(card.place.fault(format!("{kind} is not read: {remedy}")))
            }
        }
    }

    const fn nodes(&self) -> usize {
        match self {
            Self::Solid(kind) => kind.nodes(),
            Self::Outline(nodes) => *nodes,
        }
    }
}

fn elements(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) {
    card.only(&["TYPE", "ELSET"], faults);
    let (role, listed) = match Role::of(card).and_then(|role| Ok((listed(card, role.nodes())?, role))) {
        Ok((listed, role)) => (role, listed),
        Err(fault) => return faults.push(fault),
    };
    let ids = listed.iter().map(|(numbers, _)| numbers[0]).collect();
    for (numbers, place) in listed {
        let nodes = numbers[1..].to_vec();
        match role {
            Role::Solid(kind) => raw.elements.push((numbers[0], kind, nodes, place)),
            Role::Outline(_) => raw.outlines.push((numbers[0], nodes, place)),
        }
    }
    grow(&mut raw.element_sets, card, "ELSET", ids, faults);
}

/// Number and nodes of each element of a card; one may go on over several lines.
fn listed(card: &Card, nodes: usize) -> Result<Vec<(Vec<u32>, Place)>, Fault> {
    let kind = card.value("TYPE").unwrap_or_default();
    let mut listed: Vec<(Vec<u32>, Place)> = Vec::new();
    for line in &card.lines {
        let fields = Fields::of(line);
        let numbers: Result<Vec<u32>, Fault> =
            (0..fields.len()).map(|at| fields.whole(at, "number of an element or a node")).collect();
        match listed.last_mut().filter(|(open, _)| open.len() <= nodes) {
            Some((open, _)) => open.extend(numbers?),
            None => listed.push((numbers?, line.place.clone())),
        }
        if let Some((all, place)) = listed.last().filter(|(all, _)| all.len() > nodes + 1) {
            return Err(place.fault(format!("{} nodes where a {kind} has {nodes}", all.len() - 1)));
        }
    }
    match listed.last().filter(|(all, _)| all.len() <= nodes) {
        Some((all, place)) => {
            let has = all.len().saturating_sub(1);
            Err(place.fault(format!("{has} of the {nodes} nodes of a {kind}")))
        }
        None => Ok(listed),
    }
}

fn grow(sets: &mut Vec<Members>, card: &Card, parameter: &str, ids: Vec<u32>, faults: &mut Vec<Fault>) {
    let Some(name) = named(card, parameter, faults) else { return };
    let members = ids.into_iter().map(|id| Member::One(Target::Id(id), card.place.clone())).collect();
    sets.push(Members { name, members, place: card.place.clone(), own_card: false });
}

/// The name a parameter gives to a set.
fn named(card: &Card, parameter: &str, faults: &mut Vec<Fault>) -> Option<String> {
    let name = card.value(parameter)?;
    if name.is_empty() {
        faults.push(card.place.fault(format!("{parameter} has no name")));
        return None;
    }
    if name.chars().count() > LONGEST {
        faults.push(
            card.place.fault(format!("the name of the set is longer than {LONGEST} characters: {name}")),
        );
        return None;
    }
    if name.parse::<u32>().is_ok() {
        faults.push(card.place.fault(format!("a set cannot be named by a number alone: {name}")));
        return None;
    }
    Some(name)
}

fn set(sets: &mut Vec<Members>, card: &Card, parameter: &str, faults: &mut Vec<Fault>) {
    card.only(&[parameter, "GENERATE"], faults);
    if !card.has(parameter) {
        return faults.push(card.place.fault(format!("names no set: write {parameter}=NAME")));
    }
    let Some(name) = named(card, parameter, faults) else { return };
    let mut members = Vec::new();
    for line in &card.lines {
        let fields = Fields::of(line);
        if card.has("GENERATE") {
            match range(&fields) {
                Ok(range) => members.push(range),
                Err(fault) => faults.push(fault),
            }
            continue;
        }
        for at in 0..fields.len() {
            match fields.text(at) {
                "" => faults.push(fields.fault("a member is missing between two commas")),
                text => members.push(Member::One(Target::of(text), line.place.clone())),
            }
        }
    }
    sets.push(Members { name, members, place: card.place.clone(), own_card: true });
}

fn range(fields: &Fields<'_>) -> Result<Member, Fault> {
    let by = if fields.len() == 2 { 1 } else { fields.whole(2, "step")? };
    if fields.len() > 3 {
        fields.exactly(&["first", "last", "step"])?;
    }
    let (first, last) = (fields.whole(0, "first number")?, fields.whole(1, "last number")?);
    if last < first {
        return Err(fields.fault(format!("from {first} to {last} there is nothing")));
    }
    Ok(Member::Range { first, last, by, place: fields.place().clone() })
}

fn surface(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) {
    card.only(&["NAME", "TYPE"], faults);
    if card.value("TYPE").is_some_and(|kind| kind != "ELEMENT") {
        return faults.push(card.place.fault("only surfaces of TYPE=ELEMENT are read"));
    }
    let Some(name) = named(card, "NAME", faults) else {
        return faults.push(card.place.fault("names no surface: write NAME="));
    };
    for line in &card.lines {
        let fields = Fields::of(line);
        let side = fields.exactly(&["element or set", "side"]).and_then(|()| side(&fields, 1, "S"));
        match side {
            Ok(side) => {
                raw.surfaces.push((name.clone(), Target::of(fields.text(0)), side, line.place.clone()))
            }
            Err(fault) => faults.push(fault),
        }
    }
}

/// A side of a tetrahedron, `F1` to `F4` or `S1` to `S4`, from 0.
pub(super) fn side(fields: &Fields<'_>, at: usize, letter: &str) -> Result<usize, Fault> {
    let text = fields.text(at).to_uppercase();
    let number = text.strip_prefix(letter).and_then(|number| number.parse::<usize>().ok());
    number.filter(|number| (1..=4).contains(number)).map(|number| number - 1).ok_or_else(|| {
        let sides = format!("{letter}1, {letter}2, {letter}3 or {letter}4");
        fields.fault(format!("`{text}` is not a side of a tetrahedron: {sides}"))
    })
}

/// A side of a tetrahedron; none where only the letter stands, which speaks of a named surface.
pub(super) fn side_or_surface(fields: &Fields<'_>, at: usize, letter: &str) -> Result<Option<usize>, Fault> {
    if fields.text(at).eq_ignore_ascii_case(letter) { Ok(None) } else { side(fields, at, letter).map(Some) }
}
