//! Logs: endless files, very many rows, and very large cells.

use std::fmt::Write;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use super::rig::{Home, isotherm, size};

/// Verbs that read logs, without the log.
const READERS: [&[&str]; 4] = [
    &["report"],
    &["select", "--error", "z_error_um"],
    &["identify", "surface-grinder"],
    &["replay", "surface-grinder"],
];

#[test]
fn a_sparse_log_of_ten_gigabytes_is_refused_at_its_first_megabyte() {
    let home = Home::new();
    for (name, begin) in [("holes.csv", ""), ("rows_and_holes.csv", "time,bed,z_error_um\n0,20,1\n60,21,2\n")]
    {
        let path = home.write(name, begin);
        File::options().write(true).open(&path).unwrap().set_len(10_000_000_000).unwrap();
        for verb in READERS {
            let line = if begin.is_empty() { "line 1" } else { "line 4" };
            isotherm(verb, &path).is_refused(1_000_000, &[name, line, "longer than 1 MB"]);
        }
    }
}

#[test]
fn a_line_of_forty_megabytes_is_refused_wherever_it_stands() {
    let home = Home::new();
    let long = "1,".repeat(20_000_000);
    let quoted = format!("time,bed\n0,\"{}\n", "1\n".repeat(20_000_000));
    for (name, text) in [
        ("header.csv", format!("time,{long}\n0,1\n")),
        ("row.csv", format!("time,bed\n0,{long}\n")),
        ("quote.csv", quoted),
    ] {
        let path = home.write(name, text);
        for verb in READERS {
            isotherm(verb, &path).is_refused(1_000_000, &[name, "longer than 1 MB"]);
        }
    }
}

#[test]
fn a_cell_and_a_name_of_a_column_are_quoted_in_part() {
    let home = Home::new();
    let long = "x".repeat(500_000);
    for (name, text) in [
        ("cell.csv", format!("time,bed,z_error_um\n0,20,1\n60,{long},2\n")),
        ("time.csv", format!("time,bed,z_error_um\n{long},20,1\n")),
        ("twice.csv", format!("time,{long},{long}\n0,20,1\n")),
        ("names.csv", format!("time,bed,{long}\n0,20,1\n")),
    ] {
        let path = home.write(name, text);
        for verb in READERS {
            isotherm(verb, &path).is_within(size(&path));
        }
    }
}

#[test]
fn a_mistake_in_every_row_is_told_some_times_and_counted() {
    let home = Home::new();
    let mut text = String::from("time,bed,z_error_um\n");
    (0..200_000).for_each(|row| writeln!(text, "yesterday at {row},20,1").unwrap());
    let path = home.write("mistakes.csv", text);
    let refused = isotherm(&["report"], &path);
    refused.is_refused(size(&path), &["line 2, column time", "also in 199999 more lines"]);
}

#[test]
fn a_log_that_changes_its_run_in_every_row_is_refused() {
    let home = Home::new();
    let mut text = String::from("time,bed,z_error_um,part\n");
    (0..200_000).for_each(|row| writeln!(text, "{row},20,1,P{}", row % 2).unwrap());
    let path = home.write("parts.csv", text);
    let by = ["select", "--error", "z_error_um", "--run-column", "part"];
    isotherm(&by, &path).is_refused(size(&path), &["more than 10000 runs", "--run-column"]);
    let mut text = String::from("time,bed,z_error_um,part\n");
    (0..200_000).for_each(|row| writeln!(text, "{row},20,1,P{row}").unwrap());
    let path = home.write("names.csv", text);
    isotherm(&by, &path).is_refused(size(&path), &["more than 100000 different texts"]);
}

#[test]
fn a_hundred_thousand_columns_are_refused() {
    let home = Home::new();
    let names: Vec<String> = (0..100_000).map(|place| format!("t{place}")).collect();
    let path = home.write("wide.csv", format!("time,{}\n0,{}\n", names.join(","), "1,".repeat(99_999) + "1"));
    isotherm(&["report"], &path).is_refused(size(&path), &["100001 columns", "at most 10000"]);
}

/// Writes `rows` rows with the same time and value.
fn equal_rows(home: &Home, rows: usize) -> PathBuf {
    let path = home.path("equal.csv");
    let mut file = BufWriter::new(File::create(&path).unwrap());
    file.write_all(b"time,bed,z_error_um\n").unwrap();
    let some = "0,20,1\n".repeat(1000);
    (0..rows / 1000).for_each(|_| file.write_all(some.as_bytes()).unwrap());
    path
}

/// Writes a log of one day with 98 temperatures and an error.
fn wide(home: &Home, name: &str, rows: usize) -> PathBuf {
    let path = home.path(name);
    let mut file = BufWriter::new(File::create(&path).unwrap());
    let names: Vec<String> = (0..98).map(|place| format!("t{place}")).collect();
    writeln!(file, "time,{},z_error_um", names.join(",")).unwrap();
    let mut line = String::new();
    for row in 0..rows {
        line.clear();
        write!(line, "{row}").unwrap();
        for place in 0..98 {
            let value = (row * (place + 7)) % 997;
            write!(line, ",2{}.{:02}", value % 10, value / 10).unwrap();
        }
        writeln!(file, "{line},{}.5", row % 20).unwrap();
    }
    file.flush().unwrap();
    path
}

/// Asserts that all verbs stay within the limits. `most` is a stricter memory limit in MB.
fn keeps_within(path: &Path, most: f64) {
    for verb in READERS {
        let seen = isotherm(verb, path);
        let shown = (path.file_name(), verb[0], seen.code, seen.seconds, seen.peak);
        println!("{shown:?}");
        seen.is_within(size(path));
        assert!(seen.peak <= most, "{shown:?}");
    }
}

#[test]
fn many_equal_rows_and_many_columns_are_read_within_the_limits() {
    let home = Home::new();
    keeps_within(&equal_rows(&home, 500_000), f64::INFINITY);
    keeps_within(&wide(&home, "wide.csv", 10_000), f64::INFINITY);
}

/// Files of the size that once crashed the program. `tests/run long` enables this test.
#[test]
fn sixty_million_equal_rows_and_a_million_of_a_hundred_columns_are_too() {
    if std::env::var_os("TEST_LARGE_FILES").is_none() {
        return;
    }
    let home = Home::new();
    let path = equal_rows(&home, 60_000_000);
    for verb in &READERS[..3] {
        isotherm(verb, &path).is_refused(size(&path), &["line 20000002", "more than 20 million rows"]);
    }
    std::fs::remove_file(path).unwrap();
    keeps_within(&wide(&home, "large.csv", 1_000_000), 1500.0);
}

#[test]
fn of_many_columns_of_which_none_is_the_time_some_are_named() {
    let home = Home::new();
    let names: Vec<String> = (0..5000).map(|column| format!("bed{column}_degC")).collect();
    let path = home.write("columns.csv", names.join(",") + "\n1\n");
    for verb in READERS {
        let seen = isotherm(verb, &path);
        seen.is_refused(size(&path), &["columns.csv", "there is no column", "…"]);
        let longest = seen.said.lines().map(|line| line.chars().count()).max();
        assert!(longest < Some(600), "{longest:?}: {verb:?}");
    }
}
