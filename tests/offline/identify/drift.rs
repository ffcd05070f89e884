//! Results of `isotherm report` for logs with known drift.

use isotherm_identify::dataset::{Dataset, Split, every_column};
use isotherm_identify::drift::{Drift, Test, drift};

/// Log with one row per minute.
fn log(columns: &str, minutes: usize, row: impl Fn(f64) -> String) -> String {
    let rows: String = (0..minutes).map(|minute| format!("{minute},{}\n", row(minute as f64))).collect();
    format!("time_min,{columns}\n{rows}")
}

fn dataset(text: &str) -> Dataset {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("night.csv");
    std::fs::write(&path, text).unwrap();
    Dataset::read(&[path], &Split::default(), &|_| None, &every_column).unwrap()
}

fn reported(text: &str, test: Option<Test>) -> Drift {
    drift(&dataset(text), &[], test, &|_| None).unwrap_or_else(|wrong| panic!("{wrong}")).remove(0)
}

fn near(one: f64, other: f64) -> bool {
    (one - other).abs() < 1e-9
}

#[test]
fn a_night_in_which_nothing_moves_is_an_etve_test() {
    // Six hours with 1 µm/h, and 12 µm in addition within half an hour after the third hour.
    let text = log("hall_c,y_um", 361, |minute| {
        let step = ((minute - 180.0) / 30.0).clamp(0.0, 1.0);
        format!("{},{}", 20.0 + 0.01 * minute, minute / 60.0 + 12.0 * step)
    });
    let drift = reported(&text, None);
    assert_eq!(drift.test, Test::Etve);
    assert!(near(drift.hours, 6.0) && drift.rows == 361 && drift.stages.is_empty(), "{drift:?}");
    let y = &drift.displacements[0];
    assert!(near(y.range_um, 18.0) && near(y.first_hour_um.unwrap(), 1.0), "{y:?}");
    assert!(near(y.last_hour_um.unwrap(), 1.0) && near(y.largest_60min_um.unwrap(), 13.0), "{y:?}");
    assert!(near(y.largest_60min_from_h.unwrap(), 2.5), "{y:?}");
    // From the mean of the first three minutes to that of the last three.
    assert!(
        near(y.drift_um, 18.0 - 2.0 / 60.0) && near(y.drift_um_per_h * (358.0 / 60.0), y.drift_um),
        "{y:?}"
    );
    let hall = &drift.temperatures[0];
    assert!(near(hall.range_k, 3.6) && near(hall.largest_60min_k.unwrap(), 0.6), "{hall:?}");
    assert!(near(hall.begin_c, 20.01) && near(hall.end_c, 23.59), "{hall:?}");
}

#[test]
fn a_spindle_that_turns_makes_stages_with_what_each_of_them_moved() {
    let speed = |minute: f64| match minute {
        _ if (60.0..120.0).contains(&minute) => 3000.0,
        _ if (120.0..180.0).contains(&minute) => 6000.0,
        _ => 0.0,
    };
    let text = log("bearing_c,spindle_rpm,z_um", 240, |minute| {
        let wander = if speed(minute) > 0.0 { 3.0 * (minute * 1.7).sin() } else { 0.0 };
        format!("21,{},{}", speed(minute) + wander, 0.1 * minute)
    });
    let drift = reported(&text, None);
    assert_eq!(drift.test, Test::Spindle);
    let stages: Vec<(f64, f64, f64)> = (drift.stages.iter())
        .map(|stage| (stage.from_h * 60.0, stage.to_h * 60.0, stage.speed.unwrap().round()))
        .collect();
    assert_eq!(stages.len(), 4, "{stages:?}");
    for (number, (from, to, speed)) in stages.iter().enumerate() {
        let begin = 60.0 * number as f64;
        assert!(near(*from, begin) && near(*to, begin + 59.0), "{stages:?}");
        assert!((speed - [0.0, 3000.0, 6000.0, 0.0][number]).abs() < 4.0, "{stages:?}");
        assert!(near(drift.displacements[0].stages_um[number].unwrap(), 5.9), "{drift:?}");
    }
}

