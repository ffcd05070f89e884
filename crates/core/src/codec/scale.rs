//! Scales, which convert raw counts to engineering units. A scale is the number of units per count.

use super::float::same;

/// Scale of a value. The structure also stores the number of counts per unit if this number is whole. Its
/// calculation for each value would require two divisions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    per_count: f64,
    counts_per_unit: Option<f64>,
}

impl Scale {
    /// Scale of one unit per count.
    pub const ONE: Scale = Scale { per_count: 1.0, counts_per_unit: Some(1.0) };

    /// Creates a scale from units per count, which must not be zero.
    pub fn of(per_count: f64) -> Scale {
        let counts = (1.0 / per_count).round();
        let is_whole = counts.abs() >= 1.0 && same(1.0 / counts, per_count);
        Scale { per_count, counts_per_unit: is_whole.then_some(counts) }
    }

    /// Returns the scale multiplied by 10 to the power of `exponent`.
    pub fn times_power_of_ten(self, exponent: i8) -> Scale {
        let power = 10f64.powi(i32::from(exponent.unsigned_abs()));
        match exponent {
            0 => self,
            1.. => Scale::of(self.per_count * power),
            // A tenth is not exact as a float, so a division by ten has the smaller error.
            _ => Scale::of(self.per_count / power),
        }
    }

    /// Returns the units per count.
    pub const fn get(self) -> f64 {
        self.per_count
    }

    /// Returns `raw · scale`. If one unit is a whole number of counts, `raw` is divided by this number instead. With
    /// scale 0.1, 229 counts are then 22.9, not 22.900000000000002.
    pub(super) fn scaled(self, raw: f64) -> f64 {
        match self.counts_per_unit {
            Some(counts) => raw / counts,
            None => raw * self.per_count,
        }
    }

    pub(super) fn unscaled(self, value: f64) -> f64 {
        match self.counts_per_unit {
            Some(counts) => value * counts,
            None => value / self.per_count,
        }
    }
}
