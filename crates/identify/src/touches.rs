//! Conversion of touches (measurements with a probe) to measured errors. A log of the gateway contains an error only in
//! the rows in which the axis was probed. Cz is the compensation value that was active during a touch.
//!
//! ```text
//! logs ── join (files of one gateway) ── divide (at each datum) ── e = measured error − Cz that acted
//! ```
//!
//! - A run goes from one datum (zero point of Cz) to the next. A datum is a machine start, or a zero command that the
//!   axis uses. The error is zero at the datum. A run also ends when the machine is switched off.
//! - Successive log files of a gateway are joined to one record. In a part of a record without a datum, the error is
//!   counted from the first touch.
//! - A long run is divided at midnight (UTC), at least 12 hours after its datum. In the later part, the error is
//!   counted from the first touch of that part.
//! - After a zero command, the rises are also counted from the datum. Such a run begins up to 12 hours before its
//!   datum, so that the lags have settled at the datum. The rows before the datum have no error.
//! - A run whose errors were recorded in each row is not changed.

use std::collections::HashMap;
use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

use crate::applied::{self, Applied};
use crate::checks::SHORTEST_RUN;
use crate::dataset::{BadLog, Column, Dataset, Datum, Errors, Kind, Origin, Run, Series};
use isotherm_core::compensation::model::Reference;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::{Profile, counted};

/// Maximum time without a row between two files of one record.
const LONGEST_PAUSE: Duration = Duration::from_hours(1);
/// Minimum time between a datum (zero point) and the midnight at which a long run is divided.
const ENDS_AFTER: Duration = Duration::from_hours(12);
const DAY: Duration = Duration::from_hours(24);
/// Maximum time before its datum (zero point) at which a run begins, so that the lags have settled. The longest usual
/// time constant is 200 min.
const LEAD_IN: Duration = Duration::from_hours(12);

/// Returns the names of two log columns of an axis: the error that the touches measured, and the Cz that was active
/// during each touch.
pub(crate) fn columns(axis: &str) -> [String; 2] {
    [format!("{axis}_measured_um"), format!("{axis}_acting_um")]
}

/// Returns whether a log column contains the Cz that was active during touches. Such a column is in µm, but is not a
/// displacement of the machine.
pub(crate) fn is_acting(dataset: &Dataset, column: &str) -> bool {
    let axis = column.strip_suffix("_acting_um");
    axis.is_some_and(|axis| dataset.column(&format!("{axis}_measured_um")).is_some())
}

/// Signals that set the datums (zero points) of a machine.
struct Datums<'a> {
    axis: &'a str,
    /// Index of the log column that shows whether the machine is on; `None` if there is no such column.
    on: Option<usize>,
    /// Index of the log column whose rising edge is a zero command; `None` if there is no such column.
    zero: Option<usize>,
    /// Whether a zero command sets a datum (zero point) of the axis.
    uses_zeros: bool,
}

/// Converts the touches of this axis to errors without Cz, in the column `error`. Runs with touches are joined and
/// divided, so that each run goes from one datum (zero point) to the next. If no log has touches, nothing changes.
///
/// # Errors
/// The Cz that was active during a touch cannot be determined. The message names the option that specifies it.
pub(crate) fn merge(
    profile: &Profile,
    dataset: &mut Dataset,
    (axis, error): (&str, &str),
    applied: &Applied,
) -> Result<(), BadLog> {
    let [measured, acting] = columns(axis);
    let Some(touched) = dataset.column(&measured) else { return Ok(()) };
    let known = dataset.column(error);
    let has = |run: &Run, column: usize| run.values[column].iter().any(|value| value.is_finite());
    let is_recorded = |run: &Run| known.is_some_and(|column| column != touched && has(run, column));
    let cz = dataset.column(&format!("{axis}_cz_um"));
    let is_logged = cz.is_some_and(|cz| dataset.columns[cz].kind == Kind::Compensation);
    // The log of a gateway may have no touch for days.
    let is_touched = |run: &Run| {
        !is_recorded(run) && (has(run, touched) || (is_logged && cz.is_some_and(|cz| has(run, cz))))
    };
    let is_touched: Vec<bool> = dataset.runs.iter().map(is_touched).collect();
    if dataset.runs.iter().zip(&is_touched).any(|(run, is_touched)| *is_touched && has(run, touched)) {
        let column = known.unwrap_or_else(|| add(dataset, error));
        let acting = dataset.column(&acting);
        let source =
            Source { measured: touched, acting, cz: source_of_cz(dataset, &is_touched, axis, applied)? };
        for (run, _) in dataset.runs.iter_mut().zip(&is_touched).filter(|(_, is_touched)| **is_touched) {
            run.values[column] = source.errors(run);
        }
        let datums = Datums::of(profile, dataset, axis);
        divide(dataset, &is_touched, &datums, column);
    }
    for name in columns(axis).iter().filter(|name| *name != error) {
        remove(dataset, name);
    }
    Ok(())
}

