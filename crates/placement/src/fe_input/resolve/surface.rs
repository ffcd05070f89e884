//! Surfaces by name: from flat elements of the geometry, and from `*SURFACE`.

use std::collections::{BTreeMap, HashMap};

use super::Resolver;
use crate::mesh::{Face, NodeId};

/// Outer faces by the name of their surface. Sets that hold outlines become node sets of the mesh, where there is none of
/// that name; `sets` keeps the solids. A surface that lies inside is none: it has nodes, but nothing flows past it.
pub(super) fn surfaces(resolver: &mut Resolver<'_>, sets: BTreeMap<String, Vec<usize>>) {
    let outlines = outlines(resolver);
    let mesh = &mut resolver.mesh;
    let outer: HashMap<[usize; 3], Face> = (mesh.outer_faces().into_iter())
        .map(|face| (mesh.face_key(&mesh.elements[face.element], face.side), face))
        .collect();
    let solids = mesh.elements.len();
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
        resolver.surfaces.extend(faces.map(|faces| (name.clone(), faces)));
        let mut nodes: Vec<usize> = flat.concat();
        nodes.sort_unstable();
        nodes.dedup();
        mesh.node_sets.entry(name).or_insert(nodes);
    }
    for (name, target, side, at) in &resolver.raw.surfaces {
        let elements = resolver.elements(target, at).into_iter();
        let faces = elements.map(|element| Face { element, side: *side });
        resolver.surfaces.entry(name.clone()).or_default().extend(faces);
    }
}

/// The nodes of each outline.
fn outlines(resolver: &mut Resolver<'_>) -> Vec<Vec<usize>> {
    let mut outlines = Vec::new();
    for (id, nodes, at) in &resolver.raw.outlines {
        let known: Vec<usize> = nodes.iter().filter_map(|node| resolver.mesh.place(NodeId(*node))).collect();
        if known.len() < nodes.len() {
            resolver.faults.push(at.fault(format!("element {id} names a node that is not defined")));
        }
        outlines.push(known);
    }
    outlines
}

/// The corners of a flat triangle, ascending; none for a line.
fn key(nodes: &[usize]) -> Option<[usize; 3]> {
    // A line of three nodes has its middle among them, which is no corner of a face: it is not found.
    let mut key = [*nodes.first()?, *nodes.get(1)?, *nodes.get(2)?];
    key.sort_unstable();
    Some(key)
}
