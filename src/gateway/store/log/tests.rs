pub(crate) mod sample;

use proptest::prelude::*;

use super::*;
use isotherm_core::compensation::{Compensation, Control, Permit, Remembered, Snapshot};
use isotherm_core::quantity::{Micron, Moment, time};
use isotherm_core::reading::{Quality, Reading, Reason};
use isotherm_profile::{DefaultLimits, DefaultRange};

fn rows(log: &str) -> Result<(Vec<LogRow>, Vec<String>), LogError> {
    let mut reader = LogReader::open(&sample::profile(), log.as_bytes(), ("day.csv", None))?;
    let mut rows = Vec::new();
    while let Some(row) = reader.next_row()? {
        rows.push(row);
    }
    Ok((rows, reader.warnings().to_vec()))
}

fn refused(log: &str) -> String {
    rows(log).expect_err("it is refused").to_string()
}

#[test]
fn seconds_and_dates_are_exact_to_the_nanosecond() {
    for (text, nanos) in [
        ("0", 0),
        ("12", 12_000_000_000),
        (" 12.5 ", 12_500_000_000),
        ("0.1", 100_000_000),
        ("0.30000000000000004", 300_000_000),
        ("1e-9", 1),
        ("+.5", 500_000_000),
        ("5.", 5_000_000_000),
        ("1.7e9", 1_700_000_000_000_000_000),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("1e-400", 0),
        ("0e400", 0),
        ("2023-11-14T22:13:20.123456789Z", 1_700_000_000_123_456_789),
        ("2023-11-14T23:13:20+01:00", 1_700_000_000_000_000_000),
        ("2023-11-14 22:13:20Z", 1_700_000_000_000_000_000),
    ] {
        assert_eq!(time::parse(text), Ok(Moment::from_nanos(nanos)), "{text}");
    }
    for text in [
        "",
        "noon",
        "-3",
        "1e99",
        "nan",
        "inf",
        "1.2.3",
        "1_000",
        "12,5",
        ".",
        "e5",
        "2023-11-14T22:13:20",
        "1969-01-01T00:00:00Z",
    ] {
        assert!(time::parse(text).is_err(), "{text}");
    }
}

#[test]
fn a_log_from_elsewhere_needs_only_time_and_a_signal() {
    let (rows, warnings) = rows("\u{feff}time, bed ,z_error_um\n0,27.5,-8\n10,,\n").unwrap();
    assert_eq!(
        warnings,
        ["day.csv: these signals are not in the log: wheelhead, hydraulics_on, zero_button"]
    );
    assert_eq!(rows[0].readings[0].usable(), Some(27.5));
    assert_eq!(rows[0].readings[1].quality, Quality::Bad(Reason::NotInLog));
    assert_eq!(rows[1].readings[0].quality, Quality::Bad(Reason::NotInLog));
    assert_eq!(rows[0].errors, [Some(-8.0), None]);
    assert_eq!((rows[1].errors[0], rows[1].line, rows[1].time.as_str()), (None, 3, "10"));
    let armed = |take_over| Control { permit: Permit::Armed, take_over, ..Control::default() };
    assert_eq!(rows[0].controls, [armed(Some(Micron::ZERO)); 2]);
    assert_eq!(rows[1].controls, [armed(None); 2]);
    assert_eq!(rows[0].decided, [None, None]);
}

#[test]
fn values_the_gateway_would_refuse_are_refused() {
    let (rows, _) = rows("time,bed,wheelhead\n0,-32.0,NaN\n1,101,inf\n").unwrap();
    let reasons: Vec<_> = rows.iter().flat_map(|row| &row.readings[..2]).map(|r| r.quality).collect();
    let (out, nan) = (Quality::Bad(Reason::OutOfRange), Quality::Bad(Reason::NotANumber));
    assert_eq!(reasons, [out, nan, out, nan]);
}

