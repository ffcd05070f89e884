//! Blocks of a structure: parts of its finite-element mesh that have one temperature sensor each. They are made from
//! node sets or cutting planes. The module also finds the nodes of each block that may carry its sensor.

use std::collections::{BTreeMap, HashMap};
use std::str::FromStr;

use crate::element::{cross, dot, minus};
use crate::mesh::{AXES, Kind, Mesh, axis_and_value, range};
use crate::problem::Block;

/// Cutting plane perpendicular to a direction of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Direction: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// Position of the plane in this direction, mm.
    pub at: f64,
    /// Name of the block that the plane divides. If earlier cuts have divided this block, the plane divides its parts.
    /// `None`: the plane divides every block that it intersects.
    pub of: Option<String>,
}

impl FromStr for Cut {
    type Err = String;

    fn from_str(text: &str) -> Result<Cut, String> {
        let (plane, of) = text.split_once(':').map_or((text, None), |(plane, of)| (plane, Some(of.trim())));
        let (axis, at) = axis_and_value(plane)
            .ok_or_else(|| format!("`{text}` is not a cut; write z=450, or x=0:BLK3 for one block only"))?;
        Ok(Cut { axis, at, of: of.filter(|of| !of.is_empty()).map(str::to_owned) })
    }
}

impl std::fmt::Display for Cut {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}={}", AXES[self.axis], self.at)?;
        self.of.iter().try_for_each(|of| write!(f, ":{of}"))
    }
}

/// Name and nodes of one block, before the possible sensor nodes of the block are known.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Name of the block.
    pub name: String,
    /// Indices of the nodes of the block, ascending.
    pub nodes: Vec<usize>,
}

/// Name of the only block, if the mesh has no node sets for blocks.
const WHOLE: &str = "BLK";

/// Divides the mesh into parts. Each node set with a name that begins with `prefix` is one part; without such sets, the
/// whole mesh is one part. The cuts then divide these parts.
///
/// # Errors
/// The mesh has no blocks, a cut divides no block, or a node is not in exactly one part. The messages contain the node
/// numbers.
pub fn parts(mesh: &Mesh, prefix: &str, cuts: &[Cut]) -> Result<Vec<Part>, Vec<String>> {
    let prefix = prefix.to_uppercase();
    let part = |(name, nodes): (&String, &Vec<usize>)| {
        let mut nodes = nodes.clone();
        nodes.sort_unstable();
        Part { name: name.clone(), nodes }
    };
    let named = mesh.node_sets.iter().filter(|(name, _)| name.starts_with(&prefix));
    let mut parts: Vec<Part> = named.map(part).collect();
    if parts.is_empty() && cuts.is_empty() {
        let sets: Vec<&str> = mesh.node_sets.keys().map(String::as_str).collect();
        return Err(vec![format!(
            "there are no blocks: no node set begins with {prefix} (there are: {}). Name the blocks with \
             --blocks, or divide the structure by planes, e.g. --cut z=450 --cut z=900",
            if sets.is_empty() { "none".to_owned() } else { sets.join(", ") }
        )]);
    }
    if parts.is_empty() {
        parts.push(Part { name: WHOLE.to_owned(), nodes: (0..mesh.nodes.len()).collect() });
    }
    let mut wrong = not_disjoint(mesh, &parts);
    if wrong.is_empty() {
        for cut in cuts {
            match divided(mesh, &parts, cut) {
                Ok(cut) => parts = cut,
                Err(why) => wrong.push(why),
            }
        }
    }
    if wrong.is_empty() { Ok(parts) } else { Err(wrong) }
}

/// Returns messages about nodes that are not in exactly one part, and about empty parts.
fn not_disjoint(mesh: &Mesh, parts: &[Part]) -> Vec<String> {
    let owners = owners(mesh, parts);
    let mut wrong = Vec::new();
    let mut twice: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (place, part) in parts.iter().enumerate() {
        for node in &part.nodes {
            if let Some(other) = owners[*node].filter(|other| *other != place) {
                twice.entry((place, other)).or_default().push(*node);
            }
        }
    }
    wrong.extend(twice.into_iter().map(|((one, other), nodes)| {
        format!(
            "{} and {} have {} in common, but every node must be in exactly one block. Remove these nodes \
             from one of the two sets. Sets made from volumes share the nodes of their common face: divide \
             by planes instead, e.g. --cut z=450",
            parts[one].name,
            parts[other].name,
            listed(mesh, &nodes)
        )
    }));
    let left_out: Vec<usize> = (0..owners.len()).filter(|node| owners[*node].is_none()).collect();
    if !left_out.is_empty() {
        wrong.push(format!(
            "{} are in no block ({}), but every node must be in exactly one block. Add these nodes to their \
             block",
            listed(mesh, &left_out),
            names(parts)
        ));
    }
    let empty = parts.iter().filter(|part| part.nodes.is_empty());
    wrong.extend(empty.map(|part| format!("block {} has no node of the mesh", part.name)));
    wrong
}

