//! What was found, as one HTML file that a customer can be sent: no script, and nothing from elsewhere.
//!
//! ```text
//! identified ─┬─ logs      runs, sensors, correlation map      selected
//!             ├─ judged    pictures and figures of each run
//!             └─ terms     the model, its stand-ins, its envelope, the limits in force
//! ```

use maud::{Markup, html};

use isotherm_core::quantity::Moment;
use isotherm_html::{chart, date, decimals, duration, figure, number, plain, row, table, three_digits};
use isotherm_profile::Profile;

mod drifted;
mod identified;
mod judged;
mod logs;
mod selected;
mod terms;

pub use drifted::drifted;
pub use identified::{Subject, identified};
pub use selected::selected;

/// A whole page.
fn page(title: &str, made: Moment, content: &Markup) -> String {
    isotherm_html::page(title, made, "the logs named here", content)
}

/// Among the facts at its head: which machine.
fn machine(profile: &Profile) -> Markup {
    html! {
        dt { "machine" } dd { (profile.name) @if !profile.description.is_empty() { ": " (profile.description) } }
    }
}

/// How many runs, and how long they are together, s.
fn runs(count: usize, seconds: f64) -> Markup {
    html! { dt { "runs" } dd { (count) ", " (duration(seconds)) " together" } }
}

/// A list of sentences, where there is any.
fn list(items: &[Markup]) -> Markup {
    html! { @if !items.is_empty() { ul { @for item in items { li { (item) } } } } }
}

/// A figure that may be missing.
fn optional(value: Option<f64>, written: fn(f64) -> String) -> String {
    value.map_or("–".to_owned(), written)
}
