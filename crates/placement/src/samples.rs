//! Small bodies for tests.

use crate::body::{Case, LoadCase, Material, Materials};
use crate::grid::Grid;
use crate::mesh::{Kind, Mesh};

/// Edges of the block, mm.
pub(super) const SIZE: [f64; 3] = [60.0, 40.0, 50.0];

/// A block with a corner at the origin; the corners of its tetrahedra inside are shifted, so that no two are alike.
pub(super) fn block(kind: Kind) -> Mesh {
    let grid = Grid { cells: [3, 2, 3], size: SIZE, origin: [0.0; 3] };
    grid.mesh(
        kind,
        |_| true,
        |at| {
            let inside = (0..3).all(|axis| at[axis] > 1.0 && at[axis] < SIZE[axis] - 1.0);
            let shift = |axis: usize| {
                if inside { 3.0 * (at[0] + 2.0 * at[1] + 3.0 * at[2] + axis as f64).sin() } else { 0.0 }
            };
            [0, 1, 2].map(|axis| at[axis] + shift(axis))
        },
    )
}

pub(super) fn iron(mesh: &Mesh) -> Materials {
    let material = Material {
        name: "FC300".to_owned(),
        young: 110_000.0,
        poisson: 0.26,
        expansion: 1.1e-5,
        conductivity: 50.0,
        capacity: Some(5e8 * 7.25e-9),
    };
    Materials::uniform(material, mesh)
}

/// From 20 °C, with nothing that warms.
pub(super) fn calm(mesh: &Mesh, case: Case) -> LoadCase {
    let initial = vec![20.0; mesh.nodes.len()];
    LoadCase { case, initial, films: vec![], fluxes: vec![], nodal: vec![], held: vec![] }
}

/// The node at a place.
pub(super) fn at(mesh: &Mesh, place: [f64; 3]) -> usize {
    let near = |xyz: &[f64; 3]| (0..3).all(|axis| (xyz[axis] - place[axis]).abs() < 1e-9);
    mesh.xyz.iter().position(near).unwrap()
}

/// The nodes of the block that lie on its surface.
pub(super) fn on_surface(mesh: &Mesh) -> Vec<usize> {
    let on = |xyz: &[f64; 3]| (0..3).any(|axis| xyz[axis] < 1e-9 || xyz[axis] > SIZE[axis] - 1e-9);
    (0..mesh.nodes.len()).filter(|node| on(&mesh.xyz[*node])).collect()
}
