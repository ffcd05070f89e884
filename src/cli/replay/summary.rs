//! Result of a replay, as text and as JSON.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use serde::Serialize;

use super::spans::{AxisSpans, SpanTally};
use super::{Findings, Outcome, OutputsSummary};
use crate::gateway::log::{LogRow, LoggedDecision};
use isotherm_core::compensation::{AxisState, Remembered};
use isotherm_core::quantity::Moment;
use isotherm_profile::Profile;
use isotherm_profile::{counted, duration_text};

/// Results of a replayed log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the log.
    pub log: String,
    /// Number of replayed log rows.
    pub rows: u64,
    /// Time from the earliest to the latest row of the log, s.
    pub span_s: f64,
    /// Warnings about the log.
    pub warnings: Vec<String>,
    /// Results for each axis, by name.
    pub axes: BTreeMap<String, AxisSummary>,
    /// Replay of the log of outputs in the same directory; `None` if there is no such log.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outputs: Option<OutputsSummary>,
}

/// Results for one axis: its Cz, states, time spans and errors, and the comparison with the log.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct AxisSummary {
    /// Range of Cz that the models requested, µm; `None` if no model could be used in any log row.
    pub raw_um: Option<Range>,
    /// Range of Cz after the limits of the axis (limit, deadband, step, rate, rounding), µm.
    pub cz_um: Option<Range>,
    /// Share of the log rows, from 0 to 1, in each state of the axis that occurred.
    pub states: BTreeMap<&'static str, f64>,
    /// Share of the log rows, from 0 to 1, at which the model was worse than no compensation, according to the
    /// measurements of the probe. `None` if there were no such rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worse: Option<f64>,
    /// Names of the learned models that the axis preferred to the models of its profile, in the order of time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub learned: Vec<String>,
    /// Time spans in which sensors were replaced or suspected, or in which the axis was on hold.
    #[serde(flatten)]
    pub spans: AxisSpans,
    /// Error without and with compensation; `None` if the log has no measured error.
    pub error: Option<ErrorSummary>,
    /// Comparison with the decisions in the log; `None` if the log has none.
    pub reproduced: Option<Reproduced>,
}

/// Smallest and largest value of a quantity over all log rows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Range {
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
}

/// Measured error without and with Cz, over the log rows that have a measured error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorSummary {
    /// Number of log rows with a measured error.
    pub rows: u64,
    /// Largest minus smallest error without Cz, µm.
    pub range_before_um: f64,
    /// Largest minus smallest error with Cz, µm.
    pub range_after_um: f64,
    /// Root mean square of the error without Cz, µm.
    pub rms_before_um: f64,
    /// Root mean square of the error with Cz, µm.
    pub rms_after_um: f64,
}

/// Bit-for-bit comparison of the replay with the log: the decisions of an axis, or the actions of an output.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Reproduced {
    /// Number of rows with a decision or an action in the log.
    pub rows: u64,
    /// Number of rows at which the replay gave another result than the log.
    pub differing: u64,
    /// First log row at which the replayed result differs from the recorded one; `None` if there is none.
    pub first: Option<Difference>,
}

/// Decision or action for which the replay differs from the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Line number in the log.
    pub line: u64,
    /// Name of the log column that differs.
    pub column: String,
    /// Value in the log.
    pub recorded: String,
    /// Value that the replay gave.
    pub replayed: String,
}

/// Collector of a [`Summary`]. It receives the log row by row.
#[derive(Debug)]
pub(super) struct Tally {
    rows: u64,
    span: Option<(Moment, Moment)>,
    last: Option<Moment>,
    /// Value of the column `time` in the last log row.
    last_time: String,
    /// First axis and model whose file of stand-ins (calculated values for lost sensors) has changed since the log was
    /// written. `None` if no file has changed.
    other_stand_ins: Option<(String, String)>,
    /// First axis with a learned model that is not used, and the name of this model. The axis had other
    /// models in the profile when the model was learned. `None` if there is no such axis.
    superseded: Option<(String, String)>,
    axes: Vec<AxisTally>,
}

