//! Parsers for the values of arguments and answers, with their error messages.

use std::io::BufRead;
use std::time::Duration;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// Error: arguments exclude or require each other. The program reports this error in the same form as clap reports a
/// wrong argument.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct WrongArguments(String);

/// Returns the error for arguments that exclude or require each other.
pub(super) fn wrong_arguments(why: impl Into<String>) -> anyhow::Error {
    WrongArguments(why.into()).into()
}

/// Returns a parser that accepts one of these values by its name, and shows the help text of each.
pub(super) fn one_of<T: Copy + Send + Sync + 'static, const N: usize>(
    all: [(T, &'static str, &'static str); N],
) -> impl TypedValueParser<Value = T> {
    let values = all.map(|(_, name, help)| PossibleValue::new(name).help(help));
    PossibleValuesParser::new(values).try_map(move |given| {
        let found = all.iter().find(|(_, name, _)| *name == given);
        found.map(|(value, ..)| *value).ok_or("no such value")
    })
}

/// Reads a line from stdin; `None` at its end.
pub(super) fn typed() -> std::io::Result<Option<String>> {
    let mut text = String::new();
    let read = std::io::stdin().lock().read_line(&mut text)?;
    Ok((read > 0).then_some(text))
}

/// Parses `KEY=VALUE`, and removes blanks around key and value.
pub(super) fn key_and_value(text: &str) -> Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("write it as KEY=VALUE, e.g. bus.cell.timeout=500ms")?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}

/// Parses a finite number for which `allowed` returns true. `hint` is the error message.
pub(super) fn number(text: &str, allowed: impl Fn(f64) -> bool, hint: &str) -> Result<f64, String> {
    let number = text.trim().parse::<f64>().ok().filter(|number| number.is_finite() && allowed(*number));
    number.ok_or_else(|| hint.to_owned())
}

/// Parses a time above zero and of at most `most`. `hint` is the error message for a time outside this range.
pub(super) fn span(text: &str, most: Duration, hint: &str) -> Result<Duration, String> {
    let span = humantime::parse_duration(text).map_err(|error| error.to_string())?;
    if span.is_zero() || span > most { Err(hint.to_owned()) } else { Ok(span) }
}

/// Checks a log filter: a level, or a filter with levels. Any other word would be taken as the name of a module, and
/// the filter would log nothing.
pub(super) fn log_filter(text: &str) -> Result<String, String> {
    const LEVELS: [&str; 6] = ["error", "warn", "info", "debug", "trace", "off"];
    let is_level = |text: &str| LEVELS.contains(&text.to_lowercase().as_str());
    let is_part =
        |part: &str| is_level(part) || part.split_once('=').is_some_and(|(_, level)| is_level(level));
    if text.split(',').all(|part| is_part(part.trim())) {
        return Ok(text.to_owned());
    }
    Err(format!("{}; or a filter such as `isotherm=debug`", isotherm_profile::allowed(text, LEVELS)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_filter_is_a_level_or_names_one() {
        for good in ["info", "DEBUG", "isotherm=debug", "warn,isotherm::gateway=trace", "off"] {
            assert_eq!(log_filter(good).as_deref(), Ok(good));
        }
        for (bad, meant) in [
            ("verbose", "allowed: error"),
            ("debgu", "did you mean `debug`"),
            ("", "allowed"),
            ("isotherm=loud", "allowed"),
        ] {
            assert!(log_filter(bad).is_err_and(|why| why.contains(meant)), "{bad}");
        }
    }
}
