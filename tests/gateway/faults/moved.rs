//! A profile that has changed since the last run. The changes are another register or scale of an output, another
//! channel of a signal, or another limit, diameter or axis of a readout.

use std::fs;
use std::path::Path;
use std::time::Duration;

use isotherm::gateway::{Handover, moved_since};
use isotherm::observe::status::Command;
use isotherm_core::codec::Address;
use isotherm_core::quantity::{Micron, Moment};

use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, World, block_on, profile};

const MINUTE: Duration = Duration::from_secs(60);
/// Time at which the operator arms.
const ARMED: Duration = Duration::from_secs(20);

/// End of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    Hold,
    FaultAction,
    Killed,
}

/// Run of a profile, and the time at which the operator arms.
struct Run {
    text: String,
    end: End,
    arm: Option<Duration>,
    keep: Option<Handover>,
    is_dry: bool,
}

impl Run {
    fn of(text: impl Into<String>) -> Run {
        Run { text: text.into(), end: End::Hold, arm: None, keep: None, is_dry: false }
    }

    fn ends(self, end: End) -> Run {
        Run { end, ..self }
    }

    fn armed(self) -> Run {
        Run { arm: Some(ARMED), ..self }
    }

    fn dry(self) -> Run {
        Run { is_dry: true, ..self }
    }

    fn kept(self, handover: Handover) -> Run {
        Run { keep: Some(handover), ..self }
    }
}

/// Runs one profile after another on the same machine and in the same directory.
fn runs(directory: &Path, faults: &str, runs: Vec<Run>) -> Vec<Trace> {
    block_on(async {
        let mut world = World::new(&text_of(&runs[0]), faults).await;
        let mut traces = Vec::new();
        for run in runs {
            let mut changed = profile(&text_of(&run));
            for (bus, before) in changed.buses.iter_mut().zip(&world.profile.buses) {
                bus.address.clone_from(&before.address);
            }
            world.profile = changed;
            let trial = world.gateway().options(|options| {
                options.directory = Some(directory.to_owned());
                options.handover = Ok(run.keep);
                options.dry_run = run.is_dry;
            });
            let trial = match run.arm {
                Some(after) => trial.command(after, Command::Arm),
                None => trial,
            };
            traces.push(match run.end {
                End::Killed => trial.killed_after(MINUTE).await,
                End::Hold | End::FaultAction => trial.run(MINUTE).await,
            });
        }
        traces
    })
}

fn text_of(run: &Run) -> String {
    match run.end {
        End::Hold => run.text.replace("arm  = \"auto\"", "arm  = \"auto\"\non_stop = \"hold\""),
        End::FaultAction | End::Killed => run.text.clone(),
    }
}

fn shared() -> String {
    BENCH.replace("refresh = \"10s\"", "refresh = \"10s\"\nshare = \"ledger\"")
}

/// Fault script that sets the register of the control to this number of counts at the start. More registers exist after
/// it.
fn holds(counts: i32) -> String {
    let [a, b, c, d] = counts.to_be_bytes();
    let words = [u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d])];
    let fault = |register: u32, words: [u16; 2]| {
        format!(
            "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"holding:{register}\"\nwords = {words:?}\nat = \"0s\"\n"
        )
    };
    fault(104, words) + &fault(110, [0, 0])
}

/// Value of the output's register at the end of a run, µm.
fn left(trace: &Trace) -> f64 {
    let output = trace.profile.outputs.iter().find(|output| output.name == "cnc_z").unwrap();
    let there = |seen: &&isotherm::virtual_machine::SeenRequest| {
        seen.device == output.device && seen.address == output.address && seen.count == 2
    };
    output.encoding.decode(&trace.wire.iter().rfind(there).unwrap().after).unwrap()
}

/// Texts of the events of a kind.
fn told(trace: &Trace, kind: &str) -> Vec<String> {
    trace.events.iter().filter(|event| event.kind == kind).map(|event| event.text.clone()).collect()
}

/// Checks that nothing was written to the control, and that the axis was off.
#[track_caller]
fn nothing_moved(trace: &Trace) {
    law::holds(trace);
    assert_eq!(trace.writes("cnc_z").len(), 0, "{}", trace.lines());
    assert_eq!(trace.states_between(15, 18), ["off"], "{}", trace.lines());
    assert_eq!(trace.reported("armed"), 0, "{}", trace.lines());
}

