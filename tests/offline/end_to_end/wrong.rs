//! Wrong input is rejected with a message that says what to do.

use crate::end_to_end::plant::{HEADER, PROFILE, asked, day, identify, rows, with_column, written};
use crate::end_to_end::process::{file, isotherm};

/// Names and texts of logs.
type Logs = Vec<(&'static str, String)>;

/// Checks that all three verbs reject the first log with these words.
#[track_caller]
fn all_refuse(log: &str, words: &[&str]) {
    let home = tempfile::tempdir().unwrap();
    let logs = [("wrong.csv", log.to_owned()), ("two.csv", day(2))];
    let answers = [
        identify(home.path(), PROFILE, &logs, &[]),
        asked(home.path(), &["select", "--error", "z_error_um"], &logs, &[]),
        asked(home.path(), &["report"], &logs, &[]),
    ];
    for answer in answers {
        assert_eq!(answer.code, Some(1), "{}", answer.said);
        for word in words {
            assert!(answer.said.contains(word), "`{word}` is not in: {}", answer.said);
        }
        assert!(answer.said.lines().count() <= 5, "it says one thing of a column once: {}", answer.said);
    }
}

#[test]
fn a_log_that_is_no_such_csv_is_reported_with_what_to_write() {
    all_refuse("", &["wrong.csv, line 1", "the log is empty"]);
    all_refuse("time,bearing,z_error_um\n", &["there are no rows under the header"]);
    let with_commas = day(1).replace('.', ",");
    all_refuse(
        &with_commas,
        &[
            "cells (also in",
            "more lines), but there are 6 column names",
            "decimal commas, write decimal points",
        ],
    );
    let quoted: Vec<String> = (day(1).lines())
        .map(|line| {
            line.split(',')
                .map(|cell| format!("\"{}\"", cell.replace('.', ",")))
                .collect::<Vec<_>>()
                .join(",")
        })
        .collect();
    all_refuse(&quoted.join("\n"), &["wrong.csv, line", "has a decimal comma; state --decimal comma"]);
    let back = day(1).replace("\n6000,", "\n60,");
    all_refuse(&back, &["wrong.csv, line 102: the time of this row is earlier", "--run-column"]);
    all_refuse(&day(1).replace("time,", "when,"), &["there is no column time", "time_min"]);
}

#[test]
fn a_file_in_utf_16_is_read_as_one_in_utf_8() {
    let home = tempfile::tempdir().unwrap();
    let wide: Vec<u8> =
        std::iter::once(0xFEFF).chain(day(1).encode_utf16()).flat_map(u16::to_le_bytes).collect();
    std::fs::write(home.path().join("day.csv"), wide).unwrap();
    let wide = asked(home.path(), &["report", "day.csv"], &[], &[]);
    assert_eq!(wide.code, Some(0), "{}", wide.said);
    let plain = asked(home.path(), &["report"], &[("day.csv", day(1))], &[]);
    assert_eq!(wide.out, plain.out);
}

#[test]
fn a_copy_of_a_day_is_refused_where_a_model_is_tested() {
    let home = tempfile::tempdir().unwrap();
    let logs = [("one.csv", day(1)), ("two.csv", day(2)), ("two - Copy.csv", day(2))];
    for answer in [
        identify(home.path(), PROFILE, &logs, &[]),
        asked(home.path(), &["select", "--error", "z_error_um"], &logs, &[]),
    ] {
        assert_eq!(answer.code, Some(1), "{}", answer.said);
        assert!(answer.said.contains("contains the same rows as"), "{}", answer.said);
    }
    let report = asked(home.path(), &["report"], &logs, &[]);
    assert_eq!(report.code, Some(0), "{}", report.said);
    assert!(report.out.contains("contains the same rows as"), "{}", report.out);
}

#[test]
fn overloads_are_named_by_all_verbs_and_too_many_are_refused() {
    let home = tempfile::tempdir().unwrap();
    let overloaded = |every: usize| {
        let line = |(number, line): (usize, &str)| match line.rsplit_once(',') {
            Some((rest, _)) if number > 10 && number % every == 0 => format!("{rest},9.9E+37\n"),
            _ => format!("{line}\n"),
        };
        day(1).lines().enumerate().map(line).collect::<String>()
    };
    let answers = |every: usize| {
        let logs = [("one.csv", overloaded(every)), ("two.csv", day(2)), ("three.csv", day(3))];
        [
            identify(home.path(), PROFILE, &logs, &[]),
            asked(home.path(), &["select", "--error", "z_error_um"], &logs, &[]),
            asked(home.path(), &["report"], &logs, &[]),
        ]
    };
    for answer in answers(100) {
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        assert!(answer.out.contains("one.csv, line 101, column z_error_um: `9.9e37`"), "{}", answer.out);
    }
    for answer in answers(10) {
        assert_eq!(answer.code, Some(1), "{}", answer.out);
        assert!(answer.said.contains("more than 5 % of the values"), "{}", answer.said);
    }
}

#[test]
fn a_byte_order_mark_windows_line_ends_and_a_time_that_stands_twice_change_nothing() {
    let home = tempfile::tempdir().unwrap();
    let others = [("two.csv", day(2)), ("three.csv", day(3))];
    let reported = |first: String| {
        let logs = [&[("one.csv", first)], others.as_slice()].concat();
        let answer = identify(home.path(), PROFILE, &logs, &["--method", "ols"]);
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        answer.out
    };
    let plain = reported(day(1));
    assert_eq!(reported(format!("\u{feff}{}", day(1).replace('\n', "\r\n"))), plain);
    let line = day(1).lines().nth(100).unwrap().to_owned() + "\n";
    let twice = reported(day(1).replace(&line, &format!("{line}{line}")));
    assert_eq!(twice.lines().next(), plain.lines().next());
}

#[test]
fn files_that_are_not_there_directories_and_the_same_file_twice_are_reported() {
    let home = tempfile::tempdir().unwrap();
    file(home.path(), "plant.toml", PROFILE);
    let campaign = home.path().join("campaign");
    std::fs::create_dir_all(&campaign).unwrap();
    let said = |arguments: &[&str], code: i32| {
        let answer = asked(home.path(), arguments, &[], &[]);
        assert_eq!(answer.code, Some(code), "{arguments:?}: {}", answer.said);
        answer.said + &answer.out
    };
    assert!(said(&["report", "nowhere.csv"], 1).contains("nowhere.csv: there is no such file"));
    let bare = said(&["identify", "plant.toml", "campaign"], 1);
    assert!(
        bare.contains("campaign is a directory without a log") && bare.contains("isotherm record"),
        "{bare}"
    );
    for number in 1..=3 {
        file(&campaign, &format!("day-{number}.csv"), &day(number));
    }
    file(&campaign, "notes.txt", "not a log");
    let whole = said(&["identify", "plant.toml", "campaign"], 0);
    assert!(whole.contains("day-1") && whole.contains("day-3"), "{whole}");
    let twice = said(&["select", "--error", "z_error_um", "campaign", "campaign/day-2.csv"], 1);
    assert!(twice.contains("day-2.csv is named twice"), "{twice}");
    let swapped = said(&["identify", "campaign/day-1.csv", "campaign/day-2.csv"], 1);
    assert!(swapped.contains("is a log; give the machine's profile before the log"), "{swapped}");
    assert!(said(&["identify", "plant.toml", "campaign", "--method", "guess"], 2).contains("sparse-lag"));
    assert!(said(&["identify", "plant.toml", "campaign", "--terms", "0"], 2).contains("--terms"));
    assert!(
        said(&["identify", "plant.toml", "campaign", "--axis", "q"], 1)
            .contains("the profile has no axis `q`")
    );
}

#[test]
fn a_file_in_the_place_of_another_is_one_error_that_names_both_kinds() {
    let home = tempfile::tempdir().unwrap();
    let template =
        "title = \"ours\"\nsource = \"its manual\"\n[channel.t]\nregister = \"input:0\"\ntype = \"i16\"\n";
    let (one, two) = (day(1), day(2));
    for (name, text) in [
        ("machine.toml", PROFILE),
        ("module.toml", template),
        ("block.toml", "[[axis.z.model]]\nname = \"a\"\nkind = \"linear\"\n"),
        ("module.dbc", "VERSION \"\"\nBU_: A\nBO_ 2 Top: 8 A\n"),
        ("one.csv", one.as_str()),
        ("two.csv", two.as_str()),
    ] {
        file(home.path(), name, text);
    }
    let cases: [(&[&str], i32, &str); 13] = [
        (&["identify", "machine.toml", "machine.toml"], 1, "machine.toml: this is a profile, not a log"),
        (&["report", "module.dbc"], 1, "module.dbc: this is a DBC file, not a log"),
        (
            &["select", "--error", "z_error_um", "block.toml"],
            1,
            "block.toml: this is a model block, not a log",
        ),
        (
            &["identify", "machine.toml", "one.csv", "--error", "error", "--gauge", "module.toml"],
            1,
            "module.toml: this is a device template, not a log",
        ),
        (&["replay", "surface-grinder", "machine.toml"], 1, "machine.toml: this is a profile, not a log"),
        (&["replay", "one.csv", "machine.toml"], 64, "one.csv: this is a log, not a profile"),
        (&["check", "one.csv"], 64, "one.csv: this is a log, not a profile"),
        (&["check", "module.toml"], 64, "module.toml: this is a device template, not a profile"),
        (&["check", "block.toml"], 64, "block.toml: this is a model block, not a profile"),
        (&["virtual", "surface-grinder", "--faults", "one.csv"], 1, "this is a log, not a fault script"),
        (&["place", "machine.toml"], 1, "machine.toml: this is a profile, not the mesh or input file"),
        (&["place", "one.csv"], 1, "one.csv: this is a log, not the mesh or input file"),
        (
            &["identify", "machine.toml", "one.csv", "two.csv", "--prior", "module.toml"],
            1,
            "this is a device template, not a model block",
        ),
    ];
    for (arguments, code, words) in cases {
        let answer = asked(home.path(), arguments, &[], &[]);
        assert_eq!(answer.code, Some(code), "{arguments:?}: {}", answer.said);
        assert_eq!(answer.said.matches(words).count(), 1, "{arguments:?}: {}", answer.said);
        assert!(answer.said.lines().count() <= 4, "{arguments:?}: {}", answer.said);
    }
}

#[test]
fn what_cannot_be_learnt_from_is_reported_by_identify_and_select() {
    let home = tempfile::tempdir().unwrap();
    let of = |log: fn(u32) -> String| -> Logs { vec![("one.csv", log(1)), ("two.csv", log(2))] };
    let fahrenheit = |number: u32| {
        let mut rows = rows(number);
        rows.iter_mut().for_each(|row| row[1..4].iter_mut().for_each(|value| *value = *value * 1.8 + 32.0));
        written(&HEADER, &rows)
    };
    let cases: [(Logs, &[&str]); 5] = [
        (of(fahrenheit), &["°F", "(F − 32) / 1.8"]),
        (of(|number| with_column(number, 5, |_| 1.0)), &["z_error_um is constant in every run"]),
        (of(|number| with_column(number, 0, |second| second / 60.0)), &["--time-unit min"]),
        (of(|number| day(number).replace(",z_error_um", ",left_um")), &["z_error_um", "left_um"]),
        (
            vec![("one.csv", day(1)), ("two.csv", day(2).replace(",z_error_um", ",left_um"))],
            &["two has no number in the column z_error_um"],
        ),
    ];
    for (logs, words) in cases {
        for answer in [
            identify(home.path(), PROFILE, &logs, &[]),
            asked(home.path(), &["select", "--error", "z_error_um"], &logs, &[]),
        ] {
            assert_eq!(answer.code, Some(1), "{words:?}: {}", answer.said);
            assert!(words.iter().all(|word| answer.said.contains(word)), "{words:?}: {}", answer.said);
        }
    }
    let few = |number: u32| written(&HEADER, &rows(number).into_iter().step_by(150).collect::<Vec<_>>());
    let logs = [("one.csv", few(1)), ("two.csv", few(2))];
    let answer = identify(
        home.path(),
        PROFILE,
        &logs,
        &["--method", "ols", "--keep", "bearing,oil,post", "--time-unit", "s"],
    );
    assert!(answer.said.contains("terms cannot be identified from"), "{}", answer.said);
}

#[test]
fn one_run_gives_a_model_that_says_what_it_is_worth_and_nothing_to_select_from() {
    let home = tempfile::tempdir().unwrap();
    let logs = [("one.csv", day(1))];
    let answer = identify(home.path(), PROFILE, &logs, &[]);
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    assert!(answer.out.contains("no run could be held out"), "{}", answer.out);
    let answer = asked(home.path(), &["select", "--error", "z_error_um"], &logs, &[]);
    assert_eq!(answer.code, Some(1), "{}", answer.said);
    assert!(answer.said.contains("there is only one run, one") && answer.said.contains("Record another day"));
}

#[test]
fn logs_with_different_columns_are_taken_with_a_word() {
    let home = tempfile::tempdir().unwrap();
    let logs =
        [("one.csv", day(1).replace(",oil,", ",coolant,")), ("two.csv", day(2)), ("three.csv", day(3))];
    let answer = identify(home.path(), PROFILE, &logs, &[]);
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    assert!(answer.out.contains("one.csv has no column oil"), "{}", answer.out);
    assert!(
        answer.out.contains("because the profile has no signal with this name: coolant"),
        "{}",
        answer.out
    );
    let select = asked(home.path(), &["select", "--error", "z_error_um"], &logs, &[]);
    for answer in [answer, select] {
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        let note = answer.out.lines().find(|line| line.contains("The RMS error of held-out runs is"));
        assert!(
            note.is_some_and(|note| note.contains("left out: ") && note.contains("oil")),
            "{}",
            answer.out
        );
    }
}

#[test]
fn a_reader_who_goes_away_is_no_failure() {
    use std::process::Stdio;
    let home = tempfile::tempdir().unwrap();
    let logs: Vec<_> =
        (1..=4).map(|number| file(home.path(), &format!("{number}.csv"), &day(number))).collect();
    let mut report = isotherm(home.path());
    let mut report =
        report.arg("report").args(logs).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(report.stdout.take());
    let ended = report.wait_with_output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
}

#[test]
fn a_drift_report_refuses_times_of_an_unclear_unit_and_remarks_what_is_unusual() {
    let home = tempfile::tempdir().unwrap();
    let minutes = [("short.csv", with_column(1, 0, |second| second / 60.0))];
    let refused = asked(home.path(), &["report"], &minutes, &[]);
    assert_eq!(refused.code, Some(1), "{}", refused.out);
    for words in ["short lasts 4m 59s", "--time-unit min", "If the times are in seconds, add --time-unit s"] {
        assert!(refused.said.contains(words), "{words}: {}", refused.said);
    }
    let stated = asked(home.path(), &["report"], &minutes, &["--time-unit", "min"]);
    assert_eq!(stated.code, Some(0), "{}", stated.said);
    assert!(!stated.out.contains("lasts 4m 59s"), "{}", stated.out);
    let logs = [
        ("short.csv", with_column(1, 0, |second| second / 60.0).replace("time,", "time_s,")),
        ("long.csv", with_column(1, 0, |second| second).replace("time,", "time_min,")),
        ("still.csv", with_column(1, 5, |_| 0.25)),
    ];
    let answer = asked(home.path(), &["report"], &logs, &[]);
    assert_eq!(answer.code, Some(0), "{}", answer.said);
    for words in [
        "note: short lasts 4m 59s",
        "--time-unit min",
        "note: long lasts 12 days",
        "note: z_error_um is constant: was the probe connected?",
    ] {
        assert!(answer.out.contains(words), "{words}: {}", answer.out);
    }
}
