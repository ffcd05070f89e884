//! Scale factors that virtual devices store in registers as powers of ten, and values with these factors.

use std::borrow::Cow;

use crate::virtual_machine::registers::Bank;
use isotherm_core::codec::{Address, Encoding};
use isotherm_profile::{Profile, Signal};

/// Usual power of ten at power-on, for values with one decimal. A signal with a large range needs a larger power.
const USUAL: i8 = -1;
const LARGEST: i8 = 9;

/// Returns the power of ten that the scale register of this signal contains at power-on. With this power, the values of
/// all signals with this scale register fit their data types.
pub(super) fn at_power_on(profile: &Profile, signal: &Signal) -> i8 {
    let place =
        |signal: &Signal| signal.scale_from.as_ref().map(|from| (from.address, from.encoding.data_type));
    let shares = |other: &&Signal| other.device == signal.device && place(other) == place(signal);
    profile.signals.iter().filter(shares).map(needed).max().unwrap_or(USUAL)
}

/// Returns the smallest power of ten with which the range of a signal fits its data type.
fn needed(signal: &Signal) -> i8 {
    let (low, high) = signal.range.unwrap_or_default();
    let fits = |exponent: &i8| {
        let encoding = times(&signal.encoding, *exponent);
        !encoding.encode(low).saturated && !encoding.encode(high).saturated
    };
    (USUAL..=LARGEST).find(fits).unwrap_or(USUAL)
}

/// Returns the encoding of a signal, with the power of ten that its scale register contains now.
pub(super) fn encoding<'s>(signal: &'s Signal, bank: &Bank) -> Cow<'s, Encoding> {
    let Some(from) = &signal.scale_from else { return Cow::Borrowed(&signal.encoding) };
    let words = bank.read(&Address::Modbus(from.address), from.encoding.data_type.registers());
    let exponent = words.and_then(|words| from.exponent(words).ok()).unwrap_or_default();
    Cow::Owned(times(&signal.encoding, exponent))
}

fn times(encoding: &Encoding, exponent: i8) -> Encoding {
    Encoding { scale: encoding.scale.times_power_of_ten(exponent), ..encoding.clone() }
}