#[test]
fn a_shared_register_that_becomes_the_gateways_alone_keeps_the_operators_offset_until_a_person_has_seen_both_figures()
 {
    for end in [End::Hold, End::FaultAction, End::Killed] {
        let directory = tempfile::tempdir().unwrap();
        let whole = || Run::of(BENCH).ends(end);
        let all = vec![Run::of(shared()).ends(end).armed(), whole(), whole(), whole().armed(), whole()];
        let traces = runs(directory.path(), &holds(200), all);
        let held = left(&traces[0]);
        let share = held - 20.0;
        assert_eq!(share > 5.0, end != End::FaultAction, "{end:?}: {share}\n{}", traces[0].lines());
        for trace in &traces[1..3] {
            nothing_moved(trace);
            assert!((left(trace) - held).abs() < 0.01, "{end:?}: {} of {held}", left(trace));
            let told = told(trace, "output-moved");
            assert_eq!(told.len(), 2, "at the start, and with what the register holds: {told:#?}");
            let figures = [
                format!(
                    "output cnc_z has changed: from share ledger to share whole; {share:.1} µm from the \
                     gateway were verified before the change"
                ),
                format!("the register holds {held:.1} µm now"),
            ];
            assert!(told[0].contains(&figures[0]), "{told:#?}");
            assert!(figures.iter().all(|figure| told[1].contains(figure)), "{figures:?} in {told:#?}");
            let sample = trace.between(15, 16).next().unwrap();
            let why = &sample.status.axes[0].why;
            assert!(figures.iter().all(|figure| why.cause.contains(figure)), "{why:?}");
            assert!(why.hint.as_ref().is_some_and(|hint| hint.contains("including the operator offset")));
            assert!(sample.status.alarms.iter().any(|alarm| alarm.id == "place of output cnc_z"));
        }
        let [.., armed, after] = &traces[..] else { panic!() };
        law::holds(armed);
        assert_eq!((armed.reported("armed"), armed.reported("place-confirmed")), (1, 1), "{}", armed.lines());
        assert!(armed.writes("cnc_z").iter().all(|(at, _)| armed.seconds(*at) >= 20.0));
        assert!(!armed.writes("cnc_z").is_empty(), "{end:?}: the person has confirmed it\n{}", armed.lines());
        assert_eq!((after.reported("output-moved"), after.reported("armed")), (0, 1), "{}", after.lines());
    }
}

#[test]
fn a_register_that_becomes_an_operators_waits_for_a_person() {
    let directory = tempfile::tempdir().unwrap();
    let traces = runs(directory.path(), &holds(0), vec![Run::of(BENCH), Run::of(shared())]);
    nothing_moved(&traces[1]);
    assert!((left(&traces[1]) - left(&traces[0])).abs() < 0.01);
    assert_eq!(
        (traces[1].reported("output-moved"), traces[1].reported("ledger-doubt")),
        (2, 1),
        "{}",
        traces[1].lines()
    );
}

#[test]
fn another_register_receives_nothing_while_the_former_one_keeps_its_value_and_that_is_named() {
    let elsewhere = || BENCH.replace("holding:104", "holding:106");
    for end in [End::Hold, End::Killed] {
        let directory = tempfile::tempdir().unwrap();
        let run = || Run::of(elsewhere()).ends(end);
        let all = vec![Run::of(BENCH).ends(end), run(), run(), run().armed(), run()];
        let traces = runs(directory.path(), &holds(0), all);
        let held = left(&traces[0]);
        assert!(held > 5.0, "{held}");
        for trace in &traces[1..3] {
            nothing_moved(trace);
            let [left] = &told(trace, "register-left")[..] else { panic!("{}", trace.lines()) };
            assert!(
                left.contains("µm from the gateway were verified in holding:104 (40105) of unit 1 at"),
                "{left}"
            );
            let moved = told(trace, "output-moved");
            assert!(moved[1].contains("output cnc_z has changed: from holding:104 (40105)"), "{moved:?}");
            let is = [" to holding:106 (40107); ", "; the register holds 0.0 µm now"];
            assert!(is.iter().all(|part| moved[1].contains(part)), "{moved:?}");
            let alarms = &trace.between(15, 16).next().unwrap().status.alarms;
            let is_raised = |id: &str| alarms.iter().any(|alarm| alarm.id == id);
            assert!(
                is_raised("former register of output cnc_z") && is_raised("place of output cnc_z"),
                "{alarms:?}"
            );
        }
        if end == End::Hold {
            let figure = format!("{held:.1} µm from the gateway");
            assert!(told(&traces[1], "register-left")[0].contains(&figure), "{}", traces[1].lines());
        }
        let [.., armed, after] = &traces[..] else { panic!() };
        law::holds(armed);
        let first = armed.writes("cnc_z")[0];
        assert!(first.1.abs() <= 1.0 && armed.seconds(first.0) >= 20.0, "it walks in from zero: {first:?}");
        assert_eq!(armed.reported("place-confirmed"), 1, "{}", armed.lines());
        let alarms = &armed.between(40, 41).next().unwrap().status.alarms;
        assert!(alarms.iter().all(|alarm| !alarm.id.ends_with("output cnc_z")), "{alarms:?}");
        assert_eq!(after.reported("register-left") + after.reported("output-moved"), 0, "{}", after.lines());
    }
}

