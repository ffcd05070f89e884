//! Reader functions of the cards that define nodes, elements, sets and surfaces. A card is a line with a
//! keyword such as `*NODE`, together with the data lines below it.

use super::Fault;
use super::card::{Card, Line, Location, quoted};
use super::reader::Reader;
use crate::element::worst_determinant;
use crate::mesh::{Element, Face, Kind, NodeId};

/// Maximum length of a set name, as in CalculiX.
const LONGEST: usize = 80;

pub(super) fn nodes(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    let first = reader.nodes.len();
    reader.each(card, |reader, line| {
        // Omitted coordinates are 0.
        if line.len() > 4 {
            line.exactly(&["number", "x", "y", "z"])?;
        }
        let id = line.id(line.text(0), "number of the node")?;
        let xyz = line.coordinates(1)?;
        let xyz = card.position.as_ref().map_or(xyz, |position| position.place(xyz));
        reader.nodes.push((id, xyz, line.at.clone()));
        Ok(())
    });
    reader.is_spoiled |= reader.nodes.len() - first < card.lines.len();
    let ids = reader.nodes[first..].iter().map(|(id, ..)| *id).collect();
    reader.named.extend(named(card, "NSET")?.map(|name| (true, name, ids)));
    Ok(())
}

/// Names of element types with the same shape, with the kind of solid and the number of nodes. `None` instead of a kind
/// means a line or surface element, which only marks a place of the geometry. Each list includes the types for heat
/// transfer (`DC3D10`), for coupled steps (`C3D10T`), and with other formulations (`C3D10MH`, which meshio writes).
const TYPES: [(&str, Option<Kind>, usize); 6] = [
    ("C3D4 DC3D4 C3D4T C3D4H", Some(Kind::Tet4), 4),
    (
        "C3D10 DC3D10 C3D10T C3D10H C3D10HT C3D10M C3D10MT C3D10MH C3D10MHT C3D10HS C3D10I",
        Some(Kind::Tet10),
        10,
    ),
    ("T3D2 B31 B31R B31H DC1D2", None, 2),
    ("T3D3 B32 B32R B33H DC1D3", None, 3),
    ("CPS3 CPE3 CAX3 DC2D3 DCAX3 S3 S3R S3RS STRI3 DS3 M3D3 R3D3 SFM3D3", None, 3),
    ("CPS6 CPE6 CAX6 DC2D6 DCAX6 S6 STRI65 DS6 M3D6 SFM3D6", None, 6),
];

pub(super) fn elements(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    let name = card
        .value("TYPE")
        .ok_or_else(|| card.fault("the card names no TYPE: write TYPE=C3D4 or TYPE=C3D10"))?;
    let known = TYPES.iter().find(|(known, ..)| known.split(' ').any(|known| known == name));
    let (_, kind, nodes) = known.ok_or_else(|| {
        card.fault(format!(
            "element type {name} is not supported: mesh the structure with tetrahedra, C3D4 or C3D10"
        ))
    })?;
    let mut ids = Vec::new();
    for (numbers, at) in listed(card, &name, *nodes)? {
        let (id, nodes) = (numbers[0], &numbers[1..]);
        ids.push(id);
        if let Some(nodes) = places(reader, id, nodes, &at) {
            match kind {
                Some(kind) => solid(reader, Element { id, kind: *kind, nodes }, at),
                None => reader.outlines.push((id, nodes)),
            }
        }
    }
    reader.named.extend(named(card, "ELSET")?.map(|name| (false, name, ids)));
    Ok(())
}

/// Returns for each element of a card the number of the element, followed by the numbers of its nodes. The data of an
/// element may continue over several lines.
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
            return Err(
                at.fault(format!("the element has {} nodes, but a {name} has {nodes}", all.len() - 1))
            );
        }
    }
    match listed.last().filter(|(all, _)| all.len() <= nodes) {
        Some((all, at)) => Err(at.fault(format!(
            "the element has {} nodes, but a {name} has {nodes}",
            all.len().saturating_sub(1)
        ))),
        None => Ok(listed),
    }
}

/// Returns the indices of the nodes of an element. If a node is not defined, adds an error and returns `None`.
fn places(reader: &mut Reader, id: u32, nodes: &[u32], at: &Location) -> Option<Vec<usize>> {
    let mut places = Vec::with_capacity(nodes.len());
    for node in nodes {
        match reader.mesh.place(NodeId(*node)) {
            Some(place) => places.push(place),
            None => reader.missed(at, format!("element {id} names node {node}, which is not defined")),
        }
    }
    (places.len() == nodes.len()).then_some(places)
}

fn solid(reader: &mut Reader, element: Element, at: Location) {
    let (id, nodes) = (element.id, &element.nodes);
    let known = reader.numbers.insert(id, reader.mesh.elements.len());
    if let Some(first) = known {
        let line = reader.element_at[first].line;
        reader.faults.push(at.fault(format!("element {id} is defined already in line {line}")));
    }
    if (1..nodes.len()).any(|place| nodes[..place].contains(&nodes[place])) {
        reader.faults.push(at.fault(format!("element {id} has a node twice: mesh the structure again")));
    } else if worst_determinant(element.kind, &reader.mesh.corners(&element)) <= 0.0 {
        reader.faults.push(at.fault(format!(
            "element {id} is numbered inside out or folded: its volume is not positive; mesh the structure \
             again"
        )));
    }
    reader.mesh.elements.push(element);
    reader.element_at.push(at);
}

