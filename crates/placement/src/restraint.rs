//! Whether supports hold a structure: its rigid-body modes, part by part.

use std::collections::HashMap;

use nalgebra::{SMatrix, SVector};

use crate::element::cross;
use crate::mesh::Mesh;
use crate::structure::StructureError;

/// For each node the directions x, y, z in which it cannot move.
pub(super) type Held = Vec<[bool; 3]>;

const FREE: [bool; 3] = [false; 3];

/// Refuses supports that leave a part free to move.
///
/// Parts are joined by common faces. One that hangs on another by three nodes that are not on one line is held by it;
/// by an edge or a single node it is hinged.
pub(super) fn holds(mesh: &Mesh, supports: &[[bool; 3]]) -> Result<(), StructureError> {
    if supports.iter().all(|held| *held == FREE) {
        return Err(StructureError::NothingFixed);
    }
    let mut held: Held = supports.to_vec();
    let mut loose = parts(mesh);
    loop {
        let before = loose.len();
        loose.retain(|nodes| {
            let still = motion(mesh, nodes, &held);
            if still.is_none() {
                nodes.iter().for_each(|node| held[*node] = [true; 3]);
            }
            still.is_some()
        });
        let Some(nodes) = loose.first() else { return Ok(()) };
        if loose.len() == before {
            let motion = motion(mesh, nodes, &held).unwrap_or_default();
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

/// Below this share of the stiffest mode a mode is not held: rounding of coordinates alone must not hold it, and a
/// support a thousandth of the part's size apart still does.
const NOT_HELD: f64 = 1e-9;

/// How a part can still move, if it can: the rigid-body mode that its supports feel least.
fn motion(mesh: &Mesh, nodes: &[usize], held: &[[bool; 3]]) -> Option<String> {
    let count = f64::from(u32::try_from(nodes.len()).unwrap_or(u32::MAX));
    let sum = nodes.iter().fold([0.0; 3], |sum, node| add(sum, mesh.xyz[*node]));
    let middle = sum.map(|sum| sum / count);
    let arm = |node: usize| [0, 1, 2].map(|axis| mesh.xyz[node][axis] - middle[axis]);
    let reach = nodes.iter().flat_map(|node| arm(*node)).fold(0.0, |most: f64, arm| most.max(arm.abs()));
    // What the supports feel of three translations and of three rotations that move the farthest node as far.
    let mut felt = SMatrix::<f64, 6, 6>::zeros();
    let mut supports = 0;
    for node in nodes {
        let turns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| cross(axis, arm(*node)));
        for (axis, _) in held[*node].iter().enumerate().filter(|(_, held)| **held) {
            supports += 1;
            let mut row = SVector::<f64, 6>::zeros();
            row[axis] = 1.0;
            (0..3).for_each(|turn| row[3 + turn] = turns[turn][axis] / reach);
            felt += row * row.transpose();
        }
    }
    if supports == 0 {
        return Some("move and turn in every direction".to_owned());
    }
    let modes = felt.symmetric_eigen();
    let least = modes.eigenvalues.imin();
    if modes.eigenvalues[least] > NOT_HELD * modes.eigenvalues.max() {
        return None;
    }
    let mode: Vec<f64> = modes.eigenvectors.column(least).iter().map(|part| part.abs()).collect();
    let turns = mode[3..].iter().any(|part| *part > 0.1);
    let (shown, verb) =
        if turns { (&mode[3..], "turn about a line along") } else { (&mode[..3], "move along") };
    let most = (0..3).max_by(|a, b| shown[*a].total_cmp(&shown[*b])).unwrap_or_default();
    Some(format!("{verb} {}", ["x", "y", "z"][most]))
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
