use std::time::Duration;

use proptest::prelude::*;

use super::*;
use crate::gateway::log::{Recorder, sample};
use isotherm_core::compensation::{Control, Measured, Permit, Remembered};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::{Reading, Reason};

use isotherm_core::compensation::model::{Expected, Growth};
use isotherm_core::compensation::settings::{Datum, Filter, GainSettings, OnWorse, ProbeSettings};

mod lags;
mod models;
mod replaced;

fn replayed(profile: &Profile, log: &str) -> (Summary, Vec<Vec<String>>) {
    let mut out = Vec::new();
    let summary = replay(profile, log.as_bytes(), "day.csv", Some(&mut out)).unwrap();
    let mut table = csv::ReaderBuilder::new().has_headers(false).from_reader(out.as_slice());
    let rows = table.records().map(|row| row.unwrap().iter().map(str::to_owned).collect());
    (summary, rows.collect())
}

fn column(table: &[Vec<String>], name: &str) -> Vec<String> {
    let place = table[0].iter().position(|header| header == name).expect(name);
    table[1..].iter().map(|row| row[place].clone()).collect()
}

fn numbers(table: &[Vec<String>], name: &str) -> Vec<f64> {
    column(table, name).iter().map(|text| text.parse().unwrap()).collect()
}

/// Temperatures of a machine that warms up.
fn warming(time: f64) -> (f64, f64) {
    (20.0 + 7.5 * (1.0 - (-time / 5400.0).exp()), 20.0 + 4.0 * (1.0 - (-time / 1800.0).exp()))
}

#[test]
fn the_models_value_stands_at_every_row_whatever_the_time_step() {
    let irregular = [0.3, 9.9, 0.1, 31.7, 1e-6, 120.0];
    for steps in [&[1.0][..], &[10.0], &[60.0], &irregular] {
        let (mut log, mut time, mut expected) = ("time,bed,wheelhead\n".to_owned(), 0.0, Vec::new());
        for step in steps.iter().cycle().take(600) {
            let (bed, wheelhead) = warming(time);
            log += &format!("{time},{bed},{wheelhead}\n");
            expected.push(2.4 * (bed - wheelhead));
            time += step;
        }
        let (summary, table) = replayed(&sample::profile(), &log);
        let raw = numbers(&table, "z_raw_um");
        assert_eq!((raw.len(), summary.rows), (600, 600));
        for (raw, expected) in raw.iter().zip(&expected) {
            assert!((raw - expected).abs() < 1e-6, "{steps:?}: {raw} {expected}");
        }
        let lags = summary.warnings.iter().any(|warning| warning.contains("update interval of axis z (10s)"));
        assert_eq!(lags, steps == [60.0], "{:?}", summary.warnings);
        for pair in numbers(&table, "z_cz_um").windows(2) {
            assert!((pair[1] - pair[0]).abs() <= 1.0 + 1e-9);
        }
    }
}

#[test]
fn machine_on_time_is_the_same_in_seconds_and_in_dates() {
    for (start, later) in [("0", "30000"), ("2026-01-31T08:00:00Z", "2026-01-31T16:20:00Z")] {
        let log = format!("time,bed,hydraulics_on\n{start},27.5,1\n{later},27.5,1\n");
        let (_, table) = replayed(&sample::profile(), &log);
        assert!((numbers(&table, "z_raw_um")[1] - 8.4).abs() < 1e-9);
        assert_eq!(column(&table, "z_model"), ["bed, only"; 2]);
        assert_eq!(column(&table, "time"), [start, later], "time is written as it was read");
    }
}

#[test]
fn the_columns_are_those_that_programs_expect() {
    let (_, table) =
        replayed(&sample::profile(), "time,bed,wheelhead,z_error_um\n0,25,20,-8.4\n10,25,,\n20,,,1\n");
    let wanted = "time,z_raw_um,z_cz_um,z_model,z_state,z_acted,z_residual_um,\
                  x_raw_um,x_cz_um,x_model,x_state,x_acted";
    assert_eq!(table[0].join(","), wanted);
    assert_eq!(table[1][..7].join(","), "0,12,1,difference,active,step,-7.4");
    assert_eq!(table[2][..7].join(","), "10,,1,,holding,,");
    assert_eq!(table[3][..7].join(","), "20,,1,,holding,,2");
}

