//! The report of `identify`.

use maud::{Markup, html};

use super::drifted::displacements;
use super::{date, duration, judged, logs, page, terms};
use crate::drift::Drift;
use crate::facts::of_error;
use crate::faults::{Finding, Repaired};
use crate::identified::Identified;
use crate::setup::Ready;
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;

/// What was identified, on which machine, from what.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// The machine.
    pub profile: &'a Profile,
    /// The runs as they were learnt from.
    pub ready: &'a Ready<'a>,
    /// The model.
    pub found: &'a Identified,
    /// When the report is made.
    pub made: Moment,
}

/// One HTML file.
pub fn identified(subject: &Subject<'_>) -> String {
    let Subject { profile, ready, found, made } = *subject;
    let dataset = ready.logs;
    let mended = found.repaired.iter().map(Repaired::finding);
    let faulty: Vec<Finding> = found.excluded.iter().cloned().chain(mended).collect();
    let axis = profile.axes.iter().map(|axis| &axis.settings).find(|axis| axis.name == found.axis);
    let used = |name: &str| {
        found.columns.iter().find(|column| column.name == name).map_or("–", |column| column.used)
    };
    let drifts = of_error(profile, dataset, &found.error);
    let hours: f64 = dataset.runs.iter().map(|run| run.lasts().as_secs_f64()).sum();
    let content = html! {
        dl .facts {
            dt { "machine" } dd { (profile.name) @if !profile.description.is_empty() { ": " (profile.description) } }
            dt { "axis" } dd { (found.axis) ", measured error " (found.error) }
            dt { "date" } dd { (date(made)) }
            dt { "method" } dd {
                (found.method)
                @if let Some(probe) = found.probe_s { ", with a probe every " (duration(probe)) }
            }
            dt { "runs" } dd { (dataset.runs.len()) ", " (duration(hours)) " together" }
        }
        (judged::headline(&found.means, &found.uncompensated))
        @if !faulty.is_empty() || !found.remarks.is_empty() {
            ul {
                @for faulty in &found.excluded { li { strong { (faulty.signal) } " was left out: " (faulty.reason) } }
                @for mended in &found.repaired {
                    li { strong { (mended.signal) } " " (mended.fault) " in " (mended.run) ": " (mended.done) }
                }
                @for remark in &found.remarks { li { (remark) } }
            }
        }
        (judged::pictures(found))
        (judged::cross_validation(&found.runs, &found.means, &found.uncompensated))
        (terms::terms(found))
        (terms::stand_ins(&found.fallbacks, &found.means))
        (terms::envelope(found.region.as_ref()))
        @if let Some(axis) = axis { (terms::limits(axis)) }
        (drift(&drifts))
        (logs::runs(dataset, &found.ambient))
        (logs::sensors(dataset, &used, &faulty, &found.ambient))
        (logs::over_time(dataset, &faulty))
        (logs::alike(&ready.campaign))
    };
    page(&format!("{}: thermal compensation of axis {}", profile.name, found.axis), made, &content)
}

/// The bare error of each run, in the terms of ISO 230-3.
fn drift(drifts: &[Drift]) -> Markup {
    let rows =
        drifts.iter().flat_map(|drift| drift.displacements.iter().map(|moved| (drift.name.as_str(), moved)));
    html! {
        h2 { "Drift tests" }
        p { "The measured error of each run, without compensation, in the terms of ISO 230-3. A description: no duration and no limit of the standard is applied." }
        ul { @for drift in drifts { li { (drift.name) ": " (drift.test.words()) ", as " (drift.because) } } }
        (displacements(rows))
    }
}
