//! The last check before a value leaves: what the control makes of the registers that it is about to be sent.

use std::fmt;

use super::Encoding;
use crate::quantity::Micron;

/// How a control reads the registers of one output.
///
/// The gateway turns µm into registers by the settings of the merged profile. This view turns the registers back into µm by
/// what the profile file itself states, below every layer. [`ControlView::admit`] compares the two right before a request
/// is made of the registers.
///
/// The check protects against:
/// - registers that do not hold the value: a count that wrapped or was cut to the range of its type, words in a wrong order;
/// - arithmetic that carries a value further than half a count past the limit;
/// - a scale, bias, diameter or limit that is not the one of the profile file, whatever changed it;
/// - a share of an operator's register, or a corrected position, that is further than the limit from the operator's part or
///   from the position.
///
/// It cannot protect against a profile that states a wrong scale itself, or a control that is set otherwise: the gateway
/// knows no other statement than the profile's. A control that reports what it applies (`read_back`) shows that.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlView {
    /// How the control reads the registers.
    pub encoding: Encoding,
    /// Size of a correction of 1 µm, in the unit of the value.
    pub per_micron: f64,
    /// The largest correction.
    pub limit: Micron,
}

/// Why registers must not be sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inadmissible {
    /// They hold no number.
    NoNumber,
    /// The control would apply more than the limit.
    Beyond {
        /// The correction that it would apply.
        correction: Micron,
        /// The limit.
        limit: Micron,
    },
    /// The control would apply another correction than the gateway means.
    Unlike {
        /// The correction that it would apply.
        correction: Micron,
        /// The correction that was meant.
        meant: Micron,
    },
}

impl ControlView {
    /// The value that the control reads in these registers, in the unit of the output; `None` if they hold no number.
    pub fn value(&self, registers: &[u16]) -> Option<f64> {
        self.encoding.decode(registers).ok()
    }

    /// Whether these registers may be sent.
    ///
    /// `meant` is the correction that the gateway means by them. `centre` is the value without a correction: zero, the
    /// operator's part, or the position. `held` is the correction that the register holds now: a value beyond the limit
    /// passes if it is no further away than that, because a register beyond the limit is walked back in steps.
    ///
    /// # Errors
    /// Why they must not be sent.
    pub fn admit(
        &self,
        registers: &[u16],
        meant: Micron,
        centre: f64,
        held: Micron,
    ) -> Result<(), Inadmissible> {
        let value = self.value(registers).ok_or(Inadmissible::NoNumber)?;
        let correction = self.micron(value - centre).ok_or(Inadmissible::NoNumber)?;
        let slack = self.slack(value.abs() + centre.abs());
        let most = self.limit.get().max(held.abs().get());
        if correction.abs().get() > most + slack {
            return Err(Inadmissible::Beyond { correction, limit: self.limit });
        }
        if (correction - meant).abs().get() > slack {
            return Err(Inadmissible::Unlike { correction, meant });
        }
        Ok(())
    }

    /// The correction that this much of the value is; `None` if it is no number.
    pub fn micron(&self, value: f64) -> Option<Micron> {
        Micron::new(value / self.per_micron)
    }

    /// How far the registers may be from what was meant because they hold whole counts, or floats of so many bits.
    fn slack(&self, size: f64) -> f64 {
        let data_type = self.encoding.data_type;
        let (count, digits) = match data_type.integer_range() {
            Some(_) => (0.5 * self.encoding.scale.get().abs(), ARITHMETIC),
            None if data_type.width() == 32 => (0.0, f64::from(f32::EPSILON)),
            None => (0.0, ARITHMETIC),
        };
        (count + size * digits) / self.per_micron.abs()
    }
}

/// Relative rounding error of a few operations on floats of 64 bits.
const ARITHMETIC: f64 = 1e-14;

impl fmt::Display for Inadmissible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Inadmissible::NoNumber => f.write_str("the control would read no number"),
            Inadmissible::Beyond { correction, limit } => {
                write!(f, "the control would read {correction}, beyond the limit of ±{limit}")
            }
            Inadmissible::Unlike { correction, meant } => {
                write!(f, "the control would read {correction} instead of {meant}")
            }
        }
    }
}

#[cfg(test)]
mod tests;
