//! Division of log files into runs. Each file is one run, or a new run begins at each change of a column or after a
//! gap.

use std::collections::HashMap;
use std::ops::Range;
use std::time::Duration;

use jiff::tz::TimeZone;

use super::implausible::leave_out;
use super::kind::KindOf;
use super::run::{Errors, Origin};
use super::table::{Cells, Table};
use super::{BadLog, Refusal, Run, Series};
use isotherm_core::quantity::{DateOrder, DecimalMark, TimeUnit};

/// Maximum number of runs. A column with more changes is not suitable to divide a log into runs.
const MOST_RUNS: usize = 10_000;

/// Settings for the division of log files into runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Split {
    /// Name of the column whose changes begin a new run; `None` if no column divides the logs into runs.
    pub column: Option<String>,
    /// Minimum time without a row after which a new run begins; `None` if gaps do not divide the logs into runs.
    pub gap: Option<Duration>,
    /// Time zone of times without an offset from UTC. Without a time zone, such times are rejected.
    pub zone: Option<TimeZone>,
    /// Decimal mark of the numbers; `None` if it is detected from the numbers.
    pub decimal: Option<DecimalMark>,
    /// Order of day and month in dates with slashes; `None` if it is detected from the dates.
    pub dates: Option<DateOrder>,
    /// Unit of times that are numbers; `None` if the name of the time column states it.
    pub time_unit: Option<TimeUnit>,
    /// Names of columns that are displacements, even if neither name nor unit shows this.
    pub displacements: Vec<String>,
}

/// Runs of all files. Implausible values, which no sensor measured, are removed from them.
#[derive(Debug, Default)]
pub(super) struct Divided {
    pub(super) runs: Vec<Run>,
    /// Remarks about the implausible values that were removed.
    pub(super) remarks: Vec<String>,
    /// Columns with too many implausible values.
    pub(super) refused: Vec<Refusal>,
}

/// Divides all tables into runs. Each run has the columns `names`, in this order.
pub(super) fn runs(
    tables: Vec<Table>,
    names: &[String],
    split: &Split,
    kind: KindOf<'_>,
) -> Result<Divided, BadLog> {
    let (mut divided, mut wrong) = (Divided::default(), Vec::new());
    for table in tables {
        match of_table(table, names, split, kind) {
            Ok(own) => {
                divided.runs.extend(own.runs);
                divided.remarks.extend(own.remarks);
                divided.refused.extend(own.refused);
            }
            Err(BadLog(why)) => wrong.extend(why),
        }
    }
    // Files with the same name in different directories are different runs.
    let mut alike: HashMap<String, usize> = HashMap::new();
    for run in &mut divided.runs {
        let number = alike.entry(run.name.clone()).or_default();
        *number += 1;
        if *number > 1 {
            run.name = format!("{} ({number})", run.name);
        }
    }
    BadLog::unless(wrong, divided)
}

fn of_table(mut table: Table, names: &[String], split: &Split, kind: KindOf<'_>) -> Result<Divided, BadLog> {
    let labels = split.column.as_ref().map(|name| labels(&table, name)).transpose()?;
    let parts = parts(&table, labels.as_ref(), split)?;
    let label = |rows: &Range<usize>| labels.as_ref().map(|labels| labels.of(rows.start));
    let mut alike: HashMap<Option<String>, usize> = HashMap::new();
    for rows in &parts {
        *alike.entry(label(rows)).or_default() += 1;
    }
    let stem = table.file.file_stem().and_then(|stem| stem.to_str()).unwrap_or("run");
    // A compressed log is named day.csv.gz.
    let is_compressed = table.file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gz"));
    let stem = stem.rsplit_once('.').filter(|_| is_compressed).map_or(stem, |(stem, _)| stem);
    let (mut named, mut wrong) = (Vec::new(), Vec::new());
    for (number, rows) in (1..).zip(parts.iter().cloned()) {
        let label = label(&rows);
        let is_alone = alike.get(&label) == Some(&1);
        let name = match label {
            _ if parts.len() == 1 => stem.to_owned(),
            Some(label) if is_alone => format!("{stem} {label}"),
            // A value may occur again after another one. Each group of consecutive rows with one value is a separate
            // run.
            Some(label) => format!("{stem} {label} {number}"),
            None => format!("{stem} {number}"),
        };
        let back = (rows.start + 1..rows.end).find(|row| table.times[*row] < table.times[row - 1]);
        if let Some(back) = back {
            wrong.push(format!(
                "{}, line {}: the time of this row is earlier than that of the row before. Sort the rows, \
                 write each run to its own file, or name the column that distinguishes the runs with \
                 --run-column",
                table.file.display(),
                table.lines.of(back)
            ));
        }
        named.push((name, rows));
    }
    BadLog::unless(wrong, ())?;
    let (remarks, refused) = leave_out(&mut table, &parts, kind);
    let runs = named.into_iter().map(|(name, rows)| run(&mut table, names, name, rows)).collect();
    Ok(Divided { runs, remarks, refused })
}

