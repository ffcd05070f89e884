//! Document and number that were damaged, exchanged, copied or lost between two runs. Nothing moves before the operator
//! arms.

use std::fs;
use std::path::Path;
use std::time::Duration;

use isotherm::observe::status::Command;

use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, World, block_on};

const MINUTE: Duration = Duration::from_secs(60);
const STATE: &str = "bench.state.json";
const NUMBER: &str = "bench.number";

/// Bench whose offset stays in the register when the gateway ends.
fn held() -> String {
    BENCH.replace("action = \"ramp\", after = \"30s\"", "action = \"hold\"")
}

/// Copies all files of a directory, by name.
fn copy(from: &Path, to: &Path) {
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
    }
}

fn change(path: &Path, how: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = fs::read(path).unwrap();
    how(&mut bytes);
    fs::write(path, bytes).unwrap();
}

/// Offset of a text in a file. The text is part of its content and not of its seal.
fn place(bytes: &[u8], text: &str) -> usize {
    bytes.windows(text.len()).position(|window| window == text.as_bytes()).unwrap()
}

/// Two runs, one after another, and a third one after a change of their files. In the third run the operator arms after
/// half a minute.
struct Three {
    world: World,
    /// Directories as the first and the second run left them.
    left: [tempfile::TempDir; 2],
}

impl Three {
    async fn new() -> Three {
        let mut world = World::new(&held(), "").await;
        let left = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        for run in 0..2 {
            if run == 1 {
                copy(left[0].path(), left[1].path());
            }
            let directory = Some(left[run].path().to_owned());
            let trace = world.gateway().options(|options| options.directory = directory).run(MINUTE).await;
            assert!(trace.reported("not-believed") == 0 && left_um(&trace) > 5.0, "{}", trace.lines());
        }
        Three { world, left }
    }

    async fn after(&mut self, what: &str, harm: impl FnOnce(&Path, &Path)) -> Trace {
        let directory = tempfile::tempdir().unwrap();
        copy(self.left[1].path(), directory.path());
        harm(directory.path(), self.left[0].path());
        let state = Some(directory.path().to_owned());
        let trial = self.world.gateway().options(|options| options.directory = state);
        let trace = trial.command(MINUTE / 2, Command::Arm).run(MINUTE).await;
        law::holds(&trace);
        println!("{what}:\n{}", trace.lines());
        trace
    }
}

fn left_um(trace: &Trace) -> f64 {
    let output = trace.profile.outputs.iter().find(|output| output.name == "cnc_z").unwrap();
    let there = |seen: &&isotherm::virtual_machine::SeenRequest| {
        seen.device == output.device && seen.address == output.address && seen.count == 2
    };
    output.encoding.decode(&trace.wire.iter().rfind(there).unwrap().after).unwrap()
}

fn writes_before(trace: &Trace, span: Duration) -> usize {
    trace.writes("cnc_z").iter().filter(|(at, _)| *at < trace.begin.after(span)).count()
}

