//! Times of the rows of a log: parsing and writing as seconds or RFC 3339, exact to the nanosecond in both directions.

use std::io::Write;

use super::Moment;

/// Parses a time: seconds (`12`, `0.1`, `1.7e9`) or RFC 3339.
///
/// # Errors
/// Returns a sentence that says how to write the time.
pub fn parse(text: &str) -> Result<Moment, String> {
    let text = text.trim();
    if text.is_empty() {
        return Err("the time is missing".to_owned());
    }
    if text.contains(':') {
        return stamp(text);
    }
    if text.contains(',') {
        return Err(format!(
            "`{text}` has a comma; write seconds with a decimal point, and without thousands separators"
        ));
    }
    if text.starts_with('-') {
        return Err(format!("`{text}` is negative; write seconds since the start of the log, or since 1970"));
    }
    parse_scaled(text, 0)
}

/// Parses a number of seconds times a power of ten, for example milliseconds with the power −3.
///
/// # Errors
/// Returns a sentence that says how to write the time.
pub(super) fn parse_scaled(text: &str, power: i32) -> Result<Moment, String> {
    let wrong = || format!("`{text}` is not a time; write seconds or 2026-01-31T12:00:00Z");
    seconds(text, power).ok_or_else(wrong)
}

fn stamp(text: &str) -> Result<Moment, String> {
    let stamp: jiff::Timestamp = text.parse().map_err(|_| {
        format!(
            "`{text}` is not a time; write 2026-01-31T12:00:00Z, with Z or the offset from UTC at its end"
        )
    })?;
    let nanos = u64::try_from(stamp.as_nanosecond());
    nanos.map(Moment::from_nanos).map_err(|_| format!("`{text}` lies before 1970"))
}

/// Parses seconds times a power of ten digit by digit, because a conversion through floating point would lose
/// nanoseconds. `None` if the text is not a number, or if the time is too late for a [`Moment`].
fn seconds(text: &str, shift: i32) -> Option<Moment> {
    let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
    let exponent: i32 = exponent.parse().ok()?;
    let mantissa = mantissa.strip_prefix('+').unwrap_or(mantissa);
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let is_digits = |digits: &str| digits.bytes().all(|byte| byte.is_ascii_digit());
    if whole.len() + fraction.len() == 0 || !is_digits(whole) || !is_digits(fraction) {
        return None;
    }
    let fraction = &fraction[..fraction.len().min(20)];
    let digits = whole
        .bytes()
        .chain(fraction.bytes())
        .try_fold(0u128, |sum, byte| sum.checked_mul(10)?.checked_add(u128::from(byte - b'0')))?;
    let power = exponent.checked_add(9 + shift)?.checked_sub(i32::try_from(fraction.len()).ok()?)?;
    let scale = 10u128.checked_pow(power.unsigned_abs());
    let nanos = match (scale, power >= 0) {
        (Some(scale), true) => digits.checked_mul(scale)?,
        (Some(scale), false) => digits.checked_add(scale / 2)? / scale,
        (None, true) if digits > 0 => return None,
        (None, _) => 0,
    };
    u64::try_from(nanos).ok().map(Moment::from_nanos)
}

/// Appends the moment to the line, as RFC 3339 in UTC with nine decimals.
pub fn write(line: &mut Vec<u8>, moment: Moment) {
    // Writing to a vector never fails.
    let _ = match jiff::Timestamp::from_nanosecond(i128::from(moment.as_nanos())) {
        Ok(stamp) => write!(line, "{stamp:.9}"),
        Err(_) => write!(line, "{}e-9", moment.as_nanos()),
    };
}