#[test]
fn check_names_what_has_moved_beside_the_state_of_a_stopped_gateway() {
    let directory = tempfile::tempdir().unwrap();
    let trace = runs(directory.path(), &holds(0), vec![Run::of(BENCH)]).remove(0);
    assert_eq!(moved_since(directory.path(), &trace.profile), [""; 0]);
    let mut changed = trace.profile.clone();
    let place = changed.outputs.iter().position(|output| output.name == "cnc_z").unwrap();
    changed.outputs[place].share = isotherm_profile::Share::Ledger;
    changed.signals[0].encoding.offset = 5.0;
    let moved = moved_since(directory.path(), &changed);
    assert!(moved[0].contains("output cnc_z has changed: from share whole"), "{moved:#?}");
    changed.outputs.remove(place);
    let moved = moved_since(directory.path(), &changed);
    assert!(moved[0].contains("output cnc_z is no longer in the profile"), "{moved:#?}");
    assert!(
        moved[0].contains("from the gateway were verified in holding:104 (40105) of unit 1 at"),
        "{moved:#?}"
    );
    fs::write(directory.path().join("bench.state.json"), "{ half").unwrap();
    assert_eq!(moved_since(directory.path(), &changed), [""; 0], "what cannot be read says nothing");
}

#[test]
fn another_scale_waits_for_a_person_who_has_seen_the_value_in_both() {
    let directory = tempfile::tempdir().unwrap();
    let turned = BENCH.replace("scale = 0.1\nverify", "scale = -0.1\nverify");
    let traces = runs(directory.path(), &holds(0), vec![Run::of(BENCH), Run::of(turned)]);
    let held = left(&traces[0]);
    nothing_moved(&traces[1]);
    let moved = told(&traces[1], "output-moved");
    let figures =
        [format!("to scale -0.1; {held:.1} µm from the gateway"), format!("holds -{held:.1} µm now")];
    assert!(figures.iter().all(|figure| moved[1].contains(figure)), "{figures:?} in {moved:#?}");
    assert_eq!(traces[1].reported("register-left"), 0, "it is the same register");
}

#[test]
fn an_axis_that_was_switched_off_before_keeps_its_reason_while_a_place_is_in_doubt() {
    let directory = tempfile::tempdir().unwrap();
    let off = Handover {
        by: "by a test".to_owned(),
        armed: Default::default(),
        off: [("z".to_owned(), "switched off by a person".to_owned())].into(),
    };
    let elsewhere = BENCH.replace("holding:104", "holding:106");
    let traces = runs(directory.path(), &holds(0), vec![Run::of(BENCH), Run::of(elsewhere).kept(off)]);
    nothing_moved(&traces[1]);
    assert_eq!(traces[1].reported("output-moved"), 2, "{}", traces[1].lines());
    let why = &traces[1].between(15, 16).next().unwrap().status.axes[0].why;
    assert_eq!(why.cause, "switched off by a person");
}

#[test]
fn a_profile_that_has_its_former_place_again_is_in_no_doubt() {
    let directory = tempfile::tempdir().unwrap();
    let elsewhere = BENCH.replace("holding:104", "holding:106");
    let all = vec![Run::of(BENCH), Run::of(elsewhere), Run::of(BENCH)];
    let traces = runs(directory.path(), &holds(0), all);
    nothing_moved(&traces[1]);
    let back = &traces[2];
    law::holds(back);
    assert_eq!(
        (back.reported("armed"), back.reported("output-moved"), back.reported("register-left")),
        (1, 0, 0),
        "{}",
        back.lines()
    );
    assert!(
        back.lines().contains(&format!("armed, starting from {:.1} µm", left(&traces[0]))),
        "{}",
        back.lines()
    );
}