#[test]
fn whatever_was_done_to_the_files_nothing_is_moved_before_a_person_arms() {
    type Harm = (&'static str, fn(&Path, &Path));
    let harms: [Harm; 13] = [
        ("a bit of a reference", |here, _| {
            change(&here.join(STATE), |bytes| {
                let at = place(bytes, "\"verified_um\"") + 30;
                bytes[at] ^= 1;
            });
        }),
        ("a bit of an output", |here, _| {
            change(&here.join(STATE), |bytes| {
                let at = place(bytes, "\"stood\"") + 8;
                bytes[at] ^= 1;
            });
        }),
        ("a bit of the checksum", |here, _| {
            change(&here.join(STATE), |bytes| {
                let at = place(bytes, "\"checksum\"") + 13;
                bytes[at] ^= 2;
            });
        }),
        ("a space", |here, _| change(&here.join(STATE), |bytes| bytes[1] ^= 0x20)),
        ("half a document", |here, _| change(&here.join(STATE), |bytes| bytes.truncate(bytes.len() / 2))),
        ("an empty document", |here, _| fs::write(here.join(STATE), "").unwrap()),
        ("no document", |here, _| fs::remove_file(here.join(STATE)).unwrap()),
        ("a bit of the number", |here, _| change(&here.join(NUMBER), |bytes| bytes[0] ^= 1)),
        ("half a number", |here, _| change(&here.join(NUMBER), |bytes| bytes.truncate(bytes.len() / 2))),
        ("no number", |here, _| fs::remove_file(here.join(NUMBER)).unwrap()),
        ("neither, but the logs", |here, _| {
            fs::remove_file(here.join(STATE)).unwrap();
            fs::remove_file(here.join(NUMBER)).unwrap();
        }),
        ("the document of another day", |here, before| {
            fs::copy(before.join(STATE), here.join(STATE)).unwrap();
        }),
        ("the number of another day", |here, before| {
            fs::copy(before.join(NUMBER), here.join(NUMBER)).unwrap();
        }),
    ];
    block_on(async {
        let mut three = Three::new().await;
        for (what, harm) in harms {
            let trace = three.after(what, harm).await;
            assert_eq!(writes_before(&trace, MINUTE / 2), 0, "{what}\n{}", trace.lines());
            assert!(trace.reported("not-believed") > 0, "{what}\n{}", trace.lines());
            assert_eq!(trace.states_between(5, 29), ["off"], "{what}\n{}", trace.lines());
            let why = trace.between(20, 21).next().unwrap().status.axes[0].why.to_string();
            assert!(
                why.contains("saved state was rejected") && why.contains("arm the axis again"),
                "{what}: {why}"
            );
            assert_eq!(trace.states_between(50, 59), ["active"], "{what}\n{}", trace.lines());
        }
        let trace = three.after("nothing was done", |_, _| ()).await;
        assert_eq!(trace.reported("not-believed"), 0, "{}", trace.lines());
        assert_eq!(trace.states_between(10, 29), ["active"], "{}", trace.lines());
    });
}

#[test]
fn the_state_of_another_machine_is_not_believed() {
    let elsewhere = tempfile::tempdir().unwrap();
    block_on(async {
        let mut other = World::new(&held(), "").await;
        // The other machine has the same name, and was begun at another time.
        other.wait(MINUTE).await;
        let directory = Some(elsewhere.path().to_owned());
        other.gateway().options(|options| options.directory = directory).run(5 * MINUTE).await;
        let mut three = Three::new().await;
        for name in [STATE, NUMBER] {
            let elsewhere = elsewhere.path().join(name);
            let harm = |here: &Path, _: &Path| assert!(fs::copy(elsewhere, here.join(name)).is_ok());
            let trace = three.after(name, harm).await;
            assert_eq!(writes_before(&trace, MINUTE / 2), 0, "{}", trace.lines());
            assert!(trace.lines().contains("a copy from elsewhere"), "{}", trace.lines());
        }
    });
}

#[test]
fn what_was_not_believed_stays_a_question_over_a_restart() {
    let directory = tempfile::tempdir().unwrap();
    block_on(async {
        let mut world = World::new(&held(), "").await;
        let state = Some(directory.path().to_owned());
        let mut run = async |commands: &[Command]| {
            let trial = world.gateway().options(|options| options.directory = state.clone());
            let trial = commands.iter().fold(trial, |trial, command| trial.command(MINUTE / 2, *command));
            trial.run(MINUTE).await
        };
        run(&[]).await;
        change(&directory.path().join(STATE), |bytes| bytes.truncate(99));
        for _ in 0..2 {
            let trace = run(&[]).await;
            assert_eq!(trace.states_between(5, 59), ["off"], "{}", trace.lines());
            assert_eq!(trace.writes("cnc_z").len(), 0);
        }
        let kept = fs::read(directory.path().join("bench.state.json.bad")).unwrap();
        assert_eq!(kept.len(), 99);
        assert_eq!(run(&[Command::Arm]).await.states_between(50, 59), ["active"]);
        assert_eq!(run(&[]).await.states_between(20, 59), ["active"]);
    });
}

#[test]
fn with_everything_lost_a_shared_register_that_holds_ours_waits_for_a_person() {
    let text = held().replace("refresh = \"10s\"", "refresh = \"10s\"\nshare = \"ledger\"");
    let directory = tempfile::tempdir().unwrap();
    let [first, again] = block_on(async {
        let mut world = World::new(&text, "").await;
        let state = Some(directory.path().join("state"));
        let first = world.gateway().options(|options| options.directory = state.clone()).run(MINUTE).await;
        fs::remove_dir_all(directory.path().join("state")).unwrap();
        let trial = world.gateway().options(|options| options.directory = state);
        [first, trial.command(MINUTE, Command::Arm).run(2 * MINUTE).await]
    });
    let ours = left_um(&first);
    assert!((5.0..12.0).contains(&ours), "{ours}\n{}", first.lines());
    assert_eq!(writes_before(&again, MINUTE), 0, "{}", again.lines());
    assert_eq!(again.states_between(5, 59), ["off"], "{}", again.lines());
    assert_eq!(again.reported("first-account"), 1, "{}", again.lines());
    let event = again.events.iter().find(|event| event.kind == "first-account").unwrap();
    assert!(event.text.contains(&format!("{ours:.1} µm")), "{}", event.text);
}