#[test]
fn between_updates_cz_stands_while_the_model_moves() {
    let log = (0..=20).fold("time,bed,wheelhead\n".to_owned(), |log, time| {
        log + &format!("{time},{},24\n", 24.0 + f64::from(time) / 100.0)
    });
    let (_, table) = replayed(&sample::profile(), &log);
    let cz = numbers(&table, "z_cz_um");
    assert!(
        cz[..10].iter().all(|cz| *cz < 0.05) && (cz[10] - 0.2).abs() < 1e-9 && (cz[19] - cz[10]).abs() < 1e-9
    );
    assert!((numbers(&table, "z_raw_um")[7] - 0.168).abs() < 1e-9);
}

#[test]
fn the_summary_tells_the_error_before_and_after() {
    let mut log = "time,bed,wheelhead,z_error_um\n".to_owned();
    for row in 0..200u32 {
        let (bed, wheelhead) = warming(f64::from(row) * 10.0);
        log += &format!("{},{bed},{wheelhead},{}\n", row * 10, -2.4 * (bed - wheelhead));
    }
    let (summary, _) = replayed(&sample::profile(), &log);
    let axis = &summary.axes["z"];
    let error = axis.error.unwrap();
    assert_eq!((summary.rows, error.rows), (200, 200));
    assert!((summary.span_s - 1990.0).abs() < 1e-9);
    assert!(error.range_before_um > 1.0 && error.range_after_um < 0.5, "{error:?}");
    assert!(error.rms_after_um < error.rms_before_um);
    assert!((axis.states["active"] - 1.0).abs() < 1e-9);
    assert_eq!(axis.reproduced, None);
    assert!(summary.axes["x"].raw_um.is_none() && summary.axes["x"].error.is_none());
    let reported = summary.to_string();
    assert!(reported.contains("200 rows over 33m 10s") && reported.contains("active 100.0 %"), "{reported}");
    assert!(reported.contains("never usable"), "{reported}");
    let json = serde_json::to_value(&summary).unwrap();
    assert_eq!(json["axes"]["z"]["error"]["rows"], 200);
}

#[test]
fn a_log_without_rows_is_replayed_as_nothing() {
    let (summary, table) = replayed(&sample::profile(), "time,bed\n");
    assert_eq!((summary.rows, table.len()), (0, 1));
}

#[test]
fn the_text_has_the_warnings_of_the_json_document() {
    let (summary, _) = replayed(&sample::profile(), "time,bed\n0,25\n60,25\n120,25\n180,25\n");
    assert!(summary.warnings.len() > 1, "{:?}", summary.warnings);
    let text = summary.to_string();
    let said: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("warning: ")).collect();
    assert_eq!(said, summary.warnings, "{text}");
    assert_eq!(serde_json::to_value(&summary).unwrap()["warnings"], serde_json::json!(said));
}

/// One step of a random day: time since the step before, readings, controls of both axes, and commands.
#[derive(Clone, Debug)]
struct Event {
    nanos: i64,
    values: [Option<f64>; 4],
    controls: [(Permit, Option<f64>, Option<f64>); 2],
    /// Probing of the first axis (measured error, and the Cz that acted), and whether all corrections are discarded.
    probing: (Option<(f64, Option<f64>)>, bool),
    zero: bool,
    restart: bool,
    midnight: bool,
}

fn any_event() -> impl Strategy<Value = Event> {
    let nanos = prop_oneof![
        6 => 0..12_000_000_000i64,
        1 => Just(10_000_000_000i64),
        1 => 0..40_000_000_000_000i64,
        1 => -3_000_000_000_000..0i64
    ];
    let value = || prop::option::weighted(0.9, 15.0..45.0f64);
    let level = || prop::option::weighted(0.9, prop_oneof![4 => Just(0.0), 1 => Just(1.0)]);
    let permit = prop_oneof![
        8 => Just(Permit::Armed), 1 => Just(Permit::Off), 1 => Just(Permit::Unverified), 1 => Just(Permit::Stopping)
    ];
    let found = prop::option::weighted(0.1, -50.0..50.0f64);
    let control = (permit, found.clone(), found);
    let values = (value(), value(), level(), level()).prop_map(|(a, b, on, zero)| [a, b, on, zero]);
    let commands = (prop::bool::weighted(0.05), prop::bool::weighted(0.03), prop::bool::weighted(0.05));
    let acting = prop::option::weighted(0.8, -40.0..40.0f64);
    let probing = (prop::option::weighted(0.15, (-30.0..30.0f64, acting)), prop::bool::weighted(0.05));
    (nanos, values, [control.clone(), control], probing, commands).prop_map(
        |(nanos, values, controls, probing, (zero, restart, midnight))| Event {
            nanos,
            values,
            controls,
            probing,
            zero,
            restart,
            midnight,
        },
    )
}