#[derive(Debug)]
struct AxisTally {
    name: String,
    every: Duration,
    /// Number of log rows whose time difference to the previous row is longer than the update interval of the axis.
    late: u64,
    raw: Spread,
    cz: Spread,
    states: BTreeMap<&'static str, u64>,
    /// Number of log rows in which the model was worse than no compensation.
    worse: u64,
    /// Learned models that the axis preferred to the models of its profile.
    learned: Vec<String>,
    spans: SpanTally,
    before: Spread,
    after: Spread,
    reproduced: Reproduced,
}

#[derive(Clone, Copy, Debug, Default)]
struct Spread {
    range: Option<Range>,
    rows: u64,
    squares: f64,
}

impl Spread {
    fn add(&mut self, value: f64) {
        let Range { min, max } = self.range.unwrap_or(Range { min: value, max: value });
        self.range = Some(Range { min: min.min(value), max: max.max(value) });
        self.rows += 1;
        self.squares += value * value;
    }

    fn width(&self) -> f64 {
        self.range.map_or(0.0, |range| range.max - range.min)
    }

    fn rms(&self) -> f64 {
        (self.squares / count(self.rows.max(1))).sqrt()
    }
}

/// Converts a number of rows to `f64`. The result is exact, because no log has 2^53 rows.
#[allow(clippy::cast_precision_loss)]
fn count(rows: u64) -> f64 {
    rows as f64
}

impl Tally {
    pub(super) fn new(profile: &Profile) -> Tally {
        let axes = profile.axes.iter().map(|axis| AxisTally {
            name: axis.settings.name.clone(),
            every: axis.settings.every,
            late: 0,
            raw: Spread::default(),
            cz: Spread::default(),
            states: BTreeMap::new(),
            worse: 0,
            learned: Vec::new(),
            spans: SpanTally::new(),
            before: Spread::default(),
            after: Spread::default(),
            reproduced: Reproduced::default(),
        });
        Tally {
            rows: 0,
            span: None,
            last: None,
            last_time: String::new(),
            other_stand_ins: None,
            superseded: None,
            axes: axes.collect(),
        }
    }

    pub(super) fn row(&mut self, row: &LogRow) {
        let now = row.now;
        self.rows += 1;
        let (first, latest) = self.span.unwrap_or((now, now));
        self.span = Some((first.min(now), latest.max(now)));
        for axis in &mut self.axes {
            axis.late += u64::from(self.last.is_some_and(|last| now.since(last) > axis.every));
        }
        self.last = Some(now);
        self.last_time.clone_from(&row.time);
    }

    pub(super) fn axis(&mut self, place: usize, row: &LogRow, outcome: &Outcome<'_>) {
        let Some(axis) = self.axes.get_mut(place) else { return };
        if let Some(raw) = outcome.raw {
            axis.raw.add(raw.get());
        }
        axis.cz.add(outcome.decision.cz.get());
        *axis.states.entry(outcome.decision.state.name()).or_default() += 1;
        axis.worse += u64::from(outcome.decision.worse.is_some());
        if let (Some(before), Some(after)) = (outcome.error, outcome.residual()) {
            axis.before.add(before);
            axis.after.add(after);
        }
        if let Some(Some(decided)) = row.decided.get(place) {
            let difference = difference(&axis.name, row.line, decided, outcome);
            axis.reproduced.rows += 1;
            axis.reproduced.differing += u64::from(difference.is_some());
            axis.reproduced.first = axis.reproduced.first.take().or(difference);
        }
    }

    /// Adds the findings about an axis at a log row.
    pub(super) fn findings(&mut self, place: usize, row: &LogRow, found: Findings) {
        if let Some(axis) = self.axes.get_mut(place) {
            axis.spans.row(row, found);
        }
    }

