//! Which nodes touch, and in which order to eliminate them.
//!
//! Nested dissection by coordinates: a set of nodes is cut across one of its axes at the median; the nodes of one half
//! that touch the other half are eliminated last. Of the three axes the one with the fewest such nodes is taken: a hollow
//! casting has cuts that are far smaller than a solid's.

use super::mesh::Mesh;

/// Neighbours of each node, ascending, itself left out.
pub(super) struct Graph {
    start: Vec<usize>,
    neighbours: Vec<usize>,
}

/// Below this many nodes a further cut costs more than it saves.
const LEAF: usize = 40;

impl Graph {
    pub(super) fn of(mesh: &Mesh) -> Self {
        let count = mesh.nodes.len();
        // Elements of each node, then the union of their nodes: no list of pairs, whose memory a large mesh would feel.
        let mut start = vec![0; count + 1];
        for node in mesh.elements.iter().flat_map(|element| &element.nodes) {
            start[node + 1] += 1;
        }
        for node in 0..count {
            start[node + 1] += start[node];
        }
        let mut fill = start.clone();
        let mut around = vec![0; start[count]];
        for (place, element) in mesh.elements.iter().enumerate() {
            for node in &element.nodes {
                around[fill[*node]] = place;
                fill[*node] += 1;
            }
        }
        let mut graph = Self { start: Vec::with_capacity(count + 1), neighbours: Vec::new() };
        graph.start.push(0);
        let mut seen = vec![usize::MAX; count];
        for node in 0..count {
            seen[node] = node;
            let begin = graph.neighbours.len();
            for element in &around[start[node]..start[node + 1]] {
                for other in &mesh.elements[*element].nodes {
                    if seen[*other] != node {
                        seen[*other] = node;
                        graph.neighbours.push(*other);
                    }
                }
            }
            graph.neighbours[begin..].sort_unstable();
            graph.start.push(graph.neighbours.len());
        }
        graph
    }

    pub(super) fn neighbours(&self, node: usize) -> &[usize] {
        &self.neighbours[self.start[node]..self.start[node + 1]]
    }

    /// For each node the number of its connected part, from 0.
    pub(super) fn parts(&self) -> Vec<usize> {
        let mut part = vec![usize::MAX; self.start.len() - 1];
        let mut next = 0;
        for seed in 0..part.len() {
            if part[seed] != usize::MAX {
                continue;
            }
            let mut waiting = vec![seed];
            part[seed] = next;
            while let Some(node) = waiting.pop() {
                for other in self.neighbours(node) {
                    if part[*other] == usize::MAX {
                        part[*other] = next;
                        waiting.push(*other);
                    }
                }
            }
            next += 1;
        }
        part
    }

    /// The nodes in an order of elimination with little fill.
    pub(super) fn order(&self, xyz: &[[f64; 3]], nodes: Vec<usize>) -> Vec<usize> {
        let mut order = Vec::with_capacity(nodes.len());
        let mut side = vec![0; xyz.len()];
        self.dissect(xyz, nodes, &mut side, &mut 0, &mut order);
        order
    }

    /// `side` marks the nodes of the right half by a number no other cut uses.
    fn dissect(
        &self,
        xyz: &[[f64; 3]],
        nodes: Vec<usize>,
        side: &mut [u32],
        cut: &mut u32,
        order: &mut Vec<usize>,
    ) {
        if nodes.len() <= LEAF {
            order.extend(nodes);
            return;
        }
        let mut best: Option<Cut> = None;
        for axis in 0..3 {
            let found = self.cut(xyz, &nodes, axis, side, cut);
            if best.as_ref().is_none_or(|best| found.separator.len() < best.separator.len()) {
                best = Some(found);
            }
        }
        let Some(Cut { left, right, separator }) = best else { return };
        if left.is_empty() || right.is_empty() {
            order.extend(left.into_iter().chain(right).chain(separator));
            return;
        }
        drop(nodes);
        self.dissect(xyz, left, side, cut, order);
        self.dissect(xyz, right, side, cut, order);
        order.extend(separator);
    }

    fn cut(&self, xyz: &[[f64; 3]], nodes: &[usize], axis: usize, side: &mut [u32], cut: &mut u32) -> Cut {
        let mut sorted = nodes.to_vec();
        let middle = sorted.len() / 2;
        sorted.select_nth_unstable_by(middle, |a, b| xyz[*a][axis].total_cmp(&xyz[*b][axis]).then(a.cmp(b)));
        let upper = sorted.split_off(middle);
        *cut += 2;
        let (below, above) = (*cut - 1, *cut);
        sorted.iter().for_each(|node| side[*node] = below);
        upper.iter().for_each(|node| side[*node] = above);
        let touches =
            |node: &usize, other: u32| self.neighbours(*node).iter().any(|node| side[*node] == other);
        let (left_edge, left): (Vec<_>, Vec<_>) = sorted.iter().partition(|node| touches(node, above));
        let (right_edge, right): (Vec<_>, Vec<_>) = upper.iter().partition(|node| touches(node, below));
        if left_edge.len() < right_edge.len() {
            Cut { left, right: upper, separator: left_edge }
        } else {
            Cut { left: sorted, right, separator: right_edge }
        }
    }
}

struct Cut {
    left: Vec<usize>,
    right: Vec<usize>,
    separator: Vec<usize>,
}
