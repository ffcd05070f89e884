//! Physical quantities and points in time as types.
//!
//! Each constructor rejects NaN and infinity, so later arithmetic never encounters them. Units are the same everywhere:
//! temperature °C, displacement µm, position mm, time s.
//!
//! A wrong unit does not compile:
//! ```compile_fail,E0308
//! use isotherm_core::quantity::{Celsius, Micron};
//! fn as_cz(rise: Celsius) -> Micron {
//!     rise
//! }
//! ```
//! ```compile_fail,E0277
//! use isotherm_core::quantity::{Micron, MicronPerCelsius};
//! fn twice_the_length(gain: MicronPerCelsius, cz: Micron) -> Option<Micron> {
//!     Micron::new(gain * cz)
//! }
//! ```
//! ```compile_fail,E0277
//! use isotherm_core::quantity::{Micron, Millimetre};
//! fn without_the_thousand(position: Millimetre, cz: Micron) -> Micron {
//!     cz + position
//! }
//! ```
//! ```compile_fail,E0277
//! use isotherm_core::quantity::{Counts, Micron};
//! fn a_count_is_no_micrometre(register: Counts, cz: Micron) -> Counts {
//!     register + cz
//! }
//! ```
//! ```compile_fail,E0277
//! use isotherm_core::quantity::{Micron, Moment};
//! fn a_moment_is_no_length(cz: Micron, now: Moment) -> Micron {
//!     cz - now
//! }
//! ```
//! Correct units compile:
//! ```
//! use isotherm_core::quantity::{Celsius, Micron, MicronPerCelsius};
//! # fn main() -> Result<(), &'static str> {
//! let gain = MicronPerCelsius::try_from(-2.4)?;
//! let rise = Celsius::try_from(25.0)? - Celsius::try_from(20.0)?;
//! assert_eq!(Micron::new(gain * rise), Micron::new(-12.0));
//! # Ok(())
//! # }
//! ```

use std::fmt;
use std::ops::{Add, Mul, Neg, Sub};

use serde::{Deserialize, Serialize};

mod cell;
mod dialect;
mod moment;
mod shift;
pub mod time;
mod time_column;
mod unit;
mod wall;

pub use cell::{Cell, is_comment, is_unit, name_and_unit, spelled};
pub use dialect::{DecimalMark, Dialect};
pub use moment::Moment;
pub(crate) use shift::shifted;
pub use shift::{Shift, Shifted};
pub use time_column::{TimeColumns, TimeUnit, with_date};
pub use unit::{Conversion, names_and_units};
pub use wall::DateOrder;

/// Defines a quantity: a finite number with its unit, its constructor, arithmetic and `Display`.
macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $unit:literal, $digits:literal, $refused:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
        #[serde(try_from = "f64", into = "f64")]
        pub struct $name(f64);

        impl $name {
            /// Quantity of zero.
            pub const ZERO: $name = $name(0.0);

            #[doc = concat!("Creates the quantity from a number in ", $unit, "; `None` for NaN or infinity.")]
            pub fn new(value: f64) -> Option<$name> {
                value.is_finite().then_some($name(value))
            }

            #[doc = concat!("Returns the number in ", $unit, ".")]
            pub const fn get(self) -> f64 {
                self.0
            }

            /// Returns the absolute value.
            pub fn abs(self) -> $name {
                $name(self.0.abs())
            }
        }

        impl From<$name> for f64 {
            fn from(quantity: $name) -> f64 {
                quantity.0
            }
        }

        impl TryFrom<f64> for $name {
            type Error = &'static str;
            fn try_from(value: f64) -> Result<$name, Self::Error> {
                $name::new(value).ok_or($refused)
            }
        }

        impl Add for $name {
            type Output = $name;
            fn add(self, other: $name) -> $name {
                $name((self.0 + other.0).clamp(f64::MIN, f64::MAX))
            }
        }

        impl Sub for $name {
            type Output = $name;
            fn sub(self, other: $name) -> $name {
                $name((self.0 - other.0).clamp(f64::MIN, f64::MAX))
            }
        }

        impl Neg for $name {
            type Output = $name;
            fn neg(self) -> $name {
                $name(-self.0)
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!("{:.", $digits, "} ", $unit), self.0)
            }
        }
    };
}

