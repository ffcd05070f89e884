//! Probings: a cycle of the CNC, and people, measure what is left of the error; the models learn, Cz never jumps.

use std::cell::RefCell;
use std::time::Duration;

use isotherm::cli::replay::replay;
use isotherm::gateway::Options;
use isotherm::observe::status::{Answer, Command, ProbeStatus, Status};
use isotherm_core::compensation::MeasuredReport;

use crate::faults::law;
use crate::faults::rig::{BENCH, LATHE, Sample, Stage, Trace, Trial, World, block_on, profile, somebody};

const SECOND: Duration = Duration::from_secs(1);
const MINUTE: Duration = Duration::from_secs(60);

/// The bench with a probing cycle every two minutes, that leaves its result in the CNC.
fn probing(trigger: &str, more: &str) -> String {
    let patient = BENCH.replace("100ms", "900ms");
    format!(
        "{patient}
        [signal.probe_z]
        device = \"cnc\"
        register = \"holding:200\"
        type = \"i32\"
        word_order = \"msw-first\"
        scale = 0.1
        unit = \"um\"
        max_age = \"5s\"
        {trigger}
        [axis.z.probe]
        signal = \"probe_z\"
        limit = 40.0
        filter = 0.5
        max_error = 200.0
        {more}"
    )
}

const COUNTER: (&str, &str) = (
    "[signal.probed]
    device = \"cnc\"
    register = \"holding:203\"
    type = \"u16\"
    unit = \"count\"
    max_age = \"5s\"",
    "trigger = \"probed\"",
);
const FLAG: (&str, &str) = (
    "[signal.probed]
    device = \"cnc\"
    register = \"discrete:9\"
    type = \"bool\"
    max_age = \"5s\"",
    "trigger = \"probed\"",
);

fn status(sample: &Sample) -> &ProbeStatus {
    sample.status.axes[0].probe.as_ref().unwrap()
}

fn last(trace: &Trace) -> &ProbeStatus {
    status(trace.samples.last().unwrap())
}

fn in_directory(directory: &std::path::Path) -> impl FnOnce(&mut Options) {
    let directory = Some(directory.to_owned());
    move |options| options.directory = directory
}

#[test]
fn a_probing_cycle_takes_what_the_model_does_not_know_out_of_the_machine() {
    for (trigger, key) in [COUNTER, FLAG, ("", "")] {
        let trace = block_on(async {
            let mut world = World::new(&probing(trigger, key), "").await;
            world.gateway().run(60 * MINUTE).await
        });
        law::holds(&trace);
        assert!((25..=30).contains(&trace.reported("probed")), "{key}: {}", trace.lines());
        assert_eq!(trace.reported("probe-refused"), 0, "{}", trace.lines());
        let history = &last(&trace).history;
        let (first, last) = (history[0].1.abs(), history[history.len() - 1].1.abs());
        assert!(first > 2.0 && last < 0.5, "{history:?}");
        assert_eq!(trace.states(), ["waiting", "active"]);
    }
}

#[test]
fn a_person_measures_and_takes_it_back_and_the_log_gives_it_all_again() {
    let directory = tempfile::tempdir().unwrap();
    let text = probing(COUNTER.0, "trigger = \"probed\"\ngains = { forgetting = 0.98, limit = 0.2 }");
    let measured = |error: Option<f64>| {
        move |stage: &Stage<'_>| {
            stage.source.measured("z", error.map(f64::into), &somebody()).unwrap();
        }
    };
    let (first, second) = block_on(async {
        let mut world = World::new(&text, "").await;
        let first = world.gateway().options(in_directory(directory.path()));
        let first = first.at(9 * MINUTE + MINUTE / 2, measured(Some(6.5))).run(15 * MINUTE).await;
        let second = world.gateway().options(in_directory(directory.path()));
        let second = second.at(MINUTE / 2, measured(Some(-4.0))).at(11 * MINUTE + MINUTE / 2, measured(None));
        (first, second.run(11 * MINUTE + 50 * MINUTE / 60).await)
    });
    law::holds(&first);
    law::holds(&second);
    let left = last(&first);
    assert!(left.correction_um.abs() > 1.0 && left.gains.len() == 3, "{left:?}");
    let taken_up = status(&second.samples[1]);
    assert_eq!(taken_up.history, left.history, "kept over the restart");
    assert_eq!(second.reported("probe-forgotten"), 1, "{}", second.lines());
    assert!(last(&second).correction_um.abs() < 1e-12, "{:?}", last(&second));
    let log = std::fs::File::open(directory.path().join("bench-2026-01-05.csv")).unwrap();
    let summary = replay(&profile(&text), log, "the day", None).unwrap();
    let reproduced = summary.axes["z"].reproduced.as_ref().unwrap();
    assert_eq!(reproduced.first, None, "{summary}");
    assert!(reproduced.rows > 700, "{summary}");
}

