//! Logs and events as Parquet files, read by DuckDB. The tests check their content, and the query of the manual for the
//! drift of a fleet over a year.
//!
//! The tests need duckdb below `target/tools`; `tests/run tools` installs it. Without it, they fail with a message.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::support::process;

use process::{Running, file, free_port, isotherm, until};

/// Executes a query with DuckDB in this directory, and returns the rows.
fn ask(home: &Path, sql: &str) -> Value {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    let asks = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/parquet.py");
    let begun =
        Command::new(&python).arg(asks).arg(home).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut begun =
        begun.unwrap_or_else(|error| panic!("{}: {error}: `tests/run tools` makes it", python.display()));
    begun.stdin.take().unwrap().write_all(sql.as_bytes()).unwrap();
    let ended = begun.wait_with_output().unwrap();
    assert!(ended.status.success(), "{sql} (without duckdb: `tests/run tools`)");
    serde_json::from_slice(&ended.stdout).unwrap()
}

/// Exports a machine to `fleet`. Returns the exit code and the whole output.
fn export(home: &Path, profile: &Path) -> (i32, String) {
    let mut command = isotherm(home);
    command.arg("export").arg(profile).arg("--parquet").arg(home.join("fleet"));
    let ended = command.arg("--state").arg(home.join("state")).output().unwrap();
    let said = [ended.stdout, ended.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    (ended.status.code().unwrap(), said)
}

/// Profile of a machine with this name, and with devices at this port.
fn profile(home: &Path, name: &str, port: u16) -> PathBuf {
    let chapter = include_str!("../../docs/commissioning.md");
    let block = chapter.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let text = block.replace("my-machine", name).replace("15020", &port.to_string());
    let text = text
        .replace("[machine]", "[machine]\non_stop = \"hold\"")
        .replace("every    = \"10s\"", "every    = \"1s\" ");
    assert!(text.contains(&format!("name = \"{name}\"")) && text.contains(&port.to_string()));
    file(home, &format!("{name}.toml"), &text)
}

fn files(place: &Path) -> Vec<String> {
    let files =
        std::fs::read_dir(place).unwrap().map(|file| file.unwrap().file_name().into_string().unwrap());
    let mut files: Vec<String> = files.collect();
    files.sort();
    files
}

#[test]
fn what_a_gateway_has_logged_is_in_the_parquet_files_cell_by_cell_with_moments_that_have_a_zone() {
    let home = tempfile::tempdir().unwrap();
    let (home, state) = (home.path(), home.path().join("state"));
    let profile = profile(home, "mill-7", free_port());
    let mut devices = Running::start(isotherm(home).arg("virtual").arg(&profile));
    devices.receives("module");
    let mut gateway = Running::start(isotherm(home).arg("run").arg(&profile).arg("--state").arg(&state));
    gateway.receives("the gateway runs");
    until("it has armed, and decided", || {
        let shown =
            isotherm(home).args(["status", "--json"]).arg(&profile).arg("--state").arg(&state).output();
        let shown = String::from_utf8(shown.unwrap().stdout).unwrap();
        if shown.contains("\"active\"") { Ok(()) } else { Err(shown) }
    });
    gateway.signal("TERM");
    assert!(gateway.ends_within(process::PATIENCE).success());
    let (code, said) = export(home, &profile);
    assert_eq!(code, 0, "{said}");

    // Every cell of the CSV file that DuckDB reads is also in the Parquet file, except the memory of the machine.
    let apart = ask(
        home,
        "CREATE VIEW csv AS SELECT * EXCLUDE (time, machine_memory, machine_zero, machine_clock), time::TIMESTAMPTZ AS time, \
         'mill-7' AS machine FROM read_csv('state/mill-7-????-??-??.csv', all_varchar = true, union_by_name = true); \
         CREATE VIEW parquet AS SELECT * EXCLUDE (machine_zero, machine_clock, time), time::TIMESTAMPTZ AS time \
         FROM read_parquet('fleet/decisions/*.parquet'); \
         SELECT (SELECT count(*) FROM csv), (SELECT count(*) FROM parquet), \
         (SELECT count(*) FROM (SELECT time, machine, bed::DOUBLE AS bed, z_permit, z_raw_um::DOUBLE AS raw, z_cz_um::DOUBLE AS cz, \
            z_model, z_state, z_acted FROM csv \
          INTERSECT ALL SELECT time, machine, bed, z_permit, z_raw_um, z_cz_um, z_model, z_state, z_acted FROM parquet))",
    );
    let rows = apart[0][0].as_u64().unwrap();
    assert!(rows > 0, "{apart}");
    assert_eq!(apart, json!([[rows, rows, rows]]));
    let kinds = ask(
        home,
        "SELECT column_name, column_type FROM (DESCRIBE SELECT * FROM read_parquet('fleet/decisions/*.parquet')) \
         WHERE column_name IN ('time', 'bed', 'z_state', 'z_cz_um') ORDER BY 1",
    );
    let expected = [
        ("bed", "DOUBLE"),
        ("time", "TIMESTAMP WITH TIME ZONE"),
        ("z_cz_um", "DOUBLE"),
        ("z_state", "VARCHAR"),
    ];
    assert_eq!(kinds, json!(expected));
    let events = ask(
        home,
        "SELECT kind, level, machine, json_valid(data) FROM read_parquet('fleet/events/*.parquet') WHERE kind = 'armed'",
    );
    assert_eq!(events, json!([["armed", "info", "mill-7", true]]));
    let counted = ask(home, "SELECT count(*), count(text) FROM read_parquet('fleet/events/*.parquet')");
    let kept: usize = files(&state)
        .iter()
        .filter(|name| name.ends_with(".events.jsonl"))
        .map(|name| std::fs::read_to_string(state.join(name)).unwrap().lines().count())
        .sum();
    assert_eq!(counted, json!([[kept, kept]]));
}

#[test]
fn a_day_that_has_not_changed_is_left_alone_and_one_that_has_is_written_anew_and_whole() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let profile = profile(home, "mill-7", 1);
    std::fs::create_dir(home.join("state")).unwrap();
    let log = |name: &str, text: &str| file(&home.join("state"), name, text);
    let head = "time,bed,z_permit,z_raw_um,z_cz_um,z_state,machine_memory\n";
    log(
        "mill-7-2026-01-31.csv",
        &format!("{head}2026-01-31T10:00:00Z,20.5,armed,1,1,active,\"{{\"\"a\"\":1}}\"\n"),
    );
    // The clock was set, the profile has another signal, and the power failed while a row was written.
    let second = "time,bed,head,z_permit,z_raw_um,z_cz_um,z_state,machine_memory\n\
                  2026-01-31T09:00:00.123456789Z,20.5,,armed,,2.5,holding,\n2026-01-31T09:00:10Z,20.5,1.0,arm";
    log("mill-7-2026-01-31.2.csv", second);
    log("mill-7-2026-02-01.csv", &format!("{head}2026-02-01T10:00:00Z,,off,,0,off,\n"));
    // Logs of another machine, and of outputs.
    log("mill-70-2026-01-31.csv", &format!("{head}2026-01-31T10:00:00Z,1,armed,1,1,active,\n"));
    log("mill-7-2026-01-31.outputs.csv", "time,output,fact\n");
    let (code, said) = export(home, &profile);
    assert!(code == 0 && said.contains("decisions of 2 days written, 0 unchanged"), "{said}");
    assert!(said.contains("mill-7-2026-01-31.2.csv: 1 row is incomplete or damaged, and left out"), "{said}");
    let place = home.join("fleet/decisions");
    assert_eq!(files(&place), ["mill-7-2026-01-31.parquet", "mill-7-2026-02-01.parquet"]);
    let rows = "SELECT epoch_us(time), bed, head, z_permit, z_raw_um, z_cz_um, z_state, machine \
                FROM read_parquet('fleet/decisions/mill-7-2026-01-31.parquet')";
    let expected = json!([
        [1_769_853_600_000_000_u64, 20.5, null, "armed", 1.0, 1.0, "active", "mill-7"],
        [1_769_850_000_123_456_u64, 20.5, null, "armed", null, 2.5, "holding", "mill-7"],
    ]);
    assert_eq!(ask(home, rows), expected);

    let (code, said) = export(home, &profile);
    assert!(code == 0 && said.contains("decisions of 0 days written, 2 unchanged"), "{said}");
    // A file server may store times with a lower resolution than a disk. The time that was set must survive that.
    for name in files(&place) {
        let time = place.join(name).metadata().unwrap().modified().unwrap();
        let since = time.duration_since(std::time::UNIX_EPOCH).unwrap();
        assert_eq!(since.subsec_nanos() % 1000, 0);
    }
    let mut more =
        std::fs::OpenOptions::new().append(true).open(home.join("state/mill-7-2026-02-01.csv")).unwrap();
    more.write_all(b"2026-02-01T10:00:10Z,21,armed,,0.5,active,\n").unwrap();
    drop(more);
    std::fs::remove_file(home.join("state/mill-7-2026-01-31.csv")).unwrap();
    std::fs::remove_file(home.join("state/mill-7-2026-01-31.2.csv")).unwrap();
    let (code, said) = export(home, &profile);
    assert!(code == 0 && said.contains("decisions of 1 day written, 0 unchanged"), "{said}");
    let count =
        "SELECT count(*), max(bed) FROM read_parquet('fleet/decisions/*.parquet', union_by_name = true)";
    assert_eq!(ask(home, count), json!([[4, 21.0]]), "what was deleted of the logs is kept");
}

