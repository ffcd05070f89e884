//! Graph of the nodes of a mesh, and the order in which a Cholesky factorization eliminates them.
//!
//! The order is nested dissection by coordinates. A plane across one of the axes divides a set of nodes. The nodes on
//! one side that are connected to the other side (the separator) are eliminated last. The search covers all planes
//! between the outer quarters, across all three axes, and selects the plane with the fewest such nodes. A hollow
//! casting has planes with very few such nodes. On the measured columns, this order halves the work compared with
//! approximate minimum degree.

use crate::mesh::{Mesh, count};

/// For each node of the mesh, the other nodes of its elements (neighbours), ascending.
pub(super) struct Graph(Vec<Vec<usize>>);

/// Number of nodes up to which a set is not divided further, because another cut would take more time than it saves.
const LEAF: usize = 20;

/// Weight of the size difference between the two sides in the cost of a cut. The weight is low, because a small
/// separator is more important than equal sides.
const UNEVEN: f64 = 1.0;

impl Graph {
    pub(super) fn of(mesh: &Mesh) -> Self {
        let mut around = vec![Vec::new(); mesh.nodes.len()];
        for element in &mesh.elements {
            element.nodes.iter().for_each(|node| around[*node].push(element));
        }
        let mut seen = vec![usize::MAX; mesh.nodes.len()];
        let neighbours = around.into_iter().enumerate().map(|(node, elements)| {
            seen[node] = node;
            let near = elements.into_iter().flat_map(|element| &element.nodes).copied();
            let mut near: Vec<usize> =
                near.filter(|other| std::mem::replace(&mut seen[*other], node) != node).collect();
            near.sort_unstable();
            near.shrink_to_fit();
            near
        });
        Self(neighbours.collect())
    }

    pub(super) fn neighbours(&self, node: usize) -> &[usize] {
        &self.0[node]
    }

    /// Returns an elimination order of the nodes that keeps the Cholesky factor small: with few additional nonzero
    /// values.
    pub(super) fn order(&self, xyz: &[[f64; 3]], nodes: Vec<usize>) -> Vec<usize> {
        let mut order = Vec::with_capacity(nodes.len());
        let mut rank = vec![OUTSIDE; xyz.len()];
        self.dissect(xyz, nodes, &mut rank, &mut order);
        order
    }

    /// Adds the nodes to the elimination order. `rank` is scratch memory for all nodes of the mesh; all its entries are
    /// `OUTSIDE` on entry and on return.
    fn dissect(&self, xyz: &[[f64; 3]], nodes: Vec<usize>, rank: &mut [usize], order: &mut Vec<usize>) {
        let cuts = (0..3).filter(|_| nodes.len() > LEAF).filter_map(|axis| self.cut(xyz, &nodes, axis, rank));
        let Some(cut) = cuts.min_by(|a, b| a.cost.total_cmp(&b.cost)) else { return order.extend(nodes) };
        drop(nodes);
        self.dissect(xyz, cut.left, rank, order);
        self.dissect(xyz, cut.right, rank, order);
        order.extend(cut.separator);
    }

    /// Returns the cheapest cut across an axis: the plane between the outer quarters with the fewest nodes connected
    /// across it. `None` if there is no such plane.
    fn cut(&self, xyz: &[[f64; 3]], nodes: &[usize], axis: usize, rank: &mut [usize]) -> Option<Cut> {
        let mut sorted = nodes.to_vec();
        sorted.sort_unstable_by(|a, b| xyz[*a][axis].total_cmp(&xyz[*b][axis]).then(a.cmp(b)));
        for (at, node) in sorted.iter().enumerate() {
            rank[*node] = at;
        }
        let reach = |node: usize, at: usize| {
            let others =
                self.neighbours(node).iter().map(|other| rank[*other]).filter(|other| *other != OUTSIDE);
            others.fold(at, usize::max)
        };
        let reaches: Vec<usize> = sorted.iter().enumerate().map(|(at, node)| reach(*node, at)).collect();
        sorted.iter().for_each(|node| rank[*node] = OUTSIDE);
        let mut ends = vec![0; sorted.len()];
        reaches.iter().for_each(|reach| ends[*reach] += 1);
        let mut ended = 0;
        let mut best: Option<(f64, usize)> = None;
        for (at, ends) in ends.iter().enumerate().take(3 * sorted.len() / 4) {
            ended += ends;
            if at < sorted.len() / 4 {
                continue;
            }
            let uneven = count(at.abs_diff(sorted.len() / 2)) / count(sorted.len());
            // Number of nodes on this side of the plane that are connected to a node on the other side.
            let cost = count(at + 1 - ended) * (1.0 + UNEVEN * uneven);
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, at));
            }
        }
        let (cost, at) = best?;
        let right = sorted.split_off(at + 1);
        let (mut left, mut separator) = (Vec::new(), Vec::new());
        for (node, reach) in sorted.into_iter().zip(reaches) {
            if reach > at { separator.push(node) } else { left.push(node) }
        }
        Some(Cut { left, right, separator, cost })
    }
}

const OUTSIDE: usize = usize::MAX;

struct Cut {
    left: Vec<usize>,
    right: Vec<usize>,
    separator: Vec<usize>,
    cost: f64,
}
