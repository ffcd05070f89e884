//! The program as an operator starts it, on a computer whose clock is wrong and is set while it runs. The library
//! libfaketime replaces the time of day of the C library. The axis follows its model, no write changes more than one
//! step, and each log file gives its decisions again.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::mpsc::channel;

use isotherm::clock::Clock;
use isotherm::virtual_machine::{Ports, Setup, VirtualMachine, Window};

use crate::support::process;

use process::{Running, file, isotherm, until};

const PROFILE: &str = r#"
[machine]
name = "lost"
arm = "auto"
settle = "1s"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "90ms"
late = "1s"
[device.module]
bus = "cell"
unit = 1
every = "100ms"
[device.cnc]
bus = "cell"
unit = 2
[signal.bed]
device = "module"
register = "input:0"
type = "i16"
scale = 0.1
unit = "degC"
range = [10.0, 40.0]
max_rate = "none"
max_age = "3s"
[axis.z]
limit = 400.0
step = 1.0
rate = 1000.0
deadband = 0.1
every = "100ms"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "by the time"
kind = "formula"
formula = "5 * t + 0 * A"
inputs = { A = "bed" }
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:104"
type = "i32"
word_order = "msw-first"
scale = 0.1
"#;

/// Path of the library, which depends on the Debian version.
fn library() -> PathBuf {
    let found = std::fs::read_dir("/usr/lib").unwrap().flatten().map(|entry| entry.path());
    let mut found = found.map(|place| place.join("faketime/libfaketime.so.1")).filter(|path| path.exists());
    found.next().unwrap_or_else(|| panic!("libfaketime is missing: apt-get install libfaketime"))
}

/// Devices of the machine, on a separate thread and with the right time.
fn machine() -> (Window, SocketAddr) {
    let (tell, here) = channel();
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let text = PROFILE.replace("ADDRESS", "127.0.0.1:1502");
            let profile = isotherm_profile::parse(Path::new("lost.toml"), &text, &[], &[]).unwrap().profile;
            let setup = Setup { ports: Ports::Free, journal: true, ..Setup::default() };
            let machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
            tell.send((machine.window(), machine.addresses()[0].1.parse().unwrap())).unwrap();
            std::future::pending::<()>().await;
        });
    });
    here.recv().unwrap()
}

/// Values written to the offset in their order, counts.
fn writes(window: &Window) -> Vec<i32> {
    let offset = |seen: &&isotherm::virtual_machine::SeenRequest| {
        seen.is_write() && seen.address.register().is_some_and(|register| register.offset == 104)
    };
    let count = |words: &[u16]| i32::from(words[0].cast_signed()) << 16 | i32::from(words[1]);
    window.requests().iter().filter(offset).map(|seen| count(&seen.wanted)).collect()
}

#[test]
fn a_clock_that_is_set_while_the_program_runs_moves_nothing() {
    let home = tempfile::tempdir().unwrap();
    let (window, address) = machine();
    let profile = file(home.path(), "lost.toml", &PROFILE.replace("ADDRESS", &address.to_string()));
    let (state, set_to) = (home.path().join("state"), home.path().join("faketime"));
    let run = |clock: &str| {
        std::fs::write(&set_to, clock).unwrap();
        let mut command = isotherm(home.path());
        command.arg("run").arg(&profile).arg("--state").arg(&state);
        command.env("LD_PRELOAD", library()).env("FAKETIME_TIMESTAMP_FILE", &set_to);
        command.env("FAKETIME_NO_CACHE", "1").env("FAKETIME_DONT_FAKE_MONOTONIC", "1");
        Running::start(&mut command)
    };
    let follows = |span: usize| {
        let before = writes(&window).len();
        until("the axis follows", || match writes(&window).len() {
            now if now >= before + span => Ok(()),
            now => Err(format!("{now} writes")),
        });
    };
    let mut gateway = run("@1970-01-01 00:01:00");
    gateway.receives("armed, starting from");
    follows(10);
    for (clock, from) in
        [("+0", "from 1970-01-01"), ("-1h", "clock was set"), ("+1y x1.0005", "clock was set")]
    {
        std::fs::write(&set_to, clock).unwrap();
        gateway.receives(from);
        follows(10);
    }
    gateway.killed();
    for (clock, doubts) in [("+0", true), ("+1d", false), ("+10y", true), ("@1970-01-01 00:01:00", true)] {
        let mut gateway = run(clock);
        gateway.receives("armed, starting from");
        follows(10);
        let said = gateway.killed().join("\n");
        assert_eq!(said.contains("clock does not continue from"), doubts, "{clock}: {said}");
        assert!(!said.contains("deleted"), "{clock}: {said}");
    }
    let writes = writes(&window);
    let largest = writes.windows(2).map(|pair| (pair[1] - pair[0]).abs()).max().unwrap();
    assert!(largest <= 10, "a step is 10 counts: {writes:?}");
    assert!(*writes.last().unwrap() < 4000, "the time since machine start is what was counted: {writes:?}");
    let logs: Vec<PathBuf> = std::fs::read_dir(&state).unwrap().flatten().map(|entry| entry.path()).collect();
    let logs = logs.iter().filter(|log| log.extension().is_some_and(|ending| ending == "csv"));
    let mut count = 0;
    for log in logs {
        let replayed = isotherm(home.path()).arg("replay").arg(&profile).arg(log).output().unwrap();
        let said = String::from_utf8_lossy(&replayed.stdout).into_owned();
        assert!(said.contains("of the log again") && !said.contains("differ"), "{}: {said}", log.display());
        count += 1;
    }
    assert!(count >= 10, "{count} files of logs");
}
