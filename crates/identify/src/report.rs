//! Reports of results, as one HTML file without scripts and external resources. It can be sent to a customer.
//!
//! ```text
//! identified ─┬─ logs      runs, sensors, correlation map      selected
//!             ├─ judged    charts and figures of each run
//!             └─ terms     the model, its substitutes, its envelope, the limits in force
//! ```

use maud::{Markup, html};

use isotherm_core::quantity::Moment;
use isotherm_html::{chart, date, decimals, duration, figure, number, plain, row, table, three_digits};
use isotherm_profile::Profile;

mod drift_page;
mod identified;
mod logs;
mod selection_page;
mod terms;
mod validation_page;

pub use drift_page::drift_page;
pub use identified::{Subject, identified};
pub use selection_page::selection_page;

/// Renders a whole HTML page.
fn page(title: &str, made: Moment, content: &Markup) -> String {
    isotherm_html::page(title, made, "the logs named here", content)
}

/// Machine, in the facts at the head of an HTML report.
fn machine(profile: &Profile) -> Markup {
    html! {
        dt { "machine" } dd { (profile.name) @if !profile.description.is_empty() { ": " (profile.description) } }
    }
}

/// Number of runs and their total duration in seconds, in the facts at the head of an HTML report.
fn runs(count: usize, seconds: f64) -> Markup {
    html! { dt { "runs" } dd { (count) ", " (duration(seconds)) " together" } }
}

/// List of sentences; nothing if it is empty.
fn list(items: &[Markup]) -> Markup {
    html! { @if !items.is_empty() { ul { @for item in items { li { (item) } } } } }
}

/// Formats a figure; "–" if it is missing.
fn optional(value: Option<f64>, written: fn(f64) -> String) -> String {
    value.map_or("–".to_owned(), written)
}