/// A log of an earlier version contains values that its gateway accepted without default limits. The same decisions need
/// the same values.
#[test]
fn default_limits_are_not_applied_to_a_log() {
    let mut profile = sample::profile();
    profile.signals[0].range = None;
    let range = Some(DefaultRange::Within(-40.0, 200.0));
    profile.signals[0].defaults = DefaultLimits { range, max_rate: Some(5.0) };
    let log = "time,bed\n0,-3276.8\n1,1e30\n2,20\n";
    let mut reader = LogReader::open(&profile, log.as_bytes(), ("day.csv", None)).unwrap();
    for value in [-3276.8, 1e30, 20.0] {
        assert_eq!(reader.next_row().unwrap().unwrap().readings[0].usable(), Some(value));
    }
}

#[test]
fn cells_and_times_of_loggers_are_read_as_identify_reads_them() {
    for log in [
        "time,bed\n0,20.5\n60,OL\n120,21\n",
        "Zeit;bed\n0;20,5 °C\n60;---\n120;21 °C\n",
        "Zeit;bed\n0,5;20,5\n60,5;OL\n120,5;21\n",
        "time_min,bed\n0,+   20.5\n1,1.#QNAN\n2,2.1D+01\n",
        "time,bed [°F]\n0,68.9\n60,Err\n120,69.8\n",
        "time,bed\n0,68.9 °F\n60,OL\n120,69.8 °F\n",
        "Zeit [min];bed [K]\n0;293,65\n1;Burnout\n2;294,15\n",
        "Date,Time,bed\n05.01.2026,06:00:00,20.5\n05.01.2026,06:01:00,Over\n05.01.2026,06:02:00,21\n",
    ] {
        let zone = Some(jiff::tz::TimeZone::UTC);
        let mut reader = LogReader::open(&sample::profile(), log.as_bytes(), ("day.csv", zone)).unwrap();
        let mut rows = Vec::new();
        while let Some(row) = reader.next_row().unwrap_or_else(|wrong| panic!("{log}: {wrong}")) {
            rows.push((row.now, row.readings[0].usable()));
        }
        let values: Vec<Option<f64>> =
            rows.iter().map(|(_, value)| value.map(|value| (value * 1e6).round() / 1e6)).collect();
        assert_eq!(values, [Some(20.5), None, Some(21.0)], "{log}");
        assert_eq!(rows[2].0.since(rows[0].0), std::time::Duration::from_secs(120), "{log}");
    }
}

#[test]
fn what_cannot_be_read_is_named_with_its_place() {
    for (log, words) in [
        ("", "line 1: the log is empty"),
        ("when,bed\n0,1\n", "there is no column time; the columns are when, bed"),
        ("time,bed\n0,\"1,020\"\n", "line 2, column bed: `1,020` can be 1020 or 1.020"),
        ("time;bed\n0;1,5\n5;1.5\n", "line 3, column bed: `1.5` and `1,5`"),
        ("time,oil\n0,1\n", "none of the profile's signals is in the log: bed,"),
        ("time,bed,bed\n0,1,1\n", "the column bed occurs twice"),
        (
            "time,bed\n0,1\n5,\"27,5\"\n",
            "day.csv, line 3, column bed: `27,5` has a decimal comma; state --decimal comma, or write 27.5",
        ),
        (
            "time,bed\n0,27,5\n",
            "line 2: the row has 3 cells, but the header has 2 column names; are there decimal commas?",
        ),
        ("time,bed\n0,1\n5,warm\n", "line 3, column bed: `warm` is not a number"),
        ("time,bed\r\n\r\n\r\n0,1\r\n5,warm", "line 5, column bed: `warm` is not a number"),
        ("time,bed\n0,1\nnoon,1\n", "line 3, column time: `noon` is not a time"),
        ("time,bed\n,1\n", "line 2, column time: the time is missing"),
        ("time,bed,wheelhead\n0,1\n5,1,1\n", "line 2: the row has 2 cells, but the header has 3"),
        ("time,bed,z_permit\n0,1,maybe\n", "line 2, column z_permit: `maybe` is not one of off, armed"),
        ("time,bed,machine_memory\n0,1,{\n", "line 2, column machine_memory"),
    ] {
        let message = refused(log);
        assert!(message.contains(words), "{log:?}: {message}");
    }
    let latin: &[u8] = b"time,bed\n0,1\n5,27\xb0\n";
    let mut reader = LogReader::open(&sample::profile(), latin, ("day.csv", None)).unwrap();
    reader.next_row().unwrap();
    assert!(reader.next_row().unwrap_err().to_string().contains("line 3: this is not text in UTF-8"));
}

