//! Nodes, elements, sets and surfaces.

use super::Fault;
use super::card::{Card, Line, Place};
use super::fields::Fields;
use super::raw::{Raw, Target};
use crate::placement::mesh::Kind;

pub(super) const KEYS: [&str; 5] = ["NODE", "ELEMENT", "NSET", "ELSET", "SURFACE"];

/// The longest name of a set, as CalculiX has it.
const LONGEST: usize = 80;

/// What a set is said to hold, in the order of the deck.
#[derive(Debug)]
pub(super) struct Members {
    pub(super) name: String,
    pub(super) members: Vec<Member>,
    pub(super) place: Place,
    /// Whether a card of its own says so: a second one is refused. Sets that `*NODE` and `*ELEMENT` name grow.
    pub(super) own_card: bool,
}

#[derive(Debug)]
pub(super) enum Member {
    One(Target, Place),
    Range { first: u32, last: u32, by: u32, place: Place },
}

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
            Err(fault) => faults.push(fault),
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

fn elements(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) {
    card.only(&["TYPE", "ELSET"], faults);
    let kind = match card.value("TYPE").as_deref() {
        Some("C3D4") => Kind::Tet4,
        Some("C3D10") => Kind::Tet10,
        other => return faults.push(card.place.fault(no_solid(other))),
    };
    let first = raw.elements.len();
    let mut open: Option<(Vec<u32>, &Line)> = None;
    for line in &card.lines {
        let fields = Fields::of(line);
        let numbers: Result<Vec<u32>, Fault> =
            (0..fields.len()).map(|at| fields.whole(at, "number of an element or a node")).collect();
        let numbers = match numbers {
            Ok(numbers) => numbers,
            Err(fault) => return faults.push(fault),
        };
        // An element may go on over several lines.
        let (mut all, at) = open.take().unwrap_or_else(|| (Vec::new(), line));
        all.extend(numbers);
        match all.len().cmp(&(kind.nodes() + 1)) {
            std::cmp::Ordering::Less => open = Some((all, at)),
            std::cmp::Ordering::Equal => {
                raw.elements.push((all[0], kind, all[1..].to_vec(), at.place.clone()));
            }
            std::cmp::Ordering::Greater => {
                return faults.push(at.place.fault(format!(
                    "{} nodes where a {} has {}",
                    all.len() - 1,
                    kind.name(),
                    kind.nodes()
                )));
            }
        }
    }
    if let Some((all, line)) = open {
        let has = all.len().saturating_sub(1);
        faults.push(line.place.fault(format!("{has} of the {} nodes of a {}", kind.nodes(), kind.name())));
    }
    let ids = raw.elements[first..].iter().map(|(id, ..)| *id).collect();
    grow(&mut raw.element_sets, card, "ELSET", ids, faults);
}

fn no_solid(kind: Option<&str>) -> String {
    let Some(kind) = kind else { return "names no TYPE: C3D4 and C3D10 are read".to_owned() };
    let flat = ["T3D", "CPS", "CPE", "STRI", "S3", "S6", "B31", "B32", "M3D"];
    if flat.iter().any(|name| kind.starts_with(name)) {
        return format!(
            "{kind} is a line or a surface of the geometry, not a solid: in Gmsh give physical groups, and keep elements \
             of volumes and nodes of surfaces only (Mesh.SaveGroupsOfElements = -1000; Mesh.SaveGroupsOfNodes = -100)"
        );
    }
    format!("{kind} is not read: mesh the structure with tetrahedra, C3D4 or C3D10")
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
    for line in &card.lines {
        let fields = Fields::of(line);
        let side = fields.exactly(&["element or set", "side"]).and_then(|()| side(&fields, 1, "S"));
        match side {
            Ok(side) => raw.surfaces.push((Target::of(fields.text(0)), side, line.place.clone())),
            Err(fault) => faults.push(fault),
        }
    }
}

/// A side of a tetrahedron, `F1` to `F4` or `S1` to `S4`, from 0.
pub(super) fn side(fields: &Fields<'_>, at: usize, letter: &str) -> Result<usize, Fault> {
    let text = fields.text(at).to_uppercase();
    let number = text.strip_prefix(letter).and_then(|number| number.parse::<usize>().ok());
    number.filter(|number| (1..=4).contains(number)).map(|number| number - 1).ok_or_else(|| {
        fields.fault(format!(
            "`{text}` is not a side of a tetrahedron: {letter}1, {letter}2, {letter}3 or {letter}4"
        ))
    })
}
