//! What warms the body, and what holds it.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

use super::super::card::Place;
use super::super::raw::{Raw, Where};
use super::super::{Fault, Places};
use super::names::Names;
use super::whole;
use crate::body::{Film, Flux, LoadCase};
use crate::mesh::Face;

/// Nodes that are held in all three directions.
pub(super) fn supports(raw: &Raw, names: &Names<'_>, faults: &mut Vec<Fault>) -> Vec<usize> {
    let mut held: BTreeMap<usize, ([bool; 3], &Place)> = BTreeMap::new();
    for bound in raw.boundaries.iter().filter(|bound| bound.last <= 3) {
        for node in names.nodes(&bound.target, &bound.place, faults) {
            let (directions, _) = held.entry(node).or_insert(([false; 3], &bound.place));
            (bound.first..=bound.last).for_each(|direction| directions[direction as usize - 1] = true);
        }
    }
    if let Some((node, (_, place))) = held.iter().find(|(_, (directions, _))| directions.contains(&false)) {
        let node = names.mesh.nodes[*node];
        faults.push(place.fault(format!("node {node} is held in some directions only: hold it in 1 to 3")));
    }
    held.into_keys().collect()
}

pub(super) fn load(
    path: &Path,
    raw: &Raw,
    names: &Names<'_>,
    faults: &mut Vec<Fault>,
) -> Option<(LoadCase, Places)> {
    let initial = initial(path, raw, names, faults);
    let Some(step) = &raw.load else {
        if faults.is_empty() {
            faults.push(whole(path, "the step has no *HEAT TRANSFER: nothing says how the structure warms"));
        }
        return None;
    };
    let outer: HashSet<Face> = names.mesh.outer_faces().into_iter().collect();
    let mut load = LoadCase {
        case: step.case,
        initial: initial?,
        films: Vec::new(),
        fluxes: Vec::new(),
        nodal: Vec::new(),
        held: Vec::new(),
    };
    let mut places = Places::default();
    let mut once = Once::default();
    for (at, sink, coefficient, place) in &step.films {
        for face in faces(at, "F", names, &outer, place, faults) {
            let id = names.mesh.elements[face.element].id;
            let what = || format!("side F{} of element {id} has a film", face.side + 1);
            once.check((0, face.element, face.side), what, place, faults);
            places.films.push(at.name());
            load.films.push(Film { face, sink: *sink, coefficient: *coefficient });
        }
    }
    for (at, heat, place) in &step.fluxes {
        let twice = |element: usize| format!("element {} has this flux", names.mesh.elements[element].id);
        if let Where::Volume(target) = at {
            for element in names.elements(target, place, faults) {
                once.check((1, element, 0), || twice(element), place, faults);
                places.fluxes.push(at.name());
                load.fluxes.push(Flux::Volume(element, *heat));
            }
            continue;
        }
        for face in faces(at, "S", names, &outer, place, faults) {
            once.check((2, face.element, face.side), || twice(face.element), place, faults);
            places.fluxes.push(at.name());
            load.fluxes.push(Flux::Face(face, *heat));
        }
    }
    for (target, heat, place) in &step.nodal {
        for node in names.nodes(target, place, faults) {
            once.check((3, node, 0), || format!("node {} has a flux", names.mesh.nodes[node]), place, faults);
            load.nodal.push((node, *heat));
        }
    }
    let mut held: BTreeMap<usize, f64> = BTreeMap::new();
    for bound in raw.boundaries.iter().filter(|bound| bound.last == 11) {
        for node in names.nodes(&bound.target, &bound.place, faults) {
            let other = held.insert(node, bound.value);
            if other.is_some_and(|other| other.to_bits() != bound.value.to_bits()) {
                let node = names.mesh.nodes[node];
                faults.push(bound.place.fault(format!("node {node} is held at another temperature already")));
            }
        }
    }
    load.held = held.into_iter().collect();
    Some((load, places))
}

/// What may be said only once, and the line that said it.
#[derive(Default)]
struct Once(HashMap<(u8, usize, usize), usize>);

impl Once {
    fn check(
        &mut self,
        key: (u8, usize, usize),
        what: impl Fn() -> String,
        place: &Place,
        faults: &mut Vec<Fault>,
    ) {
        if let Some(line) = self.0.insert(key, place.line) {
            faults.push(place.fault(format!("{} already (line {line}); which one counts?", what())));
        }
    }
}

/// The outer faces that are meant.
fn faces(
    at: &Where,
    letter: &str,
    names: &Names<'_>,
    outer: &HashSet<Face>,
    place: &Place,
    faults: &mut Vec<Fault>,
) -> Vec<Face> {
    let faces = match at {
        Where::Surface(target) => names.surface(target, place, faults),
        Where::Side(target, side) => {
            let elements = names.elements(target, place, faults).into_iter();
            elements.map(|element| Face { element, side: *side }).collect()
        }
        Where::Volume(_) => Vec::new(),
    };
    for face in faces.iter().filter(|face| !outer.contains(face)) {
        let id = names.mesh.elements[face.element].id;
        faults.push(place.fault(format!(
            "side {letter}{} of element {id} lies inside the structure, between two elements",
            face.side + 1
        )));
    }
    faces
}

fn initial(path: &Path, raw: &Raw, names: &Names<'_>, faults: &mut Vec<Fault>) -> Option<Vec<f64>> {
    let mut initial: Vec<Option<f64>> = vec![None; names.mesh.nodes.len()];
    for (target, temperature, place) in &raw.initial {
        for node in names.nodes(target, place, faults) {
            let other = initial[node].replace(*temperature);
            if other.is_some_and(|other| other.to_bits() != temperature.to_bits()) {
                let node = names.mesh.nodes[node];
                faults.push(place.fault(format!("node {node} starts at another temperature already")));
            }
        }
    }
    // A line of the card that is wrong has been told; what it leaves out is not missed on top.
    let told = faults.iter().any(|fault| fault.card == "*INITIAL CONDITIONS");
    if let Some(node) = initial.iter().position(Option::is_none).filter(|_| !told) {
        let node = names.mesh.nodes[node];
        let message = format!(
            "node {node} has no initial temperature: write *INITIAL CONDITIONS, TYPE=TEMPERATURE for all nodes before \
             *STEP"
        );
        faults.push(whole(path, &message));
    }
    initial.into_iter().collect()
}
