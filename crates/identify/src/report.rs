//! Reports of results, as one HTML file without scripts and external resources. The file can be sent to a customer.
//!
//! ```text
//! identified ─┬─ logs              runs, sensors, correlation map
//!             ├─ validation_page   charts and figures of each run
//!             └─ terms             the model, its stand-ins, its envelope, the limits in force
//! selection_page                   uses logs and validation_page, too
//! drift_page                       drift in the terms of ISO 230-3
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

/// Renders the machine for the list of facts at the head of a report.
fn machine(profile: &Profile) -> Markup {
    html! {
        dt { "machine" } dd { (profile.name) @if !profile.description.is_empty() { ": " (profile.description) } }
    }
}

/// Renders the number of runs and their total duration for the list of facts at the head of a report. `seconds` is the
/// duration.
fn runs(count: usize, seconds: f64) -> Markup {
    html! { dt { "runs" } dd { (count) ", " (duration(seconds)) " together" } }
}

/// Renders a list of sentences; nothing if there are none.
fn list(items: &[Markup]) -> Markup {
    html! { @if !items.is_empty() { ul { @for item in items { li { (item) } } } } }
}

/// Formats a figure; "–" if it is missing.
fn optional(value: Option<f64>, written: fn(f64) -> String) -> String {
    value.map_or("–".to_owned(), written)
}
