//! Body made of the grid cells of a box, as a mesh of tetrahedra.

use std::collections::HashMap;

use crate::element::EDGES;
use crate::mesh::{Element, Kind, Mesh, NodeId, count};

/// Box that is divided into grid cells.
#[derive(Debug, Clone, Copy)]
pub struct Grid {
    /// Number of grid cells along each axis.
    pub cells: [usize; 3],
    /// Length of the box along each axis, mm.
    pub size: [f64; 3],
    /// Corner with the smallest coordinates, mm.
    pub origin: [f64; 3],
}

impl Grid {
    /// Meshes the grid cells. A cell is included if `kept` returns true for its centre. `moved` maps each corner to its
    /// position. All coordinates are in mm.
    #[must_use]
    pub fn mesh(
        &self,
        kind: Kind,
        kept: impl Fn([f64; 3]) -> bool,
        moved: impl Fn([f64; 3]) -> [f64; 3],
    ) -> Mesh {
        let mut elements = self.tetrahedra(kept);
        let [nx, ny, nz] = self.cells;
        let each = (0..=nz).flat_map(move |k| (0..=ny).flat_map(move |j| (0..=nx).map(move |i| [i, j, k])));
        let mut xyz: Vec<[f64; 3]> = each.map(|at| moved(self.place(at.map(count)))).collect();
        if kind == Kind::Tet10 {
            add_middles(&mut elements, &mut xyz);
        }
        keep_used(&mut elements, &mut xyz);
        let nodes = (1..=u32::try_from(xyz.len()).unwrap_or(u32::MAX)).map(NodeId).collect();
        Mesh { nodes, xyz, elements, ..Mesh::default() }
    }

    fn corner(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * (self.cells[1] + 1) + j) * (self.cells[0] + 1) + i
    }

    fn place(&self, at: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.origin[axis] + at[axis] * self.size[axis] / count(self.cells[axis]))
    }

    fn tetrahedra(&self, kept: impl Fn([f64; 3]) -> bool) -> Vec<Element> {
        // The six paths along three edges from one corner of a cell to the opposite one.
        const PATHS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
        let [nx, ny, nz] = self.cells;
        let mut elements = Vec::new();
        for cell in (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k]))) {
            if !kept(self.place(cell.map(|at| count(at) + 0.5))) {
                continue;
            }
            for (path, axes) in PATHS.into_iter().enumerate() {
                let mut at = cell;
                let mut nodes = vec![self.corner(at)];
                for axis in axes {
                    at[axis] += 1;
                    nodes.push(self.corner(at));
                }
                // Odd permutations have the opposite orientation.
                if path >= 3 {
                    nodes.swap(1, 2);
                }
                let id = u32::try_from(elements.len() + 1).unwrap_or(u32::MAX);
                elements.push(Element { id, kind: Kind::Tet4, nodes });
            }
        }
        elements
    }
}

/// Converts linear elements to quadratic elements: adds the midpoints of their edges as nodes.
fn add_middles(elements: &mut [Element], xyz: &mut Vec<[f64; 3]>) {
    let mut middles: HashMap<[usize; 2], usize> = HashMap::new();
    for element in elements {
        for edge in EDGES {
            let mut ends = edge.map(|corner| element.nodes[corner]);
            ends.sort_unstable();
            let middle = *middles.entry(ends).or_insert_with(|| {
                let [a, b] = ends.map(|end| xyz[end]);
                xyz.push([0, 1, 2].map(|axis| f64::midpoint(a[axis], b[axis])));
                xyz.len() - 1
            });
            element.nodes.push(middle);
        }
        element.kind = Kind::Tet10;
    }
}

/// Removes nodes that belong to no element.
fn keep_used(elements: &mut [Element], xyz: &mut Vec<[f64; 3]>) {
    let mut number = vec![usize::MAX; xyz.len()];
    elements.iter().flat_map(|element| &element.nodes).for_each(|node| number[*node] = 0);
    let mut kept = Vec::new();
    for (node, number) in number.iter_mut().enumerate().filter(|(_, number)| **number == 0) {
        *number = kept.len();
        kept.push(xyz[node]);
    }
    elements.iter_mut().flat_map(|element| &mut element.nodes).for_each(|node| *node = number[*node]);
    *xyz = kept;
}