#[test]
fn what_a_person_sends_is_held_against_what_stands_in_the_machine() {
    let trace = block_on(async {
        let text = probing("", "").replace("signal = \"probe_z\"\n", "").replace("200.0", "20.0");
        let mut world = World::new(&text, "").await;
        let send = |stage: &Stage<'_>, axis, error: f64| {
            stage.source.measured(axis, Some(error.into()), &somebody())
        };
        let trial = world.gateway().at(5 * MINUTE, move |stage| {
            assert!(send(stage, "q", 1.0).unwrap_err().contains("there is no axis q; there are z"));
            assert!(send(stage, "z", f64::NAN).unwrap_err().contains("a finite number"));
            assert!(matches!(send(stage, "z", 3.0), Ok(Answer::TooSoon(_))), "one a second");
        });
        let trial = trial.at(5 * MINUTE + SECOND, move |stage| {
            let far = send(stage, "z", 400.0).unwrap_err();
            assert!(
                far.contains("the model would be wrong by") && far.contains("axis.z.probe.max_error"),
                "{far}"
            );
        });
        let trial = trial.at(5 * MINUTE + 2 * SECOND, move |stage| {
            let said = send(stage, "z", 3.0).unwrap();
            assert!(said.text().starts_with("z: error 3.0 µm, measured while a Cz of"), "{said:?}");
        });
        trial.run(6 * MINUTE).await
    });
    law::holds(&trace);
    // What is not learned from is compared all the same.
    assert_eq!((trace.reported("probed"), trace.reported("probe-refused")), (1, 1), "{}", trace.lines());
    let probe = last(&trace).last.clone().unwrap();
    let before: &Status = &trace.between(295, 299).last().unwrap().status;
    let written = before.outputs.iter().find(|output| output.name == "cnc_z").unwrap().value.unwrap();
    let shared = before.outputs.iter().find(|output| output.name == "readout_z").unwrap();
    assert_eq!(shared.state, "verified");
    assert!((probe.acting_um - written).abs() < 1.1, "{probe:?} {written}");
    assert!((last(&trace).correction_um + 0.5 * probe.residual_um.unwrap()).abs() < 1e-9);
}

#[test]
fn a_model_that_is_worse_than_no_compensation_is_an_alarm_and_cz_goes_to_zero() {
    let directory = tempfile::tempdir().unwrap();
    let text = probing("", "worse = \"ramp\"").replace("signal = \"probe_z\"\n", "");
    let trace = block_on(async {
        let mut world = World::new(&text, "").await;
        // The machine needs nothing: all that is left of its error is the Cz that acts.
        let touch = |stage: &Stage<'_>| {
            let acting = stage.source.status().axes[0].verified_um.unwrap();
            stage.source.measured("z", Some(acting.into()), &somebody()).unwrap();
        };
        let trial = world.gateway().options(in_directory(directory.path()));
        trial.at(8 * MINUTE, touch).at(9 * MINUTE, touch).run(15 * MINUTE).await
    });
    law::holds(&trace);
    let found = ["probed", "worse", "worse-over"].map(|kind| trace.reported(kind));
    assert_eq!(found, [2, 1, 0], "{}", trace.lines());
    assert_eq!(trace.states(), ["waiting", "active", "ramping", "zeroed"], "{}", trace.lines());
    let before = &trace.samples.iter().rfind(|sample| sample.at <= trace.stopped.0).unwrap().status;
    let axis = &before.axes[0];
    assert_eq!((axis.cz_um, axis.why.cause.as_str()), (0.0, "the model is worse than no compensation"));
    let worse = axis.probe.as_ref().unwrap().worse.unwrap();
    assert!(worse.ramps && worse.touches == 2 && worse.with_um > worse.without_um, "{worse:?}");
    assert!(before.alarms.iter().any(|alarm| alarm.id == "compensation of axis z"), "{:?}", before.alarms);
    let log = std::fs::read_to_string(directory.path().join("bench-2026-01-05.csv")).unwrap();
    assert!(log.lines().next().unwrap().contains(",z_worse,"), "{log}");
    let summary = replay(&profile(&text), log.as_bytes(), "the day", None).unwrap();
    let axis = &summary.axes["z"];
    assert_eq!(axis.reproduced.as_ref().unwrap().first, None, "{summary}");
    assert!(axis.worse.is_some_and(|share| (0.3..0.5).contains(&share)), "{summary}");
}