#[test]
fn an_output_that_is_removed_is_named_with_its_value_and_a_new_one_does_not_repeat_it() {
    let (before, after) = BENCH.split_once("[output.cnc_z]").unwrap();
    let (_, heartbeat) = after.split_once("[heartbeat]").unwrap();
    let removed = format!("{before}[heartbeat]{heartbeat}");
    let renamed = BENCH.replace("[output.cnc_z]", "[output.other]").replace("holding:104", "holding:106");
    let directory = tempfile::tempdir().unwrap();
    let traces = runs(directory.path(), &holds(0), vec![Run::of(BENCH), Run::of(removed)]);
    law::holds(&traces[1]);
    assert_eq!(traces[1].reported("register-left"), 1, "{}", traces[1].lines());
    assert_eq!(traces[1].states_between(15, 50), ["active"], "the readout goes on\n{}", traces[1].lines());
    let directory = tempfile::tempdir().unwrap();
    let all =
        vec![Run::of(BENCH), Run::of(renamed.clone()), Run::of(renamed.clone()), Run::of(renamed).armed()];
    let traces = runs(directory.path(), &holds(0), all);
    for trace in &traces[1..3] {
        law::holds(trace);
        assert_eq!(
            (trace.writes("other").len(), trace.reported("register-left")),
            (0, 1),
            "{}",
            trace.lines()
        );
    }
    assert_eq!(traces[3].reported("place-confirmed"), 1, "{}", traces[3].lines());
    assert!(!traces[3].writes("other").is_empty());
}

#[test]
fn an_output_that_comes_under_another_name_one_start_after_the_removal_waits_for_a_person() {
    let (before, after) = BENCH.split_once("[output.cnc_z]").unwrap();
    let (_, heartbeat) = after.split_once("[heartbeat]").unwrap();
    let removed = format!("{before}[heartbeat]{heartbeat}");
    let new =
        || Run::of(BENCH.replace("[output.cnc_z]", "[output.z2]").replace("holding:104", "holding:106"));
    for end in [End::Hold, End::Killed] {
        let directory = tempfile::tempdir().unwrap();
        let all = vec![Run::of(BENCH).ends(end), Run::of(removed.clone()), new(), new(), new().armed()];
        let traces = runs(directory.path(), &holds(0), all);
        assert!(left(&traces[0]) > 5.0);
        for trace in &traces[1..4] {
            law::holds(trace);
            assert_eq!(trace.reported("register-left"), 1, "{}", trace.lines());
        }
        for trace in &traces[2..4] {
            assert_eq!(trace.writes("z2").len(), 0, "{}", trace.lines());
            assert_eq!(trace.states_between(15, 18), ["off"], "{}", trace.lines());
        }
        assert_eq!(traces[4].reported("place-confirmed"), 1, "{}", traces[4].lines());
        assert!(traces[4].writes("z2").iter().all(|(at, _)| traces[4].seconds(*at) >= 20.0));
        assert!(!traces[4].writes("z2").is_empty());
    }
}

/// Bench with one model that measures the rise of the bed since the start, −4 µm for each degree.
fn rise() -> String {
    let (before, after) = BENCH.split_once("[[axis.z.model]]").unwrap();
    let (_, outputs) = after.split_once("[output.readout_z]").unwrap();
    let model = "[[axis.z.model]]\nname = \"rise\"\nkind = \"linear\"\n\
                 terms = [{ signal = \"bed\", gain = -4.0, reference = \"start\" }]\n";
    format!("{before}{model}\n[output.readout_z]{outputs}")
}

#[test]
fn the_reference_of_a_signal_that_has_moved_is_captured_again() {
    let directory = tempfile::tempdir().unwrap();
    let warmer = rise().replacen("scale = 0.1\nbad", "scale = 0.1\noffset = 5.0\nbad", 1);
    let all = vec![Run::of(rise()), Run::of(warmer.clone()), Run::of(warmer)];
    let traces = runs(directory.path(), &holds(0), all);
    for trace in &traces {
        law::holds(trace);
        let raw: Vec<f64> = trace.between(20, 59).filter_map(|sample| sample.status.axes[0].raw_um).collect();
        assert!(raw.len() > 30 && raw.iter().all(|raw| raw.abs() < 3.0), "{raw:?}\n{}", trace.lines());
        assert_eq!(trace.states_between(20, 59), ["active"], "{}", trace.lines());
    }
    let counts: Vec<usize> = traces.iter().map(|trace| trace.reported("reference-forgotten")).collect();
    assert_eq!(counts, [0, 1, 0], "{}", traces[1].lines());
    let told = &told(&traces[1], "reference-forgotten")[0];
    assert!(told.contains("signal bed has changed: from offset 0 to offset 5"), "{told}");
}

