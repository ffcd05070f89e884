//! Parts of a page that all reports have in common.

use maud::{Markup, html};

use isotherm_core::quantity::Moment;
use isotherm_html::duration;
use isotherm_profile::Profile;

/// Renders a report as a whole HTML page. `made` is the time of the report.
pub(super) fn page(title: &str, made: Moment, content: &Markup) -> String {
    isotherm_html::page(title, made, "the logs named here", content)
}

/// Renders the name and the description of the machine, for the list of facts at the head of a report.
pub(super) fn machine(profile: &Profile) -> Markup {
    html! {
        dt { "machine" } dd { (profile.name) @if !profile.description.is_empty() { ": " (profile.description) } }
    }
}

/// Renders two entries for the list of facts at the head of a report: the number of runs, and their total duration
/// `seconds`.
pub(super) fn runs(count: usize, seconds: f64) -> Markup {
    html! { dt { "runs" } dd { (count) ", " (duration(seconds)) " together" } }
}

/// Renders a list of sentences. If there are no sentences, renders nothing.
pub(super) fn list(items: &[Markup]) -> Markup {
    html! { @if !items.is_empty() { ul { @for item in items { li { (item) } } } } }
}

/// Formats a number with the function `written`; `–` if the number is missing.
pub(super) fn optional(value: Option<f64>, written: fn(f64) -> String) -> String {
    value.map_or("–".to_owned(), written)
}
