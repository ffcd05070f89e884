//! Position of an Abaqus instance in the model. A part contains a mesh; an instance puts the part at a
//! position in the assembly.

use crate::element::{cross, dot, minus};

/// Position of an instance: a translation, then a rotation about an axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Position {
    /// Translation, mm.
    pub(super) shift: [f64; 3],
    pub(super) turn: Option<Turn>,
}

/// Rotation about an axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Turn {
    /// Point on the axis, mm.
    pub(super) origin: [f64; 3],
    /// Direction of the axis, of length 1.
    pub(super) axis: [f64; 3],
    /// Angle in radians, by the right-hand rule.
    pub(super) angle: f64,
}

impl Position {
    /// Converts the coordinates of a point of the part to the coordinates of this point in the model, mm.
    pub(super) fn place(&self, xyz: [f64; 3]) -> [f64; 3] {
        let moved = [0, 1, 2].map(|axis| xyz[axis] + self.shift[axis]);
        let Some(Turn { origin, axis, angle }) = &self.turn else { return moved };
        let arm = minus(moved, *origin);
        let (sine, cosine) = angle.sin_cos();
        let (across, along) = (cross(*axis, arm), dot(*axis, arm) * (1.0 - cosine));
        [0, 1, 2].map(|at| origin[at] + cosine * arm[at] + sine * across[at] + along * axis[at])
    }
}
