//! A register that no output uses any more, and that an operator releases. It returns to its base, and nothing else
//! moves.

use std::cell::RefCell;
use std::path::Path;
use std::time::Duration;

use isotherm::observe::status::{Answer, Command, ReleaseProgress, ReleaseRequest};
use isotherm_core::codec::{Address, Register, Table};

use crate::faults::rig::{BENCH, Stage, Trace, World, block_on, profile, somebody};

const MINUTE: Duration = Duration::from_secs(60);
/// Time at which the operator releases the register.
const RELEASED: Duration = Duration::from_secs(30);
/// Time at which the operator arms.
const ARMED: Duration = Duration::from_secs(20);
const FORMER: u16 = 104;

/// End of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    Hold,
    FaultAction,
    Killed,
}

/// One command of the operator, with its time.
type Act = (Duration, fn(&Stage<'_>) -> Result<Answer, String>);

struct Run {
    text: String,
    span: Duration,
    end: End,
    acts: Vec<Act>,
    is_dry: bool,
}

impl Run {
    fn of(text: impl Into<String>) -> Run {
        Run { text: text.into(), span: MINUTE, end: End::Hold, acts: Vec::new(), is_dry: false }
    }

    fn ends(self, end: End) -> Run {
        Run { end, ..self }
    }

    fn lasts(self, span: Duration) -> Run {
        Run { span, ..self }
    }

    fn dry(self) -> Run {
        Run { is_dry: true, ..self }
    }

    fn act(mut self, after: Duration, act: fn(&Stage<'_>) -> Result<Answer, String>) -> Run {
        self.acts.push((after, act));
        self
    }

    fn armed(self) -> Run {
        self.act(ARMED, |stage| stage.source.command(Command::Arm, None, &somebody()))
    }

    fn released(self) -> Run {
        self.act(RELEASED, release)
    }
}

/// The operator looks at what is left of the output, and releases it.
fn release(stage: &Stage<'_>) -> Result<Answer, String> {
    let left = stage.source.status().left;
    let can = left.iter().filter(|left| left.output == "cnc_z" && left.obstacle.is_none());
    let seen: Vec<f64> = can.map(|left| left.found_um.unwrap_or(left.held_um)).collect();
    stage.source.release("cnc_z", ReleaseRequest::Back(&seen), &somebody())
}

/// Runs one profile after another on the same machine and in the same directory. Also returns the answers to the
/// operator.
fn runs(directory: &Path, faults: &str, runs: Vec<Run>) -> (Vec<Trace>, Vec<Result<Answer, String>>) {
    let said = RefCell::new(Vec::new());
    let traces = block_on(async {
        let mut world = World::new(&text_of(&runs[0]), faults).await;
        let mut traces = Vec::new();
        for run in runs {
            let mut changed = profile(&text_of(&run));
            for (bus, before) in changed.buses.iter_mut().zip(&world.profile.buses) {
                bus.address.clone_from(&before.address);
            }
            world.profile = changed;
            let mut trial = world.gateway().options(|options| {
                options.directory = Some(directory.to_owned());
                options.dry_run = run.is_dry;
            });
            for (after, act) in run.acts {
                let said = &said;
                trial = trial.at(after, move |stage| said.borrow_mut().push(act(stage)));
            }
            traces.push(match run.end {
                End::Killed => trial.killed_after(run.span).await,
                End::Hold | End::FaultAction => trial.run(run.span).await,
            });
        }
        traces
    });
    (traces, said.into_inner())
}

fn text_of(run: &Run) -> String {
    match run.end {
        End::Hold => run.text.replace("arm  = \"auto\"", "arm  = \"auto\"\non_stop = \"hold\""),
        End::FaultAction | End::Killed => run.text.clone(),
    }
}

fn moved() -> String {
    BENCH.replace("holding:104", "holding:106")
}

/// Bench without the output. Its readout stays.
fn removed() -> String {
    let (before, after) = BENCH.split_once("[output.cnc_z]").unwrap();
    let (_, heartbeat) = after.split_once("[heartbeat]").unwrap();
    format!("{before}[heartbeat]{heartbeat}")
}

fn shared(text: &str) -> String {
    text.replace("refresh = \"10s\"", "refresh = \"10s\"\nshare = \"ledger\"")
}

/// Fault script that sets the register to this number of counts at this time. More registers exist after it.
fn holds(counts: i32, at: &str) -> String {
    let [a, b, c, d] = counts.to_be_bytes();
    let words = [u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d])];
    let fault = |register: u16, words: [u16; 2], at: &str| {
        format!(
            "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"holding:{register}\"\nwords = {words:?}\nat = \"{at}\"\n"
        )
    };
    fault(FORMER, words, at) + &fault(110, [0, 0], "0s")
}

/// One access to the former register: seconds of the run, value before and after it in µm, and whether it was written.
type Access = (f64, f64, f64, bool);

fn accesses(trace: &Trace) -> Vec<Access> {
    let bench = profile(BENCH);
    let output = bench.outputs.iter().find(|output| output.name == "cnc_z").unwrap();
    let former = Address::from(Register { table: Table::Holding, offset: FORMER });
    let value = |words: &[u16]| output.encoding.decode(words).unwrap();
    let here = trace.wire.iter().filter(|seen| {
        let is_at = seen.address == former && seen.count == 2 && seen.before.len() == 2;
        seen.device == output.device && is_at
    });
    here.map(|seen| (trace.seconds(seen.at), value(&seen.before), value(&seen.after), seen.is_write()))
        .collect()
}

/// Value of the former register when it was accessed last, µm.
fn left(trace: &Trace) -> f64 {
    accesses(trace).last().unwrap().2
}

/// Writes to the former register.
fn writes(trace: &Trace) -> Vec<Access> {
    accesses(trace).into_iter().filter(|(.., is_write)| *is_write).collect()
}

/// Checks that the former register moves from one value towards the other. The steps are at most 1 µm, without a pause
/// and no faster than 0.5 µm/s.
#[track_caller]
fn walks(trace: &Trace, from: f64, to: f64) {
    let writes = writes(trace);
    assert!(!writes.is_empty(), "{}", trace.lines());
    let mut at = from;
    for (seconds, before, after, _) in &writes {
        assert!((before - at).abs() < 0.05, "{before} instead of {at} at {seconds:.1} s\n{}", trace.lines());
        assert!(
            (after - before).abs() <= 1.0 + 1e-6,
            "{before} → {after} at {seconds:.1} s\n{}",
            trace.lines()
        );
        assert!(
            (after - to).abs() < (before - to).abs(),
            "{before} → {after}: away from {to}\n{}",
            trace.lines()
        );
        at = *after;
    }
    let (first, last) = (writes[0].0, writes[writes.len() - 1].0);
    let way = (writes[0].1 - at).abs();
    assert!(last - first >= (way - 1.0) / 0.5 - 1.0, "{way} µm in {:.1} s", last - first);
}

/// Texts of the events of a kind.
fn told(trace: &Trace, kind: &str) -> Vec<String> {
    trace.events.iter().filter(|event| event.kind == kind).map(|event| event.text.clone()).collect()
}

fn alarms(trace: &Trace) -> Vec<String> {
    trace.samples.last().unwrap().status.alarms.iter().map(|alarm| alarm.id.clone()).collect()
}

#[track_caller]
fn done(said: &Result<Answer, String>) -> &str {
    match said {
        Ok(Answer::Done(text)) => text,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_former_register_goes_back_to_its_base_in_steps_and_the_new_one_stays_untouched() {
    for end in [End::Hold, End::FaultAction] {
        let directory = tempfile::tempdir().unwrap();
        let all = vec![
            Run::of(BENCH),
            Run::of(moved()).released(),
            Run::of(moved()).lasts(3 * MINUTE).ends(end),
            Run::of(moved()),
        ];
        let (traces, said) = runs(directory.path(), &holds(0, "0s"), all);
        let [before, asked, back, after] = &traces[..] else { panic!() };
        let held = left(before);
        assert!(held > 5.0, "{held}");
        assert_eq!(said.len(), 1);
        let text = done(&said[0]);
        assert!(text.contains(&format!("{held:.1} µm in holding:104 (40105) of unit 1")), "{text}");
        let hint = &told(asked, "register-left")[0];
        assert!(hint.contains("isotherm release bench.toml cnc_z"), "{hint}");
        assert_eq!(accesses(asked).len(), 0, "it begins with the next start\n{}", asked.lines());
        let state = |trace: &Trace| trace.samples.last().unwrap().status.left.first().map(|left| left.state);
        assert_eq!(state(asked), Some(ReleaseProgress::Asked));
        walks(back, held, 0.0);
        assert!(left(back).abs() < 1e-9, "{end:?}: {}", left(back));
        assert_eq!(
            (back.reported("register-released"), back.reported("register-left")),
            (1, 0),
            "{}",
            back.lines()
        );
        assert_eq!(told(back, "armed").len(), 1, "{}", back.lines());
        assert!(told(back, "armed")[0].contains("release_cnc_z"), "{}", back.lines());
        assert_eq!(back.writes("cnc_z").len(), 0, "the new output waits for a person\n{}", back.lines());
        assert_eq!(back.states_between(15, 100), ["off"], "{}", back.lines());
        assert_eq!(state(back), None, "nothing is left");
        let alarms = alarms(back);
        assert!(!alarms.contains(&"former register of output cnc_z".to_owned()), "{alarms:?}");
        assert!(alarms.contains(&"place of output cnc_z".to_owned()), "{alarms:?}");
        // The next start does not have this axis, and the new place still waits for the operator.
        assert_eq!(accesses(after).len(), 0, "{}", after.lines());
        assert_eq!(
            (after.reported("output-moved"), after.reported("register-left")),
            (2, 0),
            "{}",
            after.lines()
        );
        assert!(after.samples.last().unwrap().status.axes.iter().all(|axis| axis.name == "z"));
    }
}

#[test]
fn the_register_of_a_removed_output_goes_back_while_the_readout_goes_on() {
    let directory = tempfile::tempdir().unwrap();
    let back = || Run::of(removed()).lasts(3 * MINUTE);
    let all = vec![Run::of(BENCH), Run::of(removed()).released(), back(), Run::of(removed())];
    let (traces, said) = runs(directory.path(), &holds(0, "0s"), all);
    let held = left(&traces[0]);
    done(&said[0]);
    walks(&traces[2], held, 0.0);
    assert!(left(&traces[2]).abs() < 1e-9, "{}", left(&traces[2]));
    assert_eq!(traces[2].states_between(15, 170), ["active"], "the readout goes on\n{}", traces[2].lines());
    let shown = &traces[2].between(40, 41).next().unwrap().status;
    assert!(shown.outputs.iter().any(|output| output.name == "cnc_z" && output.axis == "release_cnc_z"));
    assert!(shown.missing().is_empty(), "the machine lacks nothing: {:?}", shown.missing());
    assert_eq!(traces[2].reported("register-released"), 1, "{}", traces[2].lines());
    assert_eq!(accesses(&traces[3]).len() + traces[3].reported("register-left"), 0, "{}", traces[3].lines());
}

#[test]
fn the_operators_part_of_a_shared_register_stays() {
    let directory = tempfile::tempdir().unwrap();
    let elsewhere = || shared(&moved());
    let all = vec![
        Run::of(shared(BENCH)).armed(),
        Run::of(elsewhere()).released(),
        Run::of(elsewhere()).lasts(3 * MINUTE),
    ];
    let (traces, said) = runs(directory.path(), &holds(200, "0s"), all);
    let held = left(&traces[0]);
    assert!(held - 20.0 > 5.0, "{held}");
    assert!(done(&said[1]).contains(&format!("{:.1} µm in holding:104", held - 20.0)), "{said:?}");
    walks(&traces[2], held, 20.0);
    assert!((left(&traces[2]) - 20.0).abs() < 1e-9, "{}\n{}", left(&traces[2]), traces[2].lines());
    assert_eq!(traces[2].reported("register-released"), 1, "{}", traces[2].lines());
    assert_eq!(traces[2].reported("foreign-change"), 0, "{}", traces[2].lines());
    // Only the division of the new register must be confirmed by the operator.
    let doubts = told(&traces[2], "ledger-doubt");
    assert!(doubts.iter().all(|doubt| doubt.starts_with("output cnc_z: ")), "{doubts:?}");
}

#[test]
fn a_release_that_was_killed_in_the_middle_is_over_and_a_person_releases_the_rest() {
    for text in [moved(), removed(), shared(&moved())] {
        let directory = tempfile::tempdir().unwrap();
        let is_shared = text.contains("ledger");
        let (first, base) = if is_shared { (shared(BENCH), 20.0) } else { (BENCH.to_owned(), 0.0) };
        let again = || Run::of(text.clone()).released();
        let all = vec![
            Run::of(first).armed(),
            again(),
            Run::of(text.clone()).lasts(Duration::from_secs(10)).ends(End::Killed),
            again(),
            // The last verified value may be some seconds old. The operator then sees the register value, and releases
            // it once more.
            again(),
            Run::of(text.clone()).lasts(4 * MINUTE),
        ];
        let (traces, said) = runs(directory.path(), &holds(if is_shared { 200 } else { 0 }, "0s"), all);
        done(&said[1]);
        let mut at = left(&traces[0]);
        for (run, trace) in traces.iter().enumerate().filter(|(_, trace)| !writes(trace).is_empty()).skip(1) {
            walks(trace, at, base);
            at = left(trace);
            let is_killed = at - base > 0.5 && at < left(&traces[0]) - 0.5;
            assert!(run != 2 || is_killed, "in the middle: {at}");
        }
        assert!((at - base).abs() < 1e-9, "{at}\n{}", traces[5].lines());
        assert_eq!(accesses(&traces[3]).len(), 0, "nothing resumes by itself\n{}", traces[3].lines());
        assert_eq!(traces[3].reported("register-left"), 1, "{}", traces[3].lines());
        let reported: usize = traces[2..].iter().map(|trace| trace.reported("register-released")).sum();
        assert_eq!(reported, 1, "{}", traces[5].lines());
    }
}

#[test]
fn an_operator_who_has_taken_ours_out_of_a_shared_register_keeps_his_part() {
    let directory = tempfile::tempdir().unwrap();
    let elsewhere = || shared(&moved());
    let all = vec![
        Run::of(shared(BENCH)).armed(),
        Run::of(elsewhere()).released(),
        Run::of(elsewhere()).lasts(2 * MINUTE),
    ];
    // The edit comes more than one minute after the start, when the operator has already released the register.
    let faults = holds(200, "0s") + &holds(200, "110s");
    let (traces, said) = runs(directory.path(), &faults, all);
    assert!(left(&traces[0]) > 25.0, "{}", left(&traces[0]));
    done(&said[1]);
    assert_eq!(writes(&traces[2]).len(), 0, "{}", traces[2].lines());
    assert!((left(&traces[2]) - 20.0).abs() < 1e-9);
    let why = &told(&traces[2], "arm-refused")[0];
    assert!(why.contains("the operator offset was 20.0"), "{why}");
    assert_eq!(traces[2].reported("register-released"), 0, "{}", traces[2].lines());
}

#[test]
fn another_value_than_a_person_has_seen_is_left_alone_until_a_person_has_seen_it() {
    let directory = tempfile::tempdir().unwrap();
    let all = vec![
        Run::of(BENCH),
        Run::of(moved()).released(),
        Run::of(moved()).act(MINUTE / 2, release),
        Run::of(moved()).lasts(2 * MINUTE),
    ];
    let faults = holds(0, "0s") + &holds(50, "100s");
    let (traces, said) = runs(directory.path(), &faults, all);
    let held = left(&traces[0]);
    assert!(held > 6.5, "{held}");
    let refused = &traces[2];
    assert_eq!(writes(refused).len(), 0, "{}", refused.lines());
    assert!((left(refused) - 5.0).abs() < 1e-9);
    let why = &told(refused, "arm-refused")[0];
    let figures = ["holds 5.0 µm", &format!("{held:.1} µm from the gateway were expected")];
    assert!(figures.iter().all(|figure| why.contains(figure)), "{figures:?} in {why}");
    assert_eq!(refused.reported("register-left"), 1, "{}", refused.lines());
    let shown = &refused.between(20, 21).next().unwrap().status.left[0];
    assert_eq!((shown.state, shown.found_um.map(f64::round)), (ReleaseProgress::Left, Some(5.0)));
    assert!((shown.held_um - held).abs() < 0.05);
    // The operator has seen it, and releases it once more.
    assert!(done(&said[1]).contains("5.0 µm in holding:104"), "{said:?}");
    walks(&traces[3], 5.0, 0.0);
    assert_eq!((left(&traces[3]).abs() < 1e-9, traces[3].reported("register-released")), (true, 1));
}

#[test]
fn what_cannot_be_released_is_refused_with_the_reason_and_moves_nothing() {
    let unknown = |stage: &Stage<'_>| stage.source.release("nothing", ReleaseRequest::Back(&[]), &somebody());
    let present =
        |stage: &Stage<'_>| stage.source.release("readout_z", ReleaseRequest::Back(&[]), &somebody());
    let other = |stage: &Stage<'_>| stage.source.release("cnc_z", ReleaseRequest::Back(&[1.5]), &somebody());
    let refused = |said: &Result<Answer, String>, words: &[&str]| {
        let why = said.as_ref().unwrap_err();
        assert!(words.iter().all(|word| why.contains(word)), "{words:?} in {why}");
    };
    let second = |second: u64| Duration::from_secs(second);
    let directory = tempfile::tempdir().unwrap();
    let all = vec![
        Run::of(BENCH).act(second(30), release),
        Run::of(moved()).act(second(10), unknown).act(second(20), present).act(second(30), other),
        Run::of(moved()).dry().released(),
    ];
    let (traces, said) = runs(directory.path(), &holds(0, "0s"), all);
    refused(&said[0], &["output cnc_z: there is nothing to release", "isotherm status"]);
    refused(&said[1], &["there is nothing to release", "isotherm status"]);
    refused(&said[2], &["output readout_z: there is nothing to release"]);
    refused(&said[3], &["a former register of output cnc_z has changed", "check the value"]);
    refused(&said[4], &["dry run"]);
    assert!(traces[1..].iter().all(|trace| accesses(trace).is_empty()));
    assert_eq!(traces[1].reported("command-refused"), 3, "{}", traces[1].lines());

    // The interlock has a signal that the profile does not have any more.
    let directory = tempfile::tempdir().unwrap();
    let renamed = moved().replace("cnc_on", "cnc_runs");
    let (traces, said) =
        runs(directory.path(), &holds(0, "0s"), vec![Run::of(BENCH), Run::of(renamed).released()]);
    refused(
        &said[0],
        &["cannot be released", "the interlock cnc_on == 1 of this register", "set that register to zero"],
    );
    let hint = &told(&traces[1], "register-left")[0];
    assert!(
        hint.contains(
            "`isotherm release` cannot remove the value: the interlock cnc_on == 1 of this register"
        ),
        "{hint}"
    );
}

#[test]
fn a_person_may_ask_twice_and_is_told_while_it_goes_back() {
    let directory = tempfile::tempdir().unwrap();
    let second = |second: u64| Duration::from_secs(second);
    let all = vec![
        Run::of(BENCH),
        Run::of(moved()).act(second(20), release).act(second(40), release),
        Run::of(moved()).lasts(3 * MINUTE).act(second(8), release).act(second(170), release),
    ];
    let (traces, said) = runs(directory.path(), &holds(0, "0s"), all);
    assert_eq!(done(&said[0]), done(&said[1]), "it is noted once");
    let why = said[2].as_ref().unwrap_err();
    assert!(why.contains("is already returning to its base value"), "{why}");
    let why = said[3].as_ref().unwrap_err();
    assert!(why.contains("output cnc_z: there is nothing to release"), "{why}");
    walks(&traces[2], left(&traces[0]), 0.0);
    assert_eq!(traces[2].reported("register-released"), 1);
}

#[test]
fn a_person_can_end_a_release_and_nobody_else_arms_its_axis() {
    let directory = tempfile::tempdir().unwrap();
    let second = |second: u64| Duration::from_secs(second);
    let disarm =
        |stage: &Stage<'_>| stage.source.command(Command::Disarm, Some("release_cnc_z"), &somebody());
    let arm = |stage: &Stage<'_>| stage.source.command(Command::Arm, Some("release_cnc_z"), &somebody());
    let all_armed = |stage: &Stage<'_>| stage.source.command(Command::Arm, None, &somebody());
    let all = vec![
        Run::of(BENCH),
        Run::of(removed()).released(),
        Run::of(removed()).act(second(8), disarm).act(second(20), arm).act(second(30), all_armed),
        Run::of(removed()),
    ];
    let (traces, said) = runs(directory.path(), &holds(0, "0s"), all);
    done(&said[1]);
    assert!(said[2].as_ref().unwrap_err().contains("only returns a register"), "{said:?}");
    let all = done(&said[3]);
    assert!(
        all.starts_with("z: armed") && !all.contains("release_"),
        "all axes are those of the profile: {all}"
    );
    let ended = &traces[2];
    assert!(writes(ended).iter().all(|(seconds, ..)| *seconds <= 9.0), "{}", ended.lines());
    let stays = left(ended);
    assert!(stays > 1.0 && stays < left(&traces[0]) - 0.5, "{stays}");
    assert_eq!(ended.reported("register-released"), 0, "{}", ended.lines());
    // A write that was under way when the operator ended the release counts as well.
    let named = told(ended, "register-left");
    assert!(named.last().unwrap().contains(&format!("{stays:.1} µm from the gateway")), "{}", ended.lines());
    let shown = &ended.samples.last().unwrap().status.left[0];
    assert!((shown.held_um - stays).abs() < 0.05 && shown.state == ReleaseProgress::Left, "{shown:?}");
    // The register is reported again, and nothing continues by itself.
    assert_eq!(accesses(&traces[3]).len(), 0, "{}", traces[3].lines());
    let again = &told(&traces[3], "register-left")[..];
    assert!(matches!(again, [one] if one.contains(&format!("{stays:.1} µm from the gateway"))), "{again:?}");
}
