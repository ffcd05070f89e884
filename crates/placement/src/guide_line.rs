//! The guideway as one line: displacements of its nodes, and the matrix P, are averaged over the rails. P contains the
//! displacements for each block that is 1 K warmer.

use crate::mesh::{count, range};

/// The guideway as one line: the mean of its rails.
#[derive(Clone, Debug, PartialEq)]
pub struct GuideLine {
    /// Direction in which the guideway extends: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// Number of rails of which the line is the mean.
    pub rails: usize,
    /// Positions of the points along the guideway, mm, ascending.
    pub guide_mm: Vec<f64>,
    /// For each point, the guideway nodes (indices in the list of guideway nodes) and their weights.
    weights: Vec<Vec<(usize, f64)>>,
}

/// Distance below which two points are treated as one point, as a fraction of the length of the guideway.
const SAME: f64 = 1e-4;

impl GuideLine {
    /// Creates the line from the coordinates of the guideway nodes. Without `axis`, the line has the direction in which
    /// the guideway is longest.
    ///
    /// The largest gap across the guideway separates the rails. Each rail is interpolated linearly to the points of all
    /// rails. Several nodes of a rail at one position are treated as one.
    #[must_use]
    pub fn new(guide: &[[f64; 3]], axis: Option<usize>) -> GuideLine {
        let length = |axis: usize| {
            let (low, high) = range(guide.iter().map(|xyz| xyz[axis]));
            high - low
        };
        let longest = || (0..3).max_by(|one, other| length(*one).total_cmp(&length(*other))).unwrap_or(0);
        let axis = axis.unwrap_or_else(longest);
        let same = SAME * length(axis).max(f64::MIN_POSITIVE);
        let mut rails = vec![(0..guide.len()).collect::<Vec<usize>>()];
        for across in (0..3).filter(|across| *across != axis) {
            rails = rails.into_iter().flat_map(|rail| apart(guide, rail, across)).collect();
        }
        let lines: Vec<Vec<(f64, Vec<usize>)>> =
            rails.iter().map(|rail| line(guide, rail, axis, same)).collect();
        let mut guide_mm: Vec<f64> = lines.iter().flatten().map(|(at, _)| *at).collect();
        guide_mm.sort_by(f64::total_cmp);
        guide_mm.dedup_by(|next, kept| *next - *kept <= same);
        let each = 1.0 / count(lines.len().max(1));
        let weights = guide_mm.iter().map(|at| {
            let shares = lines.iter().flat_map(|line| shares(line, *at));
            shares.map(|(node, share)| (node, share * each)).collect()
        });
        GuideLine { axis, rails: rails.len(), weights: weights.collect(), guide_mm }
    }

    /// Returns the mean of a quantity in one direction at each point of the line. `values` contains x, y and z of each
    /// guideway node, one node after the other. `component` selects 0 x, 1 y or 2 z.
    #[must_use]
    pub fn mean(&self, values: &[f64], component: usize) -> Vec<f64> {
        let point = |weights: &Vec<(usize, f64)>| {
            weights.iter().map(|(node, share)| share * values[3 * node + component]).sum()
        };
        self.weights.iter().map(point).collect()
    }
}

/// Divides the nodes into two rails at the largest gap between them, if this gap is more than half of the extent of the
/// nodes. `across` is an axis across the guideway.
fn apart(guide: &[[f64; 3]], mut rail: Vec<usize>, across: usize) -> Vec<Vec<usize>> {
    rail.sort_by(|one, other| guide[*one][across].total_cmp(&guide[*other][across]));
    let at = |place: usize| guide[rail[place]][across];
    let Some(last) = rail.len().checked_sub(1) else { return vec![rail] };
    let extent = at(last) - at(0);
    let gap = |place: usize| at(place) - at(place - 1);
    let widest = (1..rail.len()).max_by(|one, other| gap(*one).total_cmp(&gap(*other)));
    match widest.filter(|place| gap(*place) > 0.5 * extent && extent > 0.0) {
        // A single node is not a rail.
        Some(place) if place > 1 && rail.len() - place > 1 => {
            let far = rail.split_off(place);
            vec![rail, far]
        }
        _ => vec![rail],
    }
}

/// Returns the points of a rail along the guideway: the position in mm, ascending, and the nodes at this position.
fn line(guide: &[[f64; 3]], rail: &[usize], axis: usize, same: f64) -> Vec<(f64, Vec<usize>)> {
    let mut nodes = rail.to_vec();
    nodes.sort_by(|one, other| guide[*one][axis].total_cmp(&guide[*other][axis]));
    let mut points: Vec<(f64, Vec<usize>)> = Vec::new();
    for node in nodes {
        let at = guide[node][axis];
        match points.last_mut() {
            Some((last, nodes)) if at - *last <= same => nodes.push(node),
            _ => points.push((at, vec![node])),
        }
    }
    points
}

/// Returns the nodes of a rail at a position, each with its weight. Between two points, the interpolation uses both
/// points; beyond the ends, it uses the end point.
fn shares(line: &[(f64, Vec<usize>)], at: f64) -> Vec<(usize, f64)> {
    let after = line.partition_point(|(point, _)| *point <= at);
    let (low, high) = (after.saturating_sub(1), after.min(line.len().saturating_sub(1)));
    let span = line[high].0 - line[low].0;
    let share = if span > 0.0 { ((at - line[low].0) / span).clamp(0.0, 1.0) } else { 0.0 };
    let of = |point: usize, share: f64| {
        let nodes = &line[point].1;
        nodes.iter().map(move |node| (*node, share / count(nodes.len())))
    };
    of(low, 1.0 - share).chain(of(high, share)).filter(|(_, share)| *share > 0.0).collect()
}

#[cfg(test)]
mod tests;
