//! State and ledger that version f2a36f8a has written become one document. The axes resume, and the files are kept.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::faults::law;
use crate::faults::rig::{Trace, World, block_on};

const MACHINE: &str = include_str!("../earlier/mixed.toml");
const MINUTE: Duration = Duration::from_secs(60);

/// Files that this version has left: after a stop in order, or killed while it wrote to the shared register.
fn left(how: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/gateway/earlier").join(how)
}

fn copied(how: &str) -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(left(how)).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), directory.path().join(entry.file_name())).unwrap();
    }
    directory
}

/// Registers as this version left them.
fn registers(whole: u16, shared: u16) -> String {
    let holds = |register: u32, words: &str| {
        format!(
            "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"holding:{register}\"\nwords = [{words}]\nat = \"0s\"\n"
        )
    };
    holds(100, &format!("0, {whole}")) + &holds(104, &format!("0, {shared}")) + &holds(111, "52, 62")
}

/// Runs the gateway twice in this directory.
fn runs(directory: &Path, faults: &str) -> [Trace; 2] {
    block_on(async {
        let mut world = World::new(MACHINE, faults).await;
        let state = || Some(directory.to_owned());
        let first = world.gateway().options(|options| options.directory = state()).run(MINUTE).await;
        [first, world.gateway().options(|options| options.directory = state()).run(MINUTE).await]
    })
}

fn base(trace: &Trace) -> f64 {
    let sample = trace.between(50, 51).next().unwrap();
    let output = sample.status.outputs.iter().find(|output| output.name == "shared").unwrap();
    output.shares.as_ref().unwrap().base
}

#[test]
fn what_an_earlier_version_left_is_taken_once_and_kept_beside() {
    for (how, whole, shared) in [("stopped", 32, 1232), ("killed", 92, 1352)] {
        let directory = copied(how);
        let here = |name: &str| directory.path().join(name);
        let traces = runs(directory.path(), &registers(whole, shared));
        for (trace, taken) in traces.iter().zip([1, 0]) {
            law::holds(trace);
            let lines = trace.lines();
            assert_eq!(trace.reported("taken-from-earlier"), taken, "{how}\n{lines}");
            assert_eq!(trace.reported("default-limits"), taken, "{how}\n{lines}");
            for kind in ["not-believed", "operator-change", "ledger-doubt", "first-account", "foreign-change"]
            {
                assert_eq!(trace.reported(kind), 0, "{how}: {kind}\n{lines}");
            }
            assert_eq!(trace.states_between(50, 59), ["active"], "{how}\n{lines}");
            assert!((base(trace) - 120.0).abs() < 0.05, "{how}: {}\n{lines}", base(trace));
        }
        for (name, beside) in
            [("mixed.state.json", "mixed.state.v4.json"), ("mixed.ledger.json", "mixed.ledger.v3.json")]
        {
            assert_eq!(fs::read(here(beside)).unwrap(), fs::read(left(how).join(name)).unwrap());
        }
        assert!(!here("mixed.ledger.json").exists() && here("mixed.number").exists());
        assert!(fs::read_to_string(here("mixed.state.json")).unwrap().starts_with("{ \"version\": 6,"));
    }
}

#[test]
fn a_value_that_an_earlier_version_sent_last_is_known_in_its_shared_register() {
    let directory = copied("killed");
    let [trace, _] = runs(directory.path(), &registers(92, 1292));
    law::holds(&trace);
    assert_eq!(trace.reported("ledger-doubt"), 1, "{}", trace.lines());
    assert!(trace.lines().contains("a very late write of the gateway"), "{}", trace.lines());
}

#[test]
fn an_earlier_pair_that_does_not_fit_is_not_taken() {
    type Harm = (&'static str, fn(&Path));
    let harms: [Harm; 4] = [
        ("no ledger", |here| fs::remove_file(here.join("mixed.ledger.json")).unwrap()),
        ("the state of another day", |here| {
            fs::copy(left("stopped").join("mixed.state.json"), here.join("mixed.state.json")).unwrap();
            fs::copy(left("killed").join("mixed.ledger.json"), here.join("mixed.ledger.json")).unwrap();
        }),
        ("a bit of the ledger", |here| {
            let text = fs::read_to_string(here.join("mixed.ledger.json")).unwrap();
            fs::write(here.join("mixed.ledger.json"), text.replace("152", "153")).unwrap();
        }),
        ("an earlier layout", |here| fs::write(here.join("mixed.state.json"), "{ \"version\": 3 }").unwrap()),
    ];
    for (what, harm) in harms {
        let directory = copied("killed");
        harm(directory.path());
        let [first, again] = runs(directory.path(), &registers(92, 1352));
        assert_eq!(
            (first.reported("not-believed"), again.reported("not-believed")),
            (1, 0),
            "{what}\n{}",
            first.lines()
        );
        for trace in [first, again] {
            law::holds(&trace);
            assert_eq!(trace.reported("taken-from-earlier"), 0, "{what}");
            assert_eq!(trace.states_between(20, 59), ["off"], "{what}\n{}", trace.lines());
            assert_eq!(trace.writes("whole").len() + trace.writes("shared").len(), 0, "{what}");
        }
    }
}
