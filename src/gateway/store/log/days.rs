//! Decision logs in a state directory, and the data types of their columns, for programs that copy logs.

use std::path::{Path, PathBuf};

use super::outputs::ENDING;
use crate::gateway::store::storage::retention::logs;
use isotherm_profile::log_columns::{ACTED, CLOCK, MEMORY, MODEL, PERMIT, PREFERRED, STATE, STOOD_IN, ZERO};

/// Returns the days with logs of this machine, oldest first, and the paths of the logs of each day. The logs of one
/// day are in the order of their beginning.
pub fn days(directory: &Path, machine: &str) -> Vec<(String, Vec<PathBuf>)> {
    let mut days: Vec<(String, Vec<PathBuf>)> = Vec::new();
    let mut logs = logs(directory, machine);
    logs.retain(|log| log.name.ends_with(".csv") && !log.name.ends_with(ENDING));
    logs.sort_by_key(|log| (log.day, number(&log.name)));
    for log in logs {
        let (day, path) = (log.day.to_string(), directory.join(log.name));
        match days.last_mut() {
            Some((known, paths)) if *known == day => paths.push(path),
            _ => days.push((day, vec![path])),
        }
    }
    days
}

/// Returns the number of a log within its day: 2 for `NAME-2026-01-31.2.csv`, 1 without a number.
fn number(name: &str) -> u32 {
    name.trim_end_matches(".csv").rsplit_once('.').and_then(|(_, number)| number.parse().ok()).unwrap_or(1)
}

/// Returns whether a column contains text; all other columns contain numbers. `columns` contains all columns
/// of the log. The function needs all columns, because the name of a signal may have the form of a column of
/// an axis, for example `bed_state`.
pub fn is_text(column: &str, columns: &[&str]) -> bool {
    let is_of_an_axis = |word: &str| {
        let axis = column.strip_suffix(word).and_then(|rest| rest.strip_suffix('_'));
        axis.is_some_and(|axis| columns.contains(&format!("{axis}_{PERMIT}").as_str()))
    };
    [MEMORY, ZERO, CLOCK].contains(&column)
        || [PERMIT, MODEL, STATE, ACTED, STOOD_IN, PREFERRED].into_iter().any(is_of_an_axis)
}

/// Returns whether only a replay (calculation of the decisions from the log) uses a log column.
pub fn is_for_replay(column: &str) -> bool {
    column == MEMORY
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_logs_of_a_day_stand_in_the_order_in_which_they_were_begun() {
        let home = tempfile::tempdir().unwrap();
        for name in [
            "m-2026-01-31.10.csv",
            "m-2026-01-31.2.csv",
            "m-2026-01-31.csv",
            "m-2026-01-31.outputs.csv",
            "m-2026-01-30.csv",
        ] {
            std::fs::write(home.path().join(name), "").unwrap();
        }
        let found = days(home.path(), "m");
        let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
        let found: Vec<(String, Vec<String>)> =
            found.iter().map(|(day, paths)| (day.clone(), paths.iter().map(name).collect())).collect();
        let last =
            ["m-2026-01-31.csv", "m-2026-01-31.2.csv", "m-2026-01-31.10.csv"].map(str::to_owned).to_vec();
        assert_eq!(
            found,
            [("2026-01-30".to_owned(), vec!["m-2026-01-30.csv".to_owned()]), ("2026-01-31".to_owned(), last)]
        );
    }

    #[test]
    fn only_what_an_axis_says_in_words_is_text() {
        let columns = ["time", "bed", "bed_state", "z_permit", "z_cz_um", "z_state", "machine_zero"];
        let text: Vec<&str> = columns.into_iter().filter(|column| is_text(column, &columns)).collect();
        assert_eq!(text, ["z_permit", "z_state", "machine_zero"]);
    }
}
