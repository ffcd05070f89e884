//! Values of arguments, and what is said of those that are none.

use std::time::Duration;

/// A key and its value, without the blanks around them.
pub(super) fn key_and_value(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("write it as KEY=VALUE, e.g. bus.cell.timeout=500ms")?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}

/// A finite number that is `allowed`; `hint` says how to write one.
pub(super) fn number(text: &str, allowed: impl Fn(f64) -> bool, hint: &str) -> Result<f64, String> {
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite() && allowed(*number));
    number.ok_or_else(|| hint.to_owned())
}

/// A time above zero and of at most `most`; `hint` says how to write one.
pub(super) fn span(text: &str, most: Duration, hint: &str) -> Result<Duration, String> {
    let span = humantime::parse_duration(text).map_err(|error| error.to_string())?;
    if span.is_zero() || span > most { Err(hint.to_owned()) } else { Ok(span) }
}
