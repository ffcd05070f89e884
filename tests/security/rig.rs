//! A gateway with one axis, its device, and the tools to check that the machine was not affected.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use crate::device::{Device, Times, profile};
use crate::on_time::OnTime;
use crate::process::{PATIENCE, Running, file, isotherm};

/// Poll interval of the device.
pub(crate) const EVERY: Duration = Duration::from_millis(200);
/// Timeouts for a device in this process. They are long, because a stall of this process must not count as a missing
/// answer, which would cause back-off.
const TIMES: Times = Times { timeout: Duration::from_secs(5), every: EVERY, max_age: Duration::from_secs(5) };

pub(crate) struct Machine {
    pub(crate) home: tempfile::TempDir,
    pub(crate) device: Device,
    profile: PathBuf,
    pub(crate) gateway: Running,
}

/// Guard that asserts at its drop that its machine was compensated on time.
pub(crate) struct Beside {
    /// Dropped, and thus checked, before the gateway ends.
    _on_time: OnTime,
    _machine: Machine,
}

impl Machine {
    /// Starts a gateway with these arguments, with this limit of file descriptors, and with this part of a profile.
    pub(crate) fn start(descriptors: Option<u32>, arguments: &[&str], web: &str) -> Machine {
        let (device, text) = walker();
        let home = tempfile::tempdir().unwrap();
        let text = text + web;
        let profile = file(home.path(), "walker.toml", &text);
        let program = isotherm(home.path());
        let limit = descriptors.map_or(String::new(), |limit| format!("ulimit -n {limit}; "));
        let mut command = Command::new("sh");
        command.env_clear().envs(program.get_envs().filter_map(|(name, value)| Some((name, value?))));
        command.arg("-c").arg(format!("{limit}exec \"$0\" \"$@\"")).arg(program.get_program());
        command.arg("run").arg(&profile).args(arguments).arg("--state").arg(home.path());
        let gateway = Running::start(&mut command);
        Machine { home, device, profile, gateway }
    }

    /// Starts a compensated machine that must be on time during a test on the same computer.
    pub(crate) fn beside() -> Beside {
        let machine = Machine::start(None, &[], "");
        machine.is_held();
        Beside { _on_time: machine.on_time(), _machine: machine }
    }

    /// Address of the page, from the output of the gateway.
    pub(crate) fn page(&mut self) -> SocketAddr {
        let line = self.gateway.receives("page http");
        line.rsplit('/').next().unwrap().parse().unwrap()
    }

    /// Makes the command of a verb for this machine.
    pub(crate) fn verb(&self, verb: &str) -> Command {
        let mut command = isotherm(self.home.path());
        command.arg(verb).arg(&self.profile).arg("--state").arg(self.home.path());
        command
    }

    /// Output of a verb that needs only the profile.
    pub(crate) fn verb_of_profile(&self, verb: &str, options: &[&str]) -> String {
        let output = isotherm(self.home.path()).arg(verb).arg(&self.profile).args(options).output().unwrap();
        [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat()
    }

    /// Waits until the axis moves.
    pub(crate) fn is_held(&self) {
        self.device.asks(2000);
        let moves = self.device.wait(PATIENCE, |state| (state.writes() > 0).then_some(()));
        moves.expect("the axis does not move");
    }

    /// Brings the device back. Returns the time until it was polled.
    pub(crate) fn comes_back(&self) -> Duration {
        let up = self.device.now();
        self.device.is_down(false);
        let polled = self
            .device
            .wait(2 * PATIENCE, |state| state.seen.last().filter(|seen| seen.at >= up).map(|seen| seen.at));
        polled.expect("the device is not polled again").since(up)
    }

    /// Begins to check that the machine is polled on time, until the guard is dropped.
    pub(crate) fn on_time(&self) -> OnTime {
        OnTime::from_now(&self.device, EVERY, self.gateway.id())
    }
}

/// A device, and the profile of a machine with only this device.
pub(crate) fn walker() -> (Device, String) {
    let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
    // Only an attacker should delay a poll.
    let text = profile(device.address(), TIMES).replace("\"100ms\" }", "\"1ms\" }");
    (device, text)
}

/// Complete answer to this request; `None` if there is none.
pub(crate) fn ask(page: SocketAddr, request: &str) -> Option<String> {
    let mut stream = TcpStream::connect(page).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream.write_all(request.as_bytes()).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    (!answer.is_empty()).then_some(answer)
}

/// Request for a page. The connection ends after the answer.
pub(crate) fn get(page: SocketAddr, path: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: {page}\r\nConnection: close\r\n\r\n")
}
