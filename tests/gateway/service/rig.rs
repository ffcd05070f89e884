//! Gateway as a service manager starts it, with its device.

use std::ffi::OsStr;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use crate::service::device::{Device, Times, profile};
use crate::service::manager::Manager;
use crate::service::process::{Running, file, isotherm, until};

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

/// Copies the program in a separate process. A program file cannot be started while another process, which another test
/// has just started, still has it open for writing.
pub(crate) fn copy(program: &str, to: &Path) {
    assert!(Command::new("cp").arg(program).arg(to).status().unwrap().success());
}

/// Profile with a corrected position. The position is in the same register with 0.1 µm per count, so that position and
/// Cz are equal.
pub(crate) fn corrected(text: &str) -> String {
    let position = "[signal.scale]\ndevice = \"cnc\"\nregister = \"holding:0\"\ntype = \"i16\"\nscale = 0.0001\nunit = \"mm\"\n\
                    max_age = \"2s\"\n[axis.z]";
    let text = text
        .replace("[axis.z]", position)
        .replace("writes = \"offset\"", "writes = \"corrected\"\nposition = \"scale\"");
    let (before, output) = text.split_once("[output.cnc_z]").unwrap();
    format!("{before}[output.cnc_z]{}", output.replace("scale = 0.1\n", "scale = 0.0001\n"))
}

impl Service {
    /// Starts a gateway with a changed profile, and waits until it is ready.
    pub(crate) fn start(change: impl FnOnce(String) -> String) -> Service {
        Service::start_by(change, &[], &[], |_, _| ())
    }

    /// Starts it by this command, with further environment variables. The command becomes the program that it gets as
    /// its arguments. `meanwhile` gets the process and the state directory before the gateway is waited for.
    pub(crate) fn start_by(
        change: impl FnOnce(String) -> String,
        by: &[&str],
        environment: &[(&str, &str)],
        meanwhile: impl FnOnce(&mut Running, &Path),
    ) -> Service {
        let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
        let home = tempfile::tempdir().unwrap();
        let text = profile(device.address(), TIMES).replace("100ms", "5ms");
        let path = file(home.path(), "walker.toml", &change(text));
        let mut manager = Manager::listen(home.path());
        // Separate copy of the program, which can be replaced.
        let program = home.path().join("isotherm");
        copy(env!("CARGO_BIN_EXE_isotherm"), &program);
        let state = home.path().join("state");
        let words: Vec<&OsStr> = by.iter().map(OsStr::new).chain([program.as_os_str()]).collect();
        let mut command = Command::new(words[0]);
        command.env_clear().env("HOME", home.path()).env("NOTIFY_SOCKET", &manager.path);
        command.envs(environment.iter().copied());
        command.args(&words[1..]).arg("run").arg(&path).arg("--state").arg(&state);
        let mut gateway = Running::start(&mut command);
        meanwhile(&mut gateway, &state);
        manager.receives("READY=1");
        Service { home, device, profile: path, program, manager, gateway }
    }

    /// Changes the profile on disk.
    pub(crate) fn rewrite(&self, change: impl FnOnce(String) -> String) {
        let text = std::fs::read_to_string(&self.profile).unwrap();
        std::fs::write(&self.profile, change(text)).unwrap();
    }

    /// Runs `isotherm restart --keep`. Returns its exit code and its output.
    pub(crate) fn restart(&self, options: &[&str]) -> (Option<i32>, String) {
        let output = self.verb(&[&["restart", "--keep"], options].concat());
        let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
        (output.status.code(), said)
    }

    /// Events of this kind, with their data.
    pub(crate) fn events(&self, kind: &str) -> Vec<serde_json::Value> {
        let said = String::from_utf8(self.verb(&["events", "--json"]).stdout).unwrap();
        let events = said.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
        events.filter(|event| event["kind"] == kind).collect()
    }

    /// Sets the temperature so that the axis moves to this offset in counts, and waits until it is there.
    #[track_caller]
    pub(crate) fn walks_to(&self, offset: i16) {
        self.device.asks(offset);
        until("the offset is there", || match self.device.offset() {
            found if found == offset => Ok(()),
            found => Err(format!("{found}")),
        });
    }

    /// Runs a verb for this machine.
    pub(crate) fn verb(&self, words: &[&str]) -> Output {
        let mut command: Command = isotherm(self.home.path());
        let (verb, options) = words.split_first().unwrap();
        command.arg(verb).arg(&self.profile).args(options).arg("--state").arg(self.home.path().join("state"));
        command.output().unwrap()
    }
}