    /// Checks the state with which the gateway begins at this row of the log. Stores the first axis and model whose
    /// file of stand-ins has changed since the log, and the first axis whose learned model is not used.
    pub(super) fn begins(&mut self, profile: &Profile, memory: &Remembered) {
        let found = memory.other_stand_ins(profile.axes.iter().map(|axis| &axis.settings));
        let named = found.map(|(axis, model)| (axis.to_owned(), model.to_owned()));
        self.other_stand_ins = self.other_stand_ins.take().or(named);
        let found = memory.superseded(profile.axes.iter().map(|axis| &axis.settings)).next();
        let named = found.map(|(axis, model)| (axis.to_owned(), model.to_owned()));
        self.superseded = self.superseded.take().or(named);
    }

    /// Records the learned model that an axis prefers to the models of its profile.
    pub(super) fn learned(&mut self, place: usize, name: &str) {
        if let Some(axis) =
            self.axes.get_mut(place).filter(|axis| axis.learned.last().is_none_or(|last| last != name))
        {
            axis.learned.push(name.to_owned());
        }
    }

    pub(super) fn summary(self, log: &str, odd: &[String]) -> Summary {
        let mut warnings = odd.to_vec();
        for axis in self.axes.iter().filter(|axis| axis.reproduced.rows == 0 && 2 * axis.late > self.rows) {
            warnings.push(format!(
                "{log}: most rows are further apart than the update interval of axis {} ({}); the replay \
                 updates once per row, so Cz may lag",
                axis.name,
                duration_text(axis.every),
            ));
        }
        if let Some((axis, model)) = self.other_stand_ins {
            warnings.push(format!(
                "{log}: axis {axis}, model {model}: the stand-ins of the model have changed since the log \
                 was written; the replay resets the state of the stand-ins"
            ));
        }
        if let Some((axis, model)) = self.superseded {
            warnings.push(format!(
                "{log}: axis {axis}: the learned model {model} was learned when the profile had other \
                 models; the replay uses the models of the profile"
            ));
        }
        let span = self.span.map_or(Duration::ZERO, |(first, latest)| latest.since(first));
        let last = (self.last_time.as_str(), self.last.unwrap_or_default());
        let axes = self.axes.into_iter().map(|axis| (axis.name.clone(), axis.summary(self.rows, last)));
        let axes = axes.collect();
        let log = log.to_owned();
        Summary { log, rows: self.rows, span_s: span.as_secs_f64(), warnings, axes, outputs: None }
    }
}

impl AxisTally {
    fn summary(self, rows: u64, last: (&str, Moment)) -> AxisSummary {
        let error = (self.before.rows > 0).then(|| ErrorSummary {
            rows: self.before.rows,
            range_before_um: self.before.width(),
            range_after_um: self.after.width(),
            rms_before_um: self.before.rms(),
            rms_after_um: self.after.rms(),
        });
        let states = self.states.into_iter().map(|(name, times)| (name, count(times) / count(rows.max(1))));
        AxisSummary {
            raw_um: self.raw.range,
            cz_um: self.cz.range,
            states: states.collect(),
            worse: (self.worse > 0).then(|| count(self.worse) / count(rows.max(1))),
            learned: self.learned,
            spans: self.spans.spans(last),
            error,
            reproduced: (self.reproduced.rows > 0).then_some(self.reproduced),
        }
    }
}

