//! Scale of a value in another register of the device: a power of ten, or a number of decimals.
//!
//! Such a register is a setting of the device. If it changes, values before and after the change have different scales,
//! and a device may change value and scale at different times. Therefore a value is used only with an exponent that was
//! in the same answer, or that was equal before and after the value. A changed exponent is used only after a second
//! read has confirmed it. The functions are pure.

use std::ops::RangeInclusive;

use super::{Encoding, Register};
use crate::reading::Reason;

/// Powers of ten that a register may contain.
const ALLOWED: RangeInclusive<i8> = -ScaleFrom::LARGEST..=ScaleFrom::LARGEST;

/// Register that contains the power of ten of a value's scale.
#[derive(Clone, Debug, PartialEq)]
pub struct ScaleFrom {
    /// Register that contains the exponent.
    pub address: Register,
    /// Encoding of the exponent in this register. Its scale is 1.
    pub encoding: Encoding,
    /// Meaning of the number in the register: a power of ten, or a number of decimals.
    pub meaning: ScaleMeaning,
}

/// Meaning of the number in the register of a scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaleMeaning {
    /// Power of ten with its sign, as in SunSpec: -1 means a tenth.
    PowerOfTen,
    /// Number of decimals: 1 means a tenth.
    Decimals,
}

impl ScaleFrom {
    /// Largest power of ten, and largest number of decimals. SunSpec has this limit for its scale factors.
    pub const LARGEST: i8 = 10;

    /// Returns the power of ten in the registers.
    ///
    /// # Errors
    /// [`Reason::BadReply`] if the registers hold no integer. [`Reason::NoScale`] if the number is beyond
    /// [`ScaleFrom::LARGEST`]. SunSpec sends -32768 for a value that the device does not have.
    pub fn exponent(&self, registers: &[u16]) -> Result<i8, Reason> {
        let counts = self.encoding.counts(registers).ok_or(Reason::BadReply)?;
        let number = i8::try_from(counts.0).ok().filter(|number| ALLOWED.contains(number));
        match (self.meaning, number) {
            (ScaleMeaning::PowerOfTen, Some(power)) => Ok(power),
            (ScaleMeaning::Decimals, Some(decimals @ 0..)) => Ok(-decimals),
            _ => Err(Reason::NoScale),
        }
    }

    /// Returns the number that the register contains for this power of ten.
    pub const fn number(&self, exponent: i8) -> i8 {
        match self.meaning {
            ScaleMeaning::PowerOfTen => exponent,
            ScaleMeaning::Decimals => -exponent,
        }
    }
}

/// Exponent of one signal: the accepted value, and the value of the last read. Two equal reads confirm a change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScaleWatch {
    /// Exponent that is in use: the first exponent after the start, or a later exponent that two reads have confirmed.
    accepted: Option<i8>,
    /// Exponent of the last read. `None` before the first read, and after a read without an exponent.
    last: Option<i8>,
}

/// Effect of one read of an exponent on the values of the signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScaleRead {
    /// Exponent for the values in the same answer, or the reason why these values cannot be used.
    pub together: Result<i8, Reason>,
    /// Exponent for the values that were read between the previous read and this read of an exponent, or the
    /// reason why these values cannot be used. `None` if the scale of these values is unknown: an exponent is
    /// in use, but the previous read gave no exponent.
    pub before: Option<Result<i8, Reason>>,
    /// Former and new exponent, if this read confirms a change.
    pub changed: Option<(i8, i8)>,
}

impl ScaleWatch {
    /// Creates the state after a start of the gateway. `exponent` is the exponent that was in use when the gateway last
    /// stopped; `None` if it is not known.
    pub fn after_start(exponent: Option<i8>) -> ScaleWatch {
        ScaleWatch { accepted: exponent, last: exponent }
    }

    /// Returns the exponent that is in use. `None` if no exponent has been read.
    pub fn accepted(&self) -> Option<i8> {
        self.accepted
    }

