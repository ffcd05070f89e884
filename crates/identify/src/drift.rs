//! Drift in a log, in the terms of ISO 230-3: how much each displacement changed, when it changed, and which movements
//! warmed the machine at that time. This module only describes the drift. It does not apply a test duration or a limit
//! of the standard.

use serde::Serialize;

use crate::checks;
use crate::dataset::{BadLog, Dataset, Kind, Refusal, Run, Units};
use crate::minutes::Minutes;
use crate::statistics::range;
use crate::touches::is_acting;
use activity::Mover;

mod activity;

pub use activity::Stage;
pub(crate) use activity::is_feed;

/// Tests of ISO 230-3 to which a log can correspond.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Test {
    /// Environmental temperature variation error: no spindle turns, and no axis moves.
    Etve,
    /// Thermal distortion by a rotating spindle.
    Spindle,
    /// Thermal distortion by moving linear axes.
    Axis,
    /// Thermal distortion by rotary motion.
    Rotary,
}

/// Range below which a displacement counts as constant, µm.
const STILL: f64 = 1e-6;

impl Test {
    /// Returns the name of the test in the words of the standard.
    pub fn title(self) -> &'static str {
        match self {
            Test::Etve => "environmental temperature variation error (ETVE)",
            Test::Spindle => "thermal distortion by a rotating spindle",
            Test::Axis => "thermal distortion by moving linear axes",
            Test::Rotary => "thermal distortion by rotary motion",
        }
    }
}

/// Drift of one run: the changes of its displacements and temperatures, and the movements that warmed the machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drift {
    /// Name of the run.
    pub name: String,
    /// Test to which the log corresponds.
    pub test: Test,
    /// Reason for the choice of `test`.
    pub because: String,
    /// Duration of the run, from its first log row to its last, h.
    pub hours: f64,
    /// Number of rows of the run.
    pub rows: usize,
    /// Drift of each displacement in the log.
    pub displacements: Vec<Displacement>,
    /// Change of each temperature in the log.
    pub temperatures: Vec<Temperature>,
    /// Stages of the movement that warms the machine; empty if nothing moved.
    pub stages: Vec<Stage>,
    /// Remarks for the operator about unusual data.
    pub remarks: Vec<String>,
}

/// Drift of one displacement over a run, from the means of each minute. Ranges are maximum minus minimum.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Displacement {
    /// Name of the log column with the displacement.
    pub name: String,
    /// Range of the displacement over the whole run, µm.
    pub range_um: f64,
    /// Range of the displacement in the first hour of the run, µm; `None` if the run is shorter than an hour.
    pub first_hour_um: Option<f64>,
    /// Range of the displacement in the last hour of the run, µm; `None` if the run is shorter than an hour.
    pub last_hour_um: Option<f64>,
    /// Largest range of the displacement within any 60 min of the run, µm; `None` if the run is shorter than an hour.
    pub largest_60min_um: Option<f64>,
    /// Start of the 60 min with the largest range, h since the first row; `None` if the run is shorter than an hour.
    pub largest_60min_from_h: Option<f64>,
    /// Change of the displacement from the first minutes of the run to its last minutes, µm.
    pub drift_um: f64,
    /// Mean drift rate: change of the displacement from the start to the end of the run, divided by the time between
    /// them, µm/h.
    pub drift_um_per_h: f64,
    /// Change of the displacement in each stage, µm; `None` if the displacement was not measured in the stage.
    pub stages_um: Vec<Option<f64>>,
}

/// Change of the temperature at one sensor over a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Temperature {
    /// Name of the log column with the temperature.
    pub name: String,
    /// Mean temperature in the first minutes of the run, °C.
    pub begin_c: f64,
    /// Mean temperature in the last minutes of the run, °C.
    pub end_c: f64,
    /// Range of the temperature in the run (maximum minus minimum), K.
    pub range_k: f64,
    /// Largest range of the temperature within any 60 min of the run, K; `None` if the run is shorter than an hour.
    pub largest_60min_k: Option<f64>,
}

