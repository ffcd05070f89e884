//! Surfaces by name: from flat elements of the geometry, and from `*SURFACE`.

use std::collections::{BTreeMap, HashMap};

use super::super::Fault;
use super::super::raw::{Raw, Target};
use crate::mesh::{Face, Mesh, NodeId};

/// Outer faces by the name of their surface. Sets that hold outlines become node sets of the mesh, where there is none of
/// that name; `sets` keeps the solids. A surface that lies inside is none: it has nodes, but nothing flows past it.
pub(super) fn surfaces(
    raw: &Raw,
    mesh: &mut Mesh,
    sets: BTreeMap<String, Vec<usize>>,
    faults: &mut Vec<Fault>,
) -> BTreeMap<String, Vec<Face>> {
    let outer: HashMap<[usize; 3], Face> = (mesh.outer_faces().into_iter())
        .map(|face| (mesh.face_key(&mesh.elements[face.element], face.side), face))
        .collect();
    let outlines = outlines(raw, mesh, faults);
    let solids = mesh.elements.len();
    let mut surfaces: BTreeMap<String, Vec<Face>> = BTreeMap::new();
    for (name, members) in sets {
        let (elements, flat): (Vec<usize>, Vec<usize>) = members.iter().partition(|member| **member < solids);
        if !elements.is_empty() || flat.is_empty() {
            mesh.element_sets.insert(name.clone(), elements);
        }
        if flat.is_empty() {
            continue;
        }
        let flat: Vec<&[usize]> = flat.iter().map(|member| &outlines[member - solids][..]).collect();
        let faces: Option<Vec<Face>> = flat.iter().map(|nodes| outer.get(&key(nodes)?).copied()).collect();
        surfaces.extend(faces.map(|faces| (name.clone(), faces)));
        let mut nodes: Vec<usize> = flat.concat();
        nodes.sort_unstable();
        nodes.dedup();
        mesh.node_sets.entry(name).or_insert(nodes);
    }
    let numbers: HashMap<u32, usize> =
        mesh.elements.iter().enumerate().map(|(place, element)| (element.id, place)).collect();
    for (name, target, side, place) in &raw.surfaces {
        let elements = match target {
            Target::Id(id) => numbers.get(id).map(|at| vec![*at]),
            Target::Set(set) => mesh.element_sets.get(set).cloned(),
        };
        let Some(elements) = elements else {
            faults.push(place.fault("this element or set is not defined"));
            continue;
        };
        let faces = elements.into_iter().map(|element| Face { element, side: *side });
        surfaces.entry(name.clone()).or_default().extend(faces);
    }
    surfaces
}

/// The nodes of each outline.
fn outlines(raw: &Raw, mesh: &Mesh, faults: &mut Vec<Fault>) -> Vec<Vec<usize>> {
    let each = raw.outlines.iter().map(|(id, nodes, place)| {
        let found: Vec<usize> = nodes.iter().filter_map(|node| mesh.place(NodeId(*node))).collect();
        if found.len() < nodes.len() && !raw.spoiled_nodes {
            faults.push(place.fault(format!("element {id} names a node that is not defined")));
        }
        found
    });
    each.collect()
}

/// The corners of a flat triangle, ascending; none for a line.
fn key(nodes: &[usize]) -> Option<[usize; 3]> {
    // A line of three nodes has its middle among them, which is no corner of a face: it is not found.
    let mut key = [*nodes.first()?, *nodes.get(1)?, *nodes.get(2)?];
    key.sort_unstable();
    Some(key)
}
