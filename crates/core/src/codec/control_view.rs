//! Last check before a write. It computes the correction that the control would apply for the registers, and rejects a
//! wrong correction.

use std::fmt;

use super::Encoding;
use crate::quantity::Micron;

/// View of a control (CNC) on the registers of one output.
///
/// The gateway converts µm into registers with the settings of the merged profile. This view converts the registers
/// back into µm with the settings of the profile file alone. [`ControlView::admit`] compares the corrections of both
/// calculations directly before the registers are sent.
///
/// The check protects against:
/// - registers that do not hold the value: a count that wrapped or was limited to the range of its type, or a wrong
///   word order;
/// - rounding of the calculation that exceeds the limit by more than half a count;
/// - a scale, bias, diameter or limit that differs from the profile file, for any reason;
/// - a gateway share (the gateway's part of a shared register) that exceeds the limit;
/// - a corrected position whose distance from the measured position exceeds the limit.
///
/// The check cannot detect a wrong scale in the profile file, or other settings in the control, because the gateway has
/// no other source. A control that reports the applied value (`read_back`) reveals both faults.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlView {
    /// Encoding that the control uses for the registers.
    pub encoding: Encoding,
    /// Change of the value in the registers, in the unit of the output, for a correction of 1 µm.
    pub per_micron: f64,
    /// Largest absolute correction that may be written.
    pub limit: Micron,
}

/// Reason why registers must not be sent to the control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Inadmissible {
    /// The registers hold NaN, infinity or a sentinel (a value that means "no measurement"), or the number of registers
    /// is wrong.
    NoNumber,
    /// The control would apply more than the limit.
    Beyond {
        /// Correction that the control would apply.
        correction: Micron,
        /// Limit that the correction exceeds.
        limit: Micron,
    },
    /// The control would convert the registers to a correction that differs from the intended correction.
    Unlike {
        /// Correction that the control would apply.
        correction: Micron,
        /// Correction that the gateway intends to write.
        meant: Micron,
    },
}

impl ControlView {
    /// Returns the value that the control reads from the registers, in the unit of the output. `None` if the registers
    /// hold no number.
    pub fn value(&self, registers: &[u16]) -> Option<f64> {
        self.encoding.decode(registers).ok()
    }

    /// Checks whether the registers may be sent.
    ///
    /// - `meant` is the intended correction.
    /// - `centre` is the value without a correction: zero, the operator offset, or the position.
    /// - `held` is the correction in the register now. A correction beyond the limit is allowed if it is not
    ///   larger than `held`, because the gateway returns a register from beyond the limit in steps.
    ///
    /// # Errors
    /// Returns why the registers must not be sent.
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

    /// Converts a difference in the unit of the output into a correction. `None` if the result is NaN or infinite.
    pub fn micron(&self, value: f64) -> Option<Micron> {
        Micron::new(value / self.per_micron)
    }

    /// Returns the allowed deviation from the intended correction, µm: half a count for an integer, or the
    /// rounding of a float. `size`: sum of the absolute values of the value and of its centre, in the unit of
    /// the output.
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

/// Relative rounding error of a few operations on floats of 64 bits. The allowed deviation of a correction includes
/// this error.
const ARITHMETIC: f64 = 1e-14;

impl fmt::Display for Inadmissible {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Inadmissible::NoNumber => f.write_str("the control would read a value that is not a number"),
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
