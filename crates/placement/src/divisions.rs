//! Lower bound of the residual error for many divisions of a structure into blocks. A block is a part with one
//! temperature sensor. The residual error is the displacement of the guideway that the block temperatures do not
//! predict. With the lower bound, the module finds the best further cut, and the best two blocks to join.

use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::blocks::{Cut, Part, divided, owners};
use crate::mesh::{AXES, Mesh, count, range};
use crate::methods::bounded::least_squares;
use crate::problem::{Load, UM_PER_MM, in_directions};
use crate::structure::Adjoint;

/// Calculator of the lower bound of the residual error for any division of a structure into blocks. The bound applies
/// to all load cases and to the chosen directions.
#[derive(Debug)]
pub struct Floors<'a> {
    mesh: &'a Mesh,
    /// One row for each guideway node and evaluated direction: its displacement if a single node of the mesh is 1 K
    /// warmer, mm/K. The columns are the nodes of the mesh.
    rows: Vec<&'a [f64]>,
    loads: &'a [Load],
    /// Displacement of the guideway in each load case, µm.
    moved: Vec<DVector<f64>>,
}

/// Response and temperature range of one block, from which lower bounds are calculated.
#[derive(Clone, Debug)]
struct Piece {
    /// Displacement of the guideway if this block is 1 K warmer, µm/K: a column of the matrix P.
    column: Vec<f64>,
    /// Lowest and highest temperature rise in the block for each load case, K.
    bounds: Vec<(f64, f64)>,
}

/// Division into blocks after one change: a further cut, or two blocks joined.
#[derive(Clone, Debug, PartialEq)]
pub struct Division {
    /// Additional cut that gives this division; `None` if two parts were joined.
    pub cut: Option<Cut>,
    /// Parts of the mesh after the change; each part is one block.
    pub parts: Vec<Part>,
    /// Lower bound of the residual error with these parts, µm RMS over all guideway nodes and load cases.
    pub floor_um: f64,
}

/// Number of equal intervals into which the tried cutting planes divide a block along a direction.
const PLANES: usize = 9;