fn names(parts: &[Part]) -> String {
    parts.iter().map(|part| part.name.as_str()).collect::<Vec<_>>().join(", ")
}

/// Formats a list of nodes: `12 nodes (3, 4, 7, …)`.
fn listed(mesh: &Mesh, nodes: &[usize]) -> String {
    let shown: Vec<String> = nodes.iter().take(8).map(|node| mesh.nodes[*node].to_string()).collect();
    let more = if nodes.len() > shown.len() { ", …" } else { "" };
    let word = if nodes.len() == 1 { "node" } else { "nodes" };
    format!("{} {word} ({}{more})", nodes.len(), shown.join(", "))
}

/// Applies a cut (a cutting plane) to the parts. Each intersected part becomes two parts. The name of the part below
/// the plane gets the suffix `a`, and the name of the part above the plane the suffix `b`.
///
/// # Errors
/// The cut intersects no part, or names a block that does not exist.
pub fn divided(mesh: &Mesh, parts: &[Part], cut: &Cut) -> Result<Vec<Part>, String> {
    let came_from = |name: &str, of: &str| {
        let (name, of) = (name.to_uppercase(), of.to_uppercase());
        name.strip_prefix(&of).is_some_and(|halves| halves.chars().all(|half| "AB".contains(half)))
    };
    let meant = |part: &Part| cut.of.as_ref().is_none_or(|of| came_from(&part.name, of));
    if !parts.iter().any(meant) {
        return Err(format!("--cut {cut}: this block does not exist; the blocks are {}", names(parts)));
    }
    let mut done = Vec::new();
    for part in parts {
        let (below, above): (Vec<usize>, Vec<usize>) =
            part.nodes.iter().partition(|node| mesh.xyz[**node][cut.axis] < cut.at);
        if !meant(part) || below.is_empty() || above.is_empty() {
            done.push(part.clone());
        } else {
            done.push(Part { name: format!("{}a", part.name), nodes: below });
            done.push(Part { name: format!("{}b", part.name), nodes: above });
        }
    }
    if done.len() == parts.len() {
        let nodes = parts.iter().filter(|part| meant(part)).flat_map(|part| &part.nodes);
        let (low, high) = range(nodes.map(|node| mesh.xyz[*node][cut.axis]));
        return Err(format!(
            "--cut {cut} divides no block: along {} {} reaches from {low} to {high} mm",
            AXES[cut.axis],
            cut.of.as_deref().unwrap_or("the structure")
        ));
    }
    Ok(done)
}

/// Returns the index of the part of each node; `None` for a node in no part.
pub(super) fn owners(mesh: &Mesh, parts: &[Part]) -> Vec<Option<usize>> {
    let mut owners = vec![None; mesh.nodes.len()];
    for (place, part) in parts.iter().enumerate() {
        part.nodes.iter().for_each(|node| owners[*node] = Some(place));
    }
    owners
}

/// Nodes at which sensors may be mounted, and their minimum distance from other blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Reach {
    /// Minimum distance from the nodes of other blocks, mm.
    pub margin: f64,
    /// Whether each node of the mesh may carry a sensor. With the option `--candidates`, such a node is on
    /// the outer surface and in the given node set. Without the option, such a node is visible from outside.
    /// Guideway nodes and fixed nodes are excluded.
    pub allowed: Vec<bool>,
}

/// Creates the blocks: each part with the centre of its volume, and the nodes that may carry its sensor.
///
/// # Errors
/// A block has no node that may carry a sensor. The messages contain a remedy.
pub fn blocks(mesh: &Mesh, parts: &[Part], reach: &Reach) -> Result<Vec<Block>, Vec<String>> {
    Surveyed::new(mesh, reach).blocks(parts)
}

/// Mesh with precomputed node volumes and grid cells, which every division into blocks uses.
pub(super) struct Surveyed<'a> {
    mesh: &'a Mesh,
    reach: &'a Reach,
    /// Volume of each node, mm³.
    volumes: Vec<f64>,
    /// Nodes of each grid cell, for the search for near nodes. The side length of a cell is [`Reach::margin`]. If the
    /// margin is 0, the list is empty.
    cells: Vec<Vec<usize>>,
    /// For each grid cell, its own index and the indices of the adjacent cells.
    around: Vec<Vec<usize>>,
}