#[test]
fn an_axis_without_a_probe_takes_no_measured_errors_and_a_diameter_is_halved() {
    let text = format!("{LATHE}\n[axis.x.probe]\nlimit = 5.0\nfilter = 1.0\nmax_error = 30.0\nwarn = 1.0\n");
    let trace = block_on(async {
        let mut world = World::new(&text, "").await;
        let trial = world.gateway().at(3 * MINUTE, |stage| {
            let refused = stage.source.measured("z", Some(1.0.into()), &somebody()).unwrap_err();
            assert!(refused.contains("axis z does not accept measured errors"), "{refused}");
            let status = stage.source.status();
            assert!((status.axes[0].cz_um - status.axes[0].raw_um.unwrap()).abs() < 0.2, "it has arrived");
            stage.source.measured("x", Some(3.0.into()), &somebody()).unwrap();
        });
        trial.run(4 * MINUTE).await
    });
    law::holds(&trace);
    let probe = last(&trace);
    assert!((probe.last.as_ref().unwrap().error_um - 1.5).abs() < 1e-12);
    assert!((probe.correction_um + 1.5).abs() < 0.25, "{probe:?}");
    assert_eq!(trace.reported("model-ages"), 1, "{}", trace.lines());
}

#[test]
fn a_result_that_cannot_be_read_and_a_machine_that_is_not_known_are_reported() {
    let faults = "
        [[fault]]
        device = \"cnc\"
        kind = \"sentinel\"
        signal = \"probe_z\"
        at = \"3min\"
        for_time = \"4min\"";
    let text = probing(COUNTER.0, COUNTER.1).replace(
        "scale = 0.1\n        unit = \"um\"",
        "scale = 0.1\n        bad = [-99999]\n        unit = \"um\"",
    );
    let trace = block_on(async {
        let mut world = World::new(&text, faults).await;
        world.gateway().run(11 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!(trace.reported("probe-refused"), 2, "{}", trace.lines());
    assert!(trace.lines().contains("the result of the probing could not be read"), "{}", trace.lines());
    assert!(trace.reported("probed") >= 2, "{}", trace.lines());
}

#[test]
fn how_wrong_a_model_is_expected_to_be_is_shown_logged_and_comes_out_again() {
    let directory = tempfile::tempdir().unwrap();
    let expected = "kind = \"linear\"\nexpected = { since_datum = [60.0, 0.0], since_touch = [0.0, 0.25] }";
    let text =
        probing("", "").replace("signal = \"probe_z\"\n", "").replacen("kind = \"linear\"", expected, 1);
    let trace = block_on(async {
        let mut world = World::new(&text, "").await;
        let trial = world.gateway().options(in_directory(directory.path()));
        let trial = trial.at(5 * MINUTE, |stage| {
            stage.source.measured("z", Some(3.0.into()), &somebody()).unwrap();
        });
        trial.run(10 * MINUTE).await
    });
    law::holds(&trace);
    let shown = |from, to| trace.between(from, to).last().unwrap().status.axes[0].expected_um.unwrap();
    // 1 µm² more each minute since the machine's start, until there was a probing.
    assert!((shown(230, 240) - 2.0).abs() < 0.05 && (shown(290, 299) - 5_f64.sqrt()).abs() < 0.05);
    // The residual of 3 µm at an expected variance of about 5 µm² scales the error.
    let scaled = 0.5 * ((8.0 + 9.0 / 5.0) / 9.0_f64).sqrt();
    assert!((shown(310, 320) - scaled).abs() < 0.01 && (shown(580, 599) - shown(310, 320)).abs() < 1e-9);
    let log = std::fs::read_to_string(directory.path().join("bench-2026-01-05.csv")).unwrap();
    assert!(log.lines().next().unwrap().contains(",z_correction_um,z_expected_um,"), "{log}");
    let summary = replay(&profile(&text), log.as_bytes(), "the day", None).unwrap();
    assert_eq!(summary.axes["z"].reproduced.as_ref().unwrap().first, None, "{summary}");
    let mut table = Vec::new();
    let other = text.replace("[0.0, 0.25]", "[0.0, 0.16]");
    let summary = replay(&profile(&other), log.as_bytes(), "the day", Some(&mut table)).unwrap();
    let first = summary.axes["z"].reproduced.as_ref().unwrap().first.clone().unwrap();
    let [recorded, replayed] = [&first.recorded, &first.replayed].map(|text| text.parse::<f64>().unwrap());
    assert!(
        first.column == "z_expected_um" && (replayed / recorded - 0.8).abs() < 1e-9,
        "{} {recorded} {replayed}",
        first.column
    );
    assert!(String::from_utf8(table).unwrap().lines().next().unwrap().contains(",z_expected_um"));
}

#[test]
fn a_probing_that_disagrees_is_told_everywhere_and_waits_for_a_second_one() {
    let trace = block_on(async {
        let text =
            probing("", "").replace("signal = \"probe_z\"\n", "").replace("filter = 0.5\n", "repeat = 0.5\n");
        let mut world = World::new(&text, "").await;
        let send = |stage: &Stage<'_>, error: f64| {
            stage.source.measured("z", Some(error.into()), &somebody()).unwrap()
        };
        let trial = world.gateway().at(5 * MINUTE, move |stage| {
            let said = send(stage, 30.0);
            assert!(
                said.text().contains("not used for the correction yet: the model would be wrong by"),
                "{said:?}"
            );
            assert!(said.text().contains("a second probing that agrees"), "{said:?}");
        });
        let trial = trial.at(5 * MINUTE + 3 * SECOND, move |stage| {
            let said = send(stage, 31.0);
            assert!(said.text().ends_with("used for the correction now"), "{said:?}");
        });
        trial.run(6 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!((trace.reported("probed"), trace.reported("probe-refused")), (1, 1), "{}", trace.lines());
    let waiting = status(trace.between(301, 302).last().unwrap());
    let refused = waiting.last.as_ref().unwrap().refused.as_ref().unwrap();
    assert!(refused.contains("more than the") && refused.contains("measure again"), "{refused}");
    assert!(waiting.correction_um.abs() < 1e-12, "{waiting:?}");
    let learned = last(&trace);
    let residual = learned.last.as_ref().unwrap().residual_um.unwrap();
    assert!((learned.correction_um + residual).abs() < 0.02 * residual, "{learned:?}");
}

/// The bench whose axis doubts an error of 30 µm until a second one agrees.
fn doubting() -> String {
    probing("", "").replace("signal = \"probe_z\"\n", "").replace("filter = 0.5\n", "repeat = 0.5\n")
}

/// Sends a report; what it was answered.
fn sends(stage: &Stage<'_>, report: MeasuredReport) -> Result<String, String> {
    stage.source.measured("z", Some(report), &somebody()).map(|answer| answer.text().to_owned())
}

/// Sends the report again this often, every 3 s; each time it is rejected, and that is why.
fn again<'a>(
    trial: Trial<'a>,
    (report, why): (&'a RefCell<Option<MeasuredReport>>, &'a str),
    from: Duration,
    times: u32,
) -> Trial<'a> {
    (0..times).fold(trial, |trial, time| {
        trial.at(from + 3 * time * SECOND, move |stage| {
            let kept = report.borrow().clone();
            let rejected = sends(stage, kept.unwrap()).unwrap_err();
            assert!(rejected.starts_with("z: rejected: ") && rejected.contains(why), "{rejected}");
        })
    })
}

/// Makes the report of a kind.
type Make = fn(&Stage<'_>) -> MeasuredReport;

#[test]
fn one_measured_error_that_arrives_ten_times_is_one_over_a_restart_and_a_kill_too() {
    let timed: Make = |stage| MeasuredReport { time: Some(stage.clock.time_of_day()), ..30.0.into() };
    let named: Make = |_| MeasuredReport { id: Some("part-17/2".to_owned()), ..30.0.into() };
    let plain: Make = |_| MeasuredReport::from(30.0);
    let kinds: [(Make, &str); 3] = [
        (timed, "was accepted before with the same error; measure again"),
        (named, "the measurement with the id part-17/2 was accepted before; give each"),
        (plain, "the same error arrived 3.0 s ago, so this report is ignored; send a `time` or an `id`"),
    ];
    for (make, why) in kinds {
        let directory = tempfile::tempdir().unwrap();
        let report = RefCell::new(None);
        let (first, second, third) = block_on(async {
            let mut world = World::new(&doubting(), "").await;
            let report = &report;
            let trial = world.gateway().options(in_directory(directory.path()));
            let trial = trial.at(5 * MINUTE, move |stage| {
                let made = make(stage);
                *report.borrow_mut() = Some(made.clone());
                assert!(sends(stage, made).unwrap().contains("not used for the correction yet"));
            });
            let first = again(trial, (report, why), 5 * MINUTE + 3 * SECOND, 4)
                .killed_after(5 * MINUTE + 13 * SECOND)
                .await;
            if report.borrow().as_ref().is_some_and(|report| !report.is_identified()) {
                return (first, None, None);
            }
            let trial = world.gateway().options(in_directory(directory.path()));
            let second = again(trial, (report, why), 2 * MINUTE, 3).run(3 * MINUTE).await;
            let trial = world.gateway().options(in_directory(directory.path()));
            let third =
                again(trial, (report, why), 2 * MINUTE, 3).at(2 * MINUTE + 20 * SECOND, move |stage| {
                    let other = MeasuredReport { id: Some("part-17/3".to_owned()), ..30.5.into() };
                    assert!(sends(stage, other).unwrap().ends_with("used for the correction now"));
                });
            (first, Some(second), Some(third.run(3 * MINUTE).await))
        });
        for trace in [Some(&first), second.as_ref()].into_iter().flatten() {
            law::holds(trace);
            assert_eq!(trace.reported("probed"), 0, "{}", trace.lines());
            assert!(last(trace).correction_um.abs() < 1e-12, "{:?}", last(trace));
            assert!(trace.reported("command-refused") >= 3, "{}", trace.lines());
        }
        assert_eq!(third.map(|third| third.reported("probed")), second.map(|_| 1));
    }
}

#[test]
fn a_measured_error_of_before_the_zero_or_of_the_future_is_rejected_with_both_times() {
    let text = doubting().replace("arm  = \"auto\"", "arm  = \"auto\"\nsettle = \"20s\"").replacen(
        "reference = 0.0",
        "reference = \"zero\"",
        2,
    );
    let trace = block_on(async {
        let mut world = World::new(&text, "").await;
        let at = |stage: &Stage<'_>, ahead: i64| {
            let now = stage.clock.time_of_day();
            let span = Duration::from_secs(ahead.unsigned_abs());
            let time = Some(if ahead < 0 { now.before(span) } else { now.after(span) });
            sends(stage, MeasuredReport { time, ..1.0.into() })
        };
        let rejected = |said: Result<String, String>, why: &str| {
            let said = said.unwrap_err();
            assert!(said.starts_with("z: rejected: ") && said.contains(why), "{said}");
        };
        let trial = world.gateway().command(5 * MINUTE, Command::Zero);
        // While the datum is being taken, and once it is there.
        let trial = trial
            .at(5 * MINUTE + 5 * SECOND, move |stage| rejected(at(stage, -10), "older than the datum (zero"));
        let trial = trial.at(6 * MINUTE, move |stage| rejected(at(stage, -50), "older than the datum (zero"));
        let trial = trial.at(6 * MINUTE + 2 * SECOND, move |stage| rejected(at(stage, 60), "Set the clock"));
        let trial = trial.at(6 * MINUTE + 4 * SECOND, move |stage| {
            assert!(at(stage, -10).unwrap().ends_with("used for the correction now"));
        });
        trial.run(7 * MINUTE).await
    });
    law::holds(&trace);
    assert_eq!((trace.reported("probed"), trace.reported("command-refused")), (1, 3), "{}", trace.lines());
}
