//! Formats counts, durations and lines of a profile for use in sentences.

use std::fmt::Display;
use std::time::Duration;

/// Warning about a model that depends on machine start, if no signal shows the start. The gateway then
/// keeps the first good reading of its first run as the reference, also over restarts.
pub const NO_MACHINE_START: &str = "The model counts from machine start, but no signal shows the start \
     ([machine] on). Without such a signal, the gateway always uses the reference temperature of its first run.";

/// Formats a count with its noun, which gets an "s" unless the count is one: `1 row`, `2 rows`.
pub fn counted(count: impl Display, noun: &str) -> String {
    let count = count.to_string();
    let plural = if count == "1" { "" } else { "s" };
    format!("{count} {noun}{plural}")
}

/// Formats the line `allow_override = […]` with these keys. With this line, a profile permits layers (local file,
/// environment, `--set`) to set the keys.
pub(crate) fn allowing_line<'a>(keys: impl IntoIterator<Item = &'a String>) -> String {
    let keys: Vec<String> = keys.into_iter().map(|key| format!("{key:?}")).collect();
    format!("allow_override = [{}]", keys.join(", "))
}

/// Formats a duration for a sentence, in a notation that a profile also accepts: `1m 30s`, `9 days`, `1 day 2h`.
pub fn duration_text(span: Duration) -> String {
    let mut text = humantime::format_duration(span).to_string();
    // Words need a space before them, symbols do not.
    for word in ["day", "month", "year"] {
        if let Some(place) = text.find(word) {
            text.insert(place, ' ');
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_no_plural() {
        let counts = [0_u64, 1, 2, 11, 21].map(|count| counted(count, "read request"));
        assert_eq!(
            counts,
            ["0 read requests", "1 read request", "2 read requests", "11 read requests", "21 read requests"]
        );
        assert_eq!(counted(1_usize, "time"), "1 time");
    }

    #[test]
    fn a_unit_that_is_a_word_stands_apart_and_a_profile_takes_the_text() {
        const DAY: u64 = 86_400;
        for (seconds, text) in [
            (0, "0s"),
            (90, "1m 30s"),
            (9 * DAY, "9 days"),
            (DAY, "1 day"),
            (DAY + 7200, "1 day 2h"),
            (31_557_600, "1 year"),
            (2 * 31_557_600 + 2_630_016 + 3 * DAY + 1, "2 years 1 month 3 days 1s"),
        ] {
            let span = Duration::from_secs(seconds);
            assert_eq!(duration_text(span), text);
            assert_eq!(humantime::parse_duration(text).unwrap(), span);
        }
        assert_eq!(duration_text(Duration::from_millis(1500)), "1s 500ms");
    }
}
