//! What the sensors are chosen by: the displacement of the guideway, and what the blocks' temperatures say of it.

use nalgebra::{DMatrix, DVector};

/// One block of the structure: its temperature is told by one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Its name.
    pub name: String,
    /// Places of its nodes in the mesh, ascending.
    pub nodes: Vec<usize>,
    /// Those of them that may carry the sensor, ascending; never empty.
    pub candidates: Vec<usize>,
    /// The centre of its volume, mm.
    pub centre: [f64; 3],
}

/// One load case: the structure under one heat load.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Its name.
    pub name: String,
    /// Temperature rise of each node of the mesh, K.
    pub rise: Vec<f64>,
    /// True displacement of the guideway (δ1), mm, rows 3·guide + component.
    pub moved_mm: Vec<f64>,
}

/// The displacement of the guideway in one direction or several, as blocks with one temperature each tell it.
///
/// Everything that methods ask many times is held as products: with P'P, P'δ1 and δ1'δ1 the squared error of any set
/// of block temperatures θ is δ1'δ1 − 2·θ'P'δ1 + θ'P'P·θ, whatever the number of guideway nodes.
#[derive(Clone, Debug)]
pub struct Problem {
    /// The blocks.
    pub blocks: Vec<Block>,
    /// P in these directions: rows guideway nodes, one direction after the other, columns blocks, µm/K.
    pub matrix: DMatrix<f64>,
    square: DMatrix<f64>,
    /// One for each load case.
    pub aims: Vec<Aim>,
}

/// What one load case asks of the blocks.
#[derive(Clone, Debug)]
pub struct Aim {
    /// Name of the load case.
    pub name: String,
    /// δ1 in these directions, µm.
    pub moved: DVector<f64>,
    cross: DVector<f64>,
    power: f64,
    /// For each block the rises of its candidates, K, in their order.
    pub offered: Vec<Vec<f64>>,
    /// For each block the mean rise of all its nodes, K.
    pub mean: Vec<f64>,
    /// For each block the lowest and the highest rise among its nodes, K.
    pub bounds: Vec<(f64, f64)>,
}

const UM_PER_MM: f64 = 1000.0;

impl Problem {
    /// From P (rows 3·guide + component, one column per block, mm/K) and the load cases, in these directions (0 x, 1 y,
    /// 2 z).
    #[must_use]
    pub fn new(blocks: Vec<Block>, p: &[Vec<f64>], loads: &[Load], components: &[usize]) -> Problem {
        let rows = in_directions(p, components);
        let matrix = DMatrix::from_fn(rows.len(), blocks.len(), |row, block| rows[row][block] * UM_PER_MM);
        let aims = loads
            .iter()
            .map(|load| {
                let moved = in_directions(&load.moved_mm, components).into_iter().copied();
                Aim::new(load, DVector::from_iterator(rows.len(), moved) * UM_PER_MM, &matrix, &blocks)
            })
            .collect();
        Problem { square: matrix.tr_mul(&matrix), matrix, blocks, aims }
    }

    /// P'P, µm²/K².
    #[must_use]
    pub fn square(&self) -> &DMatrix<f64> {
        &self.square
    }

    /// Rows: guideway nodes, as often as there are directions.
    #[must_use]
    pub fn rows(&self) -> f64 {
        count(self.matrix.nrows())
    }

    /// Root mean square over the guideway of what block temperatures `theta` (rises, K) leave of a case, µm.
    #[must_use]
    pub fn rms(&self, aim: &Aim, theta: &[f64]) -> f64 {
        let theta = DVector::from_column_slice(theta);
        let left = aim.power - 2.0 * theta.dot(&aim.cross) + theta.dot(&(&self.square * &theta));
        (left.max(0.0) / self.rows().max(1.0)).sqrt()
    }

    /// What is left of a case at each guideway node, µm: told minus true.
    #[must_use]
    pub fn left(&self, aim: &Aim, theta: &[f64]) -> Vec<f64> {
        (self.told(theta) - &aim.moved).as_slice().to_vec()
    }

    /// Displacement that block temperatures tell, µm.
    #[must_use]
    pub fn told(&self, theta: &[f64]) -> DVector<f64> {
        &self.matrix * DVector::from_column_slice(theta)
    }

    /// The rises that sensors read in a case; `places` are places in the blocks' lists of candidates.
    #[must_use]
    pub fn read(&self, aim: &Aim, places: &[usize]) -> Vec<f64> {
        places.iter().zip(&aim.offered).map(|(place, offered)| offered[*place]).collect()
    }

    /// What sensors at these candidates leave of a case, µm RMS.
    #[must_use]
    pub fn rms_of(&self, aim: &Aim, places: &[usize]) -> f64 {
        self.rms(aim, &self.read(aim, places))
    }
}

impl Aim {
    fn new(load: &Load, moved: DVector<f64>, matrix: &DMatrix<f64>, blocks: &[Block]) -> Aim {
        let offered: Vec<Vec<f64>> = blocks
            .iter()
            .map(|block| block.candidates.iter().map(|node| load.rise[*node]).collect())
            .collect();
        let mean = blocks
            .iter()
            .map(|block| {
                block.nodes.iter().map(|node| load.rise[*node]).sum::<f64>() / count(block.nodes.len())
            })
            .collect();
        let widest = |(low, high): (f64, f64), rise: f64| (low.min(rise), high.max(rise));
        let bounds = |block: &Block| {
            let rises = block.nodes.iter().map(|node| load.rise[*node]);
            rises.fold((f64::INFINITY, f64::NEG_INFINITY), widest)
        };
        let bounds = blocks.iter().map(bounds).collect();
        Aim {
            name: load.name.clone(),
            cross: matrix.tr_mul(&moved),
            power: moved.norm_squared(),
            moved,
            offered,
            mean,
            bounds,
        }
    }

    /// P'δ1, µm²/K.
    #[must_use]
    pub fn cross(&self) -> &DVector<f64> {
        &self.cross
    }

    /// δ1'δ1, µm².
    #[must_use]
    pub fn power(&self) -> f64 {
        self.power
    }
}

/// Of rows 3·guide + component those of these directions, one direction after the other.
pub(super) fn in_directions<'a, T>(rows: &'a [T], components: &[usize]) -> Vec<&'a T> {
    components.iter().flat_map(|component| rows.iter().skip(*component).step_by(3)).collect()
}

/// A number of things to compute with.
pub(crate) fn count(things: usize) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "nodes of a mesh")]
    let count = things as f64;
    count
}
