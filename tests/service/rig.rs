//! A gateway as a service manager starts it, beside its device.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use crate::device::{Device, Times, profile};
use crate::manager::Manager;
use crate::process::{Running, file, isotherm, until};

pub(crate) const TIMES: Times = Times {
    timeout: Duration::from_millis(200),
    every: Duration::from_millis(200),
    max_age: Duration::from_secs(2),
};

pub(crate) struct Service {
    pub(crate) home: tempfile::TempDir,
    pub(crate) device: Device,
    pub(crate) profile: PathBuf,
    pub(crate) program: PathBuf,
    pub(crate) manager: Manager,
    pub(crate) gateway: Running,
}

/// By a process of its own: a program is busy, and cannot be started, while one that another test has just started still has it open
/// for writing.
pub(crate) fn copy(program: &str, to: &Path) {
    assert!(Command::new("cp").arg(program).arg(to).status().unwrap().success());
}

impl Service {
    /// Started with a profile that was changed so; and once it is ready.
    pub(crate) fn start(change: impl FnOnce(String) -> String) -> Service {
        let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
        let home = tempfile::tempdir().unwrap();
        let text = profile(device.address(), TIMES).replace("100ms", "5ms");
        let path = file(home.path(), "walker.toml", &change(text));
        let mut manager = Manager::listen(home.path());
        // A copy of its own, which can be replaced.
        let program = home.path().join("isotherm");
        copy(env!("CARGO_BIN_EXE_isotherm"), &program);
        let mut command = Command::new(&program);
        command.env_clear().env("HOME", home.path()).env("NOTIFY_SOCKET", &manager.path);
        command.arg("run").arg(&path).arg("--state").arg(home.path().join("state"));
        let gateway = Running::start(&mut command);
        manager.hears("READY=1");
        Service { home, device, profile: path, program, manager, gateway }
    }

    /// What is changed so in its profile is there from now on.
    pub(crate) fn rewrite(&self, change: impl FnOnce(String) -> String) {
        let text = std::fs::read_to_string(&self.profile).unwrap();
        std::fs::write(&self.profile, change(text)).unwrap();
    }

    /// `isotherm restart --keep`: its exit code and what it says.
    pub(crate) fn restart(&self, options: &[&str]) -> (Option<i32>, String) {
        let output = self.verb(&[&["restart", "--keep"], options].concat());
        let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
        (output.status.code(), said)
    }

    /// The events of this kind, with their data.
    pub(crate) fn events(&self, kind: &str) -> Vec<serde_json::Value> {
        let said = String::from_utf8(self.verb(&["events", "--json"]).stdout).unwrap();
        let events = said.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
        events.filter(|event| event["kind"] == kind).collect()
    }

    /// It is so warm that the axis goes there, in counts; waits until it has.
    #[track_caller]
    pub(crate) fn walks_to(&self, offset: i16) {
        self.device.asks(offset);
        until("the offset is there", || match self.device.offset() {
            found if found == offset => Ok(()),
            found => Err(format!("{found}")),
        });
    }

    /// A verb of this machine.
    pub(crate) fn verb(&self, words: &[&str]) -> Output {
        let mut command: Command = isotherm(self.home.path());
        let (verb, options) = words.split_first().unwrap();
        command.arg(verb).arg(&self.profile).args(options).arg("--state").arg(self.home.path().join("state"));
        command.output().unwrap()
    }
}
