//! Test bodies of cast iron as tetrahedra, for benchmarks and tests.
//!
//! A machine column with any element size has walls, ribs and two guide rails. It is 700 mm wide (x), 1500 mm high (y),
//! 480 mm deep (z), and hollow. The front is at positive z, and carries the rails. The other body is a small block.

#![allow(dead_code, reason = "each of the tests uses its part")]

use std::collections::BTreeMap;

use isotherm_placement::body::{Case, Film, Flux, LoadCase, Material, Materials};
use isotherm_placement::grid::Grid;
use isotherm_placement::mesh::{Face, Kind, Mesh};

const WIDTH: f64 = 700.0;
const HEIGHT: f64 = 1500.0;
const DEPTH: f64 = 480.0;
const WALL: f64 = 40.0;

/// Centres of the rails across the width, and half the width of a rail, mm.
const RAILS: [f64; 2] = [-200.0, 200.0];
const HALF_RAIL: f64 = 45.0;

/// A machine column as a mesh, and its material.
#[derive(Debug, Clone)]
pub(crate) struct Column {
    /// Mesh with the node sets `ALL`, `BASE` (the foot), `GUIDE` (the front of the rails, left rail first, upwards) and
    /// `BLK1` to `BLK8`.
    pub(crate) mesh: Mesh,
    /// Cast iron for all elements.
    pub(crate) materials: Materials,
}

/// Heat source of the column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Warming {
    /// Air that is warmer with height.
    Air,
    /// Spindle on the front, in the upper half.
    Spindle,
    /// Spindle on the front for one hour, from a cold column: a transient case.
    SpindleHour,
    /// Motor on the top.
    Motor,
    /// Coolant that flows inside the foot.
    Coolant,
    /// All steady sources together.
    All,
}

impl Warming {
    /// All heat sources.
    pub(crate) const EACH: [Self; 6] =
        [Self::Air, Self::Spindle, Self::SpindleHour, Self::Motor, Self::Coolant, Self::All];

    /// Name of the load case.
    #[must_use]
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Air => "air",
            Self::Spindle => "spindle",
            Self::SpindleHour => "spindle_hour",
            Self::Motor => "motor",
            Self::Coolant => "coolant",
            Self::All => "all",
        }
    }
}

impl Column {
    /// Makes a column of cells of about `cell` mm, each divided into six tetrahedra. Walls are at least one cell thick.
    ///
    /// With quadratic elements, it has about 6,000 nodes at 80 mm and 26,000 at 40 mm.
    #[must_use]
    pub(crate) fn new(cell: f64, kind: Kind) -> Self {
        let size = [WIDTH, HEIGHT, DEPTH];
        let cells = size.map(|length| count(length / cell));
        let grid = Grid { cells, size, origin: [-WIDTH / 2.0, 0.0, -DEPTH / 2.0] };
        let wall = WALL.max(cell);
        let mut mesh = grid.mesh(kind, |at| is_iron(at, wall), |at| at);
        mesh.node_sets = node_sets(&mesh);
        mesh.element_sets = BTreeMap::from([("ALL".to_owned(), (0..mesh.elements.len()).collect())]);
        let materials = iron(&mesh);
        Self { mesh, materials }
    }

    /// Load case that starts at 20 °C.
    #[must_use]
    pub(crate) fn load(&self, warming: Warming) -> LoadCase {
        let is = |one| warming == one || warming == Warming::All;
        let hour = Case::Transient { step: 300.0, period: 3600.0 };
        let case = if warming == Warming::SpindleHour { hour } else { Case::Steady };
        let mut load = calm(&self.mesh, case);
        for face in self.mesh.outer_faces() {
            let [x, y, z] = self.middle(face);
            let inside =
                x.abs() < WIDTH / 2.0 - 1.0 && y > 1.0 && y < HEIGHT - 1.0 && z.abs() < DEPTH / 2.0 - 1.0;
            let sink = if is(Warming::Air) { 20.0 + 6.0 * y / HEIGHT } else { 20.0 };
            let film = match inside {
                true if is(Warming::Coolant) && y < 300.0 => Film { face, sink: 27.0, coefficient: 0.1 },
                true => Film { face, sink: 20.0, coefficient: 0.002 },
                false => Film { face, sink, coefficient: 0.008 },
            };
            // The foot is on the ground, and has no film.
            if y > 1.0 {
                load.films.push(film);
            }
            let on_front = z > DEPTH / 2.0 - 1.0 && x.abs() < 160.0 && (800.0..1100.0).contains(&y);
            if on_front && (is(Warming::Spindle) || warming == Warming::SpindleHour) {
                load.fluxes.push(Flux::Face(face, 4.0));
            }
            if y > HEIGHT - 1.0 && x.abs() < 120.0 && is(Warming::Motor) {
                load.fluxes.push(Flux::Face(face, 2.5));
            }
        }
        load
    }

