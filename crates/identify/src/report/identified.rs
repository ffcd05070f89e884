//! HTML report of the command `isotherm identify`: the model, its validation, its sensors and its logs.

use maud::{Markup, html};

use super::drift_page::displacements;
use super::page::{list, machine, page, runs};
use super::{logs, terms, validation_page};
use crate::drift::Drift;
use crate::facts::of_error;
use crate::faults::{Finding, Omission, Repaired};
use crate::identified::Identified;
use crate::setup::Ready;
use isotherm_core::quantity::Moment;
use isotherm_html::{date, duration, number};
use isotherm_profile::Profile;

/// Content of the report: the model, its machine, and its logs.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// Profile of the machine.
    pub profile: &'a Profile,
    /// Runs from which the model was identified.
    pub ready: &'a Ready<'a>,
    /// Identified model with its cross-validation.
    pub found: &'a Identified,
    /// Time at which the report is made.
    pub made: Moment,
}

/// Returns the report about an identified model as one HTML file.
pub fn identified(subject: &Subject<'_>) -> String {
    let Subject { profile, ready, found, made } = *subject;
    let dataset = ready.logs;
    let mended = found.repaired.iter().map(Repaired::finding);
    let faulty: Vec<Finding> = found.notes.excluded.iter().cloned().chain(mended).collect();
    let axis = profile.axes.iter().map(|axis| &axis.settings).find(|axis| axis.name == found.axis);
    let used = |name: &str| {
        found.columns.iter().find(|column| column.name == name).map_or("–", |column| column.used)
    };
    let excluded = |faulty: &Finding| html! { strong { (faulty.signal) } " was left out: " (faulty.reason) };
    let repaired = |mended: &Repaired| html! { strong { (mended.signal) } " " (mended.fault) " in " (mended.run) ": " (mended.done) };
    let omitted = |omission: &Omission| {
        html! {
            "Without " strong { (omission.signal) } " the error of held-out runs is " (number(omission.without_um)) " µm RMS, with it "
            (number(omission.with_um)) " µm"
        }
    };
    let remark = |remark: &String| html! { (remark) };
    let mut notes: Vec<Markup> = found.notes.excluded.iter().map(excluded).collect();
    notes.extend(found.notes.omissions.iter().map(omitted));
    notes.extend(found.repaired.iter().map(repaired).chain(found.notes.remarks.iter().map(remark)));
    let content = html! {
        dl .facts {
            (machine(profile))
            dt { "axis" } dd { (found.axis) ", measured error " (found.error) }
            dt { "date" } dd { (date(made)) }
            dt { "method" } dd {
                (found.method)
                @if let Some(probe) = found.probe_s { ", with a probe every " (duration(probe)) }
            }
            (runs(dataset.runs.len(), dataset.seconds()))
        }
        @if !found.runs.is_empty() { (validation_page::headline(&found.means, &found.uncompensated)) }
        (list(&notes))
        @if !found.runs.is_empty() {
            (validation_page::pictures(found))
            (validation_page::cross_validation(&found.runs, &found.means, &found.uncompensated))
        }
        (terms::terms(found))
        (terms::expected(found))
        (terms::by_sensors(&found.by_sensors))
        (terms::stand_ins(found))
        (terms::envelope(found.region.as_ref()))
        @if let Some(axis) = axis { (terms::limits(axis)) }
        (drift(&of_error(profile, dataset, &found.error)))
        (logs::runs(dataset, &found.notes.ambient))
        (logs::sensors(dataset, &used, &faulty, &found.notes.ambient))
        (logs::over_time(dataset, &faulty))
        (logs::alike(&ready.campaign))
    };
    page(&format!("{}: thermal compensation of axis {}", profile.name, found.axis), made, &content)
}

/// Renders the drift of the measured error in each run, in the terms of ISO 230-3.
fn drift(drifts: &[Drift]) -> Markup {
    let rows =
        drifts.iter().flat_map(|drift| drift.displacements.iter().map(|moved| (drift.name.as_str(), moved)));
    html! {
        h2 { "Drift tests" }
        p { "The measured error of each run, without compensation, in the terms of ISO 230-3. This is a description: no duration and no limit of the standard is applied." }
        ul { @for drift in drifts { li { (drift.name) ": " (drift.test.title()) ", as " (drift.because) } } }
        (displacements(rows))
    }
}