#[test]
fn a_moving_axis_and_a_turning_table_are_known_by_their_positions() {
    let moving = |minute: f64| if minute < 60.0 { 100.0 * (minute % 2.0) } else { 0.0 };
    let axis = reported(&log("scale_mm,z_um", 120, |minute| format!("{},{minute}", moving(minute))), None);
    assert_eq!(axis.test, Test::Axis);
    let moves: Vec<bool> = axis.stages.iter().map(|stage| stage.moves).collect();
    assert_eq!(moves, [true, false], "{:?}", axis.stages);
    let table = reported(&log("table_deg,z_um", 120, |minute| format!("{},{minute}", 3.0 * minute)), None);
    assert_eq!(table.test, Test::Rotary);
    assert!(table.remarks.is_empty(), "{:?}", table.remarks);
}

#[test]
fn a_test_that_is_asked_for_is_taken_and_what_does_not_fit_is_reported() {
    let spindle = log("spindle_rpm,z_um", 120, |minute| format!("3000,{minute}"));
    let etve = reported(&spindle, Some(Test::Etve));
    assert_eq!((etve.test, etve.because.as_str()), (Test::Etve, "as requested"));
    assert_eq!(etve.remarks, ["spindle_rpm moved: the heat of this movement is included in the results"]);
    let table = reported(&spindle, Some(Test::Rotary));
    assert_eq!(table.stages.len(), 1, "a table's speed is a speed too");
    let still = reported(&log("hall_c,z_um", 120, |minute| format!("20,{minute}")), Some(Test::Spindle));
    let stages = "no column shows which spindle or axis moved: the run cannot be divided into stages. Log \
                  the speed or the position";
    assert_eq!(still.remarks, [stages]);
}

#[test]
fn a_log_shorter_than_an_hour_has_no_figures_of_an_hour() {
    let drift = reported(&log("z_um", 40, |minute| format!("{minute}")), None);
    let z = &drift.displacements[0];
    assert_eq!((z.first_hour_um, z.last_hour_um, z.largest_60min_um), (None, None, None));
    assert!(near(z.range_um, 39.0), "{z:?}");
}

#[test]
fn missing_cells_are_no_movement() {
    let text = log(
        "z_um",
        180,
        |minute| if (60.0..90.0).contains(&minute) { String::new() } else { "2".to_owned() },
    );
    assert!(near(reported(&text, None).displacements[0].range_um, 0.0));
}

#[test]
fn a_log_without_a_displacement_is_told_what_to_do() {
    let dataset = dataset(&log("hall_c,probe", 120, |minute| format!("20,{}", 200.0 + minute)));
    let refused = |names: &[String]| drift(&dataset, names, None, &|_| None).unwrap_err().to_string();
    let reported = refused(&[]);
    assert!(
        reported.contains("Add the ending `_um`")
            && reported.contains("--displacement. The columns are hall_c, probe"),
        "{reported}"
    );
    let reported = refused(&["prob".to_owned()]);
    assert!(reported.contains("no log has a column `prob`; there are hall_c, probe"), "{reported}");
    assert!(drift(&dataset, &["probe".to_owned()], None, &|_| None).is_ok());
}

#[test]
fn times_in_hours_are_refused_unless_their_unit_is_stated() {
    let text = |time: &str| {
        let rows: String =
            (0..480).map(|minute| format!("{},{minute}\n", f64::from(minute) / 60.0)).collect();
        format!("{time},z_um\n{rows}")
    };
    let refused = drift(&dataset(&text("time")), &[], None, &|_| None).unwrap_err().to_string();
    for words in ["night lasts 7s (480 rows)", "--time-unit min, h, d or excel", "add --time-unit s"] {
        assert!(refused.contains(words), "{words}: {refused}");
    }
    let lasts = |drift: &Drift| drift.remarks.iter().any(|remark| remark.contains("night lasts 7s"));
    assert!(lasts(&reported(&text("time_s"), None)), "seconds that are stated are only unusual");
    let hours = reported(&text("time_h"), None);
    assert!((hours.hours - 479.0 / 60.0).abs() < 1e-6 && !lasts(&hours), "{hours:?}");
}
