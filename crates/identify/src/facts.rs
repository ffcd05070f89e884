//! What a report says besides the model: the machine, its runs, what bounds the axis, and the drift of each run. For
//! programs; the page says the same.

use serde::Serialize;

use crate::ambient::is_ambient;
use crate::dataset::{Dataset, Kind, Run};
use crate::drift::{Drift, drift};
use crate::identified::Identified;
use crate::setup::Ready;
use crate::statistics::least_and_most;
use isotherm_core::compensation::settings::{AxisSettings, OnFault};
use isotherm_core::quantity::Moment;
use isotherm_html::rfc3339;
use isotherm_profile::Profile;

/// What was identified, with the machine and the logs that it comes from: the JSON of `identify`.
#[derive(Clone, Debug, Serialize)]
pub struct Document<'a> {
    /// The machine's name.
    pub machine: &'a str,
    /// In its profile's words.
    pub description: &'a str,
    /// When this was made, RFC 3339.
    pub made: Option<String>,
    /// The model and its cross-validation.
    #[serde(flatten)]
    pub found: &'a Identified,
    /// The runs as they were recorded.
    pub logs: Vec<LogFacts>,
    /// What bounds the axis, whatever a model asks for.
    pub limits: Option<Limits>,
    /// The drift of the measured error over each run, in the terms of ISO 230-3.
    pub drift: Vec<Drift>,
}

/// One run as it was recorded.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogFacts {
    /// Its name.
    pub name: String,
    /// Its first row, RFC 3339; none where the log counts from its own beginning.
    pub begins: Option<String>,
    /// From the first row to the last, s.
    pub duration_s: f64,
    /// Rows.
    pub rows: usize,
    /// Least and most of each speed.
    pub speeds: Vec<Span>,
    /// Least and most of the air around the machine, °C: of the column that is named for it, or behaves so.
    pub ambient: Option<Span>,
}

/// From where to where a column went.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Span {
    /// The column.
    pub name: String,
    /// Its least value.
    pub min: f64,
    /// Its largest value.
    pub max: f64,
}

/// The guard of an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Limits {
    /// Largest |Cz|, µm.
    pub limit_um: f64,
    /// Largest change of one update, µm.
    pub step_um: f64,
    /// Update period, s.
    pub every_s: f64,
    /// µm/s.
    pub rate_um_per_s: f64,
    /// A smaller change is not made, µm.
    pub deadband_um: f64,
    /// Beyond it the axis warns, µm.
    pub warn_um: Option<f64>,
    /// Beyond it the axis goes off, µm.
    pub error_um: Option<f64>,
    /// hold, ramp or zero.
    pub on_fault: &'static str,
}

/// Everything that the report says, for programs.
pub fn document<'a>(
    profile: &'a Profile,
    ready: &Ready<'_>,
    found: &'a Identified,
    made: Moment,
) -> Document<'a> {
    let dataset = ready.campaign.dataset.as_ref();
    let axis = profile.axes.iter().map(|axis| &axis.settings).find(|axis| axis.name == found.axis);
    Document {
        machine: &profile.name,
        description: &profile.description,
        made: rfc3339(made),
        found,
        logs: dataset.runs.iter().map(|run| log(dataset, run, found)).collect(),
        limits: axis.map(limits),
        drift: of_error(profile, dataset, &found.error),
    }
}

/// The drift of the measured error over each run.
pub(super) fn of_error(profile: &Profile, dataset: &Dataset, error: &str) -> Vec<Drift> {
    let unit =
        |name: &str| profile.signals.iter().find(|signal| signal.name == name).map(|signal| signal.unit.0);
    // What the dataset remarks stands in the document already; an error that was identified on has a drift.
    let mut drifts = drift(dataset, &[error.to_owned()], None, &unit).unwrap_or_default();
    drifts.iter_mut().for_each(|drift| drift.remarks.retain(|remark| !dataset.remarks.contains(remark)));
    drifts
}

fn log(dataset: &Dataset, run: &Run, found: &Identified) -> LogFacts {
    let span = |place: usize| {
        let (min, max) = least_and_most(run.values[place].iter().copied())?;
        Some(Span { name: dataset.columns[place].name.clone(), min, max })
    };
    let of_kind = |kind: Kind| {
        dataset
            .columns
            .iter()
            .enumerate()
            .filter(move |(_, column)| column.kind == kind)
            .map(|(place, _)| place)
    };
    let behaves =
        |place: &usize| found.ambient.iter().any(|like| like.signal == dataset.columns[*place].name);
    let ambient = of_kind(Kind::Temperature)
        .find(|place| is_ambient(&dataset.columns[*place].name))
        .or_else(|| of_kind(Kind::Temperature).find(behaves));
    LogFacts {
        name: run.name.clone(),
        begins: run.times.first().and_then(|first| rfc3339(*first)),
        duration_s: run.lasts().as_secs_f64(),
        rows: run.times.len(),
        speeds: of_kind(Kind::Speed).filter_map(span).collect(),
        ambient: ambient.and_then(span),
    }
}

fn limits(axis: &AxisSettings) -> Limits {
    Limits {
        limit_um: axis.guard.limit.get(),
        step_um: axis.guard.step.get(),
        every_s: axis.every.as_secs_f64(),
        rate_um_per_s: axis.guard.rate.get(),
        deadband_um: axis.guard.deadband.get(),
        warn_um: axis.levels.warn.map(|level| level.get()),
        error_um: axis.levels.error.map(|level| level.get()),
        on_fault: match axis.on_fault {
            OnFault::Hold => "hold",
            OnFault::Ramp { .. } => "ramp",
            OnFault::Zero => "zero",
        },
    }
}
