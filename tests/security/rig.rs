//! A gateway of one axis, its device, and what it takes to see whether the machine noticed.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use crate::device::{Device, Times, profile};
use crate::on_time::OnTime;
use crate::process::{PATIENCE, Running, file, isotherm};

/// How often the device is polled.
pub(crate) const EVERY: Duration = Duration::from_millis(200);
/// The device is in this process: where that is late, it is no device that does not answer, which is asked less and less.
const TIMES: Times = Times { timeout: Duration::from_secs(5), every: EVERY, max_age: Duration::from_secs(5) };

pub(crate) struct Machine {
    pub(crate) home: tempfile::TempDir,
    pub(crate) device: Device,
    profile: PathBuf,
    pub(crate) gateway: Running,
}

/// As long as it lasts, its machine is held on time: else the test fails where it ends.
pub(crate) struct Beside {
    /// Looked at before the gateway ends.
    _on_time: OnTime,
    _machine: Machine,
}

impl Machine {
    /// A gateway with these arguments, under this limit of file descriptors, and with this in its profile.
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

    /// One that is held on time beside what a test does elsewhere on this computer.
    pub(crate) fn beside() -> Beside {
        let machine = Machine::start(None, &[], "");
        machine.is_held();
        Beside { _on_time: machine.on_time(), _machine: machine }
    }

    /// Where the page listens, as the gateway says it.
    pub(crate) fn page(&mut self) -> SocketAddr {
        let line = self.gateway.hears("page http");
        line.rsplit('/').next().unwrap().parse().unwrap()
    }

    /// A verb of this machine.
    pub(crate) fn verb(&self, verb: &str) -> Command {
        let mut command = isotherm(self.home.path());
        command.arg(verb).arg(&self.profile).arg("--state").arg(self.home.path());
        command
    }

    /// What a verb says that knows the profile alone.
    pub(crate) fn verb_of_profile(&self, verb: &str, options: &[&str]) -> String {
        let output = isotherm(self.home.path()).arg(verb).arg(&self.profile).args(options).output().unwrap();
        [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat()
    }

    /// The axis holds the machine.
    pub(crate) fn is_held(&self) {
        self.device.asks(2000);
        let moves = self.device.wait(PATIENCE, |state| (state.writes() > 0).then_some(()));
        moves.expect("the axis does not move");
    }

    /// The device is up again, and polled; how long that took.
    pub(crate) fn comes_back(&self) -> Duration {
        let up = self.device.now();
        self.device.is_down(false);
        let polled = self
            .device
            .wait(2 * PATIENCE, |state| state.seen.last().filter(|seen| seen.at >= up).map(|seen| seen.at));
        polled.expect("the device is not polled again").since(up)
    }

    /// From now on it is held on time, as long as what is returned lives.
    pub(crate) fn on_time(&self) -> OnTime {
        OnTime::from_now(&self.device, EVERY, self.gateway.id())
    }
}

/// A device, and the profile of a machine that it is all of.
pub(crate) fn walker() -> (Device, String) {
    let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
    // Nobody is to hold up a poll but those who attack.
    let text = profile(device.address(), TIMES).replace("\"100ms\" }", "\"1ms\" }");
    (device, text)
}

/// A whole answer to this request, where there is one.
pub(crate) fn ask(page: SocketAddr, request: &str) -> Option<String> {
    let mut stream = TcpStream::connect(page).ok()?;
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    stream.write_all(request.as_bytes()).ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    (!answer.is_empty()).then_some(answer)
}

/// The request of a page, after whose answer the connection ends.
pub(crate) fn get(page: SocketAddr, path: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nHost: {page}\r\nConnection: close\r\n\r\n")
}