/// Log columns from which the error without Cz is calculated: the measured error minus the active Cz.
struct Source {
    measured: usize,
    acting: Option<usize>,
    /// Index of the column with the Cz that is used in rows in which the column `acting` is empty; `None` if no Cz was
    /// active in these rows.
    cz: Option<usize>,
}

impl Source {
    /// Returns for each row the error without Cz, µm. NaN in rows without a touch, or if the active Cz is not known.
    fn errors(&self, run: &Run) -> Series {
        let acting = |row: usize| {
            let own = self.acting.map(|column| run.values[column].at(row)).filter(|cz| cz.is_finite());
            own.unwrap_or_else(|| self.cz.map_or(0.0, |column| run.values[column].at(row)))
        };
        run.values[self.measured].iter().enumerate().map(|(row, error)| error - acting(row)).collect()
    }
}

/// Returns the column that gives the active Cz for touches without a value in the column `acting`; `None` if no Cz was
/// active.
fn source_of_cz(
    dataset: &Dataset,
    is_touched: &[bool],
    axis: &str,
    applied: &Applied,
) -> Result<Option<usize>, BadLog> {
    let [measured, acting] = columns(axis);
    match applied {
        Applied::Nothing => return Ok(None),
        Applied::Column(name) => return applied::named(dataset, name).map(Some),
        Applied::AsLogged => {}
    }
    let Some(cz) = dataset.column(&format!("{axis}_cz_um")) else { return Ok(None) };
    if dataset.columns[cz].kind == Kind::Compensation {
        return Ok(Some(cz));
    }
    let touches = dataset.column(&measured);
    let logged = dataset.column(&acting);
    let lacks = |run: &Run| {
        let is_known = |row: usize| logged.is_some_and(|column| run.values[column].at(row).is_finite());
        let is_touch = |row: usize| touches.is_some_and(|column| run.values[column].at(row).is_finite());
        (0..run.times.len()).any(|row| is_touch(row) && !is_known(row))
    };
    let mut runs = dataset.runs.iter().zip(is_touched).filter(|(_, is_touched)| **is_touched);
    match runs.find(|&(run, _)| run.range(cz) > 0.0 && lacks(run)) {
        None => Ok(None),
        Some((run, _)) => {
            let cz = &dataset.columns[cz].name;
            Err(BadLog(vec![format!(
                "{}: some touches have no value of {acting}, and {cz} changed. It is not known whether \
                 {measured} contains this Cz. Fill the column {acting}, or add --cz {cz} if it does, \
                 otherwise --cz none",
                run.name
            )]))
        }
    }
}

/// Adds a column for the error, in which all values are missing. Returns its index.
fn add(dataset: &mut Dataset, error: &str) -> usize {
    dataset.columns.push(Column { name: error.to_owned(), kind: Kind::Displacement });
    for run in &mut dataset.runs {
        run.values.push(Series::missing(run.times.len()));
    }
    dataset.columns.len() - 1
}

/// Moves a column to the list of unused columns. Does nothing if the dataset does not have this column.
fn remove(dataset: &mut Dataset, name: &str) {
    let Some(place) = dataset.column(name) else { return };
    let column = dataset.columns.remove(place);
    dataset.unread.push(column);
    for run in &mut dataset.runs {
        run.values.remove(place);
    }
}