/// Returns the range of table rows of each run, in order; an error if there are more than [`MOST_RUNS`] runs.
fn parts(table: &Table, labels: Option<&Labels<'_>>, split: &Split) -> Result<Vec<Range<usize>>, BadLog> {
    let ends = |row: &usize| {
        labels.is_some_and(|labels| !labels.are_alike(row - 1, *row))
            || split.gap.is_some_and(|longest| table.times[*row].since(table.times[row - 1]) > longest)
    };
    let rows = table.times.len();
    let mut parts = Vec::new();
    let mut first = 0;
    for end in (1..rows).filter(ends).chain([rows]) {
        if parts.len() == MOST_RUNS {
            return Err(BadLog(vec![format!(
                "{}, line {}: more than {MOST_RUNS} runs: check --run-column and --gap",
                table.file.display(),
                table.lines.of(first)
            )]));
        }
        parts.push(first..end);
        first = end;
    }
    Ok(parts)
}

/// Creates a run from these rows. If the run is the whole table, the columns are moved out of the table instead of
/// copied.
fn run(table: &mut Table, names: &[String], name: String, rows: Range<usize>) -> Run {
    let zeros = table.zeros.iter().filter(|(row, _)| rows.contains(row));
    let origin = Origin {
        zeros: zeros.map(|(row, axis)| (row - rows.start, axis.clone())).collect(),
        // The machine may be on at the beginning of a later part of a log of the gateway.
        continues: if rows.start == 0 { table.continues } else { !table.acted.is_empty() },
        errors: Errors::Recorded,
        is_open: false,
        is_unit_assumed: table.understood.is_unit_assumed,
    };
    if rows.len() == table.times.len() {
        let mut columns: HashMap<String, Cells> = std::mem::take(&mut table.columns).into_iter().collect();
        let values = names.iter().map(|name| match columns.remove(name) {
            Some(Cells::Numbers(numbers)) => numbers,
            _ => Series::missing(rows.len()),
        });
        let values = values.collect();
        return Run {
            name,
            file: table.file.clone(),
            times: std::mem::take(&mut table.times),
            values,
            origin,
        };
    }
    let of = |name: &String| match table.numbers(name) {
        Some(numbers) => numbers.within(rows.clone()).collect(),
        None => Series::missing(rows.len()),
    };
    let values = names.iter().map(of).collect();
    Run { name, file: table.file.clone(), times: table.times[rows.clone()].to_vec(), values, origin }
}

/// Texts or numbers of the column by which a log is divided into runs, one for each log row.
enum Labels<'t> {
    Words(Vec<&'t str>),
    Numbers(&'t Series),
}

impl Labels<'_> {
    fn of(&self, row: usize) -> String {
        match self {
            Labels::Words(words) => words[row].to_owned(),
            Labels::Numbers(numbers) => numbers.at(row).to_string(),
        }
    }

    fn are_alike(&self, row: usize, other: usize) -> bool {
        match self {
            Labels::Words(words) => words[row] == words[other],
            Labels::Numbers(numbers) => {
                let [one, other] = [row, other].map(|row| numbers.at(row));
                one.to_bits() == other.to_bits() || (one.is_nan() && other.is_nan())
            }
        }
    }
}

fn labels<'t>(table: &'t Table, name: &str) -> Result<Labels<'t>, BadLog> {
    match table.cells(name) {
        Some(Cells::Text(texts)) => Ok(Labels::Words(texts.iter().collect())),
        Some(Cells::Numbers(numbers) | Cells::Unread(numbers)) => Ok(Labels::Numbers(numbers)),
        None => {
            let known: Vec<&str> = table.columns.iter().map(|(name, _)| name.as_str()).collect();
            Err(BadLog(vec![format!(
                "{}: there is no column {name}, which --run-column names; the columns are {}",
                table.file.display(),
                known.join(", ")
            )]))
        }
    }
}
