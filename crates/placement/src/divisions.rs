//! What a division into blocks leaves at best, for many divisions: which cut helps most, which two blocks can be one.

use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::blocks::{Cut, Part, divided, owners};
use crate::mesh::{AXES, Mesh, count, range};
use crate::methods::bounded::least_squares;
use crate::problem::{Load, UM_PER_MM, in_directions};
use crate::structure::Adjoint;

/// The floor of any division: the structure in some directions under all load cases.
#[derive(Debug)]
pub struct Floors<'a> {
    mesh: &'a Mesh,
    /// How each guideway node follows every node, mm/K.
    rows: Vec<&'a [f64]>,
    loads: &'a [Load],
    /// True displacement of each case, µm.
    moved: Vec<DVector<f64>>,
}

/// A part as floors see it.
#[derive(Clone, Debug)]
struct Piece {
    /// Its column of P, µm/K.
    column: Vec<f64>,
    /// Its coldest and its warmest rise in each case, K.
    bounds: Vec<(f64, f64)>,
}

/// A division that is better or cheaper.
#[derive(Clone, Debug, PartialEq)]
pub struct Division {
    /// The cut; none where two parts became one.
    pub cut: Option<Cut>,
    /// The parts afterwards.
    pub parts: Vec<Part>,
    /// What they leave at best, µm RMS over guideway and cases.
    pub floor_um: f64,
}

/// Planes that are tried along a direction.
const PLANES: usize = 9;

impl<'a> Floors<'a> {
    /// In these directions (0 x, 1 y, 2 z).
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

    /// What these pieces, some gone and others made, leave at best, µm RMS over guideway and cases.
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

    /// What these parts leave at best, µm RMS over guideway and cases.
    #[must_use]
    pub fn of(&self, parts: &[Part]) -> f64 {
        self.floor(&self.pieces(parts), &[], &[])
    }

    /// The one more cut after which least is left; `may` says which divisions can be used at all. None where no cut is
    /// possible.
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

    /// Planes through a part, in whole millimetres where it is large enough.
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

    /// The two neighbours that can be one block with the least loss; none where there is one part only.
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

/// Pairs of parts that share an element, the lower place first.
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
