//! Which nodes touch, and in which order to eliminate them.
//!
//! Nested dissection by coordinates: a set of nodes is cut by a plane across one of its axes; the nodes on one side that
//! touch the other side are eliminated last. Of all planes between the outer quarters, across all three axes, the one with
//! the fewest such nodes is taken: a hollow casting has planes that cut far less than others, and on the columns measured
//! half the work remains of what approximate minimum degree leaves.

use crate::mesh::{Mesh, count};

/// Neighbours of each node, ascending, itself left out.
pub(super) struct Graph {
    start: Vec<usize>,
    neighbours: Vec<usize>,
}

/// Below this many nodes a further cut costs more than it saves.
const LEAF: usize = 20;

/// How much dearer a cut counts that leaves everything on one side: small separators matter more than even halves.
const UNEVEN: f64 = 1.0;

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
        let mut rank = vec![OUTSIDE; xyz.len()];
        self.dissect(xyz, nodes, &mut rank, &mut order);
        order
    }

    /// `rank` is scratch for all nodes of the mesh, `OUTSIDE` on entry and on return.
    fn dissect(&self, xyz: &[[f64; 3]], nodes: Vec<usize>, rank: &mut [usize], order: &mut Vec<usize>) {
        let best = (nodes.len() > LEAF)
            .then(|| {
                (0..3)
                    .filter_map(|axis| self.cut(xyz, &nodes, axis, rank))
                    .min_by(|a, b| a.cost.total_cmp(&b.cost))
            })
            .flatten();
        let Some(cut) = best else {
            order.extend(nodes);
            return;
        };
        drop(nodes);
        self.dissect(xyz, cut.left, rank, order);
        self.dissect(xyz, cut.right, rank, order);
        order.extend(cut.separator);
    }

    /// The cheapest cut across an axis: of all planes between the outer quarters the one that the fewest nodes reach
    /// across.
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
        // How many nodes up to a place reach beyond it.
        let mut change = vec![0_i64; sorted.len() + 1];
        for (at, reach) in reaches.iter().enumerate() {
            change[at] += 1;
            change[*reach] -= 1;
        }
        let mut across = 0;
        let mut best: Option<(f64, usize)> = None;
        for (at, change) in change.iter().enumerate().take(3 * sorted.len() / 4) {
            across += change;
            if at < sorted.len() / 4 {
                continue;
            }
            let uneven = count(at.abs_diff(sorted.len() / 2)) / count(sorted.len());
            #[allow(clippy::cast_precision_loss, reason = "a count of nodes")]
            let cost = across as f64 * (1.0 + UNEVEN * uneven);
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, at));
            }
        }
        let (cost, at) = best?;
        let right = sorted.split_off(at + 1);
        let mut place = 0;
        let mut separator = Vec::new();
        sorted.retain(|node| {
            let stays = reaches[place] <= at;
            place += 1;
            if !stays {
                separator.push(*node);
            }
            stays
        });
        Some(Cut { left: sorted, right, separator, cost })
    }
}

const OUTSIDE: usize = usize::MAX;

struct Cut {
    left: Vec<usize>,
    right: Vec<usize>,
    separator: Vec<usize>,
    cost: f64,
}
