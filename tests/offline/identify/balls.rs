//! Ball arrays on machines with known drift: the terms must equal it.

use isotherm_identify::balls::{Terms, log, terms};
use isotherm_identify::dataset::{BadLog, Dataset, Split, every_column};
use isotherm_identify::method::{Method, Settings};
use proptest::prelude::*;

/// Movement of the ball coordinates, µm and µm/mm.
#[derive(Clone, Copy, Debug)]
struct Truth {
    drift: [f64; 3],
    /// k along the array, A across it.
    slope: [f64; 3],
    /// B, across the array.
    spindle: [f64; 3],
}

const STILL: Truth = Truth { drift: [0.0; 3], slope: [0.0; 3], spindle: [0.0; 3] };

fn read(name: &str, text: &str) -> Result<Dataset, BadLog> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    std::fs::write(&path, text).unwrap();
    Dataset::read(&[path], &Split::default(), &|_| None, &every_column)
}

/// Five balls at a distance of 100 mm along one direction, in rounds of ten minutes, with one stylus or two.
fn touches(along: usize, rounds: &[Truth], styli: &[f64]) -> String {
    let mut text = "time,ball,x_mm,y_mm,z_mm,stylus_mm\n".to_owned();
    let mut second = 0;
    for truth in rounds {
        for stylus in styli {
            for ball in 0..5 {
                let place = 100.0 * f64::from(ball);
                let mut at = [12.5, -300.0, 40.0];
                at[along] += place;
                for (direction, at) in at.iter_mut().enumerate() {
                    let tilt = if direction == along { 0.0 } else { truth.spindle[direction] };
                    let moved =
                        truth.drift[direction] + truth.slope[direction] * place + tilt * (stylus - styli[0]);
                    *at += moved / 1000.0;
                }
                text += &format!("{second},{},{},{},{},{stylus}\n", ball + 1, at[0], at[1], at[2]);
                second += 60;
            }
        }
    }
    text
}

fn found(text: &str) -> Terms {
    terms(&read("balls.csv", text).unwrap(), None).unwrap_or_else(|wrong| panic!("{wrong}"))
}

fn refused(text: &str) -> String {
    match read("balls.csv", text) {
        Err(wrong) => wrong.to_string(),
        Ok(dataset) => {
            terms(&dataset, None).map_or_else(|wrong| wrong.to_string(), |terms| panic!("{terms:?}"))
        }
    }
}

/// Case M6 of the reference values.
#[test]
fn two_balls_100_mm_apart_and_3_5_um_give_0_035_um_per_mm() {
    let text = "time,ball,x_mm,y_mm,z_mm\n0,1,0,0,100\n30,2,0,0,200\n3600,1,0,0,100\n3630,2,0,0,200.0035\n";
    let terms = found(text);
    assert_eq!((terms.array, terms.rounds.len(), terms.origin_mm), ("z", 2, 100.0));
    let warm = &terms.rounds[1];
    assert!((warm.slope_um_per_mm[2] - 0.035).abs() < 1e-9, "{warm:?}");
    assert!(warm.drift_um[2].abs() < 1e-6 && (warm.hours - 1.0).abs() < 1e-9, "{warm:?}");
    assert!(terms.remarks.iter().any(|remark| remark.contains("two lengths")), "{:?}", terms.remarks);
}

proptest! {
    #[test]
    fn any_drift_expansion_and_tilts_come_back(
        along in 0usize..3,
        drift in prop::array::uniform3(-200.0..200.0f64),
        slope in prop::array::uniform3(-0.3..0.3f64),
        spindle in prop::array::uniform3(-0.3..0.3f64),
    ) {
        let truth = Truth { drift, slope, spindle };
        let terms = found(&touches(along, &[STILL, truth], &[80.0, 180.0]));
        prop_assert_eq!(terms.along, along);
        let warm = &terms.rounds[1];
        let tilts = warm.spindle_um_per_mm.unwrap();
        for direction in 0..3 {
            prop_assert!((warm.drift_um[direction] - drift[direction]).abs() < 1e-6);
            prop_assert!((warm.slope_um_per_mm[direction] - slope[direction]).abs() < 1e-8);
            let tilt = if direction == along { 0.0 } else { spindle[direction] };
            prop_assert!((tilts[direction] - tilt).abs() < 1e-8);
        }
        prop_assert!(warm.rms_um < 1e-6);
    }
}

#[test]
fn what_one_touch_is_off_by_is_shared_by_the_balls_and_reported_as_what_is_left() {
    let truth = Truth { slope: [0.0, 0.0, 0.05], ..STILL };
    let text = touches(2, &[STILL, truth], &[80.0]);
    let last = text.lines().last().unwrap().to_owned();
    // The last ball is 5 µm too high: the slope increases by 5 · 200/100000 µm/mm.
    let height: f64 = last.split(',').nth(4).unwrap().parse().unwrap();
    let off = text.replace(&last, &last.replace(&height.to_string(), &(height + 0.005).to_string()));
    let warm = &found(&off).rounds[1];
    assert!((warm.slope_um_per_mm[2] - 0.06).abs() < 1e-6, "{warm:?}");
    assert!((warm.drift_um[2] + 1.0).abs() < 1e-6, "{warm:?}");
    assert!((warm.rms_um - (10.0f64 / 15.0).sqrt()).abs() < 1e-6, "{warm:?}");
}