impl<'a> Datums<'a> {
    fn of(profile: &Profile, dataset: &Dataset, axis: &'a str) -> Datums<'a> {
        let column = |signal: Option<SignalId>| dataset.column(&profile.signals.get(signal?.0)?.name);
        let own = profile.axes.iter().find(|own| own.settings.name == axis);
        let uses_zeros = own.is_some_and(|own| own.counts_from(Reference::Zero));
        Datums { axis, on: column(profile.machine.on), zero: column(profile.machine.zero), uses_zeros }
    }

    /// Returns the rows that divide a record, in ascending order. Each is either the row of a datum (zero point), with
    /// this datum, or the row in which the machine is switched off, with `None`.
    fn rows(&self, record: &Run) -> Vec<(usize, Option<Datum>)> {
        let mut rows: Vec<(usize, Option<Datum>)> = Vec::new();
        if let Some(on) = self.on {
            rows.extend(edges(&record.values[on], true).map(|row| (row, Some(Datum::Start))));
            rows.extend(edges(&record.values[on], false).map(|row| (row, None)));
        }
        if self.uses_zeros {
            let own = |axis: &Option<String>| axis.as_ref().is_none_or(|axis| axis == self.axis);
            let commands = record.origin.zeros.iter().filter(|(_, axis)| own(axis)).map(|(row, _)| *row);
            let edges = self.zero.into_iter().flat_map(|zero| edges(&record.values[zero], true));
            rows.extend(commands.chain(edges).map(|row| (row, Some(Datum::Zero(row)))));
        }
        // A machine start goes before a zero in the same row, which then is the datum.
        rows.sort_by_key(|(row, datum)| (*row, matches!(datum, Some(Datum::Zero(_)))));
        rows
    }

    /// Returns the datum (zero point) that applies to the first rows of a record, before any other datum; `None` if the
    /// machine is off in these rows.
    fn first(&self, record: &Run) -> Option<Datum> {
        let level = self.on.and_then(|on| record.values[on].iter().find(|level| level.is_finite()));
        match level {
            Some(level) if level < 0.5 => None,
            _ if record.origin.continues => Some(Datum::Touch(0)),
            _ => Some(Datum::Start),
        }
    }
}

/// Returns the rows in which a signal changes to on (if `to` is `true`) or to off (if `to` is `false`). Missing values
/// are skipped.
fn edges(levels: &Series, to: bool) -> impl Iterator<Item = usize> + '_ {
    let mut was_on = None;
    let is_edge = move |(_, level): &(usize, f64)| {
        let is_on = *level >= 0.5;
        was_on.replace(is_on) == Some(!to) && is_on == to
    };
    levels.iter().enumerate().filter(|(_, level)| level.is_finite()).filter(is_edge).map(|(row, _)| row)
}

/// Joined log files of one gateway, or a single file of another source.
struct Record {
    run: Run,
    /// First row of each joined run in the record, with the name and the file of the run.
    sources: Vec<(usize, String, PathBuf)>,
}

/// Joins the runs with touches to records, and replaces each record by new runs, each from one datum (zero point) to
/// the next.
fn divide(dataset: &mut Dataset, is_touched: &[bool], datums: &Datums<'_>, error: usize) {
    let mut runs: Vec<Run> = Vec::new();
    let mut names: HashMap<String, usize> = HashMap::new();
    let mut left_out = 0;
    let mut record: Option<Record> = None;
    let touched = dataset.runs.iter().zip(is_touched).filter(|(_, is_touched)| **is_touched);
    let latest = touched.filter_map(|(run, _)| run.times.last().copied()).max();
    let mut end = |record: Option<Record>, runs: &mut Vec<Run>| {
        let Some(record) = record else { return };
        for (rows, datum) in parts(&record.run, datums) {
            match record.part(rows, datum, error, &mut names) {
                Some(run) => runs.push(run),
                None => left_out += 1,
            }
        }
    };
    for (run, is_touched) in std::mem::take(&mut dataset.runs).into_iter().zip(is_touched) {
        if !is_touched {
            end(record.take(), &mut runs);
            runs.push(run);
            continue;
        }
        match &mut record {
            Some(record) if record.is_before(&run) => record.join(run),
            _ => end(record.replace(Record::new(run)), &mut runs),
        }
    }
    end(record, &mut runs);
    // A record that another one follows does not go on.
    runs.iter_mut().for_each(|run| run.origin.is_open &= run.times.last().copied() >= latest);
    dataset.runs = runs;
    if left_out > 0 {
        let parts = counted(left_out, "part");
        dataset.remarks.push(format!(
            "{parts} of the logs not used: without a touch between two datums (zero points), or shorter than \
             20 min"
        ));
    }
}

