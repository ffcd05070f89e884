//! Whether fixed nodes hold a structure: its rigid-body modes, part by part.

use std::collections::HashMap;

use super::element::{cross, dot};
use super::mesh::Mesh;
use super::structure::StructureError;

/// Refuses fixed nodes that leave a part free to move.
///
/// Parts are joined by common faces. One that hangs on another by three nodes that are not on one line is held by it;
/// by an edge or a single node it is hinged.
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
            let still = motion(mesh, nodes, &held);
            if still.is_none() {
                nodes.iter().for_each(|node| held[*node] = true);
            }
            still.is_some()
        });
        let Some(nodes) = loose.first() else { return Ok(()) };
        if loose.len() == before {
            let motion = motion(mesh, nodes, &held).unwrap_or("move");
            return Err(StructureError::Loose { node: mesh.nodes[nodes[0]], nodes: nodes.len(), motion });
        }
    }
}

/// Nodes of each part of the mesh whose elements have common faces, ascending.
fn parts(mesh: &Mesh) -> Vec<Vec<usize>> {
    let mut leader: Vec<usize> = (0..mesh.elements.len()).collect();
    let mut seen = HashMap::with_capacity(2 * mesh.elements.len());
    for (place, element) in mesh.elements.iter().enumerate() {
        for side in 0..4 {
            let other = *seen.entry(mesh.face_key(element, side)).or_insert(place);
            let (a, b) = (lead(&mut leader, place), lead(&mut leader, other));
            leader[a.max(b)] = a.min(b);
        }
    }
    let mut parts: HashMap<usize, Vec<usize>> = HashMap::new();
    for (place, element) in mesh.elements.iter().enumerate() {
        parts.entry(lead(&mut leader, place)).or_default().extend(&element.nodes);
    }
    let mut parts: Vec<Vec<usize>> = parts.into_values().collect();
    for part in &mut parts {
        part.sort_unstable();
        part.dedup();
    }
    parts.sort_unstable();
    parts
}

fn lead(leader: &mut [usize], mut of: usize) -> usize {
    while leader[of] != of {
        leader[of] = leader[leader[of]];
        of = leader[of];
    }
    of
}

/// How a part can still move, if it can.
fn motion(mesh: &Mesh, nodes: &[usize], held: &[bool]) -> Option<&'static str> {
    let mut fixed = nodes.iter().filter(|node| held[**node]).map(|node| mesh.xyz[*node]);
    let Some(first) = fixed.next() else { return Some("move and turn in every direction") };
    let arms: Vec<[f64; 3]> =
        fixed.map(|place| [place[0] - first[0], place[1] - first[1], place[2] - first[2]]).collect();
    let Some(longest) = arms.iter().max_by(|a, b| dot(**a, **a).total_cmp(&dot(**b, **b))) else {
        return Some("turn about one node");
    };
    // A millionth of the length: where rounding of coordinates alone would hold the part.
    let least = 1e-12 * dot(*longest, *longest).powi(2);
    let spans = |arm: &[f64; 3]| {
        let normal = cross(*longest, *arm);
        dot(normal, normal) > least
    };
    if arms.iter().any(spans) { None } else { Some("turn about the line through its fixed nodes") }
}
