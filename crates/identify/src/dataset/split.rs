//! From files to runs: one each, or split by a column or a gap.

use super::table::{Cells, Table};
use super::{BadLog, Run, Split};

/// The runs of all tables over the columns `names`.
pub(super) fn runs(tables: &[Table], names: &[&str], split: &Split) -> Result<Vec<Run>, BadLog> {
    let (mut runs, mut wrong) = (Vec::new(), Vec::new());
    for table in tables {
        match of_table(table, names, split) {
            Ok(own) => runs.extend(own),
            Err(BadLog(why)) => wrong.extend(why),
        }
    }
    // Two files of one name in two directories are two runs.
    for place in 1..runs.len() {
        let name = &runs[place].name;
        let before = runs[..place].iter().filter(|run: &&Run| run.name == *name).count();
        if before > 0 {
            runs[place].name = format!("{name} ({})", before + 1);
        }
    }
    BadLog::unless(wrong, runs)
}

fn of_table(table: &Table, names: &[&str], split: &Split) -> Result<Vec<Run>, BadLog> {
    let labels = split.column.as_ref().map(|name| labels(table, name)).transpose()?;
    let goes_on = |row: &usize, next: &usize| {
        labels.as_ref().is_none_or(|labels| labels[*row] == labels[*next])
            && split.gap.is_none_or(|longest| table.times[*next].since(table.times[*row]) <= longest)
    };
    let rows: Vec<usize> = (0..table.times.len()).collect();
    let parts: Vec<&[usize]> = rows.chunk_by(goes_on).collect();
    let label = |rows: &[usize]| labels.as_ref().map(|labels| labels[rows[0]].as_str());
    let stem = table.file.file_stem().and_then(|stem| stem.to_str()).unwrap_or("run");
    let (mut runs, mut wrong) = (Vec::new(), Vec::new());
    for (number, rows) in (1..).zip(&parts) {
        let alike = parts.iter().filter(|other| label(other) == label(rows)).count();
        let name = match label(rows) {
            _ if parts.len() == 1 => stem.to_owned(),
            Some(label) if alike == 1 => format!("{stem} {label}"),
            // One value may come back after another: each stretch is a run of its own.
            Some(label) => format!("{stem} {label} {number}"),
            None => format!("{stem} {number}"),
        };
        if let Some(back) = rows.windows(2).find(|pair| table.times[pair[1]] < table.times[pair[0]]) {
            wrong.push(format!(
                "{}, line {}: time runs back; sort the rows, give each run its own file, or name the column that tells \
                 runs apart with --run-column",
                table.file.display(),
                table.lines[back[1]]
            ));
        }
        let of = |name: &&str| {
            let numbers = table.numbers(name);
            rows.iter().map(|row| numbers.map_or(f64::NAN, |numbers| numbers[*row])).collect()
        };
        let times = rows.iter().map(|row| table.times[*row]).collect();
        runs.push(Run { name, file: table.file.clone(), times, values: names.iter().map(of).collect() });
    }
    BadLog::unless(wrong, runs)
}

/// By row: what the column says that runs are told apart by.
fn labels(table: &Table, name: &str) -> Result<Vec<String>, BadLog> {
    match table.cells(name) {
        Some(Cells::Text(texts)) => Ok(texts.iter().map(|text| text.trim().to_owned()).collect()),
        Some(Cells::Numbers(numbers)) => Ok(numbers.iter().map(f64::to_string).collect()),
        None => {
            let known: Vec<&str> = table.columns.iter().map(|(name, _)| name.as_str()).collect();
            Err(BadLog(vec![format!(
                "{}: there is no column {name} to split it by; there are {}",
                table.file.display(),
                known.join(", ")
            )]))
        }
    }
}
