//! What an output writes, in which unit.
//!
//! A control that applies a line itself, as a SINUMERIK does with `ΔK = K0(T) + tanβ(T)·(P − P0)`, is given K0, tanβ and
//! P0 as three numbers and applies them at its own rate; any other is given Cz at the axis's present position.

use isotherm_core::reading::SignalId;

/// What an output writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writes {
    /// Cz, in µm, on the axis's period.
    Offset,
    /// K0, in µm: Cz at the reference position, where the control applies the slope itself.
    Intercept,
    /// tanβ, in µm/mm: the control multiplies it by the distance from the reference position.
    Slope,
    /// P0, in mm: the reference position, a constant of the profile.
    Reference,
    /// Position + Cz, in mm, as soon as the position is read.
    Corrected {
        /// The scale.
        position: SignalId,
    },
}

impl Writes {
    /// As the profile names it.
    pub const fn name(self) -> &'static str {
        match self {
            Writes::Offset => "offset",
            Writes::Intercept => "intercept",
            Writes::Slope => "slope",
            Writes::Reference => "reference",
            Writes::Corrected { .. } => "corrected",
        }
    }

    /// The position that it corrects, if it does.
    pub const fn position(self) -> Option<SignalId> {
        match self {
            Writes::Corrected { position } => Some(position),
            _ => None,
        }
    }

    /// The unit of its value.
    pub const fn unit(self) -> &'static str {
        match self {
            Writes::Offset | Writes::Intercept => "µm",
            Writes::Slope => "µm/mm",
            Writes::Reference | Writes::Corrected { .. } => "mm",
        }
    }

    /// The axis's Cz: whole, or at the reference position.
    pub const fn is_cz(self) -> bool {
        matches!(self, Writes::Offset | Writes::Intercept)
    }

    /// Written on the axis's period, into a register that holds nothing but what was written there.
    pub const fn is_scheduled(self) -> bool {
        !matches!(self, Writes::Corrected { .. })
    }

    /// A part of the line that the control applies itself.
    pub const fn is_apart(self) -> bool {
        matches!(self, Writes::Intercept | Writes::Slope | Writes::Reference)
    }
}
