//! Reports as one HTML file with charts, without scripts and external resources.
//!
//! The module `chart` draws the charts; `style.css` contains the style for screen, phone and printer.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use isotherm_core::quantity::Moment;

pub mod chart;

const STYLE: &str = include_str!("style.css");

/// Renders a complete HTML page. `made` is the time at which the page was made. `source` names the origin of the
/// figures on the page, for example a log file.
pub fn page(title: &str, made: Moment, source: &str, content: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                (content)
                footer {
                    p { "Made by isotherm " (env!("CARGO_PKG_VERSION")) " on " (date(made)) ". All values come from " (source) "." }
                    p { "Compensation is not a safety function: guards, stops and travel limits never depend on it." }
                }
            }
        }
    }
    .into_string()
}

/// Formats a point in time in the notation of RFC 3339. Returns `None` if the time counts from the start of a log,
/// because such a time has no date.
pub fn rfc3339(moment: Moment) -> Option<String> {
    stamp(moment).map(|stamp| stamp.to_string())
}

fn stamp(moment: Moment) -> Option<jiff::Timestamp> {
    let stamp = jiff::Timestamp::from_nanosecond(i128::from(moment.as_nanos())).ok()?;
    (moment.as_secs_f64() >= YEAR_2000_S).then_some(stamp)
}

/// Seconds from 1970 to the year 2000. A smaller value is not a date, but a time since the start of a log.
const YEAR_2000_S: f64 = 946_684_800.0;

/// Formats date and time in UTC. Returns "–" if the time counts from the start of a log.
pub fn date(moment: Moment) -> String {
    stamp(moment).map_or("–".to_owned(), |stamp| stamp.strftime("%Y-%m-%d %H:%M UTC").to_string())
}

/// Renders a chart with title and caption; both may be empty.
pub fn figure(title: &str, picture: &Markup, caption: &str) -> Markup {
    html! {
        figure {
            @if !title.is_empty() { h3 { (title) } }
            (picture)
            @if !caption.is_empty() { figcaption { (caption) } }
        }
    }
}

/// Renders a table; its first column names the rows. On a narrow screen, the user can scroll the table sideways. A
/// column whose heading ends in a colon contains words, any other column contains figures.
pub fn table(heads: &[&str], rows: &Markup) -> Markup {
    html! {
        div .scroll tabindex="0" {
            table {
                thead { tr { @for head in heads { th scope="col" .words[head.ends_with(':')] { (head.trim_end_matches(':')) } } } }
                tbody { (rows) }
            }
        }
    }
}

/// Renders a row of a table: the name of the row, then its cells.
pub fn row(name: &str, cells: impl IntoIterator<Item = String>) -> Markup {
    html! { tr { th scope="row" { (name) } @for cell in cells { td { (cell) } } } }
}

/// Formats a number with two decimals, and with a minus sign as wide as a plus sign.
pub fn number(value: f64) -> String {
    decimals(value, 2)
}

/// Formats a number with this number of decimals (`places`), and with a minus sign as wide as a plus sign.
pub fn decimals(value: f64, places: usize) -> String {
    let text = format!("{value:.places$}");
    let is_zero = !text.bytes().any(|byte| (b'1'..=b'9').contains(&byte));
    if is_zero { text.trim_start_matches('-').to_owned() } else { text.replace('-', "−") }
}

/// Formats a number with three significant digits and at most five decimals. A number below a thousandth, for example a
/// gain per rpm², has the form 4.29e-7.
pub fn three_digits(value: f64) -> String {
    let size = value.abs();
    if size > 0.0 && size < 1e-3 {
        // The minus of the exponent stays ASCII, because a profile accepts only that.
        return format!("{}{size:.2e}", if value < 0.0 { "−" } else { "" });
    }
    let size = if size > 0.0 { size } else { 1.0 };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 5 decimals")]
    let places = (2.0 - size.log10().floor()).clamp(0.0, 5.0) as usize;
    decimals(value, places)
}

/// Formats a number with at most six decimals and without trailing zeros, for example the resolution of a sensor.
pub fn plain(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Formats a duration in hours and minutes. A duration below one minute is in seconds.
pub fn duration(seconds: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a run's length in minutes")]
    let minutes = (seconds / 60.0).round().max(0.0) as u64;
    if seconds < 60.0 {
        return format!("{} s", plain(seconds));
    }
    match (minutes / 60, minutes % 60) {
        (0, minutes) => format!("{minutes} min"),
        (hours, 0) => format!("{hours} h"),
        (hours, minutes) => format!("{hours} h {minutes:02} min"),
    }
}