#[test]
fn the_error_in_the_log_is_minus_the_drift_of_the_coordinates() {
    let truth = Truth { drift: [1.0, -2.0, 5.0], slope: [0.01, 0.0, 0.02], ..STILL };
    let text = log(&found(&touches(2, &[STILL, truth], &[80.0])), None).unwrap();
    let log = read("drift.csv", &text).unwrap();
    let last = |name: &str| log.runs[0].values[log.column(name).unwrap()].iter().last().unwrap();
    for (name, value) in [
        ("d_z_um", 5.0),
        ("z_error_um", -5.0),
        ("y_error_um", 2.0),
        ("k_z_um_per_mm", 0.02),
        ("z_slope_error_um_per_mm", -0.02),
        ("a_x_um_per_mm", 0.01),
        ("x_slope_error_um_per_mm", -0.01),
    ] {
        assert!((last(name) - value).abs() < 1e-6, "{name}: {}", last(name));
    }
}

#[test]
fn rounds_stand_in_the_recorded_rows_nearest_to_them_and_identify_takes_them() {
    // The z coordinates drift by −4 µm per °C, so that e = +4 µm/°C and Cz = −4 µm/°C.
    let temperature = |minute: usize, day: f64| 20.0 + day * ((minute as f64 - 10.0) / 60.0).clamp(0.0, 3.0);
    let mut logs = Vec::new();
    for day in [1.0, 1.5, 2.0] {
        let rise = |round: usize| temperature(round * 5 + 2, day) - 20.0;
        let rounds: Vec<Truth> = (0..48)
            .map(|round| Truth { drift: [0.0, 0.0, -4.0 * (rise(round) - rise(0))], ..STILL })
            .collect();
        let recorded: String =
            (0..250).map(|minute| format!("{},{}\n", minute * 60, temperature(minute, day))).collect();
        let recorded = read("recorded.csv", &format!("time,s0\n{recorded}")).unwrap();
        let text = log(&found(&touches(2, &rounds, &[80.0])), Some(&recorded)).unwrap();
        assert_eq!(text.lines().count(), 251);
        assert_eq!(text.lines().filter(|line| !line.ends_with(",,")).count(), 49);
        logs.push(text);
    }
    let settings = Settings { method: Method::Ols, ..Settings::default() };
    let model = super::rig::found(1, &logs, &settings);
    assert_eq!(model.terms.len(), 1);
    assert!((model.terms[0].gain + 4.0).abs() < 1e-3, "{:?}", model.terms);
}

#[test]
fn two_rounds_with_the_same_nearest_row_are_refused() {
    // The rounds are at 2, 7 and 12 minutes.
    let terms = found(&touches(2, &[STILL; 3], &[80.0]));
    let beside = |rows: &str| log(&terms, Some(&read("recorded.csv", &format!("time,s0\n{rows}")).unwrap()));
    let said = beside("0,20\n600,21\n1200,22\n").unwrap_err().to_string();
    assert!(said.contains("the rounds at 0.08 h and 0.17 h have the same nearest row of"), "{said}");
    let text = beside("0,20\n300,20\n600,21\n").unwrap();
    assert_eq!(text.lines().filter(|line| !line.ends_with(",,")).count(), 4, "{text}");
}

#[test]
fn a_table_that_is_no_ball_array_is_told_what_it_lacks() {
    for (text, parts) in [
        ("time,x_mm,y_mm,z_mm\n0,1,2,3\n", vec!["no column `ball`", "the number of the ball"]),
        ("time,ball,x,y_mm,z_mm\n0,1,1,2,3\n", vec!["no column `x_mm`", "in mm"]),
        ("time,ball,x_mm,y_mm,z_mm\n0,1,1,2,\n", vec!["balls.csv, touch 1: a cell is empty"]),
        ("time,ball,x_mm,y_mm,z_mm\n0,1,1,2,3\n9,1,1,2,3\n", vec!["at least two balls"]),
        ("time,ball,x_mm,y_mm,z_mm\n0,1,1,2,3\n9,2,1,2,103\n", vec!["one round only", "again while"]),
        (
            "time,ball,x_mm,y_mm,z_mm\n0,1,0,0,0\n9,2,0,70,90\n20,1,0,0,0\n",
            vec!["along z", "70 mm across", "clamp"],
        ),
    ] {
        let reported = refused(text);
        for part in parts {
            assert!(reported.contains(part), "`{part}` is not in: {reported}");
        }
    }
}

#[test]
fn balls_that_changed_numbers_are_left_out_with_the_reason() {
    let text =
        "time,ball,x_mm,y_mm,z_mm\n0,1,0,0,0\n1,2,0,0,90\n2,1,0,0,90\n3,2,0,0,0\n4,1,0,0,0\n5,2,0,0,90\n";
    let terms = found(text);
    assert_eq!(terms.rounds.len(), 2);
    assert!(
        terms.remarks[0].starts_with(
            "round 2 is left out: ball 1 is 90.000 mm away from its position in the cold round, along z"
        ),
        "{:?}",
        terms.remarks
    );
}