impl<'a> Surveyed<'a> {
    pub(super) fn new(mesh: &'a Mesh, reach: &'a Reach) -> Surveyed<'a> {
        let (cells, around) = cells(mesh, reach.margin);
        Surveyed { mesh, reach, volumes: volumes(mesh), cells, around }
    }

    /// Creates a block from each part: finds the centre of its volume, and the nodes that may carry its sensor. See
    /// [`blocks`].
    pub(super) fn blocks(&self, parts: &[Part]) -> Result<Vec<Block>, Vec<String>> {
        let Surveyed { mesh, reach, volumes, .. } = self;
        let near = self.near_others(&owners(mesh, parts));
        let mut wrong = Vec::new();
        let mut blocks = Vec::new();
        for part in parts {
            let nodes = || part.nodes.iter().copied();
            let candidates: Vec<usize> =
                nodes().filter(|node| reach.allowed[*node] && !near[*node]).collect();
            if candidates.is_empty() {
                let (name, margin) = (&part.name, reach.margin);
                wrong.push(if nodes().any(|node| reach.allowed[node]) {
                    format!(
                        "no node of block {name} that may carry a sensor is {margin} mm away from every \
                         other block. Use a smaller --margin, a finer mesh, or a larger block"
                    )
                } else {
                    format!(
                        "no node of block {name} may carry a sensor: none is on the outer surface and in the \
                         set of --candidates. The guideway and the foundation carry no sensors. Add nodes of \
                         the block to that set, or join the block to another block"
                    )
                });
            }
            let volume: f64 = nodes().map(|node| volumes[node]).sum();
            let centre = [0, 1, 2]
                .map(|axis| nodes().map(|node| volumes[node] * mesh.xyz[node][axis]).sum::<f64>() / volume);
            blocks.push(Block { name: part.name.clone(), nodes: part.nodes.clone(), candidates, centre });
        }
        if wrong.is_empty() { Ok(blocks) } else { Err(wrong) }
    }

    /// Returns for each node whether it is nearer than the margin to a node of another part, or to a node in no part.
    fn near_others(&self, owners: &[Option<usize>]) -> Vec<bool> {
        let mesh = self.mesh;
        let is_near = |one: usize, other: usize| {
            let way = minus(mesh.xyz[one], mesh.xyz[other]);
            owners[one] != owners[other] && dot(way, way).sqrt() < self.reach.margin
        };
        let mut near = vec![false; owners.len()];
        for (cell, around) in self.cells.iter().zip(&self.around) {
            let others = || around.iter().flat_map(|other| &self.cells[*other]).copied();
            // Most cells lie inside one part.
            let is_one_part = others().all(|other| owners[other] == owners[cell[0]]);
            for node in cell.iter().filter(|_| !is_one_part) {
                near[*node] = others().any(|other| is_near(*node, other));
            }
        }
        near
    }
}

/// Returns the volume of each node, mm³. A corner of a linear tetrahedron gets a quarter of the volume of the
/// tetrahedron. In a quadratic tetrahedron, a corner gets 1/32, and a mid-edge node 7/48. These are the ratios of the
/// lumped masses (Hinton, Rock and Zienkiewicz 1976).
fn volumes(mesh: &Mesh) -> Vec<f64> {
    let mut volumes = vec![0.0; mesh.nodes.len()];
    for element in &mesh.elements {
        let xyz = mesh.corners(element);
        let edge = |corner: usize| minus(xyz[corner], xyz[0]);
        let volume = dot(edge(1), cross(edge(2), edge(3))).abs() / 6.0;
        for (place, node) in element.nodes.iter().enumerate() {
            let share = match (element.kind, place) {
                (Kind::Tet4, _) => 0.25,
                (Kind::Tet10, 0..4) => 1.0 / 32.0,
                (Kind::Tet10, _) => 7.0 / 48.0,
            };
            volumes[*node] += share * volume;
        }
    }
    volumes
}

/// Divides the space into grid cells with sides of `size` mm. Returns two lists: the nodes of each cell, and for each
/// cell its own index together with the indices of the adjacent cells.
fn cells(mesh: &Mesh, size: f64) -> (Vec<Vec<usize>>, Vec<Vec<usize>>) {
    if size <= 0.0 {
        return (Vec::new(), Vec::new());
    }
    let mut nodes: BTreeMap<[i64; 3], Vec<usize>> = BTreeMap::new();
    for (node, xyz) in mesh.xyz.iter().enumerate() {
        #[allow(clippy::cast_possible_truncation, reason = "cells of a structure")]
        let cell = xyz.map(|at| (at / size).floor() as i64);
        nodes.entry(cell).or_default().push(node);
    }
    let places: HashMap<[i64; 3], usize> = nodes.keys().copied().zip(0..).collect();
    let around = |home: &[i64; 3]| {
        let touching = (0..27).map(|step| [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1]);
        let cell = |way: [i64; 3]| [home[0] + way[0], home[1] + way[1], home[2] + way[2]];
        touching.filter_map(|way| places.get(&cell(way)).copied()).collect()
    };
    let around = nodes.keys().map(around).collect();
    (nodes.into_values().collect(), around)
}

#[cfg(test)]
mod tests;
