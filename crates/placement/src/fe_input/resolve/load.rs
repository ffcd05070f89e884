//! What warms the structure, and what holds it.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

use super::super::card::Location;
use super::super::raw::{Part, Region};
use super::super::{Fault, SurfaceNames};
use super::Resolver;
use crate::body::{Film, Flux, LoadCase};
use crate::mesh::Face;

/// Nodes that are held in all three directions.
pub(super) fn supports(resolver: &mut Resolver<'_>) -> Vec<usize> {
    let mut held: BTreeMap<usize, ([bool; 3], &Location)> = BTreeMap::new();
    for bound in resolver.raw.boundaries.iter().filter(|bound| bound.last <= 3) {
        for node in resolver.nodes(&bound.target, &bound.at) {
            let (directions, _) = held.entry(node).or_insert(([false; 3], &bound.at));
            (bound.first..=bound.last).for_each(|direction| directions[direction as usize - 1] = true);
        }
    }
    if let Some((node, (_, at))) = held.iter().find(|(_, (directions, _))| directions.contains(&false)) {
        let node = resolver.mesh.nodes[*node];
        let message = format!("node {node} is held in some directions only: hold it in 1 to 3");
        resolver.faults.push(at.fault(message));
    }
    held.into_keys().collect()
}

pub(super) fn load(path: &Path, resolver: &mut Resolver<'_>) -> Option<(LoadCase, SurfaceNames)> {
    let initial = initial(path, resolver);
    let Some(step) = &resolver.raw.load else {
        if resolver.faults.is_empty() {
            let message = "the step has no *HEAT TRANSFER: nothing says how the structure warms";
            resolver.faults.push(Fault::of_file(path, message));
        }
        return None;
    };
    let outer: HashSet<Face> = resolver.mesh.outer_faces().into_iter().collect();
    let (films, fluxes, nodal) = (Vec::new(), Vec::new(), Vec::new());
    let mut load = LoadCase { case: step.case, initial: initial?, films, fluxes, nodal, held: Vec::new() };
    let mut names = SurfaceNames::default();
    let mut once = Once::default();
    for (region, sink, coefficient, at) in &step.films {
        for face in faces(region, "F", &outer, at, resolver) {
            let id = resolver.mesh.elements[face.element].id;
            let what = || format!("side F{} of element {id} has a film", face.side + 1);
            once.check((0, face.element, face.side), what, at, resolver);
            names.films.push(region.name());
            load.films.push(Film { face, sink: *sink, coefficient: *coefficient });
        }
    }
    for (region, heat, at) in &step.fluxes {
        let places: Vec<(u8, usize, usize, Flux)> = if let Part::Volume = region.part {
            let elements = resolver.elements(&region.target, at).into_iter();
            elements.map(|element| (1, element, 0, Flux::Volume(element, *heat))).collect()
        } else {
            let faces = faces(region, "S", &outer, at, resolver).into_iter();
            faces.map(|face| (2, face.element, face.side, Flux::Face(face, *heat))).collect()
        };
        for (kind, element, side, flux) in places {
            let id = resolver.mesh.elements[element].id;
            once.check((kind, element, side), || format!("element {id} has this flux"), at, resolver);
            names.fluxes.push(region.name());
            load.fluxes.push(flux);
        }
    }
    for (target, heat, at) in &step.nodal {
        for node in resolver.nodes(target, at) {
            let id = resolver.mesh.nodes[node];
            once.check((3, node, 0), || format!("node {id} has a flux"), at, resolver);
            load.nodal.push((node, *heat));
        }
    }
    let mut held: BTreeMap<usize, f64> = BTreeMap::new();
    for bound in resolver.raw.boundaries.iter().filter(|bound| bound.last == 11) {
        for node in resolver.nodes(&bound.target, &bound.at) {
            let other = held.insert(node, bound.value);
            if other.is_some_and(|other| other.to_bits() != bound.value.to_bits()) {
                let node = resolver.mesh.nodes[node];
                let message = format!("node {node} is held at another temperature already");
                resolver.faults.push(bound.at.fault(message));
            }
        }
    }
    load.held = held.into_iter().collect();
    Some((load, names))
}

/// What may be said only once, and the line that said it.
#[derive(Default)]
struct Once(HashMap<(u8, usize, usize), usize>);

impl Once {
    fn check(
        &mut self,
        key: (u8, usize, usize),
        what: impl Fn() -> String,
        at: &Location,
        resolver: &mut Resolver<'_>,
    ) {
        if let Some(line) = self.0.insert(key, at.line) {
            let message = format!("{} already (line {line}); which one counts?", what());
            resolver.faults.push(at.fault(message));
        }
    }
}

/// The outer faces that are meant.
fn faces(
    region: &Region,
    letter: &str,
    outer: &HashSet<Face>,
    at: &Location,
    resolver: &mut Resolver<'_>,
) -> Vec<Face> {
    let faces = match region.part {
        Part::Surface => resolver.surface(&region.target, at),
        Part::Side(side) => {
            let elements = resolver.elements(&region.target, at).into_iter();
            elements.map(|element| Face { element, side }).collect()
        }
        Part::Volume => Vec::new(),
    };
    for face in faces.iter().filter(|face| !outer.contains(face)) {
        let (side, id) = (face.side + 1, resolver.mesh.elements[face.element].id);
        resolver.faults.push(at.fault(format!(
            "side {letter}{side} of element {id} lies inside the structure, between two elements"
        )));
    }
    faces
}

fn initial(path: &Path, resolver: &mut Resolver<'_>) -> Option<Vec<f64>> {
    let mut initial: Vec<Option<f64>> = vec![None; resolver.mesh.nodes.len()];
    for (target, temperature, at) in &resolver.raw.initial {
        for node in resolver.nodes(target, at) {
            let other = initial[node].replace(*temperature);
            if other.is_some_and(|other| other.to_bits() != temperature.to_bits()) {
                let node = resolver.mesh.nodes[node];
                let message = format!("node {node} starts at another temperature already");
                resolver.faults.push(at.fault(message));
            }
        }
    }
    // A line of the card that is wrong has been reported; what it leaves out is not missed on top.
    let is_reported = resolver.faults.iter().any(|fault| fault.card == "*INITIAL CONDITIONS");
    if let Some(node) = initial.iter().position(Option::is_none).filter(|_| !is_reported) {
        let node = resolver.mesh.nodes[node];
        resolver.faults.push(Fault::of_file(
            path,
            format!(
                "node {node} has no initial temperature: write *INITIAL CONDITIONS, TYPE=TEMPERATURE for all nodes before \
                 *STEP"
            ),
        ));
    }
    initial.into_iter().collect()
}