    /// Processes an exponent that was read, or the reason why the answer contains no exponent.
    pub fn read(&mut self, exponent: Result<i8, Reason>) -> ScaleRead {
        let (accepted, last) = (self.accepted, self.last);
        self.last = exponent.ok();
        let exponent = match exponent {
            Ok(exponent) => exponent,
            Err(reason) => {
                return ScaleRead { together: Err(reason), before: Some(Err(reason)), changed: None };
            }
        };
        let together = match accepted {
            // The first value after the start has no predecessor from which it could jump.
            None => Ok(exponent),
            Some(accepted) if accepted == exponent || last == Some(exponent) => Ok(exponent),
            Some(_) => Err(Reason::ScaleChanged),
        };
        if together.is_ok() {
            self.accepted = Some(exponent);
        }
        let before = match (accepted, last) {
            (None, None) => Some(Ok(exponent)),
            (_, None) => None,
            (_, Some(last)) if last == exponent => Some(together),
            (_, Some(_)) => Some(Err(Reason::ScaleChanged)),
        };
        let changed = accepted.filter(|accepted| *accepted != exponent && together.is_ok());
        ScaleRead { together, before, changed: changed.map(|accepted| (accepted, exponent)) }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::codec::{DataType, Scale, WordOrder};

    fn from(meaning: ScaleMeaning) -> ScaleFrom {
        let encoding = Encoding {
            data_type: DataType::I16,
            word_order: WordOrder::MswFirst,
            byte_swap: false,
            scale: Scale::ONE,
            offset: 0.0,
            bias: 0,
            bad: Vec::new(),
        };
        ScaleFrom { address: "holding:12".parse().unwrap(), encoding, meaning }
    }

    #[test]
    fn a_register_contains_a_power_of_ten_or_a_number_of_decimals() {
        let (power, decimals) = (from(ScaleMeaning::PowerOfTen), from(ScaleMeaning::Decimals));
        for (word, of_power, of_decimals) in [
            (0, Ok(0), Ok(0)),
            (1, Ok(1), Ok(-1)),
            (10, Ok(10), Ok(-10)),
            (11, Err(Reason::NoScale), Err(Reason::NoScale)),
            (0xffff, Ok(-1), Err(Reason::NoScale)),
            (0xfff6, Ok(-10), Err(Reason::NoScale)),
            (0xfff5, Err(Reason::NoScale), Err(Reason::NoScale)),
            // SunSpec sends this number for a value that the device does not have.
            (0x8000, Err(Reason::NoScale), Err(Reason::NoScale)),
            (0x0100, Err(Reason::NoScale), Err(Reason::NoScale)),
        ] {
            assert_eq!(
                (power.exponent(&[word]), decimals.exponent(&[word])),
                (of_power, of_decimals),
                "{word}"
            );
        }
        assert_eq!(power.exponent(&[1, 2]), Err(Reason::BadReply));
        assert_eq!((power.number(-2), decimals.number(-2)), (-2, 2));
    }

    #[test]
    fn a_value_has_the_exponent_that_its_scale_makes_of_it() {
        let encoding = |scale| Encoding { scale: Scale::of(scale), ..from(ScaleMeaning::Decimals).encoding };
        assert_eq!(encoding(1.0).decode_at(&[235], -1), Ok(23.5));
        assert_eq!(encoding(1.0).decode_at(&[2350], -2), Ok(23.5));
        assert_eq!(encoding(0.1).decode_at(&[235], 0), encoding(0.1).decode(&[235]));
        assert_eq!(encoding(0.001).decode_at(&[7], 3), Ok(7.0));
        let raw = Encoding { bad: vec![235.into()], offset: -40.0, ..encoding(1.0) };
        assert_eq!(raw.decode_at(&[235], -1), Err(Reason::Sentinel));
        assert_eq!(raw.decode_at(&[236], -1), Ok(-16.4));
    }

    /// Exponent for the values in the same answer, exponent for the values before this answer, and whether a
    /// change is reported.
    type Read = (Result<i8, Reason>, Option<Result<i8, Reason>>, bool);

    /// Reads exponents in turn, and returns the result of each read.
    fn reads(exponents: &[Result<i8, Reason>]) -> Vec<Read> {
        let mut watch = ScaleWatch::default();
        let read = |exponent: &Result<i8, Reason>| {
            let ScaleRead { together, before, changed } = watch.read(*exponent);
            (together, before, changed.is_some())
        };
        exponents.iter().map(read).collect()
    }

    #[test]
    fn a_changed_exponent_is_used_when_a_second_read_shows_it() {
        let changed = Err(Reason::ScaleChanged);
        let expected = [
            (Ok(-1), Some(Ok(-1)), false),
            (Ok(-1), Some(Ok(-1)), false),
            (changed, Some(changed), false),
            (Ok(-2), Some(Ok(-2)), true),
            (Ok(-2), Some(Ok(-2)), false),
        ];
        assert_eq!(reads(&[Ok(-1), Ok(-1), Ok(-2), Ok(-2), Ok(-2)]), expected);
    }

    #[test]
    fn an_exponent_that_one_read_shows_is_never_used() {
        let changed = Err(Reason::ScaleChanged);
        let expected = [
            (Ok(-1), Some(Ok(-1)), false),
            (changed, Some(changed), false),
            (changed, Some(changed), false),
            // The value was read between two different exponents.
            (Ok(-1), Some(changed), false),
            (Ok(-1), Some(Ok(-1)), false),
        ];
        assert_eq!(reads(&[Ok(-1), Ok(3), Ok(2), Ok(-1), Ok(-1)]), expected);
    }

    #[test]
    fn after_a_read_without_an_exponent_the_values_before_the_next_one_are_not_used() {
        let none = Err(Reason::NoScale);
        let expected = [
            (none, Some(none), false),
            (Ok(-1), Some(Ok(-1)), false),
            (none, Some(none), false),
            (Ok(-1), None, false),
            (none, Some(none), false),
            (Err(Reason::ScaleChanged), None, false),
            (Ok(-2), Some(Ok(-2)), true),
        ];
        assert_eq!(reads(&[none, Ok(-1), none, Ok(-1), none, Ok(-2), Ok(-2)]), expected);
    }

    #[test]
    fn a_change_while_the_gateway_was_stopped_is_a_change() {
        let mut same = ScaleWatch::after_start(Some(-1));
        let mut other = same;
        assert_eq!(same.read(Ok(-1)), ScaleRead { together: Ok(-1), before: Some(Ok(-1)), changed: None });
        let changed = Err(Reason::ScaleChanged);
        assert_eq!(other.read(Ok(-2)), ScaleRead { together: changed, before: Some(changed), changed: None });
        assert_eq!(other.accepted(), Some(-1));
        let confirmed = ScaleRead { together: Ok(-2), before: Some(Ok(-2)), changed: Some((-1, -2)) };
        assert_eq!((other.read(Ok(-2)), other.accepted()), (confirmed, Some(-2)));
        assert_eq!(ScaleWatch::after_start(None), ScaleWatch::default());
    }

    proptest! {
        #[test]
        fn a_value_is_used_only_between_two_equal_exponents_and_never_with_one_that_only_one_read_showed(
            exponents in prop::collection::vec(prop_oneof![4 => (-2i8..2).prop_map(Ok::<i8, Reason>), 1 => Just(Err::<i8, Reason>(Reason::NoScale))], 1..40),
        ) {
            let found = reads(&exponents);
            let mut accepted: Option<i8> = None;
            for (place, (together, before, changed)) in found.iter().enumerate() {
                let last = place.checked_sub(1).and_then(|last| exponents[last].ok());
                if let Some(Ok(used)) = before.filter(|_| accepted.is_some()) {
                    prop_assert_eq!((Ok(used), Some(used)), (exponents[place], last));
                }
                if let Ok(used) = together {
                    prop_assert_eq!(Ok(*used), exponents[place]);
                    prop_assert!(accepted.is_none_or(|accepted| accepted == *used) || last == Some(*used));
                    prop_assert_eq!(*changed, accepted.is_some_and(|accepted| accepted != *used));
                    accepted = Some(*used);
                } else {
                    prop_assert!(!changed);
                }
            }
        }
    }
}
