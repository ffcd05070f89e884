//! Moments of one clock as another one counts them.
//!
//! A gateway counts time from its start, and nothing that it decides looks at the wall's clock, which may be wrong and
//! be set right at any moment. What is shown, logged or kept bears the wall's time: the counted moment, shifted. All
//! moments of a file are shifted alike, so that the spans between them are the counted ones.

use std::collections::VecDeque;

use super::Moment;

/// How much later it is by another clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shift(i64);

impl Shift {
    /// What brings the one moment to the other.
    pub fn between(from: Moment, to: Moment) -> Shift {
        let nanos = i128::from(to.as_nanos()) - i128::from(from.as_nanos());
        Shift(i64::try_from(nanos).unwrap_or(if nanos < 0 { i64::MIN } else { i64::MAX }))
    }

    /// That many nanoseconds, forward where they are positive.
    pub const fn from_nanos(nanos: i64) -> Shift {
        Shift(nanos)
    }

    /// Nanoseconds.
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// The way back.
    #[must_use]
    pub const fn reversed(self) -> Shift {
        Shift(self.0.saturating_neg())
    }
}

/// Something with moments in it.
pub trait Shifted: Sized {
    /// Brings its moments to the other clock.
    fn shift(&mut self, by: Shift);

    /// The same by the other clock.
    #[must_use]
    fn shifted(mut self, by: Shift) -> Self {
        self.shift(by);
        self
    }
}

/// The beginning of time says "never yet", its end "never": both stay. Nothing else becomes one of them.
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

/// A structure is shifted where these of its fields are.
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
