//! Wrong input is rejected with a message that says what to do.

use isotherm_identify::setup::Choice;

use super::rig::{Machine, Part, choice, refused};

fn logs() -> Vec<String> {
    let parts = [Part { sensor: 0, gain: 3.0, constant: 0.0 }];
    let machine = Machine { sensors: 2, parts: parts.to_vec(), step: 60.0, rows: 300, noise: 0.1 };
    (0..3).map(|seed| machine.day(seed).log()).collect()
}

fn each(change: impl Fn(&str) -> String) -> Vec<String> {
    logs().iter().map(|log| change(log)).collect()
}

#[track_caller]
fn says(reported: &str, parts: &[&str]) {
    for part in parts {
        assert!(reported.contains(part), "`{part}` is not in: {reported}");
    }
}

/// Log with a function applied to every cell of a column.
fn cells(log: &str, column: usize, change: impl Fn(f64) -> f64) -> String {
    let mut lines = log.lines();
    let mut text = lines.next().unwrap().to_owned() + "\n";
    for line in lines {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        cells[column] = change(cells[column].parse().unwrap()).to_string();
        text += &(cells.join(",") + "\n");
    }
    text
}

#[test]
fn an_error_column_that_is_not_there_is_answered_with_the_nearest() {
    let choice = Choice { error: Some("z_eror_um".to_owned()), ..choice() };
    says(
        &refused(2, &logs(), &choice),
        &["no log has a column `z_eror_um`", "did you mean `z_error_um`?", "--error"],
    );
}

#[test]
fn fahrenheit_is_recognised_by_its_numbers() {
    let logs = each(|log| cells(&cells(log, 1, |c| c * 1.8 + 32.0), 2, |c| c * 1.8 + 32.0));
    says(&refused(2, &logs, &choice()), &["°F", "(F − 32) / 1.8"]);
}

#[test]
fn minutes_that_are_called_seconds_and_seconds_that_are_called_minutes_are_reported() {
    let logs_of_minutes = each(|log| cells(log, 0, |time| time / 60.0));
    says(&refused(2, &logs_of_minutes, &choice()), &["day0 lasts 4m 59s (300 rows)", "--time-unit min"]);
    let longer = logs()
        .iter()
        .map(|log| log.replace("time,", "time_min,").replace("\n60,", "\n2700000,"))
        .collect::<Vec<_>>();
    says(&refused(2, &longer, &choice()), &["line 4: the time of this row is earlier"]);
    let seconds = each(|log| cells(log, 0, |time| time * 3.0).replace("time,", "time_min,"));
    says(&refused(2, &seconds, &choice()), &["state this unit with --time-unit"]);
}

#[test]
fn an_error_that_stands_still_or_is_in_millimetres_is_reported() {
    says(
        &refused(2, &each(|log| cells(log, 3, |_| 0.25)), &choice()),
        &["z_error_um is constant in every run"],
    );
    says(
        &refused(2, &each(|log| cells(log, 3, |um| um / 1000.0)), &choice()),
        &["the values are probably in mm; write them in µm"],
    );
}

#[test]
fn cells_that_are_no_numbers_are_reported_with_file_line_and_column_all_at_once() {
    let mut logs = logs();
    logs[0] = logs[0]
        .lines()
        .enumerate()
        .map(|(number, line)| {
            let line = if number == 6 { line.replacen(',', ",oops", 1) } else { line.to_owned() };
            line + "\n"
        })
        .collect();
    logs[1] = logs[1].replace("s1", "s0");
    logs[2] = logs[2].replace("\n180,", "\nnoon,");
    let reported = refused(2, &logs, &choice());
    says(&reported, &["day0.csv, line 7, column s0: `oops", "is not a number; leave the cell empty"]);
    says(&reported, &["day1.csv, line 1: the column s0 occurs twice"]);
    says(&reported, &["day2.csv, line 5, column time: `noon` is not a time"]);
}

#[test]
fn names_that_do_not_match_are_reported_from_both_files() {
    let logs = each(|log| log.replace("s0", "bed").replace("s1", "column"));
    says(
        &refused(2, &logs, &choice()),
        &["no temperature of the profile (s0, s1)", "(bed, column, z_error_um)"],
    );
}

#[test]
fn an_axis_or_an_input_that_is_not_there_is_reported() {
    let wrong = Choice { axis: Some("y".to_owned()), inputs: vec!["s7".to_owned()], ..choice() };
    says(
        &refused(2, &logs(), &wrong),
        &["the profile has no axis `y`; there are z", "the profile has no signal `s7`"],
    );
}

#[test]
fn fewer_rows_than_terms_are_reported_with_what_to_do() {
    // Five rows, six minutes apart, in each of two days; twelve sensors.
    let machine = Machine {
        sensors: 12,
        parts: vec![Part { sensor: 0, gain: 3.0, constant: 0.0 }],
        step: 360.0,
        rows: 5,
        noise: 0.1,
    };
    let days: Vec<String> = (0..2).map(|seed| machine.day(seed).log()).collect();
    let dataset = super::rig::dataset(&days).unwrap();
    let every: Vec<String> = (0..12).map(|place| format!("s{place}")).collect();
    let profile = super::rig::profile(12);
    let ready =
        isotherm_identify::setup::ready(&profile, &dataset, &Choice { keep: every, ..choice() }).unwrap();
    let settings = isotherm_identify::method::Settings {
        method: isotherm_identify::method::Method::Ols,
        ..Default::default()
    };
    let reported = isotherm_identify::identify(&ready, &settings, None, false, &|_, _| {}).unwrap_err();
    says(&reported, &["12 terms cannot be identified from the 5 rows", "--inputs", "--method sparse-lag"]);
}
