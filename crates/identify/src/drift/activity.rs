//! Movements of spindles and axes during a run, and the test of ISO 230-3 that corresponds to these movements.

use serde::Serialize;

use super::Test;
use crate::dataset::{Column, Dataset, Kind, Run, Units};
use crate::minutes::Minutes;
use crate::statistics::median;

/// Limit of a standstill: a speed in 1/min, or the travel of a position within a minute, in mm or degrees.
const STILL: f64 = 1.0;
/// Maximum difference between the speeds of one stage, as a share of the highest speed in the run.
const ONE_SPEED: f64 = 0.02;
/// Minimum duration of a stage, s. A shorter period is only a change between two speeds.
const SHORTEST_STAGE: f64 = 150.0;

/// Period of a run in which the speed was constant, a position moved, or nothing moved.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stage {
    /// Name of the log column that shows the movement.
    pub column: String,
    /// First minute of the stage, h since the first row of the run.
    pub from_h: f64,
    /// Last minute of the stage, h since the first row of the run.
    pub to_h: f64,
    /// Mean speed in the unit of its log column; `None` if the column is a position.
    pub speed: Option<f64>,
    /// Whether a spindle turned or an axis moved in this stage.
    pub moves: bool,
}

/// Log column of a speed or a position. Its movement warms the machine.
#[derive(Clone, Debug)]
pub(super) struct Mover {
    pub(super) column: usize,
    name: String,
    test: Test,
    /// Whether the column is a speed; otherwise it is a position.
    is_speed: bool,
}

/// Returns the log columns of speeds and positions whose movement may warm the machine.
pub(super) fn movers(dataset: &Dataset, units: Units<'_>) -> Vec<Mover> {
    let of = |(column, Column { name, kind }): (usize, &Column)| {
        let lower = name.to_ascii_lowercase();
        let ends = |endings: &[&str]| endings.iter().any(|ending| lower.ends_with(ending));
        let unit = units(name).unwrap_or_default();
        let (test, is_speed) = match kind {
            _ if unit == "deg" || ends(&["_deg"]) => (Test::Rotary, false),
            _ if is_feed(name, units(name)) => (Test::Axis, true),
            Kind::Speed => (Test::Spindle, true),
            Kind::Position => (Test::Axis, false),
            _ => return None,
        };
        Some(Mover { column, name: name.clone(), test, is_speed })
    };
    dataset.columns.iter().enumerate().filter_map(of).collect()
}

/// Returns whether a log column is the speed of a linear axis, by its unit or the end of its name.
pub(crate) fn is_feed(name: &str, unit: Option<&str>) -> bool {
    let name = name.to_ascii_lowercase();
    unit.is_some_and(|unit| ["mm/min", "m/min", "m/s"].contains(&unit))
        || ["mm_min", "mm/min", "_m_s", "feed"].iter().any(|ending| name.ends_with(ending))
}

/// Chooses the test of ISO 230-3 to which a run corresponds. `asked` is the test that the operator chose.
/// Returns the test, the log column of the movement that warms the machine, and the reason for the choice.
/// The column is `None` for the test `Etve`, or if no column shows the movement.
pub(super) fn likeness<'a>(
    asked: Option<Test>,
    active: &[&'a Mover],
    remarks: &mut Vec<String>,
) -> (Test, Option<&'a Mover>, String) {
    let of = |test: Test| active.iter().copied().find(|mover| mover.test == test);
    let found = [Test::Spindle, Test::Rotary, Test::Axis].into_iter().find_map(of);
    let test = asked.unwrap_or_else(|| found.map_or(Test::Etve, |mover| mover.test));
    // If the user has chosen the test, a speed may be that of a table as well as that of a spindle.
    let mover = match test {
        Test::Etve => None,
        _ => of(test).or(found.filter(|_| asked.is_some())),
    };
    let is_other = |other: &&&Mover| mover.is_none_or(|mover| mover.column != other.column);
    let others: Vec<&str> = active.iter().filter(is_other).map(|other| other.name.as_str()).collect();
    if !others.is_empty() {
        remarks.push(match (test, others.join(", ")) {
            (Test::Etve, others) => {
                format!("{others} moved: the heat of this movement is included in the results")
            }
            (_, others) => {
                format!("{others} moved as well: the effects of the different movements cannot be separated")
            }
        });
    }
    let because = match (asked, mover) {
        (None, Some(mover)) if mover.is_speed => format!("{} is not always zero", mover.name),
        (None, Some(mover)) => format!("{} moves", mover.name),
        (None, None) => "no speed and no position in the log changes".to_owned(),
        (Some(_), _) => "as requested".to_owned(),
    };
    if mover.is_none() && test != Test::Etve {
        remarks.push(
            "no column shows which spindle or axis moved: the run cannot be divided into stages. Log the \
             speed or the position"
                .to_owned(),
        );
    }
    (test, mover, because)
}

impl Mover {
    pub(super) fn moves(&self, run: &Run) -> bool {
        match self.is_speed {
            true => run.values[self.column].iter().any(|value| value.is_finite() && value.abs() > STILL),
            false => run.range(self.column) > STILL,
        }
    }

    /// Divides the movement into stages, from its values in each minute.
    pub(super) fn stages(&self, run: &Run) -> Vec<Stage> {
        let minutes = if self.is_speed { Minutes::of(run, self.column) } else { self.paths(run) };
        let fastest = minutes.values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let same = (ONE_SPEED * fastest).max(STILL);
        let mut stages: Vec<(f64, f64, Vec<f64>)> = Vec::new();
        for (second, value) in minutes.seconds.iter().zip(&minutes.values) {
            let value = if self.is_speed { *value } else { f64::from(u8::from(*value > STILL)) * 2.0 * same };
            match stages.last_mut() {
                Some((_, to, values)) if (value - values[values.len() / 2]).abs() <= same => {
                    *to = *second;
                    values.push(value);
                }
                _ => stages.push((*second, *second, vec![value])),
            }
        }
        let long = stages.into_iter().filter(|(from, to, _)| to - from >= SHORTEST_STAGE);
        let stage = |(from, to, values): (f64, f64, Vec<f64>)| {
            let speed = median(values);
            Stage {
                column: self.name.clone(),
                from_h: from / 3600.0,
                to_h: to / 3600.0,
                speed: self.is_speed.then_some(speed),
                moves: speed.abs() > STILL,
            }
        };
        long.map(stage).collect()
    }

    /// Returns the distance that the position travels within each minute. Each distance has the time of the
    /// first log row in its minute.
    fn paths(&self, run: &Run) -> Minutes {
        let mut paths = Minutes::default();
        let values = run.seconds().zip(&run.values[self.column]);
        let mut before: Option<f64> = None;
        for (second, value) in values.filter(|(_, value)| value.is_finite()) {
            let path = before.map_or(0.0, |before| (value - before).abs());
            before = Some(value);
            match (paths.seconds.last(), paths.values.last_mut()) {
                (Some(last), Some(sum)) if (last / 60.0).floor() >= (second / 60.0).floor() => *sum += path,
                _ => {
                    paths.seconds.push(second);
                    paths.values.push(path);
                }
            }
        }
        paths
    }
}