/// Bench with only the readout on its axis.
fn readout() -> String {
    let (before, after) = BENCH.split_once("[output.cnc_z]").unwrap();
    let (_, heartbeat) = after.split_once("[heartbeat]").unwrap();
    format!("{before}[heartbeat]{heartbeat}")
}

#[test]
fn a_register_that_was_only_read_is_not_called_ours_and_the_right_one_waits_for_nobody() {
    let unarmed = || Run::of(BENCH.replace("arm  = \"auto\"", "arm  = \"manual\""));
    let right = || Run::of(BENCH.replace("holding:104", "holding:106"));
    let (before, after) = BENCH.split_once("[output.cnc_z]").unwrap();
    let (_, heartbeat) = after.split_once("[heartbeat]").unwrap();
    let removed = || Run::of(format!("{before}[heartbeat]{heartbeat}"));
    let firsts = [
        unarmed,
        || Run::of(BENCH.replace("arm  = \"auto\"", "arm  = \"manual\"")).ends(End::Killed),
        || Run::of(BENCH).dry(),
    ];
    for (place, first) in firsts.into_iter().enumerate() {
        for next in [right(), removed()] {
            let directory = tempfile::tempdir().unwrap();
            let is_removed = !next.text.contains("cnc_z");
            let traces = runs(directory.path(), &holds(123), vec![first(), first(), next]);
            let [read, _, next] = &traces[..] else { panic!() };
            assert_eq!(read.writes("cnc_z").len(), 0, "{place}: {}", read.lines());
            assert!((left(read) - 12.3).abs() < 0.01, "{place}: it was read: {}", left(read));
            law::holds(next);
            assert_eq!(
                (next.reported("output-moved"), next.reported("register-left"), next.reported("armed")),
                (0, 0, 1),
                "{place}, {is_removed}: {}",
                next.lines()
            );
            if !is_removed {
                let first = next.writes("cnc_z")[0];
                assert!(first.1.abs() <= 1.0, "it walks in from what the new one holds: {first:?}");
            }
        }
    }
}

#[test]
fn an_output_with_another_name_at_its_place_continues_from_its_value_also_in_a_second_doubtful_place() {
    let named = |text: &str| Run::of(text.replace("[output.cnc_z]", "[output.feed_z]"));
    let elsewhere = BENCH.replace("holding:104", "holding:106");
    let directory = tempfile::tempdir().unwrap();
    let all = vec![Run::of(BENCH), named(BENCH), named(&elsewhere), Run::of(elsewhere.clone())];
    let traces = runs(directory.path(), &holds(0), all);
    let renamed = &traces[1];
    law::holds(renamed);
    let from = format!("armed, starting from {:.1} µm", left(&traces[0]));
    assert!(renamed.lines().contains(&from), "{from}\n{}", renamed.lines());
    assert!(renamed.lines().contains("armed before"), "{}", renamed.lines());
    assert_eq!(renamed.reported("output-moved") + renamed.reported("register-left"), 0);
    for (trace, name) in [(&traces[2], "feed_z"), (&traces[3], "cnc_z")] {
        law::holds(trace);
        assert_eq!(trace.writes(name).len(), 0, "{}", trace.lines());
        let moved = told(trace, "output-moved");
        let was = format!("output {name} has changed: from holding:104 (40105)");
        assert!(moved[0].contains(&was), "{was}: {moved:#?}");
    }
}

/// Difference between each write to the readout and the position, in µm of its register.
fn beside_the_position(trace: &Trace) -> Vec<(Moment, f64)> {
    let output = trace.profile.outputs.iter().find(|output| output.writes.position().is_some()).unwrap();
    let scale = trace.profile.signals.iter().find(|signal| signal.name == "scale_z").unwrap();
    let (mut position, mut found) = (None, Vec::new());
    for seen in &trace.wire {
        let is_at = |address: &Address| seen.address == *address;
        if seen.device == scale.device && !seen.is_write() && is_at(&scale.address) {
            position = scale.encoding.decode(&seen.after).ok().or(position);
        }
        if let Some((seen, position)) = law::of_output(seen, output).zip(position) {
            found.push((seen.at, 1000.0 * (output.encoding.decode(&seen.wanted).unwrap() - position)));
        }
    }
    found
}

