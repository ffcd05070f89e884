//! Tests of the time spans in the summary: sensors that were replaced or suspected, and an axis on hold.

use super::*;
use isotherm_core::compensation::model::stand_ins::Described;
use isotherm_core::compensation::model::{Input, Kind, Linear, Model, Reference, StandIns, Term};
use isotherm_core::compensation::settings::MachineSettings;
use isotherm_core::reading::SignalId;
use sample::of;
use serde_json::json;

/// Returns a profile with predictions: that of the spindle depends on bearing and column, that of the oil on the
/// bearing alone. One sensor is too few for a stand-in.
fn watched() -> Profile {
    let mut profile = sample::profile();
    let names = ["spindle_front", "bearing_rear", "column", "oil"];
    profile.signals.iter_mut().zip(names).for_each(|(signal, name)| signal.name = name.to_owned());
    profile.machine = MachineSettings { signals: 4, ..MachineSettings::default() };
    profile.axes.truncate(1);
    let term = |place, gain| Described::term(SignalId(place), None, gain);
    let sensor =
        |place, terms| Described { signal: SignalId(place), threshold: 0.25, stands_in: true, terms };
    let sensors = vec![sensor(0, vec![term(1, 0.5), term(2, 0.5)]), sensor(3, vec![term(1, 1.0)])];
    let rise = Term { input: Input::of(SignalId(0), Reference::Start, None), gain: of(1.0) };
    let kind = Kind::Linear(Linear { offset: of(0.0), terms: vec![rise], slope: None });
    let stand_ins = Some(StandIns::new(sensors, 1));
    profile.axes[0].settings.models = vec![Model { stand_ins, ..Model::new("rises".to_owned(), kind) }];
    profile
}

/// Returns a log of an hour with a row every ten seconds. All temperatures rise by 0.1 °C a minute. The spindle has no
/// value from minute 10 to 12. From minute 30 on, the readings of spindle and oil are constant.
fn hour() -> String {
    let mut log = "time,spindle_front,bearing_rear,column,oil\n".to_owned();
    let warm = |row: u32| 20.0 + f64::from(row) / 60.0;
    for row in 0..=360 {
        let (second, frozen) = (row * 10, warm(row.min(180)));
        let spindle = if (600..720).contains(&second) { String::new() } else { frozen.to_string() };
        let time =
            format!("2026-01-05T{:02}:{:02}:{:02}Z", 12 + second / 3600, second / 60 % 60, second % 60);
        log += &format!("{time},{spindle},{},{},{frozen}\n", warm(row), warm(row));
    }
    log
}

/// Lines of the summary about spans.
fn lines(summary: &Summary) -> Vec<String> {
    summary.to_string().lines().filter(|line| line.contains(" to ")).map(str::to_owned).collect()
}

/// The sample machine with its first axis alone.
fn alone() -> Profile {
    let mut profile = sample::profile();
    profile.axes.truncate(1);
    profile
}

const REPLACED: &str = "  2026-01-05 12:10:00 to 12:12:00 (2m): spindle_front, lost for 10s, replaced by the stand-in of \
                        bearing_rear and column";

#[test]
fn a_sensor_that_was_replaced_or_suspected_is_listed_with_when_by_what_and_why() {
    let (summary, _) = replayed(&watched(), &hour());
    assert_eq!(
        lines(&summary),
        [
            REPLACED,
            "  2026-01-05 12:35:00 to 13:00:00, the end of the log (25m): spindle_front, frozen for 5m, replaced by the \
             stand-in of bearing_rear and column",
            "  2026-01-05 12:35:00 to 13:00:00, the end of the log (25m): oil, unchanged for 5m, suspected of being frozen \
             and not replaced: the stand-in depends on bearing_rear alone",
        ]
    );
    let axis = &serde_json::to_value(&summary).unwrap()["axes"]["z"];
    assert_eq!(
        axis["stand_ins"],
        json!([
            {
                "from": "2026-01-05T12:10:00Z", "to": "2026-01-05T12:12:00Z", "span_s": 120.0, "lasts": false,
                "signal": "spindle_front", "kind": "lost", "for_s": 10.0, "by": ["bearing_rear", "column"]
            },
            {
                "from": "2026-01-05T12:35:00Z", "to": "2026-01-05T13:00:00Z", "span_s": 1500.0, "lasts": true,
                "signal": "spindle_front", "kind": "frozen", "for_s": 300.0, "by": ["bearing_rear", "column"]
            }
        ])
    );
    assert_eq!(
        axis["suspicions"],
        json!([{
            "from": "2026-01-05T12:35:00Z", "to": "2026-01-05T13:00:00Z", "span_s": 1500.0, "lasts": true,
            "signal": "oil", "for_s": 300.0, "why": "the stand-in depends on bearing_rear alone"
        }])
    );
    assert_eq!(axis["holds"], json!([]));
    assert_eq!(axis["left_out"], json!({ "stand_ins": 0, "suspicions": 0, "holds": 0 }));
}

