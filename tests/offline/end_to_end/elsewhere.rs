//! Logs from spreadsheets and loggers, and readings of a dial gauge.

use std::fmt::Write;

use serde_json::Value;

use crate::end_to_end::plant::{HEADER, OUTPUT, PROFILE, READOUT, asked, day, identify, rows, written};

/// Rows of a day with times in local time; `stamp` formats date and time.
fn dated(number: u32, stamp: impl Fn(u32, u32, u32) -> String) -> String {
    let mut text = HEADER.join(",") + "\n";
    for (minute, row) in (0..).zip(rows(number)) {
        let cells: Vec<String> = row[1..].iter().map(f64::to_string).collect();
        writeln!(text, "{},{}", stamp(4 + number, 6 + minute / 60, minute % 60), cells.join(",")).unwrap();
    }
    text
}

fn in_utc(number: u32) -> String {
    dated(number, |day, hour, minute| format!("2026-01-{day:02}T{:02}:{minute:02}:00Z", hour - 1))
}

/// File of a German spreadsheet, with empty rows at its end.
fn german(number: u32) -> String {
    let dotted = dated(number, |day, hour, minute| format!("{day:02}_01_2026 {hour:02}:{minute:02}:00"));
    let text = dotted.replace(',', ";").replace('.', ",").replace('_', ".");
    let text = text.replace("spindle.rpm", "spindle_rpm").replace("z.error.um", "z_error_um");
    let empty = ";".repeat(HEADER.len() - 1) + "\n";
    format!("\u{feff}{text}{}", empty.repeat(3000)).replace('\n', "\r\n")
}

fn of(log: &dyn Fn(u32) -> String) -> Vec<(&'static str, String)> {
    [("one.csv", 1), ("two.csv", 2), ("three.csv", 3)].map(|(name, number)| (name, log(number))).to_vec()
}

#[test]
fn a_german_spreadsheet_and_a_logger_s_dates_say_the_same_as_plain_csv() {
    let home = tempfile::tempdir().unwrap();
    let logger =
        |number| dated(number, |day, hour, minute| format!("2026-01-{day:02} {hour:02}:{minute:02}:00"));
    for verb in [["identify", "plant.toml"].as_slice(), &["select", "--error", "z_error_um"], &["report"]] {
        let answer = |log: &dyn Fn(u32) -> String, zone: &[&str]| {
            crate::end_to_end::process::file(home.path(), "plant.toml", PROFILE);
            let answer = asked(home.path(), verb, &of(log), &[&["--json"], zone].concat());
            assert_eq!(answer.code, Some(0), "{verb:?}: {}", answer.said);
            serde_json::from_str::<Value>(&answer.out).unwrap()
        };
        let plain = answer(&in_utc, &[]);
        let without_making = |mut document: Value| {
            // Time at which the block was made.
            document.as_object_mut().unwrap().remove("made");
            document
        };
        for log in [&german as &dyn Fn(u32) -> String, &logger] {
            let read = answer(log, &["--zone", "Europe/Berlin"]);
            assert_eq!(without_making(read), without_making(plain.clone()), "{verb:?}");
        }
        assert_eq!(without_making(answer(&german, &["--zone", "+01:00"])), without_making(plain), "{verb:?}");
    }
}

#[test]
fn replay_reads_a_german_spreadsheet_and_keeps_its_times() {
    let home = tempfile::tempdir().unwrap();
    let model = "[[axis.z.model]]\nname = \"m\"\nkind = \"linear\"\nterms = [ { signal = \"bearing\", gain = -2.0, reference = \
                 20.0 } ]\n";
    let profile =
        crate::end_to_end::process::file(home.path(), "plant.toml", &format!("{PROFILE}{model}{OUTPUT}"));
    let replayed = |log: String, zone: &[&str]| {
        let verb = ["replay", profile.to_str().unwrap()];
        let answer =
            asked(home.path(), &verb, &[("day.csv", log)], &[&["--json", "--out", "out.csv"], zone].concat());
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        (answer.out, std::fs::read_to_string(home.path().join("out.csv")).unwrap())
    };
    let (plain, rows) = replayed(in_utc(1), &[]);
    let (german, german_rows) = replayed(german(1), &["--zone", "Europe/Berlin"]);
    assert_eq!(german, plain);
    let behind_time = |text: &str| -> Vec<String> {
        text.lines().map(|line| line.split_once(',').unwrap().1.to_owned()).collect()
    };
    assert_eq!(behind_time(&german_rows), behind_time(&rows));
    assert!(german_rows.contains("\n05.01.2026 06:00:00,"), "{}", &german_rows[..200]);
}

