//! Symmetric positive definite system over the free nodes of a mesh. A node is free if its value is unknown, not fixed
//! or prescribed. The system is assembled, factored once, and solved for many right-hand sides.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

use crate::graph::Graph;

/// Number of equations (matrix rows) up to which threads cost more time than they save.
const SMALL: usize = 30_000;

/// Sparsity pattern of a system over the free nodes of a mesh: positions of the matrix entries that can be nonzero.
struct Pattern {
    /// For each node of the mesh, its number among the free nodes; `None` for a fixed node.
    free: Vec<Option<usize>>,
    /// Number of rows of a right-hand side: the number of equations.
    size: usize,
    /// Index in `rows` at which each column of the matrix begins.
    start: Vec<usize>,
    /// Row number of each matrix entry, ascending in each column.
    rows: Vec<usize>,
    /// Elimination order, and structure of the Cholesky factor. Both depend only on the pattern. `None` if they cannot
    /// be determined.
    symbolic: Option<Arc<SymbolicCholesky<usize>>>,
}

/// Lower triangle of a symmetric matrix, with `WIDTH` rows and columns for each free node.
#[derive(Clone)]
pub(super) struct System<const WIDTH: usize> {
    pattern: Arc<Pattern>,
    values: Vec<f64>,
}

impl<const WIDTH: usize> System<WIDTH> {
    /// Creates a matrix of zeros over the free nodes. A node is free if its value in `held` is `false`.
    pub(super) fn new(graph: &Graph, xyz: &[[f64; 3]], held: &[bool]) -> Self {
        let nodes: Vec<usize> = (0..xyz.len()).filter(|node| !held[*node]).collect();
        let mut free = vec![None; xyz.len()];
        for (number, node) in nodes.iter().enumerate() {
            free[*node] = Some(number);
        }
        let (mut start, mut rows) = (vec![0], Vec::new());
        for (number, node) in nodes.iter().enumerate() {
            let after: Vec<usize> = graph.neighbours(*node).iter().filter_map(|node| free[*node]).collect();
            let after = &after[after.partition_point(|other| *other < number)..];
            for column in 0..WIDTH {
                rows.extend((column..WIDTH).map(|row| WIDTH * number + row));
                rows.extend(after.iter().flat_map(|other| (0..WIDTH).map(move |row| WIDTH * other + row)));
                start.push(rows.len());
            }
        }
        let order: Vec<usize> = graph.order(xyz, nodes).into_iter().filter_map(|node| free[node]).collect();
        let symbolic = eliminated::<WIDTH>(&order, &start, &rows).map(Arc::new);
        let values = vec![0.0; rows.len()];
        let size = WIDTH * order.len();
        Self { pattern: Arc::new(Pattern { free, size, start, rows, symbolic }), values }
    }

    /// Returns the number of a node of the mesh among the free nodes; `None` for a fixed node.
    pub(super) fn free(&self, node: usize) -> Option<usize> {
        self.pattern.free[node]
    }

    /// Adds a block of values that couples two free nodes: `block[row][column]` with the rows of node `row` and the
    /// columns of node `column`. Both are numbers among the free nodes. The block is stored only if `row ≥ column`.
    pub(super) fn add(&mut self, row: usize, column: usize, block: &[[f64; WIDTH]; WIDTH]) {
        if row < column {
            return;
        }
        let Pattern { start, rows, .. } = &*self.pattern;
        let first = WIDTH * column;
        let Ok(place) = rows[start[first]..start[first + 1]].binary_search(&(WIDTH * row)) else { return };
        for (under, values) in block.iter().enumerate() {
            for (at, value) in values.iter().enumerate().filter(|(at, _)| row > column || *at <= under) {
                // Each column of a node begins one row below the column before.
                self.values[start[first + at] + place + under - at] += value;
            }
        }
    }

    /// Returns the number of rows of a right-hand side.
    pub(super) fn size(&self) -> usize {
        self.pattern.size
    }

    /// Returns a matrix of zeros with the same pattern.
    pub(super) fn zeroed(&self) -> Self {
        Self { pattern: Arc::clone(&self.pattern), values: vec![0.0; self.values.len()] }
    }

    /// Returns this matrix plus `factor` times another matrix over the same nodes.
    pub(super) fn plus(&self, factor: f64, other: &Self) -> Self {
        let sum = self.values.iter().zip(&other.values).map(|(own, other)| own + factor * other).collect();
        Self { pattern: Arc::clone(&self.pattern), values: sum }
    }