/// Returns the set name in a parameter, in capitals; `None` if the card does not have the parameter. Fails if the name
/// is empty, too long, or only a number.
fn named(card: &Card, parameter: &str) -> Result<Option<String>, Fault> {
    let Some(name) = card.value(parameter) else { return Ok(None) };
    if name.is_empty() {
        return Err(card.fault(format!("{parameter} has no name")));
    }
    if name.chars().count() > LONGEST {
        return Err(card.fault(format!("the name of the set is longer than {LONGEST} characters: {name}")));
    }
    if name.parse::<u32>().is_ok() {
        return Err(card.fault(format!("a set name must not be only a number: {name}")));
    }
    Ok(Some(name))
}

/// Reads a node set (`*NSET`) or an element set (`*ELSET`).
pub(super) fn set(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    let of_nodes = card.key == "NSET";
    let what = if of_nodes { "node" } else { "element" };
    let name = named(card, &card.key)?;
    let name = name.ok_or_else(|| card.fault(format!("the card names no set: write {}=NAME", card.key)))?;
    let mut members = Vec::new();
    reader.each(card, |reader, line| {
        let find = |reader: &mut Reader, id: u32| {
            let place = reader.member(of_nodes, id);
            if place.is_none() && !(of_nodes && reader.is_free(id)) {
                reader.missed(&line.at, format!("{what} {id} is not defined"));
            }
            place
        };
        if card.has("GENERATE") {
            let (first, last, by) = range(line)?;
            let there = reader.members_between(of_nodes, (first, last), by);
            let mut ids: Vec<u32> = there.iter().map(|(id, _)| *id).collect();
            if of_nodes {
                ids.extend(reader.free_between(first, last, by));
                ids.sort_unstable();
            }
            let wanted = (last - first) / by + 1;
            let lacking = wanted - u32::try_from(ids.len()).unwrap_or(u32::MAX).min(wanted);
            if lacking > 0 {
                let mut ids = ids.into_iter().peekable();
                let is_not = |id: &u32| ids.next_if_eq(id).is_none();
                let id = (first..=last).step_by(by as usize).find(is_not).unwrap_or(first);
                let others =
                    if lacking > 1 { format!(", nor are {} others", lacking - 1) } else { String::new() };
                reader.missed(&line.at, format!("{what} {id} is not defined{others}"));
            }
            members.extend(there.into_iter().map(|(_, place)| place));
            return Ok(());
        }
        for text in line.values() {
            if let Ok(id) = text.parse() {
                members.extend(find(reader, id));
            } else if let Some(set) = reader.sets(of_nodes).get(&text.to_uppercase()) {
                members.extend(set);
            } else if text.is_empty() {
                reader
                    .faults
                    .push(line.fault("the number or name of a set member is missing between two commas"));
            } else {
                reader.missed(
                    &line.at,
                    format!("`{}` is not a number, and no {what} set above has this name", quoted(text)),
                );
            }
        }
        Ok(())
    });
    if card.lines.iter().all(|line| line.len() == 0) {
        return Err(card.fault(format!("{what} set {name} is empty")));
    }
    // A second card with the same name adds to the set, as in Abaqus and CalculiX.
    reader.add_to_set(of_nodes, name, members);
    Ok(())
}

/// Returns the first number, the last number and the step of a range of node or element numbers.
fn range(line: &Line) -> Result<(u32, u32, u32), Fault> {
    let by = if line.len() == 2 { 1 } else { line.id(line.text(2), "step")? };
    if line.len() > 3 {
        line.exactly(&["first", "last", "step"])?;
    }
    let (first, last) = (line.id(line.text(0), "first number")?, line.id(line.text(1), "last number")?);
    if last < first {
        return Err(
            line.fault(format!("the range {first} to {last} is empty: write the smaller number first"))
        );
    }
    Ok((first, last, by))
}

pub(super) fn surface(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    if card.value("TYPE").is_some_and(|kind| kind != "ELEMENT") {
        return Err(card.fault("only surfaces of TYPE=ELEMENT are read"));
    }
    let name = named(card, "NAME")?.ok_or_else(|| card.fault("the card names no surface: write NAME="))?;
    reader.each(card, |reader, line| {
        line.exactly(&["element or set", "side"])?;
        let side = side(line, "S")?;
        let faces = reader.elements(line.text(0), &line.at).into_iter().map(|element| Face { element, side });
        reader.surfaces.entry(name.clone()).or_default().extend(faces);
        Ok(())
    });
    Ok(())
}

/// Parses a side of a tetrahedron from the second value of a data line: `F1` to `F4` or `S1` to `S4`. Returns the side
/// counted from 0.
pub(super) fn side(line: &Line, letter: &str) -> Result<usize, Fault> {
    let text = line.text(1).to_uppercase();
    let number = text.strip_prefix(letter).and_then(|number| number.parse::<usize>().ok());
    number.filter(|number| (1..=4).contains(number)).map(|number| number - 1).ok_or_else(|| {
        let sides = format!("{letter}1, {letter}2, {letter}3 or {letter}4");
        line.fault(format!("`{}` is not a side of a tetrahedron: {sides}", quoted(&text)))
    })
}