quantity! {
    /// A displacement or a compensation value in micrometres. Always finite.
    Micron, "µm", "1", "a displacement must be a finite number"
}
quantity! {
    /// A temperature, or the difference of two temperatures, in °C. Always finite.
    ///
    /// Models also have other inputs, for example a speed or a current. Such an input is a number in the signal's own
    /// unit, and its gain is in µm per that unit.
    Celsius, "°C", "2", "a temperature must be a finite number"
}
quantity! {
    /// A position on an axis, or a length, in millimetres. Always finite.
    Millimetre, "mm", "3", "a position must be a finite number"
}
quantity! {
    /// A gain: change of Cz (the compensation value) per 1 °C, in µm/°C. Always finite.
    MicronPerCelsius, "µm/°C", "3", "a gain must be a finite number"
}
quantity! {
    /// A slope: change of Cz (the compensation value) per millimetre of axis position, in µm/mm. Always
    /// finite.
    MicronPerMillimetre, "µm/mm", "4", "a slope must be a finite number"
}
quantity! {
    /// A rate of change of an offset, in µm/s. Always finite.
    MicronPerSecond, "µm/s", "3", "a speed must be a finite number"
}
quantity! {
    /// The gain of a slope: change of the slope per 1 °C, in µm/mm per °C. Always finite.
    MicronPerMillimetreCelsius, "µm/mm/°C", "5", "a gain must be a finite number"
}

impl Micron {
    /// Returns the value limited to the range from `-limit` to `+limit`.
    pub fn clamp_to(self, limit: Micron) -> Micron {
        Micron(self.0.clamp(-limit.0.abs(), limit.0.abs()))
    }
}

/// Returns the product in µm. The product may be infinite: a sum of such products is checked once, when it is complete.
impl Mul<Celsius> for MicronPerCelsius {
    type Output = f64;
    fn mul(self, rise: Celsius) -> f64 {
        self.0 * rise.0
    }
}

/// Returns the product in µm/mm. The product may be infinite: a sum of such products is checked once, when it is
/// complete.
impl Mul<Celsius> for MicronPerMillimetreCelsius {
    type Output = f64;
    fn mul(self, rise: Celsius) -> f64 {
        self.0 * rise.0
    }
}

/// Returns the product in µm. The product may be infinite: a sum of such products is checked once, when it is complete.
impl Mul<Millimetre> for MicronPerMillimetre {
    type Output = f64;
    fn mul(self, way: Millimetre) -> f64 {
        self.0 * way.0
    }
}

/// Whole counts of a register. Every number is valid. Sums saturate at the smallest and the largest 64-bit
/// integer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Counts(pub i64);

impl Counts {
    /// Count of zero.
    pub const ZERO: Counts = Counts(0);

    /// Returns the absolute value. The smallest 64-bit number has no absolute value, and gives the largest number.
    pub const fn abs(self) -> Counts {
        Counts(self.0.saturating_abs())
    }

    /// Returns the absolute value as an unsigned number.
    pub const fn unsigned_abs(self) -> u64 {
        self.0.unsigned_abs()
    }

    /// Returns the absolute difference of two counts.
    pub const fn abs_diff(self, other: Counts) -> u64 {
        self.0.abs_diff(other.0)
    }
}

impl Add for Counts {
    type Output = Counts;
    fn add(self, other: Counts) -> Counts {
        Counts(self.0.saturating_add(other.0))
    }
}

impl Sub for Counts {
    type Output = Counts;
    fn sub(self, other: Counts) -> Counts {
        Counts(self.0.saturating_sub(other.0))
    }
}

impl Neg for Counts {
    type Output = Counts;
    fn neg(self) -> Counts {
        Counts(self.0.saturating_neg())
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

/// Converts a number into a quantity, for tests.
#[cfg(test)]
pub(crate) fn of<Quantity: TryFrom<f64, Error = &'static str>>(value: f64) -> Quantity {
    Quantity::try_from(value).unwrap()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_micron_refuses_what_is_not_a_number() {
        assert_eq!(Micron::new(f64::NAN), None);
        assert_eq!(Micron::new(f64::INFINITY), None);
        assert_eq!(Micron::new(8.4).map(Micron::get), Some(8.4));
    }
}
