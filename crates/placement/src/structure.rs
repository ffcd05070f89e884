//! Linear thermo-elasticity: deformation of a supported body as its nodes become warmer. The guideway is the set of
//! nodes along which a machine axis moves. Its sensitivity is the displacement of these nodes per kelvin of each node
//! of the mesh, mm/K.

use faer::{Mat, MatRef};
use rayon::prelude::*;

use crate::body::{Materials, Progress};
use crate::element::{Point, dot, for_each_element, for_each_point};
use crate::fe_input::FeInput;
use crate::graph::Graph;
use crate::heat::{HeatError, temperatures_of_each};
use crate::mesh::{Mesh, NodeId};
use crate::parallel::listening;
use crate::restraint;
use crate::system::{Factor, System};

/// Reason why displacements cannot be calculated.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StructureError {
    /// No node is fixed.
    #[error(
        "no node is fixed: the structure could move freely; name the node set that is fixed to the ground"
    )]
    NothingFixed,
    /// Rigid-body modes remain: the supports do not hold a part of the mesh.
    #[error(
        "the supports do not hold the part with node {node} ({nodes} nodes), which can still {motion}. Fix \
         at least three nodes of this part that are not on one line, or join the parts of the mesh at common \
         faces"
    )]
    Loose {
        /// One node of the part, by which the user finds the part.
        node: NodeId,
        /// Number of nodes of the part.
        nodes: usize,
        /// Motion that the supports do not prevent, in words.
        motion: String,
    },
    /// The stiffness matrix is singular although the supports are sufficient.
    #[error(
        "the displacements of the structure have no solution: an element is nearly flat, or a modulus is wrong"
    )]
    Singular,
}

/// Structure with a factored stiffness matrix. Each field of temperatures then requires one solution of the system.
pub struct Structure<'a> {
    mesh: &'a Mesh,
    materials: &'a Materials,
    factor: Factor<3>,
}

/// Sensitivity matrix: displacement of each guideway node if one node of the structure is 1 K warmer.
#[derive(Debug, Clone, PartialEq)]
pub struct Adjoint {
    /// Number of rows: three (x, y, z) for each guideway node, in the order of the nodes.
    pub rows: usize,
    /// Number of columns of the matrix: nodes of the mesh.
    pub columns: usize,
    /// Values in mm/K, row by row.
    pub values: Vec<f64>,
}

impl Adjoint {
    /// Returns the sensitivity of one displacement component of one guideway node to the temperature of every node of
    /// the mesh, mm/K. The index `row` is 3·node + component.
    #[must_use]
    pub fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.columns..(row + 1) * self.columns]
    }

    /// Returns the column of the matrix P for a block: displacements of the guideway in mm if its `nodes` are 1 K
    /// warmer.
    #[must_use]
    pub fn block(&self, nodes: &[usize]) -> Vec<f64> {
        (0..self.rows).map(|row| nodes.iter().map(|node| self.row(row)[*node]).sum()).collect()
    }

    /// Returns the displacements of the guideway nodes, mm: x, y and z of each node. `rises` contains the temperature
    /// rise of every node of the mesh, K.
    #[must_use]
    pub fn displacements(&self, rises: &[f64]) -> Vec<f64> {
        let one = |row| self.row(row).iter().zip(rises).map(|(each, rise)| each * rise).sum();
        (0..self.rows).map(one).collect()
    }
}

/// Number of right-hand sides that are solved together. A larger number is faster, but needs more memory.
const TOGETHER: usize = 48;

impl<'a> Structure<'a> {
    /// Factors the stiffness of a body with the nodes `fixed` in all directions.
    ///
    /// # Errors
    /// The body can move as a rigid body.
    pub fn new(
        mesh: &'a Mesh,
        materials: &'a Materials,
        fixed: &[usize],
        progress: Progress<'_>,
    ) -> Result<Self, StructureError> {
        restraint::holds(mesh, fixed)?;
        let mut held = vec![false; mesh.nodes.len()];
        fixed.iter().for_each(|node| held[*node] = true);
        progress("stiffness", 0, 2);
        let mut system = System::<3>::new(&Graph::of(mesh), &mesh.xyz, &held);
        for_each_element(mesh, |element, points| {
            let material = materials.of(element);
            let shear = material.young / (2.0 * (1.0 + material.poisson));
            let bulk = 2.0 * shear * material.poisson / (1.0 - 2.0 * material.poisson);
            let nodes = &mesh.elements[element].nodes;
            for (a, node) in nodes.iter().enumerate() {
                let Some(row) = system.free(*node) else { continue };
                for (b, other) in nodes.iter().enumerate() {
                    let Some(column) = system.free(*other).filter(|column| *column <= row) else { continue };
                    let mut block = [[0.0; 3]; 3];
                    for point in points {
                        elastic(&mut block, point, [a, b], bulk, shear);
                    }
                    system.add(row, column, &block);
                }
            }
        });
        progress("stiffness", 1, 2);
        let factor = system.factor().ok_or(StructureError::Singular)?;
        progress("stiffness", 2, 2);
        Ok(Self { mesh, materials, factor })
    }

