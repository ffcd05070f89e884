//! Floating-point values: comparison, and conversion from and to bits and whole counts.

use super::DataType;

/// Returns whether two numbers are exactly equal. A module with floats sends its sentinel exactly, for example 9999.0.
#[allow(clippy::float_cmp)]
pub(super) fn same(a: f64, b: f64) -> bool {
    a == b
}

/// Converts a raw count to a float. Counts beyond 2^53 lose their last digits. No real device sends such large counts.
#[allow(clippy::cast_precision_loss)]
pub(super) fn as_float(raw: i128) -> f64 {
    match i64::try_from(raw) {
        // Counts of 64 bits use the fast conversion of the processor.
        Ok(raw) => raw as f64,
        Err(_) => wide_as_float(raw),
    }
}

#[cold]
#[inline(never)]
#[allow(clippy::cast_precision_loss)]
fn wide_as_float(raw: i128) -> f64 {
    raw as f64
}

/// Converts a rounded number to an integer. A number that does not fit becomes the smallest or largest integer.
#[allow(clippy::cast_possible_truncation)]
pub(super) fn as_integer(rounded: f64) -> i128 {
    const FITS: f64 = 9.0e18;
    if rounded.abs() < FITS { i128::from(rounded as i64) } else { rounded as i128 }
}

pub(super) fn float_of(data_type: DataType, bits: u64) -> f64 {
    match u32::try_from(bits) {
        Ok(narrow) if data_type == DataType::F32 => f64::from(f32::from_bits(narrow)),
        _ => f64::from_bits(bits),
    }
}

#[allow(clippy::cast_possible_truncation)]
pub(super) fn float_bits(data_type: DataType, value: f64) -> (u64, bool) {
    let finite = if value.is_nan() { 0.0 } else { value };
    if data_type == DataType::F32 {
        let limit = f64::from(f32::MAX);
        let fits = finite.clamp(-limit, limit);
        return (u64::from((fits as f32).to_bits()), !same(fits, value));
    }
    let fits = finite.clamp(f64::MIN, f64::MAX);
    (fits.to_bits(), !same(fits, value))
}
