//! A page for people: one HTML file with pictures, no script, and nothing from elsewhere.
//!
//! chart: every picture        style.css: paper, phone, printer

use maud::{DOCTYPE, Markup, PreEscaped, html};

use isotherm_core::quantity::Moment;

pub mod chart;

const STYLE: &str = include_str!("style.css");

/// A whole page; `source` says where its figures come from.
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
                    p { "Made by isotherm " (env!("CARGO_PKG_VERSION")) " on " (date(made)) ". Every figure comes from " (source) "." }
                    p { "Compensation is not a safety function: guards, stops and travel limits never depend on it." }
                }
            }
        }
    }
    .into_string()
}

/// A moment for programs; none for a log that counts from its own beginning.
pub fn rfc3339(moment: Moment) -> Option<String> {
    stamp(moment).map(|stamp| stamp.to_string())
}

fn stamp(moment: Moment) -> Option<jiff::Timestamp> {
    let stamp = jiff::Timestamp::from_nanosecond(i128::from(moment.as_nanos())).ok()?;
    (moment.as_secs_f64() >= YEAR_2000_S).then_some(stamp)
}

/// What lies before it counts from its own beginning.
const YEAR_2000_S: f64 = 946_684_800.0;

/// Date and time in UTC; a log that counts from its own beginning has none.
pub fn date(moment: Moment) -> String {
    stamp(moment).map_or("–".to_owned(), |stamp| stamp.strftime("%Y-%m-%d %H:%M UTC").to_string())
}

/// A picture with what it shows.
pub fn figure(title: &str, picture: &Markup, caption: &str) -> Markup {
    html! {
        figure {
            @if !title.is_empty() { h3 { (title) } }
            (picture)
            @if !caption.is_empty() { figcaption { (caption) } }
        }
    }
}

/// A table whose first column names its rows; it scrolls where the page is narrow. A head that ends in a colon stands over
/// words, the others over figures.
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

/// A row of a table: what it is about, then its cells.
pub fn row(name: &str, cells: impl IntoIterator<Item = String>) -> Markup {
    html! { tr { th scope="row" { (name) } @for cell in cells { td { (cell) } } } }
}

/// Two decimals, with a minus that is as wide as a plus.
pub fn number(value: f64) -> String {
    decimals(value, 2)
}

/// That many decimals, with a minus that is as wide as a plus.
pub fn decimals(value: f64, places: usize) -> String {
    let text = format!("{value:.places$}");
    let is_zero = !text.bytes().any(|byte| (b'1'..=b'9').contains(&byte));
    if is_zero { text.trim_start_matches('-').to_owned() } else { text.replace('-', "−") }
}

/// As many decimals as three digits need; below a thousandth as 4.29e-7, which gains per rpm² are.
pub fn three_digits(value: f64) -> String {
    let size = value.abs();
    if size > 0.0 && size < 1e-3 {
        // The exponent's own minus is what a profile may have.
        return format!("{}{size:.2e}", if value < 0.0 { "−" } else { "" });
    }
    let size = if size > 0.0 { size } else { 1.0 };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 5 decimals")]
    let places = (2.0 - size.log10().floor()).clamp(0.0, 5.0) as usize;
    decimals(value, places)
}

/// A step of a sensor: no more digits than it has.
pub fn plain(value: f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A length of time in hours and minutes; below a minute, in seconds.
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