#[test]
fn a_log_that_cannot_be_read_is_told_and_keeps_no_other_day_from_being_written() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let profile = profile(home, "mill-7", 1);
    std::fs::create_dir(home.join("state")).unwrap();
    let head = "time,bed,z_permit,z_raw_um,z_cz_um,z_state\n";
    std::fs::write(home.join("state/mill-7-2026-01-30.csv"), b"time,\xff\xfe\n").unwrap();
    for day in ["2026-01-29", "2026-01-31"] {
        let text = format!("{head}{day}T10:00:00Z,20.5,armed,1,1,active\n");
        file(&home.join("state"), &format!("mill-7-{day}.csv"), &text);
    }
    let (code, said) = export(home, &profile);
    assert_eq!(code, 1, "{said}");
    for words in ["mill-7-2026-01-30.csv cannot be read", "decisions of 2 days written", "not written: 1"] {
        assert!(said.contains(words), "{said}");
    }
    assert_eq!(
        files(&home.join("fleet/decisions")),
        ["mill-7-2026-01-29.parquet", "mill-7-2026-01-31.parquet"]
    );
}

/// Runs a Python program in this directory. Returns its output.
fn python(home: &Path, program: &str) -> String {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    let ended = Command::new(&python).args(["-c", program]).current_dir(home).output();
    let ended =
        ended.unwrap_or_else(|error| panic!("{}: {error}: `tests/run tools` makes it", python.display()));
    let said = [ended.stdout, ended.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(ended.status.success(), "{said}\n{program} (without its packages: `tests/run tools`)");
    said
}

/// Logs of a month: two days with two rows each. `bed` is 20.5 °C, and each of the `signals` is 30.5 °C.
fn month(state: &Path, month: u32, signals: &[&str]) {
    let names: String = signals.iter().map(|name| format!(",{name}")).collect();
    let values = ",30.5".repeat(signals.len());
    for day in [10, 11] {
        let mut text = format!("time,bed{names},z_permit,z_raw_um,z_cz_um,z_model,z_state,machine_memory\n");
        for hour in [8, 9] {
            let _ =
                writeln!(text, "2026-{month:02}-{day}T{hour:02}:00:00Z,20.5{values},armed,1,1.5,,active,");
        }
        file(state, &format!("mill-7-2026-{month:02}-{day}.csv"), &text);
    }
}

#[test]
fn months_over_a_changed_profile_are_read_by_the_programs_of_the_manual() {
    let home = tempfile::tempdir().unwrap();
    let (home, state) = (home.path(), home.path().join("state"));
    let profile = profile(home, "mill-7", 1);
    std::fs::create_dir(&state).unwrap();
    month(&state, 1, &["old"]);
    let (code, said) = export(home, &profile);
    assert!(code == 0 && said.contains("decisions of 2 days written, 0 unchanged"), "{said}");
    // The gateway has deleted the logs of January. The profile has got a signal, and has lost one.
    files(&state).iter().for_each(|name| std::fs::remove_file(state.join(name)).unwrap());
    month(&state, 2, &["head"]);
    month(&state, 3, &["head", "oil"]);
    let (code, said) = export(home, &profile);
    assert!(code == 0 && said.contains("decisions of 6 days written, 0 unchanged"), "{said}");
    let (code, said) = export(home, &profile);
    assert!(code == 0 && said.contains("decisions of 0 days written, 4 unchanged"), "{said}");

    let columns = "import glob, pyarrow.parquet as pq\nfor file in sorted(glob.glob('fleet/decisions/*')):\n    \
                   print(','.join(pq.read_schema(file).names))";
    let expected = "time,machine,bed,old,z_permit,z_raw_um,z_cz_um,z_model,z_state,head,oil";
    assert_eq!(python(home, columns).lines().collect::<Vec<_>>(), [expected; 6]);
    let dataset = "import pyarrow.dataset as ds\ntable = ds.dataset('fleet/decisions').to_table()\n\
                   print(table.num_rows, [table.num_rows - table[name].null_count for name in ('bed', 'old', 'head', 'oil')])";
    assert_eq!(python(home, dataset).trim(), "12 [12, 4, 8, 4]");

    let chapter = include_str!("../../docs/fleet.md");
    let recipes: Vec<&str> =
        chapter.split("```python\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
    let counts = [
        "print('counts', len(log), [int(log[name].count()) for name in ('bed', 'old', 'head', 'oil')])",
        "print('counts', log.select(pl.len()).collect().item(), [log.select(pl.col(name).count()).collect().item() \
         for name in ('bed', 'old', 'head', 'oil')])",
        "print('counts', len(log), list(duckdb.sql('SELECT count(bed), count(old), count(head), count(oil) FROM log')\
         .fetchall()[0]))",
    ];
    assert_eq!(recipes.len(), counts.len());
    for (recipe, counts) in recipes.into_iter().zip(counts) {
        let said = python(home, &format!("{}\n{counts}", recipe.replace("my-machine", "mill-7")));
        for word in ["2026-01", "2026-02", "2026-03", "20.5", "1.5", "counts 12 [12, 4, 8, 4]"] {
            assert!(said.contains(word), "{word} in {said}\n{recipe}");
        }
    }
}

#[test]
fn an_exported_file_that_cannot_be_read_is_written_again_if_its_logs_are_there() {
    let home = tempfile::tempdir().unwrap();
    let (home, state) = (home.path(), home.path().join("state"));
    let profile = profile(home, "mill-7", 1);
    std::fs::create_dir(&state).unwrap();
    month(&state, 1, &[]);
    assert_eq!(export(home, &profile).0, 0);
    let place = home.join("fleet/decisions");
    let [first, second] = ["10", "11"].map(|day| place.join(format!("mill-7-2026-01-{day}.parquet")));
    for path in [&first, &second] {
        let modified = path.metadata().unwrap().modified().unwrap();
        std::fs::write(path, "PAR1 and no more").unwrap();
        std::fs::File::options().write(true).open(path).unwrap().set_modified(modified).unwrap();
    }
    std::fs::remove_file(state.join("mill-7-2026-01-11.csv")).unwrap();
    let (code, said) = export(home, &profile);
    assert_eq!(code, 1, "{said}");
    for words in ["mill-7-2026-01-11.parquet cannot be read", "decisions of 1 day written", "not written: 1"]
    {
        assert!(said.contains(words), "{said}");
    }
    let rows = "SELECT count(*) FROM read_parquet('fleet/decisions/mill-7-2026-01-10.parquet')";
    assert_eq!(ask(home, rows), json!([[2]]));
}

/// Logs of a machine over a year, with a row per hour. Cz swings by `swing` µm a day, and changes by `drift` µm in the
/// year.
fn year(state: &Path, machine: &str, axis: &str, (swing, drift): (f64, f64)) {
    let begin: jiff::civil::Date = "2025-11-01".parse().unwrap();
    for day in 0..365_i32 {
        let date = begin.checked_add(jiff::Span::new().days(day)).unwrap();
        let mut text = format!("time,{machine}_bed,{axis}_permit,{axis}_raw_um,{axis}_cz_um,{axis}_state\n");
        for hour in 0..24 {
            let turn = f64::from(hour) / 24.0 * std::f64::consts::TAU;
            let cz = drift * f64::from(day) / 365.0 + swing / 2.0 * turn.sin();
            let _ = writeln!(text, "{date}T{hour:02}:00:00Z,20.5,armed,{cz},{cz},active");
        }
        file(state, &format!("{machine}-{date}.csv"), &text);
    }
}

#[test]
fn the_drift_of_every_machine_over_a_year_is_one_query_of_the_manual() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    std::fs::create_dir(home.join("state")).unwrap();
    let machines =
        [("grinder-3", "z", (8.0, 3.65)), ("mill-7", "x", (20.0, -36.5)), ("lathe-1", "z", (4.0, 0.0))];
    for (machine, axis, course) in machines {
        year(&home.join("state"), machine, axis, course);
        let (code, said) = export(home, &profile(home, machine, 1));
        assert!(code == 0 && said.contains("decisions of 365 days written"), "{said}");
    }
    let chapter = include_str!("../../docs/fleet.md");
    let query = chapter.split("```sql\n").nth(1).unwrap().split("```").next().unwrap();
    let found = ask(home, query);
    let rows: Vec<(&str, &str, f64, f64)> = found
        .as_array()
        .unwrap()
        .iter()
        .map(|row| {
            assert!((365..=366).contains(&row[2].as_u64().unwrap()), "the days of that zone: {row}");
            (
                row[0].as_str().unwrap(),
                row[1].as_str().unwrap(),
                row[3].as_f64().unwrap(),
                row[5].as_f64().unwrap(),
            )
        })
        .collect();
    // The largest is first. The columns are the swing of a day with the drift of a day, and the drift of the year.
    let expected = [("mill-7", "x", 20.0, -36.5), ("grinder-3", "z", 8.0, 3.65), ("lathe-1", "z", 4.0, 0.0)];
    assert_eq!(rows.len(), expected.len(), "{found}");
    for (row, (machine, axis, range, drift)) in rows.iter().zip(expected) {
        assert_eq!((row.0, row.1), (machine, axis), "{found}");
        assert!((row.2 - range).abs() < 0.3 && (row.3 - drift).abs() < 0.1, "{found}");
    }
}

#[test]
fn a_machine_that_has_not_run_here_is_said_to_be_one_with_the_directory_that_was_looked_into() {
    let home = tempfile::tempdir().unwrap();
    let (home, state) = (home.path(), home.path().join("state"));
    let profile = profile(home, "mill-7", 1);
    let words = format!(
        "there are no logs of mill-7 in {}. If the gateway ran with another state directory, give that \
         directory with --state",
        state.display()
    );
    let (code, said) = export(home, &profile);
    assert!(code == 1 && said.contains(&words), "{words}\n{said}");
    assert!(!said.contains("No such file") && !home.join("fleet").exists(), "{said}");
    // Another machine may have run here.
    std::fs::create_dir(&state).unwrap();
    let (code, said) = export(home, &profile);
    assert!(code == 0 && said.contains(&words), "{words}\n{said}");
}