/// Calculates the drift of every run. `displacements` contains the names of the columns; if it is empty, all columns in
/// µm are used. `test` is the test of ISO 230-3; if it is `None`, the movements in the log show which test was made.
/// `units` returns the unit of a column in the profile.
///
/// # Errors
/// A displacement column is missing or has no values, a run has no duration, or the unit of its times is probably
/// wrong. Each message tells the operator what to do.
pub fn drift(
    dataset: &Dataset,
    displacements: &[String],
    test: Option<Test>,
    units: Units<'_>,
) -> Result<Vec<Drift>, BadLog> {
    let (names, all) = (dataset.names(), dataset.names().join(", "));
    let missing = displacements.iter().filter(|name| !names.contains(&name.as_str()));
    let mut wrong: Vec<String> =
        missing.map(|name| format!("no log has a column `{name}`; there are {all}")).collect();
    let is_asked = |place: &usize| match displacements {
        [] => {
            let column = &dataset.columns[*place];
            column.kind == Kind::Displacement && !is_acting(dataset, &column.name)
        }
        asked => asked.contains(&dataset.columns[*place].name),
    };
    let columns: Vec<usize> = (0..dataset.columns.len()).filter(is_asked).collect();
    if columns.is_empty() && wrong.is_empty() {
        wrong.push(format!(
            "no column is a displacement. Add the ending `_um` to the name of a column in µm, or `_um [mm]` \
             to that of a column in mm. Or write the name of a column in µm after --displacement. The \
             columns are {all}"
        ));
    }
    let in_mm = columns.iter().filter(|column| dataset.columns[**column].kind == Kind::Position);
    wrong.extend(in_mm.map(|column| checks::in_mm(&dataset.columns[*column].name)));
    checks::check_plausible(dataset, columns.iter().copied(), &mut wrong);
    for run in &dataset.runs {
        let is_empty = |column: &&usize| !run.values[**column].iter().any(|value| value.is_finite());
        wrong.extend(
            columns
                .iter()
                .filter(is_empty)
                .map(|column| format!("{} has no value in {}: leave that log out", names[*column], run.name)),
        );
        if run.lasts().is_zero() {
            wrong.push(format!(
                "{}: all rows have the same time, but a drift needs a beginning and an end: leave that log \
                 out",
                run.name
            ));
        } else if run.origin.is_unit_assumed
            && let Some(odd) = checks::odd_length(run)
        {
            wrong.push(format!("{odd}. If the times are in seconds, add --time-unit s"));
        }
    }
    if !wrong.is_empty() {
        return Err(BadLog(wrong));
    }
    let movers = activity::movers(dataset, units);
    Ok(dataset.runs.iter().map(|run| of_run(dataset, run, &columns, test, &movers)).collect())
}

fn of_run(dataset: &Dataset, run: &Run, columns: &[usize], asked: Option<Test>, movers: &[Mover]) -> Drift {
    let mut remarks = dataset.remarks.clone();
    remarks.extend(dataset.repeats.iter().cloned());
    let is_of_another =
        |refusal: &&Refusal| !columns.iter().any(|column| dataset.columns[*column].name == refusal.column);
    remarks.extend(dataset.implausible.iter().filter(is_of_another).map(|refusal| refusal.message.clone()));
    remarks.extend(checks::odd_length(run));
    remarks.extend(columns.iter().filter_map(|column| over_touches(dataset, run, *column)));
    let is_other =
        |column: &usize| !columns.contains(column) && !movers.iter().any(|mover| mover.column == *column);
    let temperatures: Vec<usize> = dataset.of_kind(Kind::Temperature).filter(is_other).collect();
    remarks.extend(checks::fahrenheit(dataset, &temperatures));
    let name = |column: usize| dataset.columns[column].name.clone();
    let stands_still = columns.iter().filter(|column| run.range(**column) < STILL);
    remarks.extend(
        stands_still.map(|column| format!("{} is constant: was the probe connected?", name(*column))),
    );
    let active: Vec<&Mover> = movers.iter().filter(|mover| mover.moves(run)).collect();
    let (test, mover, because) = activity::likeness(asked, &active, &mut remarks);
    let stages = mover.map(|mover| mover.stages(run)).unwrap_or_default();
    let displacement = |column: &usize| displacement(name(*column), &Minutes::of(run, *column), &stages);
    let temperature = |column: usize| temperature(name(column), &Minutes::of(run, column));
    Drift {
        name: run.name.clone(),
        test,
        because,
        hours: run.lasts().as_secs_f64() / 3600.0,
        rows: run.times.len(),
        displacements: columns.iter().map(displacement).collect(),
        temperatures: temperatures.into_iter().filter_map(temperature).collect(),
        stages,
        remarks,
    }
}

/// Returns a remark if a displacement was measured by touches of a probe instead of in every row. `None` if it was
/// measured in every row.
fn over_touches(dataset: &Dataset, run: &Run, column: usize) -> Option<String> {
    let name = &dataset.columns[column].name;
    let touches = run.values[column].iter().filter(|value| value.is_finite()).count();
    let is_touched = name.contains("_measured_um") && 2 * touches < run.times.len();
    is_touched.then(|| {
        format!(
            "{name} was measured by {touches} touches of a probe. A measurement in every row would give a \
             range that is about 1.3 times as large"
        )
    })
}

fn displacement(name: String, minutes: &Minutes, stages: &[Stage]) -> Displacement {
    let (edges, largest) = (minutes.first_and_last_hour(), minutes.largest_hour());
    let (begin, end) = (minutes.begin(), minutes.end());
    let hours = (end.0 - begin.0) / 3600.0;
    let drift_um = end.1 - begin.1;
    let change = |stage: &Stage| minutes.change(stage.from_h * 3600.0, stage.to_h * 3600.0);
    Displacement {
        name,
        range_um: range(&minutes.values),
        first_hour_um: edges.map(|(first, _)| first),
        last_hour_um: edges.map(|(_, last)| last),
        largest_60min_um: largest.map(|(_, range)| range),
        largest_60min_from_h: largest.map(|(second, _)| second / 3600.0),
        drift_um,
        drift_um_per_h: if hours > 0.0 { drift_um / hours } else { 0.0 },
        stages_um: stages.iter().map(change).collect(),
    }
}

/// Returns the change of a temperature; `None` if the log has no value of it.
fn temperature(name: String, minutes: &Minutes) -> Option<Temperature> {
    (!minutes.values.is_empty()).then(|| Temperature {
        name,
        begin_c: minutes.begin().1,
        end_c: minutes.end().1,
        range_k: range(&minutes.values),
        largest_60min_k: minutes.largest_hour().map(|(_, range)| range),
    })
}