#[test]
fn a_substitution_that_would_move_the_target_by_more_than_a_step_is_a_suspicion() {
    let mut profile = watched();
    profile.axes[0].settings.guard.step = of(0.3);
    let (summary, _) = replayed(&profile, &hour());
    let why = "the stand-in would change the target of the axis by more than one `step`, or is outside the range of the sensor";
    let suspected = format!(
        "  2026-01-05 12:35:00 to 13:00:00, the end of the log (25m): spindle_front, unchanged for 5m, suspected of being \
         frozen and not replaced: {why}"
    );
    assert_eq!(lines(&summary)[..2], [REPLACED.to_owned(), suspected]);
}

#[test]
fn an_axis_that_holds_is_listed_with_its_state_and_why() {
    let mut log = "time,bed,wheelhead\n".to_owned();
    for time in (0..=100).step_by(10) {
        let wheelhead = if (10..90).contains(&time) { "" } else { "20" };
        log += &format!("{time},25,{wheelhead}\n");
    }
    let (summary, _) = replayed(&alone(), &log);
    assert_eq!(
        lines(&summary),
        [
            "  10 s to 70 s (1m): holding: wheelhead has no value in the log",
            "  70 s to 90 s (20s): zeroed: wheelhead has no value in the log",
        ]
    );
    assert_eq!(
        serde_json::to_value(&summary).unwrap()["axes"]["z"]["holds"][1],
        json!({
            "from": "70", "to": "90", "span_s": 20.0, "lasts": false, "state": "zeroed",
            "why": "wheelhead has no value in the log"
        })
    );
}

#[test]
fn an_output_that_is_not_verified_or_is_interlocked_makes_an_axis_hold_and_a_stop_does_not() {
    let permits = ["armed", "unverified", "held", "armed", "stopping", "stopping"];
    let rows = permits.iter().zip((0..).step_by(10)).map(|(permit, time)| format!("{time},25,20,{permit}\n"));
    let log = format!("time,bed,wheelhead,z_permit\n{}", rows.collect::<String>());
    assert_eq!(
        lines(&replayed(&alone(), &log).0),
        [
            "  10 s to 20 s (10s): holding: the value of an output is not verified",
            "  20 s to 30 s (10s): holding: an output is interlocked",
        ]
    );
}

#[test]
fn a_model_beyond_the_error_level_makes_an_axis_hold() {
    let mut profile = alone();
    profile.axes[0].settings.levels.error = Some(of(10.0));
    let (summary, _) = replayed(&profile, "time,bed,wheelhead\n0,25,20\n10,25,20\n");
    assert_eq!(
        lines(&summary),
        ["  0 s to 10 s, the end of the log (10s): holding: the model requested more than the error level"]
    );
}

#[test]
fn of_very_many_spans_the_first_are_kept_and_fewer_are_printed() {
    let log = (0..2400).fold("time,bed,wheelhead\n".to_owned(), |log, row| {
        log + &format!("{},25,{}\n", row * 10, if row % 2 == 0 { "20" } else { "" })
    });
    let (summary, _) = replayed(&alone(), &log);
    let spans = &summary.axes["z"].spans;
    assert_eq!((spans.holds.len(), spans.left_out.holds, spans.left_out.stand_ins), (1000, 200, 0));
    let last = &spans.holds[999];
    assert_eq!((last.from.as_str(), last.to.as_str(), last.lasts), ("19990", "20000", false));
    assert_eq!(lines(&summary).len(), 20);
    let text = summary.to_string();
    assert!(text.contains("\n  and 1180 more holds; --json lists the first 1000\n"), "{text}");
}