#[test]
fn replay_reads_below_the_lines_of_a_logger_and_leaves_no_part_of_its_output() {
    let home = tempfile::tempdir().unwrap();
    let model = "[[axis.z.model]]\nname = \"m\"\nkind = \"linear\"\nterms = [ { signal = \"bearing\", gain = -2.0, reference = \
                 20.0 } ]\n";
    let profile =
        crate::end_to_end::process::file(home.path(), "plant.toml", &format!("{PROFILE}{model}{OUTPUT}"));
    let verb = ["replay", profile.to_str().unwrap()];
    let out = home.path().join("out.csv");
    let replayed = |log: String| {
        let options = ["--json", "--out", "out.csv", "--zone", "Europe/Berlin"];
        asked(home.path(), &verb, &[("day.csv", log)], &options)
    };
    let log = german(1).trim_start_matches('\u{feff}').to_owned();
    let plain = replayed(log.clone());
    assert!(plain.code == Some(0) && out.exists(), "{}", plain.said);
    let below = replayed(format!("Logger 34970A\nSerial: 1234\n\n{log}"));
    assert_eq!(below.out, plain.out, "{}", below.said);
    std::fs::remove_file(&out).unwrap();
    let wrong = replayed(format!("Logger\n{log}yesterday{}\n", ";1".repeat(HEADER.len() - 1)));
    assert_eq!(wrong.code, Some(1), "{}", wrong.out);
    let line = log.lines().count() + 2;
    assert!(wrong.said.contains(&format!("day.csv, line {line}, column time")), "{}", wrong.said);
    let names = std::fs::read_dir(home.path()).unwrap().map(|entry| entry.unwrap().file_name());
    let parts: Vec<_> = names.filter(|name| name.to_string_lossy().starts_with("out.csv")).collect();
    assert!(parts.is_empty(), "{parts:?}");
}

#[test]
fn replay_leaves_out_the_errors_that_identify_leaves_out() {
    let home = tempfile::tempdir().unwrap();
    let model = "[[axis.z.model]]\nname = \"m\"\nkind = \"linear\"\nterms = [ { signal = \"bearing\", gain = -2.0, reference = \
                 20.0 } ]\n";
    let profile =
        crate::end_to_end::process::file(home.path(), "plant.toml", &format!("{PROFILE}{model}{OUTPUT}"));
    let replayed = |wrong: &dyn Fn(usize) -> Option<&'static str>| {
        let line = |(number, line): (usize, &str)| match (wrong(number), line.rsplit_once(',')) {
            (Some(word), Some((rest, _))) => format!("{rest},{word}\n"),
            _ => format!("{line}\n"),
        };
        let log: String = (1..).zip(in_utc(1).lines()).map(line).collect();
        let verb = ["replay", profile.to_str().unwrap()];
        asked(home.path(), &verb, &[("day.csv", log)], &["--json", "--out", "out.csv"])
    };
    for word in ["999.9", "-9999", "OL", "n/a"] {
        let answer = replayed(&|line| [100, 101].contains(&line).then_some(word));
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        let remark = format!(
            "line 100, column z_error_um: `{word}` is not a measured value, also in line 101: left out"
        );
        assert!(answer.out.contains(&remark), "{}", answer.out);
        let rows = std::fs::read_to_string(home.path().join("out.csv")).unwrap();
        let residual =
            |line: usize| rows.lines().nth(line - 1).unwrap().rsplit(',').next().unwrap().to_owned();
        assert_eq!([residual(100), residual(101)], [String::new(), String::new()], "{word}");
        assert!(!residual(102).is_empty() && !residual(99).is_empty(), "{word}");
    }
    std::fs::remove_file(home.path().join("out.csv")).unwrap();
    let many = replayed(&|line| (line > 1 && line % 10 == 0).then_some("999.9"));
    assert_eq!(many.code, Some(1), "{}", many.out);
    assert!(many.said.contains("more than 5 % of the values"), "{}", many.said);
    assert!(!home.path().join("out.csv").exists());
}

#[test]
fn what_is_wrong_in_a_spreadsheet_is_named_with_its_own_line() {
    let home = tempfile::tempdir().unwrap();
    let said = |from: &str, to: &str| {
        let log = german(1);
        let line = log.lines().nth(99).unwrap();
        let wrong = log.replace(line, &line.replacen(from, to, 1));
        assert_ne!(wrong, log);
        let answer = asked(home.path(), &["report"], &[("day.csv", wrong)], &["--zone", "Europe/Berlin"]);
        assert_eq!(answer.code, Some(1), "{}", answer.said);
        answer.said
    };
    let comma = said(",", ".");
    assert!(
        comma.contains("day.csv, line 100, column ") && comma.contains("decimal commas and points"),
        "{comma}"
    );
    let time = said("05.01.2026", "05/01/2026");
    assert!(time.contains("day.csv, line 100, column time") && time.contains("write 2026-01-31"), "{time}");
    let summer = said("05.01.2026 07:38", "29.03.2026 02:38");
    assert!(summer.contains("2026-03-29T02:38:00 does not exist in Europe/Berlin"), "{summer}");
    let cell = said(";", ";;");
    assert!(cell.contains("day.csv, line 100: this row has 7 cells, but there are 6 column names"), "{cell}");
}