impl<'a> Floors<'a> {
    /// Prepares the bound for the displacements in these directions (0 x, 1 y, 2 z).
    #[must_use]
    pub fn new(mesh: &'a Mesh, adjoint: &'a Adjoint, loads: &'a [Load], components: &[usize]) -> Floors<'a> {
        let rows: Vec<usize> = (0..adjoint.rows).collect();
        let rows = in_directions(&rows, components).into_iter().map(|row| adjoint.row(*row));
        let moved = loads.iter().map(|load| load.moved_um(components)).collect();
        Floors { mesh, rows: rows.collect(), loads, moved }
    }

    fn piece(&self, nodes: &[usize]) -> Piece {
        let sum = |row: &&[f64]| nodes.iter().map(|node| row[*node]).sum::<f64>() * UM_PER_MM;
        let bounds = self.loads.iter().map(|load| load.bounds(nodes)).collect();
        Piece { column: self.rows.iter().map(sum).collect(), bounds }
    }

    fn pieces(&self, parts: &[Part]) -> Vec<Piece> {
        parts.iter().map(|part| self.piece(&part.nodes)).collect()
    }

    /// Returns the lower bound of the residual error, µm RMS over guideway and load cases. The blocks of the division
    /// are `pieces` without the indices `gone`, together with the new blocks `made`.
    fn floor(&self, pieces: &[Piece], gone: &[usize], made: &[Piece]) -> f64 {
        let kept =
            pieces.iter().enumerate().filter(|(place, _)| !gone.contains(place)).map(|(_, piece)| piece);
        let pieces: Vec<&Piece> = kept.chain(made).collect();
        let matrix = DMatrix::from_fn(self.rows.len(), pieces.len(), |row, piece| pieces[piece].column[row]);
        let square = matrix.tr_mul(&matrix);
        let left = self.moved.iter().enumerate().map(|(case, moved)| {
            let bounds: Vec<(f64, f64)> = pieces.iter().map(|piece| piece.bounds[case]).collect();
            let theta = least_squares(&square, &matrix.tr_mul(moved), &bounds);
            (moved - &matrix * DVector::from_vec(theta)).norm_squared()
        });
        (left.sum::<f64>() / count((self.rows.len() * self.moved.len()).max(1))).sqrt()
    }

    /// Returns the lower bound of the residual error with these parts, µm RMS over all guideway nodes and load cases.
    #[must_use]
    pub fn of(&self, parts: &[Part]) -> f64 {
        self.floor(&self.pieces(parts), &[], &[])
    }

    /// Returns the division after the additional cut for which the lower bound of the residual error is smallest.
    /// `None` if no cut is possible. `may` returns whether a division is allowed.
    #[must_use]
    pub fn best_cut(&self, parts: &[Part], may: &dyn Fn(&[Part]) -> bool) -> Option<Division> {
        let pieces = self.pieces(parts);
        let tried: Vec<(usize, Cut)> =
            parts.iter().enumerate().flat_map(|(place, part)| self.cuts(place, part)).collect();
        let floors = tried.par_iter().filter_map(|(place, cut)| {
            let halves = divided(self.mesh, parts, cut).ok()?;
            let made = self.pieces(&halves[*place..*place + 2]);
            Some((self.floor(&pieces, &[*place], &made), cut, halves))
        });
        let mut found: Vec<_> = floors.collect();
        found.sort_by(|(one, ..), (other, ..)| one.total_cmp(other));
        let (floor_um, cut, parts) = found.into_iter().find(|(_, _, parts)| may(parts))?;
        Some(Division { cut: Some(cut.clone()), parts, floor_um })
    }

    /// Returns the cutting planes to try for the block `part`. Each plane is paired with `place`, the index of the
    /// block. In a block larger than 50 mm, the planes are at whole millimetres.
    fn cuts(&self, place: usize, part: &Part) -> Vec<(usize, Cut)> {
        let mut cuts = Vec::new();
        for axis in 0..AXES.len() {
            let (low, high) = range(part.nodes.iter().map(|node| self.mesh.xyz[*node][axis]));
            for plane in 1..PLANES {
                let at = low + (high - low) * count(plane) / count(PLANES);
                let at = if high - low > 50.0 { at.round() } else { at };
                cuts.push((place, Cut { axis, at, of: Some(part.name.clone()) }));
            }
        }
        cuts
    }

    /// Joins two adjacent blocks: the pair for which the lower bound of the residual error increases least. `None` if
    /// no two blocks can be joined. `may` returns whether a division is allowed.
    #[must_use]
    pub fn best_join(&self, parts: &[Part], may: &dyn Fn(&[Part]) -> bool) -> Option<Division> {
        let pieces = self.pieces(parts);
        let joined = neighbours(self.mesh, parts).into_par_iter().map(|(one, other)| {
            let joined = pieces[one].joined(&pieces[other]);
            (self.floor(&pieces, &[one, other], &[joined]), one, other)
        });
        let mut found: Vec<_> = joined.collect();
        found.sort_by(|(one, ..), (other, ..)| one.total_cmp(other));
        found.into_iter().find_map(|(floor_um, one, other)| {
            let mut parts = parts.to_vec();
            let gone = parts.remove(other);
            parts[one].name = format!("{}+{}", parts[one].name, gone.name);
            parts[one].nodes.extend(gone.nodes);
            parts[one].nodes.sort_unstable();
            may(&parts).then_some(Division { cut: None, parts, floor_um })
        })
    }
}

impl Piece {
    fn joined(&self, other: &Piece) -> Piece {
        let both = |((low, high), (other_low, other_high)): (&(f64, f64), &(f64, f64))| {
            (low.min(*other_low), high.max(*other_high))
        };
        Piece {
            column: self.column.iter().zip(&other.column).map(|(one, other)| one + other).collect(),
            bounds: self.bounds.iter().zip(&other.bounds).map(both).collect(),
        }
    }
}

/// Returns the pairs of adjacent blocks, which share an element. A pair contains the indices of the blocks, the lower
/// index first.
fn neighbours(mesh: &Mesh, parts: &[Part]) -> Vec<(usize, usize)> {
    let owner = owners(mesh, parts);
    let mut pairs = BTreeSet::new();
    for element in &mesh.elements {
        let mut owners: Vec<usize> = element.nodes.iter().filter_map(|node| owner[*node]).collect();
        owners.sort_unstable();
        owners.dedup();
        for (place, one) in owners.iter().enumerate() {
            pairs.extend(owners[place + 1..].iter().map(|other| (*one, *other)));
        }
    }
    pairs.into_iter().collect()
}
