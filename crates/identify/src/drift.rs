//! What a log says about drift, in the terms of ISO 230-3: how far each displacement went, when, and what the machine
//! did meanwhile. A description: no duration and no limit of the standard is applied.

use serde::Serialize;

use crate::checks;
use crate::dataset::{BadLog, Dataset, Kind, Run, Units};
use crate::minutes::Minutes;
use crate::statistics::range;
use activity::Mover;

mod activity;

pub use activity::Stage;
pub(crate) use activity::is_feed;

/// The tests of ISO 230-3 that a log may be like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Test {
    /// Environmental temperature variation error: nothing turns or moves.
    Etve,
    /// Thermal distortion by a rotating spindle.
    Spindle,
    /// Thermal distortion by moving linear axes.
    Axis,
    /// Thermal distortion by rotary motion.
    Rotary,
}

/// What moves less, µm, is no displacement.
const STILL: f64 = 1e-6;

impl Test {
    /// In the words of the standard.
    pub fn title(self) -> &'static str {
        match self {
            Test::Etve => "environmental temperature variation error (ETVE)",
            Test::Spindle => "thermal distortion by a rotating spindle",
            Test::Axis => "thermal distortion by moving linear axes",
            Test::Rotary => "thermal distortion by rotary motion",
        }
    }
}

/// The drift of one run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drift {
    /// The run's name.
    pub name: String,
    /// What the log is like.
    pub test: Test,
    /// Why it is taken for that.
    pub because: String,
    /// From the first row to the last, h.
    pub hours: f64,
    /// Rows of the log.
    pub rows: usize,
    /// Each displacement column.
    pub displacements: Vec<Displacement>,
    /// Each temperature column.
    pub temperatures: Vec<Temperature>,
    /// What turned or moved, stage by stage; empty where nothing did.
    pub stages: Vec<Stage>,
    /// What is odd.
    pub remarks: Vec<String>,
}

/// One displacement over a run, from means of each minute; ranges are largest minus smallest.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Displacement {
    /// The column.
    pub name: String,
    /// Over the whole time, µm.
    pub range_um: f64,
    /// In the first hour, µm; none where the log is shorter.
    pub first_hour_um: Option<f64>,
    /// In the last hour, µm; none where the log is shorter.
    pub last_hour_um: Option<f64>,
    /// The largest in any 60 min, µm; none where the log is shorter.
    pub largest_60min_um: Option<f64>,
    /// Where that hour begins, h.
    pub largest_60min_from_h: Option<f64>,
    /// From the first minutes to the last, µm.
    pub drift_um: f64,
    /// The same for each hour, µm/h.
    pub drift_um_per_h: f64,
    /// From the begin to the end of each stage, µm; none where the column is empty there.
    pub stages_um: Vec<Option<f64>>,
}

/// One temperature over a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Temperature {
    /// The column.
    pub name: String,
    /// In the first minutes, °C.
    pub begin_c: f64,
    /// In the last minutes, °C.
    pub end_c: f64,
    /// Largest minus smallest, K.
    pub range_k: f64,
    /// The largest in any 60 min, K; none where the log is shorter.
    pub largest_60min_k: Option<f64>,
}

/// The drift of every run. `displacements` names the columns; empty: all that are in µm. `test`: as what; `None`: as what
/// turns or moves. `units` gives the unit of a column where a profile knows it.
///
/// # Errors
/// Sentences that say what to do.
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
        [] => dataset.columns[*place].kind == Kind::Displacement,
        asked => asked.contains(&dataset.columns[*place].name),
    };
    let columns: Vec<usize> = (0..dataset.columns.len()).filter(is_asked).collect();
    if columns.is_empty() && wrong.is_empty() {
        wrong.push(format!(
            "no column is a displacement: name it so that it ends with _um, or give it with --displacement; there are {all}"
        ));
    }
    for run in &dataset.runs {
        let is_empty = |column: &&usize| !run.values[**column].iter().any(|value| value.is_finite());
        wrong.extend(
            columns
                .iter()
                .filter(is_empty)
                .map(|column| format!("{} has no value in {}: leave that log out", names[*column], run.name)),
        );
        if run.lasts().is_zero() {
            wrong.push(format!("{} has one time only: a drift needs a beginning and an end", run.name));
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
    remarks.extend(checks::odd_length(run));
    let is_other =
        |column: &usize| !columns.contains(column) && !movers.iter().any(|mover| mover.column == *column);
    let temperatures: Vec<usize> = dataset.of_kind(Kind::Temperature).filter(is_other).collect();
    remarks.extend(checks::fahrenheit(dataset, &temperatures));
    let name = |column: usize| dataset.columns[column].name.clone();
    let stands_still = columns.iter().filter(|column| run.range(**column) < STILL);
    remarks.extend(
        stands_still.map(|column| format!("{} stands still: was the probe connected?", name(*column))),
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

/// `None` where the column is empty.
fn temperature(name: String, minutes: &Minutes) -> Option<Temperature> {
    (!minutes.values.is_empty()).then(|| Temperature {
        name,
        begin_c: minutes.begin().1,
        end_c: minutes.end().1,
        range_k: range(&minutes.values),
        largest_60min_k: minutes.largest_hour().map(|(_, range)| range),
    })
}
