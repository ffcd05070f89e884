//! `writes` of an output: its quantity, unit and range.
//!
//! Some controls calculate the correction themselves, for example a SINUMERIK: `ΔK = K0(T) + tanβ(T)·(P − P0)`. Such a
//! control receives the three numbers K0, tanβ and P0, and applies them at its own rate. Any other control receives Cz
//! at the present position of the axis.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::tables::KeyContext;
use isotherm_core::reading::SignalId;

/// Number of µm in a mm, for outputs in mm.
pub(super) const MICRONS: f64 = 1000.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum WritesWord {
    Corrected,
    Offset,
    Intercept,
    Slope,
    Reference,
}

/// Quantity that an output writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writes {
    /// Cz in µm, written at each update of the axis.
    Offset,
    /// K0 in µm: Cz at the reference position. The control applies the slope itself.
    Intercept,
    /// tanβ in µm/mm. The control multiplies it by the distance from the reference position.
    Slope,
    /// P0 in mm: the reference position, at which the slope has no effect. It is a constant of the profile.
    Reference,
    /// Position + Cz in mm, written each time the position is read.
    Corrected {
        /// Signal with the position that the linear scale measures.
        position: SignalId,
    },
}

impl Writes {
    /// Returns the word for this quantity in a profile.
    pub const fn name(self) -> &'static str {
        match self {
            Writes::Offset => "offset",
            Writes::Intercept => "intercept",
            Writes::Slope => "slope",
            Writes::Reference => "reference",
            Writes::Corrected { .. } => "corrected",
        }
    }

    /// Returns the signal of the position that the output corrects. `None` if the output writes no position.
    pub const fn position(self) -> Option<SignalId> {
        match self {
            Writes::Corrected { position } => Some(position),
            _ => None,
        }
    }

    /// Returns the unit of the written value: µm, µm/mm or mm.
    pub const fn unit(self) -> &'static str {
        match self {
            Writes::Offset | Writes::Intercept => "µm",
            Writes::Slope => "µm/mm",
            Writes::Reference | Writes::Corrected { .. } => "mm",
        }
    }

    /// Returns whether the written value is Cz, or K0, which is Cz at the reference position.
    pub const fn is_cz(self) -> bool {
        matches!(self, Writes::Offset | Writes::Intercept)
    }

    /// Returns whether the value is written with the period of the axis. `false` for a position plus Cz, which is
    /// written each time the position is read.
    pub const fn is_scheduled(self) -> bool {
        !matches!(self, Writes::Corrected { .. })
    }

    /// Returns whether the value is K0, tanβ or P0, from which the control calculates the correction itself.
    pub const fn is_apart(self) -> bool {
        matches!(self, Writes::Intercept | Writes::Slope | Writes::Reference)
    }
}

/// Resolves the key `writes`. For "corrected", also resolves the signal of the position. `None` if `writes`
/// is missing, or if the position cannot be resolved.
pub(super) fn resolve(
    writes: Option<WritesWord>,
    position: Option<&String>,
    at: &KeyContext<'_>,
) -> Option<Writes> {
    let place = at.key("position");
    let writes = match writes? {
        WritesWord::Offset => Writes::Offset,
        WritesWord::Intercept => Writes::Intercept,
        WritesWord::Slope => Writes::Slope,
        WritesWord::Reference => Writes::Reference,
        WritesWord::Corrected => {
            let help = "write the signal with the position in mm: the gateway writes position + Cz";
            place.missing("`position` is missing: which position is corrected?", help);
            return Some(Writes::Corrected { position: place.position(position)? });
        }
    };
    if position.is_some() {
        let help = "remove this key, or write writes = \"corrected\"";
        place.wrong_key("`position` is only for a corrected position", help);
    }
    Some(writes)
}