#[test]
fn the_text_of_a_time_counts_seconds() {
    for (log, times) in [
        ("time_min,bed\n0.5,1\n1.5,1\n", ["30", "90"]),
        ("time,bed\n 0.50,1\n1.5,1\n", ["0.50", "1.5"]),
        ("time;bed\n0,5;1\n1,25;1\n", ["0.5", "1.25"]),
        ("time_ms,bed\n1500,1\n1773036000000,1\n", ["1.5", "2026-03-09T06:00:00.000000000Z"]),
        ("time,bed\n00:00:10,1\n00:01:10,1\n", ["00:00:10", "00:01:10"]),
    ] {
        let (rows, _) = rows(log).unwrap();
        assert_eq!([rows[0].time.as_str(), rows[1].time.as_str()], times, "{log}");
    }
}

#[test]
fn empty_cells_may_be_more_than_the_names_and_those_of_comments_may_be_missing() {
    let (read, _) = rows("time;bed\n0;20,5;;\n60;21;\n").unwrap();
    assert_eq!(read.len(), 2);
    let (read, _) = rows("time,bed,Comment\n0,20\n60,21,door open\n120,22\n").unwrap();
    assert_eq!(read.len(), 3);
    assert!(refused("time,bed,wheelhead\n0,20\n60,21,22\n").contains("line 2: the row has 2 cells"));
}

#[test]
fn an_error_that_no_machine_has_is_left_out_with_its_line() {
    let (read, warnings) = rows("time,bed,z_error_um\n0,20,1.5\n60,20,9.9E+37\n120,20,2.5\n").unwrap();
    let errors: Vec<Option<f64>> = read.iter().map(|row| row.errors[0]).collect();
    assert_eq!(errors, [Some(1.5), None, Some(2.5)]);
    assert!(
        warnings.iter().any(|warning| warning.contains("line 3: an error of 9.9e37 µm is not a measured")),
        "{warnings:?}"
    );
}

#[test]
fn errors_in_the_lines_of_implausible_values_are_left_out() {
    let log = "time,bed,z_error_um\n0,20,1.5\n60,20,999.9\n120,20,2.5\n";
    let implausible = [("z_error_um".to_owned(), vec![3])].into_iter().collect();
    let remarks = vec!["day.csv, line 3: left out".to_owned()];
    let recording = Recording { name: "day.csv", implausible, remarks, ..Recording::default() };
    let mut reader = LogReader::open(&sample::profile(), log.as_bytes(), recording).unwrap();
    let mut errors = Vec::new();
    while let Some(row) = reader.next_row().unwrap() {
        errors.push(row.errors[0]);
    }
    assert_eq!(errors, [Some(1.5), None, Some(2.5)]);
    assert_eq!(reader.warnings()[0], "day.csv, line 3: left out");
}

#[test]
fn time_that_runs_back_is_a_warning_with_its_line() {
    let (rows, warnings) =
        rows("time,bed,wheelhead,hydraulics_on,zero_button\n10,1,,,\n5,1,,,\n6,1,,,\n").unwrap();
    assert_eq!(rows.len(), 3);
    assert_eq!(warnings, ["day.csv, line 3: the time goes back to 5"]);
}

#[test]
fn a_clock_that_runs_wild_does_not_drown_the_reader_in_warnings() {
    let log = (0..1000).rev().fold("time,bed\n".to_owned(), |log, time| log + &format!("{time},1\n"));
    let (_, warnings) = rows(&log).unwrap();
    assert_eq!(warnings.len(), 20);
}

#[test]
fn a_last_row_that_was_cut_off_is_left_out() {
    let (rows, warnings) = rows("time,bed,wheelhead,hydraulics_on,zero_button\n0,1,2,0,0\n10,1").unwrap();
    assert_eq!(rows.len(), 1);
    assert_eq!(warnings, ["day.csv, line 3: the last row is incomplete and is left out"]);
}

