//! Machine of these tests, with the gateway in this process, or as the program that an operator starts.

use std::path::{Path, PathBuf};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::Options;
use isotherm::observe::status::{GatewayApi, Status};

use crate::late_writes::control::{Shared, serve};
use crate::late_writes::device::gateway::{self, events, reported};
use crate::late_writes::process::{PATIENCE, Running, file, isotherm};

const PROFILE: &str = r#"
[machine]
name = "held"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "200ms"
late = "LATE"
[device.cnc]
bus = "cell"
unit = 1
every = "250ms"
[signal.bed]
device = "cnc"
register = "holding:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "3s"
max_rate = "none"
[axis.z]
limit = 40.0
step = 1.0
rate = 100.0
every = "250ms"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "one"
kind = "linear"
terms = [ { signal = "bed", gain = 1.0, reference = 20.0 } ]
"#;

const OUTPUT: &str = r#"
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:10"
type = "i16"
scale = 0.1
"#;

pub(crate) const LEDGER: &str = "share = \"ledger\"\n";
/// Two outputs in one request, with a heartbeat, a control word and a sequence.
pub(crate) const SET: &str = r#"set = "block"
refresh = "500ms"
[axis.y]
limit = 40.0
step = 1.0
rate = 100.0
every = "250ms"
on_fault = { action = "hold" }
[[axis.y.model]]
name = "one"
kind = "linear"
terms = [ { signal = "bed", gain = -1.0, reference = 20.0 } ]
[output.cnc_y]
axis = "y"
device = "cnc"
writes = "offset"
register = "holding:11"
type = "i16"
scale = 0.1
set = "block"
[set.block]
heartbeat = "holding:12"
control = "holding:13"
sequence = "holding:14"
"#;

/// Profile of a machine with an offset. `more` are further keys of the output.
pub(crate) fn profile_of(control: &Shared, late: &str, more: &str) -> String {
    machine(control, late) + OUTPUT + more
}

/// Profile of a machine without an output.
pub(crate) fn machine(control: &Shared, late: &str) -> String {
    PROFILE.replace("ADDRESS", &serve(control).to_string()).replace("LATE", late)
}

/// Runs the gateway in parallel with `script`, which uses its state. The end of the script stops it. Returns its last
/// status.
pub(crate) fn beside(text: &str, script: impl FnOnce(&dyn GatewayApi) + Send + 'static) -> Status {
    let directory = tempfile::tempdir().unwrap();
    let options = Options { directory: Some(directory.path().to_owned()), ..Options::default() };
    gateway::beside(text, options, script)
}

#[track_caller]
pub(crate) fn nobody_is_blamed(control: &Shared, status: &Status, what: &str) {
    control.lock().unwrap().never_jumped();
    for kind in ["foreign-change", "disarmed", "operator-change", "ledger-doubt"] {
        assert_eq!(reported(status, kind), 0, "{what} {:#?}", events(status));
    }
}

/// Checks that no message blames another client for a late write of the gateway.
#[track_caller]
pub(crate) fn blames_nobody(name: &str, said: &[String]) {
    let blames = [
        "this gateway did not write",
        "the operator offset changed",
        "is assumed to be",
        "to zero; the CNC",
        "off:",
    ];
    for blame in blames {
        assert!(!said.iter().any(|line| line.contains(blame)), "{name}: {blame}: {said:#?}");
    }
}

/// Runs each test on a separate thread, because they wait most of the time.
#[track_caller]
pub(crate) fn all_at_once(tests: impl Iterator<Item = impl FnOnce() + Send + 'static>) {
    let threads: Vec<_> = tests.map(std::thread::spawn).collect();
    let failed = threads.into_iter().filter_map(|thread| thread.join().err()).count();
    assert_eq!(failed, 0, "of these failed, each for the reason that it gave");
}

/// The program with a profile, and a state directory that outlives it.
pub(crate) struct Program {
    home: tempfile::TempDir,
    profile: PathBuf,
    pub(crate) running: Running,
    /// Output of the programs that were killed.
    said: Vec<String>,
}

impl Program {
    pub(crate) fn start(text: &str) -> Program {
        let home = tempfile::tempdir().unwrap();
        let profile = file(home.path(), "held.toml", text);
        let running = run(&home, &profile);
        Program { home, profile, running, said: Vec::new() }
    }

    /// Kills the program, and starts another one with the same state.
    pub(crate) fn starts_again_after_a_kill(self) -> Program {
        let Program { home, profile, running, mut said } = self;
        said.extend(running.killed());
        let running = run(&home, &profile);
        Program { home, profile, running, said }
    }

    /// Path of its state document.
    pub(crate) fn document(&self) -> PathBuf {
        self.home.path().join("state/held.state.json")
    }

    /// Checks the condition repeatedly until it is true.
    #[track_caller]
    pub(crate) fn waits_until(&mut self, what: &str, is_so: impl Fn() -> bool) {
        let clock = Clock::wall();
        let begun = clock.now();
        while !is_so() {
            let waited = clock.now().since(begun);
            assert!(waited < 2 * PATIENCE, "{what}: {:#?}{:#?}", self.said, self.running.so_far());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Arms the axis, as an operator does.
    pub(crate) fn is_armed(&self) {
        let mut arm = isotherm(self.home.path());
        arm.arg("arm").arg(&self.profile).arg("--state").arg(self.home.path().join("state"));
        assert!(arm.status().unwrap().success());
    }

    /// Stops the program. Returns everything that was printed.
    pub(crate) fn ends(self) -> Vec<String> {
        let Program { mut running, mut said, .. } = self;
        running.signal("TERM");
        let exit = running.ends_within(PATIENCE);
        said.append(&mut running.said);
        assert!(exit.success(), "{exit}: {said:#?}");
        said
    }
}

fn run(home: &tempfile::TempDir, profile: &Path) -> Running {
    let state = home.path().join("state");
    Running::start(isotherm(home.path()).arg("run").arg(profile).arg("--state").arg(state))
}

/// Values of its offset that may still arrive, from this document.
pub(crate) fn promises(document: &Path) -> Vec<i64> {
    let text = std::fs::read_to_string(document).unwrap_or_default();
    let document: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    let kept = document["outputs"]["cnc_z"]["kept"]["promises"].as_array().cloned().unwrap_or_default();
    kept.iter().filter_map(|promise| promise["value"].as_i64()).collect()
}
