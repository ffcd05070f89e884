//! Check whether the fixed nodes prevent every rigid motion of each part of a structure.

use std::collections::{BTreeMap, HashMap};

use crate::element::{cross, dot, minus};
use crate::mesh::{self, AXES, Mesh, range};
use crate::structure::StructureError;

/// Returns an error if the fixed nodes leave a part free to move.
///
/// The elements of a part have common faces. A part is also fixed if it shares three nodes, not on one line, with a
/// fixed part. A part that shares only an edge or a single node can rotate about it.
pub(super) fn holds(mesh: &Mesh, fixed: &[usize]) -> Result<(), StructureError> {
    if fixed.is_empty() {
        return Err(StructureError::NothingFixed);
    }
    let mut held = vec![false; mesh.nodes.len()];
    fixed.iter().for_each(|node| held[*node] = true);
    let mut loose = parts(mesh);
    loop {
        let before = loose.len();
        loose.retain(|nodes| {
            let is_loose = motion(mesh, nodes, &held).is_some();
            if !is_loose {
                nodes.iter().for_each(|node| held[*node] = true);
            }
            is_loose
        });
        let Some(nodes) = loose.first() else { return Ok(()) };
        if loose.len() == before {
            let motion = motion(mesh, nodes, &held).unwrap_or_default();
            return Err(StructureError::Loose { node: mesh.nodes[nodes[0]], nodes: nodes.len(), motion });
        }
    }
}

/// Returns the nodes of each part of the mesh, ascending. The elements of a part have common faces.
fn parts(mesh: &Mesh) -> Vec<Vec<usize>> {
    let mut first_with = HashMap::with_capacity(2 * mesh.elements.len());
    let faces = mesh.elements.iter().enumerate().flat_map(|each| (0..4).map(move |side| (each, side)));
    let joints = faces.map(|((place, element), side)| {
        (place, *first_with.entry(mesh.face_key(element, side)).or_insert(place))
    });
    let mut parts: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (part, element) in mesh::parts(mesh.elements.len(), joints).into_iter().zip(&mesh.elements) {
        parts.entry(part).or_default().extend(&element.nodes);
    }
    let mut parts: Vec<Vec<usize>> = parts.into_values().collect();
    for part in &mut parts {
        part.sort_unstable();
        part.dedup();
    }
    parts.sort_unstable();
    parts
}

/// Maximum distance from a line at which a fixed node counts as on the line, as a share of the size of the
/// part. Fixed nodes on one line do not prevent a rotation about this line. The limit is larger than rounding
/// errors of coordinates, but a support at a thousandth of the size still prevents the rotation.
const ON_LINE: f64 = 3e-5;

/// Returns the possible motion of a part that is not fixed, for example a rotation about the line through all its fixed
/// nodes; `None` if the part cannot move.
fn motion(mesh: &Mesh, nodes: &[usize], held: &[bool]) -> Option<String> {
    let mut places = nodes.iter().filter(|node| held[**node]).map(|node| mesh.xyz[*node]);
    let Some(first) = places.next() else { return Some("move and turn in every direction".to_owned()) };
    let arms: Vec<[f64; 3]> = places.map(|place| minus(place, first)).collect();
    let length = |arm: [f64; 3]| dot(arm, arm).sqrt();
    let longest = arms.iter().copied().max_by(|one, other| length(*one).total_cmp(&length(*other)));
    let line = longest.unwrap_or_default();
    let off = arms.iter().map(|arm| length(cross(*arm, line)) / length(line)).fold(0.0, f64::max);
    let extent = |axis: usize| range(nodes.iter().map(|node| mesh.xyz[*node][axis]));
    let size = (0..3).map(extent).map(|(low, high)| high - low).fold(0.0, f64::max);
    if off > ON_LINE * size {
        return None;
    }
    let along = (0..3).max_by(|one, other| line[*one].abs().total_cmp(&line[*other].abs()));
    Some(format!("turn about a line along {}", AXES[along.unwrap_or_default()]))
}