#[test]
fn a_recorded_row_reads_as_what_was_recorded() {
    let profile = sample::profile();
    let axes = profile.axes.iter().map(|axis| axis.settings.clone()).collect();
    let mut compensation = Compensation::new(profile.machine.clone(), axes, Remembered::default());
    let mut recorder = Recorder::new(&profile);
    recorder.begin(&compensation.remembered());
    recorder.zeroed(Moment::from_nanos(41), None);
    recorder.zeroed(Moment::from_nanos(43), Some(1));
    let now = Moment::from_nanos(1_700_000_000_000_000_007);
    let readings = [
        Reading::good(27.1 + 0.2, now),
        Reading::bad(now, Reason::Timeout),
        Reading::good(1.0, now),
        Reading::good(-0.0, now),
    ];
    let controls = [
        Control { permit: Permit::Armed, take_over: Micron::new(0.1 + 0.2), ..Control::default() },
        Control { permit: Permit::Unverified, ..Control::default() },
    ];
    let snapshot = Snapshot::new(now, &readings);
    compensation.step(&snapshot, &controls);
    let mut log = Recorder::header(&profile).into_bytes();
    log.extend_from_slice(recorder.row(&snapshot, &controls, compensation.decisions()));
    let log = String::from_utf8(log).unwrap();
    // Each row of a dry run is marked.
    let mut dry = recorder.clone().of_dry_run(true);
    assert!(Recorder::dry_header(&profile).ends_with(",machine_zero,machine_clock,machine_dry_run\n"));
    assert!(dry.row(&snapshot, &controls, compensation.decisions()).ends_with(b",,,1\n"));
    assert!(log.contains("2023-11-14T22:13:20.000000007Z,27.3,,1,-0,armed,0.30000000000000004,"), "{log}");

    let (rows, warnings) = rows(&log).unwrap();
    let row = &rows[0];
    assert!(warnings.is_empty());
    assert_eq!(
        (row.now, row.zeroed.as_slice(), row.controls.as_slice()),
        (now, &[(Moment::from_nanos(41), None), (Moment::from_nanos(43), Some(1))][..], &controls[..])
    );
    assert_eq!(row.begins, Some(Remembered::default()));
    let usable =
        |readings: &[Reading]| readings.iter().map(|r| r.usable().map(f64::to_bits)).collect::<Vec<_>>();
    assert_eq!(usable(&row.readings), usable(&readings));
    let (decided, decision) = (row.decided[0].as_ref().unwrap(), compensation.decision(0).unwrap());
    assert_eq!((decided.raw, decided.cz), (decision.raw.map(Micron::get), decision.cz.get()));
    assert_eq!((decided.model.as_str(), decided.state.as_str()), ("bed, only", "degraded"));
    assert_eq!(decided.acted, decision.acted.to_string());

    let second =
        String::from_utf8(recorder.row(&snapshot, &controls, compensation.decisions()).to_vec()).unwrap();
    assert!(second.ends_with(",,\n"), "a run begins once: {second}");
}

proptest! {
    #[test]
    fn every_number_reads_back_as_itself(bits: u64) {
        let value = f64::from_bits(bits);
        prop_assume!(value.is_finite());
        let mut text = Vec::new();
        number(&mut text, value);
        let text = String::from_utf8(text).unwrap();
        prop_assert_eq!(text.parse::<f64>().unwrap().to_bits(), bits);
        prop_assert!(text.len() < 26, "{}", text);
    }

    #[test]
    fn every_moment_reads_back_as_itself(nanos: u64) {
        let mut text = Vec::new();
        time::write(&mut text, Moment::from_nanos(nanos));
        prop_assert_eq!(time::parse(std::str::from_utf8(&text).unwrap()), Ok(Moment::from_nanos(nanos)));
    }

    #[test]
    fn no_text_makes_the_reader_panic(log in "(time|bed|z_permit|[0-9]|[-,.;\"e: T\n]){0,80}") {
        let _ = rows(&log);
    }
}