/// Returns the first column in which the decision of the replay differs from the log, bit for bit. Returns `None` if
/// none differs.
fn difference(axis: &str, line: u64, decided: &LoggedDecision, outcome: &Outcome<'_>) -> Option<Difference> {
    let decision = &outcome.decision;
    let (raw, cz) = (outcome.raw.map(|raw| raw.get()), decision.cz.get());
    let number = |value: Option<f64>| value.map(super::text).unwrap_or_default();
    let same = |a: Option<f64>, b: Option<f64>| a.map(f64::to_bits) == b.map(f64::to_bits);
    let acted = decision.acted.to_string();
    let expected = decision.expected.map(|expected| expected.get());
    let logged = decided.expected.unwrap_or(expected);
    let stood_in = outcome.stood_in;
    let logged_one = decided.stood_in.as_deref().unwrap_or(stood_in);
    let worse = if decision.worse.is_some() { "1" } else { "" };
    let logged_worse = decided.worse.as_deref().unwrap_or(worse);
    let columns = [
        ("raw_um", same(decided.raw, raw), number(decided.raw), number(raw)),
        ("cz_um", same(Some(decided.cz), Some(cz)), number(Some(decided.cz)), number(Some(cz))),
        ("model", decided.model == outcome.model, decided.model.clone(), outcome.model.to_owned()),
        ("state", decided.state == decision.state.name(), decided.state.clone(), decision.state.to_string()),
        ("acted", decided.acted == acted, decided.acted.clone(), acted.clone()),
        ("expected_um", same(logged, expected), number(logged), number(expected)),
        ("stood_in", logged_one == stood_in, logged_one.to_owned(), stood_in.to_owned()),
        ("worse", logged_worse == worse, logged_worse.to_owned(), worse.to_owned()),
    ];
    let (column, _, recorded, replayed) = columns.into_iter().find(|(_, same, ..)| !same)?;
    Some(Difference { line, column: format!("{axis}_{column}"), recorded, replayed })
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let span = Duration::try_from_secs_f64(self.span_s.round()).unwrap_or_default();
        writeln!(f, "{}: {} over {}", self.log, counted(self.rows, "row"), duration_text(span))?;
        for (name, axis) in &self.axes {
            write!(f, "axis {name}: model ")?;
            write_range(f, axis.raw_um)?;
            write!(f, ", Cz ")?;
            write_range(f, axis.cz_um)?;
            writeln!(f)?;
            let known = |name: &&str| axis.states.contains_key(name);
            write!(f, "  ")?;
            for (place, state) in AxisState::NAMES.iter().filter(|name| known(name)).enumerate() {
                let between = if place > 0 { ", " } else { "" };
                write!(
                    f,
                    "{between}{state} {:.1} %",
                    axis.states.get(state).map_or(0.0, |share| share * 100.0)
                )?;
            }
            writeln!(f)?;
            if let Some(share) = axis.worse {
                writeln!(f, "  worse with its model than without compensation: {:.1} %", share * 100.0)?;
            }
            if !axis.learned.is_empty() {
                writeln!(f, "  followed a learned model: {}", axis.learned.join(", "))?;
            }
            axis.spans.fmt(f)?;
            if let Some(error) = &axis.error {
                writeln!(
                    f,
                    "  error: range {:.2} µm → {:.2} µm, rms {:.2} µm → {:.2} µm ({})",
                    error.range_before_um,
                    error.range_after_um,
                    error.rms_before_um,
                    error.rms_after_um,
                    counted(error.rows, "row")
                )?;
            }
            if let Some(reproduced) = &axis.reproduced {
                reproduced.fmt(f)?;
            }
        }
        for warning in &self.warnings {
            writeln!(f, "warning: {warning}")?;
        }
        if let Some(outputs) = &self.outputs {
            outputs.fmt(f)?;
        }
        Ok(())
    }
}

fn write_range(f: &mut fmt::Formatter<'_>, range: Option<Range>) -> fmt::Result {
    match range {
        Some(Range { min, max }) => write!(f, "{min:.2} … {max:.2} µm"),
        None => f.write_str("never usable"),
    }
}

impl fmt::Display for Reproduced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(first) = &self.first else {
            return writeln!(
                f,
                "  the replay gives the {} of the log again, bit for bit",
                counted(self.rows, "decision")
            );
        };
        writeln!(
            f,
            "  {} of {} differ in the replay; first in line {}: {} is `{}` in the log, `{}` in the replay",
            self.differing,
            counted(self.rows, "decision"),
            first.line,
            first.column,
            first.recorded,
            first.replayed
        )
    }
}
