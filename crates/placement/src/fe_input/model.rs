//! Nodes, elements, sets and surfaces.

use super::Fault;
use super::card::{Card, Line, Location};
use super::raw::{Member, Members, Raw, Target};
use crate::mesh::Kind;

/// The longest name of a set, as CalculiX has it.
const LONGEST: usize = 80;

pub(super) fn nodes(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let nodes = card.each(&mut raw.faults, |line| {
        line.exactly(&["number", "x", "y", "z"])?;
        let id = line.id(line.text(0), "number of the node")?;
        let xyz = [line.number(1, "x")?, line.number(2, "y")?, line.number(3, "z")?];
        Ok((id, xyz, line.at.clone()))
    });
    raw.spoiled_nodes |= nodes.len() < card.lines.len();
    let set = set_of(card, "NSET", nodes.iter().map(|(id, ..)| *id));
    raw.nodes.extend(nodes);
    raw.node_sets.extend(set?);
    Ok(())
}

/// Names of element types, what they are as solids, and how many nodes they have. Those that are none are lines and
/// surfaces of the geometry: they name a place and carry nothing.
const TYPES: [(&str, Option<Kind>, usize); 8] = [
    ("C3D4", Some(Kind::Tet4), 4),
    ("C3D10", Some(Kind::Tet10), 10),
    ("T3D2", None, 2),
    ("T3D3", None, 3),
    ("CPS3", None, 3),
    ("CPS6", None, 6),
    ("CPE3", None, 3),
    ("CPE6", None, 6),
];

pub(super) fn elements(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let name = card.value("TYPE").ok_or_else(|| card.fault("names no TYPE: C3D4 and C3D10 are read"))?;
    let known = TYPES.iter().find(|(known, ..)| *known == name);
    let (name, kind, nodes) = known.ok_or_else(|| {
        card.fault(format!("{name} is not read: mesh the structure with tetrahedra, C3D4 or C3D10"))
    })?;
    let listed = listed(card, name, *nodes)?;
    let set = set_of(card, "ELSET", listed.iter().map(|(numbers, _)| numbers[0]));
    for (mut numbers, at) in listed {
        let nodes = numbers.split_off(1);
        match kind {
            Some(kind) => raw.elements.push((numbers[0], *kind, nodes, at)),
            None => raw.outlines.push((numbers[0], nodes, at)),
        }
    }
    raw.element_sets.extend(set?);
    Ok(())
}

/// Number and nodes of each element of a card; one may go on over several lines.
fn listed(card: &Card, name: &str, nodes: usize) -> Result<Vec<(Vec<u32>, Location)>, Fault> {
    let mut listed: Vec<(Vec<u32>, Location)> = Vec::new();
    for line in &card.lines {
        let mut numbers = Vec::with_capacity(nodes + 1);
        for text in line.values() {
            numbers.push(line.id(text, "number of an element or a node")?);
        }
        match listed.last_mut().filter(|(open, _)| open.len() <= nodes) {
            Some((open, _)) => open.extend(numbers),
            None => listed.push((numbers, line.at.clone())),
        }
        if let Some((all, at)) = listed.last().filter(|(all, _)| all.len() > nodes + 1) {
            return Err(at.fault(format!("{} nodes where a {name} has {nodes}", all.len() - 1)));
        }
    }
    match listed.last().filter(|(all, _)| all.len() <= nodes) {
        Some((all, at)) => {
            Err(at.fault(format!("{} of the {nodes} nodes of a {name}", all.len().saturating_sub(1))))
        }
        None => Ok(listed),
    }
}

/// The set that a card of nodes or elements names, if it names one.
fn set_of(card: &Card, parameter: &str, ids: impl Iterator<Item = u32>) -> Result<Option<Members>, Fault> {
    let Some(name) = named(card, parameter)? else { return Ok(None) };
    let members = ids.map(|id| (Member::Ids(id, id, 1), card.at.clone())).collect();
    Ok(Some(Members { name, members, at: card.at.clone(), own_card: false }))
}

/// The name a parameter gives to a set.
fn named(card: &Card, parameter: &str) -> Result<Option<String>, Fault> {
    let Some(name) = card.value(parameter) else { return Ok(None) };
    if name.is_empty() {
        return Err(card.fault(format!("{parameter} has no name")));
    }
    if name.chars().count() > LONGEST {
        return Err(card.fault(format!("the name of the set is longer than {LONGEST} characters: {name}")));
    }
    if name.parse::<u32>().is_ok() {
        return Err(card.fault(format!("a set cannot be named by a number alone: {name}")));
    }
    Ok(Some(name))
}

pub(super) fn node_set(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let set = set(card, "NSET", &mut raw.faults)?;
    raw.node_sets.push(set);
    Ok(())
}

pub(super) fn element_set(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let set = set(card, "ELSET", &mut raw.faults)?;
    raw.element_sets.push(set);
    Ok(())
}

fn set(card: &Card, parameter: &str, faults: &mut Vec<Fault>) -> Result<Members, Fault> {
    let name = named(card, parameter)?;
    let name = name.ok_or_else(|| card.fault(format!("names no set: write {parameter}=NAME")))?;
    let members = if card.has("GENERATE") {
        card.each(faults, |line| Ok((range(line)?, line.at.clone())))
    } else {
        let values = card.lines.iter().flat_map(|line| line.values().map(move |text| (line, text)));
        let (missing, members): (Vec<_>, Vec<_>) = values.partition(|(_, text)| text.is_empty());
        let missing = missing.into_iter();
        faults.extend(missing.map(|(line, _)| line.fault("a member is missing between two commas")));
        let members = members.into_iter();
        members.map(|(line, text)| (Target::of(text).into(), line.at.clone())).collect()
    };
    Ok(Members { name, members, at: card.at.clone(), own_card: true })
}

fn range(line: &Line) -> Result<Member, Fault> {
    let by = if line.len() == 2 { 1 } else { line.id(line.text(2), "step")? };
    if line.len() > 3 {
        line.exactly(&["first", "last", "step"])?;
    }
    let (first, last) = (line.id(line.text(0), "first number")?, line.id(line.text(1), "last number")?);
    if last < first {
        return Err(line.fault(format!("from {first} to {last} there is nothing")));
    }
    Ok(Member::Ids(first, last, by))
}

pub(super) fn surface(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    if card.value("TYPE").is_some_and(|kind| kind != "ELEMENT") {
        return Err(card.fault("only surfaces of TYPE=ELEMENT are read"));
    }
    let name = named(card, "NAME")?.ok_or_else(|| card.fault("names no surface: write NAME="))?;
    let faces = card.each(&mut raw.faults, |line| {
        line.exactly(&["element or set", "side"])?;
        Ok((name.clone(), Target::of(line.text(0)), side(line, 1, "S")?, line.at.clone()))
    });
    raw.surfaces.extend(faces);
    Ok(())
}

/// A side of a tetrahedron, `F1` to `F4` or `S1` to `S4`, from 0.
pub(super) fn side(line: &Line, place: usize, letter: &str) -> Result<usize, Fault> {
    let text = line.text(place).to_uppercase();
    let number = text.strip_prefix(letter).and_then(|number| number.parse::<usize>().ok());
    number.filter(|number| (1..=4).contains(number)).map(|number| number - 1).ok_or_else(|| {
        let sides = format!("{letter}1, {letter}2, {letter}3 or {letter}4");
        line.fault(format!("`{text}` is not a side of a tetrahedron: {sides}"))
    })
}