#[test]
fn a_zone_that_is_none_is_refused_with_the_one_that_was_meant() {
    let home = tempfile::tempdir().unwrap();
    for (zone, says) in [
        ("Europe/Berln", "did you mean Europe/Berlin?"),
        ("MEZ+1:2:3", "write a zone as Europe/Berlin"),
        ("UTC+1", "ahead of UTC or behind UTC"),
    ] {
        let answer = asked(home.path(), &["report"], &[("day.csv", day(1))], &["--zone", zone]);
        assert_eq!(answer.code, Some(2));
        assert!(answer.said.contains(says), "{}", answer.said);
    }
}

/// Recorded log without the error, and gauge readings every ten minutes, whose times differ from those of the rows.
fn with_gauge(number: u32) -> (String, String) {
    let log = in_utc(number).lines().map(|line| format!("{}\n", line.rsplit_once(',').unwrap().0)).collect();
    let mut gauge = "time;error_mm\n".to_owned();
    for (minute, row) in (0..).zip(rows(number)).step_by(10) {
        let (hour, minute): (u32, u32) = (6 + minute / 60, minute % 60);
        let stamp = format!("{:02}.01.2026 {hour:02}:{minute:02}:17", 4 + number);
        writeln!(gauge, "{stamp};{}", (row[5] / 1000.0).to_string().replace('.', ",")).unwrap();
    }
    (log, gauge)
}

#[test]
fn readings_of_a_dial_gauge_are_put_beside_the_recorded_rows() {
    let home = tempfile::tempdir().unwrap();
    let logs = of(&|number| with_gauge(number).0);
    let readings = (1..=3).map(|number| with_gauge(number).1);
    let gauge: String = readings.map(|text| text.replacen("time;error_mm\n", "", 1)).collect();
    let gauge = format!("time;error_mm\n{gauge}");
    crate::end_to_end::process::file(home.path(), "gauge.csv", &gauge);
    let more = |zone: &'static str| ["--gauge", "gauge.csv", "--zone", zone, "--lags", "0s,25min", "--json"];
    let answer = identify(home.path(), PROFILE, &logs, &more("Europe/Berlin"));
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    let found: Value = serde_json::from_str(&answer.out).unwrap();
    let bent: f64 = (found["terms"].as_array().unwrap().iter())
        .filter(|term| term["signal"] == "bearing")
        .map(|term| term["gain"].as_f64().unwrap())
        .sum();
    assert!((bent + 3.0).abs() < 0.3, "the bearing bends by 3 µm/°C: {bent}; {}", answer.out);
    let (all, within) = ([more("UTC").as_slice(), &["--within", "10s"]].concat(), "--within");
    let wrong = identify(home.path(), PROFILE, &logs, &all);
    assert_eq!(wrong.code, Some(1));
    assert!(
        wrong.said.contains("gauge.csv: no log row is within 10s of a reading")
            && wrong.said.contains("--zone"),
        "{} {within}",
        wrong.said
    );
    let late = gauge + "12.01.2026 06:00:00;0,001\n";
    crate::end_to_end::process::file(home.path(), "gauge.csv", &late);
    let answer = identify(home.path(), PROFILE, &logs, &more("Europe/Berlin"));
    assert!(
        answer.out.contains(
            "1 of 91 readings are left out, because no log row is within 30s. The first of them is in line 92"
        ),
        "{}",
        answer.out
    );
    let has = identify(home.path(), PROFILE, &of(&in_utc), &more("Europe/Berlin"));
    assert!(has.said.contains("the logs have a column z_error_um already"), "{}", has.said);
}

#[test]
fn an_error_along_the_axis_without_its_position_gets_the_method_that_looks_at_it() {
    let home = tempfile::tempdir().unwrap();
    let along = |number: u32| {
        let mut rows = rows(number);
        for (place, row) in rows.iter_mut().enumerate() {
            let position = [0.0, 200.0, 400.0][place % 3];
            row[5] *= position / 200.0;
            row.push(position);
        }
        written(&[HEADER.as_slice(), &["scale"]].concat(), &rows)
    };
    let profile = format!("{PROFILE}{READOUT}");
    let answer = identify(home.path(), &profile, &of(&along), &["--method", "ols"]);
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    let says = "the error was measured over 400 mm of scale, but no term of the model uses this position. \
                Add --method position --position scale";
    assert!(answer.out.contains(says), "{}", answer.out);
    assert!(answer.out.contains("µm/°C"), "gains have the profile's unit: {}", answer.out);
    let answer =
        identify(home.path(), &profile, &of(&along), &["--method", "position", "--position", "scale"]);
    assert!(
        !answer.out.contains("no term of the model uses this position") && answer.out.contains("µm/mm/°C"),
        "{}{}",
        answer.said,
        answer.out
    );
}
