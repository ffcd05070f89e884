//! Placement problem: the displacement of the guideway, and its dependence on the block temperatures.

use nalgebra::{DMatrix, DVector};

use crate::mesh::{count, range};

/// Block of the structure. One sensor measures its temperature.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Name of the block.
    pub name: String,
    /// Indices of the nodes of the block in the mesh, ascending.
    pub nodes: Vec<usize>,
    /// Nodes that may carry the sensor, ascending; never empty.
    pub candidates: Vec<usize>,
    /// Centre of the volume of the block, mm.
    pub centre: [f64; 3],
}

/// Result of one load case: temperature rises, and displacement of the guideway.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Name of the load case.
    pub name: String,
    /// Temperature rise of each node of the mesh, K.
    pub rise: Vec<f64>,
    /// Displacement δ1 of the guideway in the load case, mm: x, y and z of each guideway node.
    pub moved_mm: Vec<f64>,
}

impl Load {
    /// Returns the lowest and the highest temperature rise of these nodes, K.
    pub(super) fn bounds(&self, nodes: &[usize]) -> (f64, f64) {
        range(nodes.iter().map(|node| self.rise[*node]))
    }

    /// Returns the displacement δ1 of the guideway in these directions, µm.
    pub(super) fn moved_um(&self, components: &[usize]) -> DVector<f64> {
        let moved = in_directions(&self.moved_mm, components);
        DVector::from_iterator(moved.len(), moved.into_iter().copied()) * UM_PER_MM
    }
}

/// Displacement of the guideway in one or more directions, as a function of one temperature for each block.
///
/// Figures that methods use many times are stored as products P'P, P'δ1 and δ1'δ1. The squared error of any block
/// temperatures θ is δ1'δ1 − 2·θ'P'δ1 + θ'P'P·θ. The time to calculate it does not depend on the number of guideway
/// nodes.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Blocks of the structure, each with one temperature.
    pub blocks: Vec<Block>,
    /// Matrix P in the evaluated directions, µm/K: displacement of the guideway if a block is 1 K warmer. The rows are
    /// guideway nodes, one direction after the other; the columns are blocks.
    pub matrix: DMatrix<f64>,
    /// Product P'P of the transposed matrix P and the matrix P, µm²/K².
    pub(super) square: DMatrix<f64>,
    /// For each load case, the displacement that the block temperatures must reproduce.
    pub targets: Vec<Target>,
}

/// Displacement that the block temperatures must reproduce in one load case, and the temperatures that are possible in
/// this case.
#[derive(Clone, Debug)]
pub struct Target {
    /// Name of the load case.
    pub name: String,
    /// Displacement δ1 of the guideway in the evaluated directions, µm.
    pub moved: DVector<f64>,
    /// Product P'δ1 of the transposed matrix P and the displacement δ1, µm²/K.
    pub(super) cross: DVector<f64>,
    /// Product δ1'δ1: sum of the squares of the displacement, µm².
    pub(super) power: f64,
    /// For each block, the temperature rises of its candidate nodes, K, in the order of [`Block::candidates`].
    pub offered: Vec<Vec<f64>>,
    /// For each block, the mean temperature rise of its nodes, K.
    pub mean: Vec<f64>,
    /// For each block, the lowest and highest temperature rise of its nodes, K.
    pub bounds: Vec<(f64, f64)>,
}

pub(super) const UM_PER_MM: f64 = 1000.0;

impl Problem {
    /// Creates the problem from P and the load cases, in these directions (0 x, 1 y, 2 z). P, mm/K, has three rows (x,
    /// y, z) for each guideway node, and one column for each block.
    #[must_use]
    pub fn new(blocks: Vec<Block>, p: &[Vec<f64>], loads: &[Load], components: &[usize]) -> Problem {
        let rows = in_directions(p, components);
        let matrix = DMatrix::from_fn(rows.len(), blocks.len(), |row, block| rows[row][block] * UM_PER_MM);
        let target = |load: &Load| {
            let moved = load.moved_um(components);
            let rises = |nodes: &[usize]| -> Vec<f64> { nodes.iter().map(|node| load.rise[*node]).collect() };
            let mean = |block: &Block| rises(&block.nodes).iter().sum::<f64>() / count(block.nodes.len());
            Target {
                name: load.name.clone(),
                cross: matrix.tr_mul(&moved),
                power: moved.norm_squared(),
                moved,
                offered: blocks.iter().map(|block| rises(&block.candidates)).collect(),
                mean: blocks.iter().map(mean).collect(),
                bounds: blocks.iter().map(|block| load.bounds(&block.nodes)).collect(),
            }
        };
        let targets = loads.iter().map(target).collect();
        Problem { square: matrix.tr_mul(&matrix), matrix, blocks, targets }
    }

    /// Returns the number of rows: guideway nodes times directions.
    #[must_use]
    pub fn rows(&self) -> f64 {
        count(self.matrix.nrows())
    }

    /// Returns the displacement P·θ of the guideway for the block temperatures θ (rises, K), µm.
    #[must_use]
    pub fn evaluate(&self, theta: &[f64]) -> DVector<f64> {
        &self.matrix * DVector::from_column_slice(theta)
    }

    /// Returns the residual of a case with block temperatures `theta` (rises, K), µm RMS over the guideway.
    #[must_use]
    pub fn rms(&self, target: &Target, theta: &[f64]) -> f64 {
        let theta = DVector::from_column_slice(theta);
        let left = target.power - 2.0 * theta.dot(&target.cross) + theta.dot(&(&self.square * &theta));
        (left.max(0.0) / self.rows().max(1.0)).sqrt()
    }

    /// Returns the temperature rises that sensors at these candidate nodes measure in a load case, K. `places` are
    /// indices in the blocks' lists of candidates.
    #[must_use]
    pub fn readings(&self, target: &Target, places: &[usize]) -> Vec<f64> {
        places.iter().zip(&target.offered).map(|(place, offered)| offered[*place]).collect()
    }

    /// Returns the residual error of a load case with sensors at these candidate nodes, µm RMS.
    #[must_use]
    pub fn rms_of(&self, target: &Target, places: &[usize]) -> f64 {
        self.rms(target, &self.readings(target, places))
    }

    /// Returns the residual error of each load case with sensors at these candidate nodes, µm RMS.
    #[must_use]
    pub fn rms_of_each(&self, places: &[usize]) -> Vec<f64> {
        self.targets.iter().map(|target| self.rms_of(target, places)).collect()
    }
}

/// Selects the rows of these directions from a matrix with three rows (x, y, z) for each guideway node. The result
/// contains all nodes in the first direction, then all nodes in the next.
pub(super) fn in_directions<'a, T>(rows: &'a [T], components: &[usize]) -> Vec<&'a T> {
    components.iter().flat_map(|component| rows.iter().skip(*component).step_by(3)).collect()
}
