//! Facts in a report in addition to the model: machine, runs, limits of the axis, and drift of each run. The JSON
//! document contains these facts for programs. The HTML report shows the same facts.

use serde_json::{Value, json};

use crate::ambient::ambient_column;
use crate::dataset::{Dataset, Kind, Run};
use crate::drift::{Drift, drift};
use crate::identified::Identified;
use crate::setup::{Ready, units};
use crate::statistics::least_and_most;
use isotherm_core::compensation::settings::{AxisSettings, OnFault};
use isotherm_core::quantity::Moment;
use isotherm_html::rfc3339;
use isotherm_profile::Profile;

/// Creates the JSON document of `isotherm identify`: the identified model, with facts about the machine and the logs.
///
/// # Errors
/// A number cannot be represented in JSON.
pub fn document(
    profile: &Profile,
    ready: &Ready<'_>,
    found: &Identified,
    made: Moment,
) -> serde_json::Result<Value> {
    let dataset = ready.campaign.dataset.as_ref();
    let axis = profile.axes.iter().map(|axis| &axis.settings).find(|axis| axis.name == found.axis);
    let mut document = serde_json::to_value(found)?;
    document["machine"] = json!(profile.name);
    document["description"] = json!(profile.description);
    document["made"] = json!(rfc3339(made));
    document["logs"] = dataset.runs.iter().map(|run| log(dataset, run, found)).collect();
    document["limits"] = json!(axis.map(limits));
    document["drift"] = serde_json::to_value(of_error(profile, dataset, &found.error))?;
    Ok(document)
}

/// Returns the drift of the measured error in each run.
pub(super) fn of_error(profile: &Profile, dataset: &Dataset, error: &str) -> Vec<Drift> {
    // The document contains the remarks of the dataset already. An error column from which a model was identified has a
    // drift.
    let mut drifts = drift(dataset, &[error.to_owned()], None, &units(profile)).unwrap_or_default();
    drifts.iter_mut().for_each(|drift| drift.remarks.retain(|remark| !dataset.remarks.contains(remark)));
    drifts
}

/// Returns facts about a run as a JSON object. `begins` is null if the times of the log have no date.
fn log(dataset: &Dataset, run: &Run, found: &Identified) -> Value {
    let span = |place: usize| {
        let (min, max) = least_and_most(&run.values[place])?;
        Some(json!({ "name": dataset.columns[place].name, "min": min, "max": max }))
    };
    json!({
        "name": run.name,
        "begins": run.times.first().and_then(|first| rfc3339(*first)),
        "duration_s": run.lasts().as_secs_f64(),
        "rows": run.times.len(),
        "speeds": dataset.of_kind(Kind::Speed).filter_map(span).collect::<Value>(),
        "ambient": ambient_column(dataset, &found.notes.ambient).and_then(span),
    })
}

/// Returns the limits of the axis as a JSON object. The limits apply to Cz (the compensation value), whichever model
/// calculates it.
fn limits(axis: &AxisSettings) -> Value {
    json!({
        "limit_um": axis.guard.limit.get(),
        "step_um": axis.guard.step.get(),
        "every_s": axis.every.as_secs_f64(),
        "rate_um_per_s": axis.guard.rate.get(),
        "deadband_um": axis.guard.deadband.get(),
        "warn_um": axis.levels.warn.map(|level| level.get()),
        "error_um": axis.levels.error.map(|level| level.get()),
        "on_fault": match axis.on_fault {
            OnFault::Hold => "hold",
            OnFault::Ramp { .. } => "ramp",
            OnFault::Zero => "zero",
        },
    })
}