/// Returns the log files of some days, one for each day. A row is written only if a step did anything, as the gateway
/// does.
fn logs_of(profile: &Profile, days: &[Event]) -> Vec<String> {
    let axes = || profile.axes.iter().map(|axis| axis.settings.clone()).collect();
    let mut compensation = Compensation::new(profile.machine.clone(), axes(), Remembered::default());
    let mut recorder = Recorder::new(profile);
    let mut logs = vec![Recorder::header(profile)];
    let mut nanos = 1_700_000_000_000_000_000u64;
    recorder.begin(&compensation.remembered());
    for event in days {
        nanos = nanos.saturating_add_signed(event.nanos);
        let now = Moment::from_nanos(nanos);
        if event.restart {
            compensation = Compensation::new(profile.machine.clone(), axes(), compensation.remembered());
            recorder.begin(&compensation.remembered());
        }
        if event.zero {
            let asked = Moment::from_nanos(nanos - 1);
            // Of the machine, or of one axis, where it counts from signals of its own.
            let only = nanos.is_multiple_of(2).then_some(0);
            if only.is_none_or(|axis| compensation.zero_axis(axis, asked)) {
                if only.is_none() {
                    compensation.zero(asked);
                }
                recorder.zeroed(asked, only);
            }
        }
        let reading = |value: Option<f64>| {
            value.map_or(Reading::bad(now, Reason::Timeout), |value| Reading::good(value, now))
        };
        let readings = event.values.map(reading);
        let mut controls = event.controls.map(|(permit, found, sign)| Control {
            permit,
            take_over: found.and_then(Micron::new),
            take_over_slope: found.and_then(|found| Micron::new(-0.5 * found)),
            sign: sign.and_then(Micron::new),
            ..Control::default()
        });
        if profile.axes[0].settings.probe.is_some() {
            let micron = |value| Micron::new(value).unwrap();
            let measured = |(error, acting): (f64, Option<f64>)| Measured {
                error: micron(error),
                acting: acting.map(micron),
            };
            (controls[0].measured, controls[0].forget) = (event.probing.0.map(measured), event.probing.1);
        }
        let snapshot = Snapshot::new(now, &readings);
        let running = event.midnight.then(|| compensation.running());
        if compensation.step(&snapshot, &controls).anything {
            if let Some(running) = running {
                recorder.begin(&running);
                logs.push(Recorder::header(profile));
            }
            let row = recorder.row(&snapshot, &controls, compensation.decisions());
            logs.last_mut().unwrap().push_str(std::str::from_utf8(row).unwrap());
        }
    }
    logs
}