    /// Calculates the Cholesky factor of the matrix; `None` if the matrix is not positive definite.
    pub(super) fn factor(&self) -> Option<Factor<WIDTH>> {
        let Pattern { size, start, rows, symbolic, .. } = &*self.pattern;
        let symbolic = symbolic.as_ref()?;
        let pattern = SymbolicSparseColMatRef::new_checked(*size, *size, start, None, rows);
        let mut values = vec![0.0; symbolic.len_val()];
        let parallel = if *size > SMALL { Par::rayon(0) } else { Par::Seq };
        let mut memory =
            MemBuffer::new(symbolic.factorize_numeric_llt_scratch::<f64>(parallel, Default::default()));
        symbolic
            .factorize_numeric_llt(
                &mut values,
                SparseColMatRef::new(pattern, &self.values),
                Side::Lower,
                LltRegularization::default(),
                parallel,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .ok()?;
        Some(Factor { pattern: Arc::clone(&self.pattern), symbolic: Arc::clone(symbolic), values })
    }
}

/// Determines the structure of the Cholesky factor if the free nodes are eliminated in this order; `None` if that
/// fails.
fn eliminated<const WIDTH: usize>(
    order: &[usize],
    start: &[usize],
    rows: &[usize],
) -> Option<SymbolicCholesky<usize>> {
    let forward: Vec<usize> =
        order.iter().flat_map(|node| (0..WIDTH).map(move |row| WIDTH * node + row)).collect();
    let size = forward.len();
    let mut inverse = vec![0; size];
    for (to, from) in forward.iter().enumerate() {
        inverse[*from] = to;
    }
    let pattern = SymbolicSparseColMatRef::new_checked(size, size, start, None, rows);
    let parameters = CholeskySymbolicParams {
        supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
        ..CholeskySymbolicParams::default()
    };
    let order = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, size));
    factorize_symbolic_cholesky(pattern, Side::Lower, order, parameters).ok()
}

impl System<1> {
    /// Returns the product of the matrix with the values of all nodes of the mesh. Fixed nodes are left out.
    pub(super) fn times(&self, values: &[f64]) -> Vec<f64> {
        let Pattern { free, start, rows, .. } = &*self.pattern;
        let own: Vec<f64> =
            free.iter().zip(values).filter_map(|(free, value)| free.map(|_| *value)).collect();
        let mut product = vec![0.0; own.len()];
        for (column, range) in start.windows(2).enumerate() {
            let entries = range[0]..range[1];
            for (row, value) in rows[entries.clone()].iter().zip(&self.values[entries]) {
                product[*row] += value * own[column];
                if *row != column {
                    product[column] += value * own[*row];
                }
            }
        }
        product
    }
}

/// Cholesky factor of a system of equations. The factor solves the system for any right-hand side.
pub(super) struct Factor<const WIDTH: usize> {
    pattern: Arc<Pattern>,
    symbolic: Arc<SymbolicCholesky<usize>>,
    values: Vec<f64>,
}

impl<const WIDTH: usize> Factor<WIDTH> {
    /// Returns for each node of the mesh its number among the free nodes; `None` for a fixed node.
    pub(super) fn free(&self) -> &[Option<usize>] {
        &self.pattern.free
    }

    /// Returns the number of rows of a right-hand side: `WIDTH` for each free node.
    pub(super) fn rows(&self) -> usize {
        self.symbolic.nrows()
    }

    /// Returns the number of values in the Cholesky factor, a measure of its memory.
    pub(super) fn stored(&self) -> usize {
        self.values.len()
    }

    /// Replaces the right-hand sides, one in each column, by their solutions.
    pub(super) fn solve(&self, mut sides: MatMut<'_, f64>) {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let each = sides.ncols().div_ceil(threads).max(1);
        // Columns are independent: each thread passes through the factor once, for its own columns.
        std::thread::scope(|scope| {
            while sides.ncols() > 0 {
                let some = each.min(sides.ncols());
                let (some, rest) = sides.split_at_col_mut(some);
                sides = rest;
                scope.spawn(|| self.solve_some(some));
            }
        });
    }

    fn solve_some(&self, sides: MatMut<'_, f64>) {
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(sides.ncols(), Par::Seq);
        let mut memory = MemBuffer::new(scratch);
        LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            sides,
            Par::Seq,
            MemStack::new(&mut memory),
        );
    }
}
