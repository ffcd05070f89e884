//! From files to runs: one each, or split by a column or a gap.

use super::table::{Cells, Table};
use super::{BadLog, Run, Split};

/// The runs of all tables over the columns `names`.
pub(super) fn runs(tables: &[Table], names: &[&str], split: &Split) -> Result<Vec<Run>, BadLog> {
    let mut runs = Vec::new();
    let mut wrong = Vec::new();
    for table in tables {
        let parts = match parts(table, split) {
            Ok(parts) => parts,
            Err(why) => {
                wrong.push(why);
                continue;
            }
        };
        let stem = table.file.file_stem().and_then(|stem| stem.to_str()).unwrap_or("run");
        let alone = parts.len() == 1;
        for (number, (value, rows)) in parts.into_iter().enumerate() {
            let name = match value {
                _ if alone => stem.to_owned(),
                Some(value) => format!("{stem} {value}"),
                None => format!("{stem} {}", number + 1),
            };
            if let Some(back) = runs_back(table, &rows) {
                wrong.push(back);
                continue;
            }
            let of = |name: &&str| {
                let numbers = table.numbers(name);
                rows.iter().map(|row| numbers.map_or(f64::NAN, |numbers| numbers[*row])).collect()
            };
            let times = rows.iter().map(|row| table.times[*row]).collect();
            runs.push(Run { name, file: table.file.clone(), times, values: names.iter().map(of).collect() });
        }
    }
    if wrong.is_empty() { Ok(named_apart(runs)) } else { Err(BadLog(wrong)) }
}

/// Two files of one name in two directories are two runs.
fn named_apart(mut runs: Vec<Run>) -> Vec<Run> {
    for place in 1..runs.len() {
        let name = runs[place].name.clone();
        let before = runs[..place].iter().filter(|run| run.name == name).count();
        if before > 0 {
            runs[place].name = format!("{name} ({})", before + 1);
        }
    }
    runs
}

/// The rows of each part, with the splitting column's value.
type Parts = Vec<(Option<String>, Vec<usize>)>;

fn parts(table: &Table, split: &Split) -> Result<Parts, String> {
    let file = table.file.display();
    let labels: Option<Vec<String>> = match &split.column {
        None => None,
        Some(name) => {
            let cells = table.cells(name).ok_or_else(|| {
                let known: Vec<&str> = table.columns.iter().map(|(name, _)| name.as_str()).collect();
                format!("{file}: there is no column {name} to split it by; there are {}", known.join(", "))
            })?;
            Some(match cells {
                Cells::Text(texts) => texts.iter().map(|text| text.trim().to_owned()).collect(),
                Cells::Numbers(numbers) => numbers.iter().map(f64::to_string).collect(),
            })
        }
    };
    let mut parts: Parts = Vec::new();
    for row in 0..table.times.len() {
        let label = labels.as_ref().map(|labels| labels[row].clone());
        let apart = |last: usize| {
            let gap = table.times[row].since(table.times[last]);
            split.gap.is_some_and(|longest| gap > longest)
        };
        match parts.last_mut() {
            Some((before, rows)) if *before == label && !rows.last().is_some_and(|last| apart(*last)) => {
                rows.push(row);
            }
            _ => parts.push((label, vec![row])),
        }
    }
    // One value may come back after another: each stretch is a run of its own.
    let all: Vec<Option<String>> = parts.iter().map(|(label, _)| label.clone()).collect();
    for (place, (label, _)) in parts.iter_mut().enumerate() {
        let twice = label.is_some() && all.iter().filter(|other| *other == label).count() > 1;
        if let Some(text) = label.as_mut().filter(|_| twice) {
            *text = format!("{text} {}", place + 1);
        }
    }
    Ok(parts)
}

fn runs_back(table: &Table, rows: &[usize]) -> Option<String> {
    let back = rows.windows(2).find(|pair| table.times[pair[1]] < table.times[pair[0]])?;
    let line = table.lines[back[1]];
    Some(format!(
        "{}, line {line}: time runs back; sort the rows, give each run its own file, or name the column that tells \
         runs apart with --run-column",
        table.file.display()
    ))
}