#[test]
fn a_readout_moves_by_a_step_at_most_over_a_restart_whatever_has_changed() {
    let renamed = || readout().replace("axis.z", "axis.w").replace("axis = \"z\"", "axis = \"w\"");
    let armed = || Handover {
        by: "by a test".to_owned(),
        armed: [("z".to_owned(), Micron::new(8.0).unwrap())].into(),
        off: Default::default(),
    };
    let wide = || readout().replace("deadband = 0.1", "deadband = 0.1\ndiameter = true");
    let named = readout().replace("[output.readout_z]", "[output.display_z]");
    let rows: [(&str, String, f64); 5] = [
        ("nothing", readout(), 1.0),
        ("another name", named, 1.0),
        ("a smaller limit", readout().replace("limit = 40.0", "limit = 3.0"), 1.0),
        ("diameter", wide(), 2.0),
        ("another axis", renamed(), 1.0),
    ];
    for (what, text, factor) in rows {
        for (end, keep) in [(End::Hold, false), (End::Hold, true), (End::Killed, false)] {
            let directory = tempfile::tempdir().unwrap();
            let second = Run::of(text.clone());
            let second = if keep { second.kept(armed()) } else { second };
            let traces = runs(directory.path(), "", vec![Run::of(readout()).ends(end), second]);
            let before = beside_the_position(&traces[0]).last().unwrap().1;
            assert!(before > 5.0, "{before}\n{}", traces[0].lines());
            let mut last = before;
            let after = beside_the_position(&traces[1]);
            assert!(after.len() > 30, "{what}, {end:?}, {keep}: {}\n{}", after.len(), traces[1].lines());
            for (at, value) in &after {
                // The tolerance is one count of the scale and one of the register.
                let most = factor + 0.2;
                assert!(
                    (value - last).abs() <= most,
                    "{what}, {end:?}, {keep}: {last} → {value} at {:.1} s\n{}",
                    traces[1].seconds(*at),
                    traces[1].lines()
                );
                last = *value;
            }
            assert_eq!(traces[1].reported("position-from-zero"), 0, "{}", traces[1].lines());
            if what == "a smaller limit" {
                assert!((last - 3.0).abs() < 0.2, "{last}");
            }
        }
    }
}

#[test]
fn a_readout_of_which_no_state_is_accepted_begins_at_zero_and_that_is_an_event() {
    let directory = tempfile::tempdir().unwrap();
    let first = runs(directory.path(), "", vec![Run::of(readout())]).remove(0);
    assert!(beside_the_position(&first).last().unwrap().1 > 5.0);
    fs::write(directory.path().join("bench.state.json"), "{ half").unwrap();
    let again = runs(directory.path(), "", vec![Run::of(readout()).armed()]).remove(0);
    law::holds(&again);
    assert_eq!(again.reported("position-from-zero"), 1, "{}", again.lines());
    let after = beside_the_position(&again);
    assert!(
        after[0].1.abs() <= 0.2 && again.seconds(after[0].0) >= 20.0,
        "{:?}\n{}",
        after[0],
        again.lines()
    );
}

#[test]
fn a_module_without_checks_that_was_set_otherwise_between_two_runs_is_not_accepted() {
    let directory = tempfile::tempdir().unwrap();
    let degrees = "[[fault]]\ndevice = \"thermocouples\"\nkind = \"value\"\nsignal = \"bed\"\nvalue = 2.0\nat = \"60s\"\n";
    let traces = runs(directory.path(), degrees, vec![Run::of(BENCH), Run::of(BENCH)]);
    assert_eq!(traces[0].qualities("bed", 10, 55), ["good"], "{}", traces[0].lines());
    law::holds(&traces[1]);
    assert_eq!(traces[1].qualities("bed", 10, 55), ["jumped"], "{}", traces[1].lines());
    assert_eq!(
        (traces[1].reported("armed"), traces[1].writes("cnc_z").len()),
        (0, 0),
        "{}",
        traces[1].lines()
    );
}