    /// Calculates the sensitivity of the guideway nodes `guide` to the temperature of every node, by adjoints. An
    /// adjoint is the displacement field of a unit force on one component (x, y or z) of a guideway node. Each
    /// component requires one solution, independently of the number of nodes, blocks and cases.
    #[must_use]
    pub fn guideway(&self, guide: &[usize], progress: Progress<'_>) -> Adjoint {
        let columns = self.mesh.nodes.len();
        let rows = 3 * guide.len();
        let mut values = vec![0.0; rows * columns];
        for begin in (0..rows).step_by(TOGETHER) {
            progress("guideway", begin, rows);
            let end = rows.min(begin + TOGETHER);
            let mut sides = Mat::<f64>::zeros(self.factor.rows(), end - begin);
            for row in begin..end {
                if let Some(number) = self.factor.free()[guide[row / 3]] {
                    sides[(3 * number + row % 3, row - begin)] = 1.0;
                }
            }
            self.factor.solve(sides.as_mut());
            self.gather(&sides, &mut values[begin * columns..end * columns]);
        }
        progress("guideway", rows, rows);
        Adjoint { rows, columns, values }
    }

    /// Calculates the sensitivities from the adjoint displacement fields. Each sensitivity is the work of the thermal
    /// expansion of one node (for 1 K) in one adjoint field.
    fn gather(&self, adjoints: &Mat<f64>, values: &mut [f64]) {
        let columns = self.mesh.nodes.len();
        let each = adjoints.ncols().div_ceil(rayon::current_num_threads()).max(1);
        // Each thread visits the elements once, for its own rows.
        values.par_chunks_mut(columns * each).enumerate().for_each(|(place, values)| {
            let rows = values.len() / columns;
            let own = adjoints.subcols(place * each, rows);
            let works = self.works(&side_by_side(own), rows);
            for (row, values) in values.chunks_exact_mut(columns).enumerate() {
                values
                    .iter_mut()
                    .zip(works.chunks_exact(rows))
                    .for_each(|(value, works)| *value = works[row]);
            }
        });
    }

    /// Returns for each node of the mesh the work of its thermal expansion in each of the `rows` adjoint displacement
    /// fields. `adjoints` contains the values of these fields side by side.
    fn works(&self, adjoints: &[f64], rows: usize) -> Vec<f64> {
        let mut works = vec![0.0; self.mesh.nodes.len() * rows];
        let mut spread = vec![0.0; rows];
        for_each_point(self.mesh, |element, point, _| {
            let nodes = &self.mesh.elements[element].nodes;
            spread.fill(0.0);
            for (node, gradient) in nodes.iter().zip(&point.gradient) {
                let Some(number) = self.factor.free()[*node] else { continue };
                for (axis, gradient) in gradient.iter().enumerate() {
                    add_to(&mut spread, *gradient, &adjoints[(3 * number + axis) * rows..][..rows]);
                }
            }
            let push = self.push(element) * point.volume;
            for (node, value) in nodes.iter().zip(&point.value) {
                add_to(&mut works[node * rows..][..rows], push * value, &spread);
            }
        });
        works
    }

    /// Returns the thermal stress per kelvin of an element that cannot expand, MPa/K.
    fn push(&self, element: usize) -> f64 {
        let material = self.materials.of(element);
        material.young * material.expansion / (1.0 - 2.0 * material.poisson)
    }

    /// Returns the number of values in the Cholesky factor. Each value has 8 bytes.
    #[must_use]
    pub fn stored(&self) -> usize {
        self.factor.stored()
    }
}

/// Calculates two results in parallel. The first is the displacement of the guideway nodes per kelvin of each node, for
/// the mesh and materials of the first file. The second is the temperature rises in the load case of each file.
///
/// # Errors
/// The body can move as a rigid body. The result of a single load case is an error if the load case has no solution.
#[allow(
    clippy::type_complexity,
    reason = "the function returns the sensitivity, and one result for each load case"
)]
pub fn guideway_and_temperatures(
    inputs: &[FeInput],
    fixed: &[usize],
    guide: &[usize],
    progress: Progress<'_>,
) -> Result<(Adjoint, Vec<Result<Vec<f64>, HeatError>>), StructureError> {
    let Some(first) = inputs.first() else { return Err(StructureError::NothingFixed) };
    let (adjoint, rises) = listening(progress, |says| {
        let adjoint = || {
            let structure = Structure::new(&first.mesh, &first.materials, fixed, says)?;
            Ok(structure.guideway(guide, says))
        };
        rayon::join(adjoint, || temperatures_of_each(inputs))
    });
    Ok((adjoint?, rises))
}

/// Transposes a matrix, so that the values of one row are adjacent in memory.
fn side_by_side(columns: MatRef<'_, f64>) -> Vec<f64> {
    let width = columns.ncols();
    let mut rows = vec![0.0; columns.nrows() * width];
    for (place, column) in columns.col_iter().enumerate() {
        rows.iter_mut().skip(place).step_by(width).zip(column.iter()).for_each(|(to, from)| *to = *from);
    }
    rows
}

fn add_to(sums: &mut [f64], factor: f64, values: &[f64]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += factor * value);
}

/// Adds the contribution of one integration point to the stiffness matrix between two nodes of its element.
fn elastic(block: &mut [[f64; 3]; 3], point: &Point, nodes: [usize; 2], bulk: f64, shear: f64) {
    let [a, b] = nodes.map(|node| point.gradient[node]);
    let along = shear * dot(a, b);
    for row in 0..3 {
        for column in 0..3 {
            block[row][column] += point.volume * (bulk * a[row] * b[column] + shear * a[column] * b[row]);
        }
        block[row][row] += point.volume * along;
    }
}

#[cfg(test)]
mod tests;
