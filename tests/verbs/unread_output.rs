//! Verbs whose standard output nobody reads, or whose disk is full.

use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

use super::cli::{Ended, VERBS, ended, machine};
use crate::support::process::{file, isotherm};

/// Calls of every verb. The files that they need are in the directory.
const CALLS: [&[&str]; 37] = [
    &["--help"],
    &["demo", "--for", "10min", "--speed", "100000", "--listen", "127.0.0.1:0"],
    &["demo", "--for", "10min", "--speed", "100000", "--listen", "127.0.0.1:0", "--json"],
    &["run", "machine.toml", "--state", "state", "--listen", "127.0.0.1:0"],
    &["check", "machine.toml"],
    &["check", "machine.toml", "--json"],
    &["check", "nothing.toml"],
    &["check", "machine.toml", "--online"],
    &["read", "machine.toml"],
    &["scan", "127.0.0.1:9", "--units", "1"],
    &["virtual", "machine.toml"],
    &["record", "machine.toml", "--out", "recorded.csv", "--for", "1s"],
    &["replay", "machine.toml", "day.csv"],
    &["replay", "machine.toml", "day.csv", "--json"],
    &["identify", "machine.toml", "day.csv", "--axis", "z", "--error", "z_error_um"],
    &["identify", "--balls", "day.csv", "--out", "balls.csv"],
    &["learn", "machine.toml", "--axis", "z", "--state", "state"],
    &["select", "day.csv", "--error", "z_error_um"],
    &["place", "--example", "column"],
    &["report", "day.csv", "--time-unit", "s"],
    &["arm", "machine.toml", "--state", "state"],
    &["disarm", "machine.toml", "--state", "state"],
    &["zero", "machine.toml", "--state", "state"],
    &["measured", "machine.toml", "z", "1.5"],
    &["confirm", "machine.toml", "thermocouples", "--state", "state"],
    &["adopt", "machine.toml", "--state", "state"],
    &["release", "machine.toml", "cnc_z", "--state", "state"],
    &["trace", "machine.toml", "thermocouples", "--for", "1s"],
    &["events", "machine.toml", "--state", "state"],
    &["status", "machine.toml", "--state", "state"],
    &["init"],
    &["init", "--yes", "--output", "linuxcnc-eoffset", "--control-unit", "2"],
    &["token"],
    &["sign", "machine.toml", "--state", "state"],
    &["schema"],
    &["completions", "bash"],
    &["man"],
];

/// Output to a closed pipe; [`full`] is output to a full disk.
fn gone() -> std::process::Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

fn full() -> std::process::Stdio {
    std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap().into()
}

/// Runs a verb for at most two seconds, and checks how it ends.
fn is_called(home: &Path, call: &[&str], stdout: fn() -> std::process::Stdio, is_received: bool) {
    let stderr = if is_received { std::process::Stdio::piped() } else { stdout() };
    let mut command = isotherm(home);
    command.current_dir(home).args(call).stdin(std::process::Stdio::null()).stdout(stdout()).stderr(stderr);
    let child = command.spawn().unwrap();
    let process = child.id().to_string();
    std::thread::spawn(move || {
        std::thread::sleep(Duration::from_secs(2));
        let _ = Command::new("kill").args(["-TERM", &process]).stderr(std::process::Stdio::null()).status();
    });
    let Output { status, stderr, .. } = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&stderr);
    assert!(!said.contains("panicked"), "{call:?}: {said}");
    // Before it handles the signal, the signal itself ends it.
    let is_known = status.code().is_none_or(|code| [0, 1, 2, 3, 64].contains(&code));
    assert!(
        is_known && std::os::unix::process::ExitStatusExt::signal(&status).is_none_or(|by| by == 15),
        "{call:?}: {status} {said}"
    );
}

#[test]
fn no_verb_panics_where_nobody_takes_what_it_prints() {
    let home = tempfile::tempdir().unwrap();
    file(home.path(), "machine.toml", &machine(home.path()).0);
    let rows = "time,bed,wheelhead,z_error_um\n0,20,20,0\n60,20.1,20,0.2\n120,20.3,20.1,0.5\n";
    file(home.path(), "day.csv", rows);
    std::thread::scope(|scope| {
        for call in CALLS {
            assert!(call[0].starts_with("--") || VERBS.contains(&call[0]), "{call:?}");
            let home = home.path();
            scope.spawn(move || {
                for stdout in [gone as fn() -> std::process::Stdio, full] {
                    is_called(home, call, stdout, true);
                    is_called(home, call, stdout, false);
                }
            });
        }
    });
}

#[test]
fn a_reader_who_leaves_early_as_head_does_is_no_failure_and_a_full_disk_is_one() {
    let home = tempfile::tempdir().unwrap();
    let run = |call: &[&str], stdout: std::process::Stdio| {
        ended(isotherm(home.path()).args(call).stdout(stdout).stderr(std::process::Stdio::piped()))
    };
    for call in
        [&["check", "surface-grinder"][..], &["check", "surface-grinder", "--json"], &["schema"], &["man"]]
    {
        let Ended { code, said, .. } = run(call, gone());
        assert_eq!(code, Some(0), "{call:?}: {said}");
        let Ended { code, said, .. } = run(call, full());
        assert_eq!(code, Some(1), "{call:?}: {said}");
        assert!(said.contains("standard output") && said.contains("No space left"), "{call:?}: {said}");
    }
}