/// Checks that each file of these days, replayed alone, gives the decisions of the log and these columns again.
fn come_out_again(profile: &Profile, days: &[Event], columns: &[String]) -> Result<(), TestCaseError> {
    for log in logs_of(profile, days) {
        let (summary, table) = replayed(profile, &log);
        for (name, axis) in &summary.axes {
            let (rows, first) =
                axis.reproduced.as_ref().map_or((0, None), |found| (found.rows, found.first.as_ref()));
            prop_assert_eq!((rows, first), (summary.rows, None), "{}", name);
        }
        let mut recorded = csv::ReaderBuilder::new().has_headers(false).from_reader(log.as_bytes());
        let recorded: Vec<Vec<String>> =
            recorded.records().map(|row| row.unwrap().iter().map(str::to_owned).collect()).collect();
        for name in columns {
            prop_assert_eq!(column(&table, name), column(&recorded, name), "{}", name);
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn each_file_of_a_log_replayed_alone_gives_its_decisions_bit_for_bit(
        days in prop::collection::vec(any_event(), 1..150),
    ) {
        let profile = sample::profile();
        let names = ["raw_um", "cz_um", "model", "state", "acted"];
        let columns = ["z", "x"].map(|axis| names.map(|name| format!("{axis}_{name}"))).concat();
        come_out_again(&profile, &days, &columns)?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn what_probings_teach_comes_out_of_each_file_bit_for_bit(
        is_weighed: bool,
        ramps: bool,
        days in prop::collection::vec(any_event(), 1..150),
    ) {
        let weighed = Filter::Weighed { repeat: 2.0, walk: 40.0 };
        let mut profile = sample::profile();
        profile.axes[0].settings.datum = Datum::Zero;
        profile.axes[0].settings.probe = Some(ProbeSettings {
            limit: Micron::new(10.0).unwrap(),
            filter: if is_weighed { weighed } else { Filter::Share(0.3) },
            max_error: Micron::new(60.0).unwrap(),
            warn: None,
            gains: Some(GainSettings { forgetting: 0.97, limit: 0.2 }),
            worse: if ramps { OnWorse::Ramp } else { OnWorse::Warn },
        });
        for (place, model) in profile.axes[0].settings.models.iter_mut().enumerate() {
            let growth = |size: f64| Growth::new(0.9 * size, 0.1).unwrap();
            let (since_datum, since_touch) = (growth(1.0), (place == 0).then(|| growth(0.7)));
            model.expected = Some(Expected { since_datum, since_touch });
        }
        come_out_again(&profile, &days, &["raw_um", "cz_um", "expected_um"].map(|name| format!("z_{name}")))?;
    }
}

#[test]
fn a_log_from_elsewhere_may_have_probings() {
    let mut profile = sample::profile();
    let um = |value| Micron::new(value).unwrap();
    let filter = Filter::Share(1.0);
    let (max_error, worse) = (um(60.0), OnWorse::Warn);
    let probe = ProbeSettings { limit: um(10.0), filter, max_error, warn: None, gains: None, worse };
    profile.axes[0].settings.probe = Some(probe);
    // Cz is 12 µm: at row 20 s, 1 µm acts, and 3 µm more than the model knows are missing.
    let log = "time,bed,wheelhead,z_measured_um,z_acting_um\n0,25,20,,\n10,25,20,,\n20,25,20,-14,1\n30,25,20,,\n\
               40,25,20,-15,\n50,25,20,,\n";
    let (_, table) = replayed(&profile, log);
    let raw = numbers(&table, "z_raw_um");
    assert_eq!(raw[..4], [12.0, 12.0, 15.0, 15.0]);
    // Cz as it was decided last acts, 4 µm: 19 are wanted.
    assert!((raw[4] - 19.0).abs() < 1e-9, "{raw:?}");
}

#[test]
fn a_decision_that_does_not_come_out_again_is_reported_with_its_line() {
    let profile = sample::profile();
    let event = Event {
        nanos: 10_000_000_000,
        values: [Some(27.5), Some(24.0), Some(1.0), Some(0.0)],
        controls: [(Permit::Armed, None, None); 2],
        probing: (None, false),
        zero: false,
        restart: false,
        midnight: false,
    };
    let log = logs_of(&profile, &vec![event; 30]).remove(0);
    let mut other = profile.clone();
    other.axes[0].settings.guard.step = Micron::new(0.5).unwrap();
    other.axes[0].settings.every = Duration::from_secs(10);
    let (summary, _) = replayed(&other, &log);
    let reproduced = summary.axes["z"].reproduced.clone().unwrap();
    let first = reproduced.first.unwrap();
    assert_eq!((first.line, first.column.as_str()), (2, "z_cz_um"));
    assert_eq!((first.recorded.as_str(), first.replayed.as_str()), ("1", "0.5"));
    assert!(reproduced.differing > 10);
    assert_eq!(summary.axes["x"].reproduced.as_ref().unwrap().differing, 0);
    assert!(summary.to_string().contains("first in line 2: z_cz_um is `1` in the log, `0.5` in the replay"));
}
