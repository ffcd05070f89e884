//! Answer of the operator in a sign check with a dial gauge.

use isotherm_core::explained::Explained;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Direction in which a dial gauge moved when Cz increased.
#[derive(Clone, Copy, Debug, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DialDirection {
    /// The gauge moved in the plus direction, which is correct.
    Plus,
    /// The gauge moved in the minus direction, so the sign is wrong.
    Minus,
    /// The gauge did not move.
    None,
}

impl DialDirection {
    /// All directions with their names.
    pub const ALL: [(&'static str, DialDirection); 3] =
        [("plus", DialDirection::Plus), ("minus", DialDirection::Minus), ("none", DialDirection::None)];

    /// Returns the meaning of this direction for the axis, with the action of the operator as a hint.
    pub fn explained(self, axis: &str) -> Explained {
        match self {
            DialDirection::Plus => "the gauge moved to plus: the sign is right".into(),
            DialDirection::Minus => Explained::new(
                "the gauge moved to minus: the sign is WRONG, and every µm makes the error larger",
                format!(
                    "disarm {axis}, change the sign of `scale` at its output (or the sign in the control), \
                     and check again"
                ),
            ),
            DialDirection::None => Explained::new(
                format!(
                    "the gauge did not move: the control does not apply the offset, or the gauge does not \
                     measure along {axis}"
                ),
                format!("disarm {axis} and look for the cause"),
            ),
        }
    }
}