    fn middle(&self, face: Face) -> [f64; 3] {
        let element = &self.mesh.elements[face.element];
        let corners =
            element.kind.face(face.side).iter().take(3).map(|place| self.mesh.xyz[element.nodes[*place]]);
        corners.fold([0.0; 3], |sum, at| [0, 1, 2].map(|axis| sum[axis] + at[axis] / 3.0))
    }
}

/// Returns whether this point is inside the iron. The iron is four walls, foot, top, a floor at half height with a
/// hole, and a middle wall in the lower half.
fn is_iron([x, y, z]: [f64; 3], wall: f64) -> bool {
    let near = |at: f64, edge: f64| at > edge - wall;
    let shell = near(x.abs(), WIDTH / 2.0) || near(z.abs(), DEPTH / 2.0) || y < wall || near(y, HEIGHT);
    let floor = (y - 750.0).abs() < wall / 2.0 && (x.abs() > 140.0 || z.abs() > 100.0);
    let middle = x.abs() < wall / 2.0 + 0.01 && y < 750.0;
    shell || floor || middle
}

fn node_sets(mesh: &Mesh) -> BTreeMap<String, Vec<usize>> {
    let mut sets: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (node, [x, y, z]) in mesh.xyz.iter().enumerate() {
        let mut add = |name: &str| sets.entry(name.to_owned()).or_default().push(node);
        add("ALL");
        if *y < 1e-6 {
            add("BASE");
        }
        let on_rail = RAILS.iter().any(|rail| (x - rail).abs() <= HALF_RAIL);
        if *z > DEPTH / 2.0 - 1e-6 && on_rail && (150.0..1450.0).contains(y) {
            add("GUIDE");
        }
        let storey = [375.0, 750.0, 1125.0].iter().filter(|cut| y > cut).count();
        add(&format!("BLK{}", storey + if *z > 0.0 { 5 } else { 1 }));
    }
    thin_guide(mesh, &mut sets);
    sets
}

/// Keeps only the nodes of the rails that are nearest to their centre lines, one for each height and rail.
fn thin_guide(mesh: &Mesh, sets: &mut BTreeMap<String, Vec<usize>>) {
    let Some(guide) = sets.get_mut("GUIDE") else { return };
    let off = |node: usize, rail: f64| (mesh.xyz[node][0] - rail).abs();
    let mut kept = Vec::new();
    for rail in RAILS {
        let mine = || guide.iter().copied().filter(|node| off(*node, rail) <= HALF_RAIL);
        let nearest = mine().map(|node| off(node, rail)).fold(f64::INFINITY, f64::min);
        let Some(line) = mine().find(|node| off(*node, rail) <= nearest).map(|node| mesh.xyz[node][0]) else {
            continue;
        };
        kept.extend(mine().filter(|node| (mesh.xyz[*node][0] - line).abs() < 1e-6));
    }
    kept.sort_unstable();
    *guide = kept;
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "cells along an edge of a column")]
fn count(cells: f64) -> usize {
    cells.round().clamp(1.0, 1000.0) as usize
}

/// Edge lengths of the block, mm.
pub(crate) const SIZE: [f64; 3] = [60.0, 40.0, 50.0];

/// Block with a corner at the origin. Its inner corners are shifted, so that all tetrahedra differ.
pub(crate) fn block(kind: Kind) -> Mesh {
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

/// Cast iron for all elements.
pub(crate) fn iron(mesh: &Mesh) -> Materials {
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

/// Load case that starts at 20 °C, without heat sources.
pub(crate) fn calm(mesh: &Mesh, case: Case) -> LoadCase {
    let initial = vec![20.0; mesh.nodes.len()];
    LoadCase { case, initial, films: vec![], fluxes: vec![], nodal: vec![], held: vec![] }
}

/// Node at a position, which must exist.
pub(crate) fn at(mesh: &Mesh, place: [f64; 3]) -> usize {
    let near = |xyz: &[f64; 3]| (0..3).all(|axis| (xyz[axis] - place[axis]).abs() < 1e-9);
    mesh.xyz.iter().position(near).unwrap_or(usize::MAX)
}

/// Nodes on the surface of the block.
pub(crate) fn on_surface(mesh: &Mesh) -> Vec<usize> {
    let on = |xyz: &[f64; 3]| (0..3).any(|axis| xyz[axis] < 1e-9 || xyz[axis] > SIZE[axis] - 1e-9);
    (0..mesh.nodes.len()).filter(|node| on(&mesh.xyz[*node])).collect()
}