/// Returns the parts of a record: the rows and the datum (zero point) of each part.
fn parts(record: &Run, datums: &Datums<'_>) -> Vec<(Range<usize>, Datum)> {
    let rows = record.times.len();
    let begins: Vec<(usize, Option<Datum>)> =
        std::iter::once((0, datums.first(record))).chain(datums.rows(record)).collect();
    let ends = begins.iter().skip(1).map(|(row, _)| *row).chain([rows]);
    let mut parts = Vec::new();
    for ((begin, datum), end) in begins.iter().copied().zip(ends) {
        if let Some(datum) = datum {
            parts.extend(not_too_long(record, begin..end, datum));
        }
    }
    parts
}

/// Divides the rows of one datum (zero point) at midnight, if they are too long for one run. In each later part, the
/// error is counted from the first touch. The parts do not depend on which files are read together.
fn not_too_long(record: &Run, mut rows: Range<usize>, datum: Datum) -> Vec<(Range<usize>, Datum)> {
    let (mut parts, mut datum) = (Vec::new(), datum);
    while !rows.is_empty() {
        let first = record.times[rows.start];
        let least = if matches!(datum, Datum::Touch(_)) { first } else { first.after(ENDS_AFTER) };
        let midnight = next_midnight(least);
        let end = record.times.partition_point(|time| *time < midnight).clamp(rows.start + 1, rows.end);
        parts.push((rows.start..end, datum));
        (rows.start, datum) = (end, Datum::Touch(end));
    }
    parts
}

/// Returns the first midnight (UTC) after a time.
fn next_midnight(time: Moment) -> Moment {
    let day = u64::try_from(DAY.as_nanos()).unwrap_or(u64::MAX);
    Moment::from_nanos((time.as_nanos() / day).saturating_add(1).saturating_mul(day))
}

impl Record {
    fn new(run: Run) -> Record {
        Record { sources: vec![(0, run.name.clone(), run.file.clone())], run }
    }

    /// Returns whether the given run continues this record without a long pause.
    fn is_before(&self, run: &Run) -> bool {
        let ends = self.run.times.last().zip(run.times.first());
        let follows = |last: Moment, first: Moment| first > last && first.since(last) <= LONGEST_PAUSE;
        run.origin.continues && ends.is_some_and(|(last, first)| follows(*last, *first))
    }

    fn join(&mut self, run: Run) {
        let rows = self.run.times.len();
        self.sources.push((rows, run.name, run.file));
        self.run.times.extend(run.times);
        self.run.values.iter_mut().zip(run.values).for_each(|(all, more)| all.extend(&more));
        let zeros = run.origin.zeros.into_iter().map(|(row, axis)| (row + rows, axis));
        self.run.origin.zeros.extend(zeros);
    }

    /// Creates a run from these rows, which begin at a datum (zero point). `None` if the run would have too few
    /// touches, or would be too short.
    fn part(
        &self,
        rows: Range<usize>,
        datum: Datum,
        error: usize,
        names: &mut HashMap<String, usize>,
    ) -> Option<Run> {
        let record = &self.run;
        let touches = record.values[error].within(rows.clone()).filter(|error| error.is_finite()).count();
        let needed = if matches!(datum, Datum::Touch(_)) { 2 } else { 1 };
        let lasts = record.times[rows.end - 1].since(record.times[rows.start]);
        if touches < needed || lasts < SHORTEST_RUN {
            return None;
        }
        let begin = match datum {
            Datum::Start => rows.start,
            Datum::Zero(_) | Datum::Touch(_) => {
                let lead_in = record.times[rows.start].before(LEAD_IN);
                record.times.partition_point(|time| *time < lead_in)
            }
        };
        let before = rows.start - begin;
        let part = |column: &Series| column.within(begin..rows.end).collect::<Series>();
        let mut values: Vec<Series> = record.values.iter().map(part).collect();
        values[error].change(|errors| errors[..before].fill(f64::NAN));
        let datum = match datum {
            Datum::Zero(_) => Datum::Zero(before),
            Datum::Touch(_) => Datum::Touch(before),
            Datum::Start => Datum::Start,
        };
        let source = self.sources.partition_point(|(first, ..)| *first <= rows.start);
        let (_, name, file) = &self.sources[source.saturating_sub(1)];
        let number = names.entry(name.clone()).or_default();
        *number += 1;
        let name = if *number > 1 { format!("{name} ({number})") } else { name.clone() };
        let is_open = rows.end == record.times.len();
        let origin = Origin { errors: Errors::Touched(datum), is_open, ..Origin::default() };
        Some(Run { name, file: file.clone(), times: record.times[begin..rows.end].to_vec(), values, origin })
    }
}
