//! Conversion of times between clocks.
//!
//! The gateway measures time with a monotonic clock from its start. Its decisions do not use the wall clock, which may
//! be wrong and may be set at any time. Displayed, logged and stored times are wall-clock times: the monotonic time
//! plus a [`Shift`]. All times of a file get the same shift, so that the intervals between them do not change.

use std::collections::VecDeque;

use super::Moment;

/// Difference between two clocks. Adding it to a time of one clock gives the time of the other clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shift(i64);

impl Shift {
    /// Returns the shift that converts the time `from` of one clock to the time `to` of the other.
    pub fn between(from: Moment, to: Moment) -> Shift {
        let nanos = i128::from(to.as_nanos()) - i128::from(from.as_nanos());
        Shift(i64::try_from(nanos).unwrap_or(if nanos < 0 { i64::MIN } else { i64::MAX }))
    }

    /// Creates a shift from nanoseconds. A positive shift gives later times.
    pub const fn from_nanos(nanos: i64) -> Shift {
        Shift(nanos)
    }

    /// Returns the shift in nanoseconds. A positive shift gives later times.
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Returns the opposite shift, which converts times back to the first clock.
    #[must_use]
    pub const fn reversed(self) -> Shift {
        Shift(self.0.saturating_neg())
    }
}

/// Value that contains times and can be converted to another clock.
pub trait Shifted: Sized {
    /// Adds the shift to every time that the value contains.
    fn shift(&mut self, by: Shift);

    /// Returns the value with every time in it converted to the other clock.
    #[must_use]
    fn shifted(mut self, by: Shift) -> Self {
        self.shift(by);
        self
    }
}

/// Shifts a moment. The earliest moment means "not yet" and the latest "never": these two are not shifted, and no other
/// moment becomes one of them.
impl Shifted for Moment {
    fn shift(&mut self, by: Shift) {
        if *self != Moment::default() && *self != Moment::END {
            let nanos = self.as_nanos().saturating_add_signed(by.0);
            *self = Moment::from_nanos(nanos.clamp(1, u64::MAX - 1));
        }
    }
}

impl<T: Shifted> Shifted for Option<T> {
    fn shift(&mut self, by: Shift) {
        self.iter_mut().for_each(|inner| inner.shift(by));
    }
}

impl<T: Shifted> Shifted for Vec<T> {
    fn shift(&mut self, by: Shift) {
        self.iter_mut().for_each(|inner| inner.shift(by));
    }
}

impl<T: Shifted> Shifted for VecDeque<T> {
    fn shift(&mut self, by: Shift) {
        self.iter_mut().for_each(|inner| inner.shift(by));
    }
}

/// Implements [`Shifted`] for a structure by shifting the listed fields.
macro_rules! shifted {
    ($name:ty: $($field:ident),+) => {
        impl $crate::quantity::Shifted for $name {
            fn shift(&mut self, by: $crate::quantity::Shift) {
                $($crate::quantity::Shifted::shift(&mut self.$field, by);)+
            }
        }
    };
}
pub(crate) use shifted;

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Moment = Moment::from_nanos(1_000);

    #[test]
    fn a_shift_goes_there_and_back() {
        for other in [1, 999, 1_000, 5_000_000_000_000_000_000] {
            let by = Shift::between(NOW, Moment::from_nanos(other));
            assert_eq!(NOW.shifted(by), Moment::from_nanos(other));
            assert_eq!(NOW.shifted(by).shifted(by.reversed()), NOW);
        }
    }

    #[test]
    fn never_stays_never_and_nothing_becomes_it() {
        let back = Shift::from_nanos(i64::MIN);
        assert_eq!(Moment::default().shifted(Shift::from_nanos(7)), Moment::default());
        assert_eq!(Moment::END.shifted(back), Moment::END);
        assert_eq!(NOW.shifted(back), Moment::from_nanos(1));
    }
}
