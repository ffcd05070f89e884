//! A gateway of one axis, its device, and what it takes to see whether the machine noticed.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm_core::quantity::Moment;

use crate::device::{Device, Seen, Times, What, profile};
use crate::process::{Running, file, isotherm};

/// How often the device is polled.
pub(crate) const EVERY: Duration = Duration::from_millis(200);
const TIMES: Times =
    Times { timeout: Duration::from_millis(100), every: EVERY, max_age: Duration::from_secs(1) };
/// Polls stay within this of their time, whoever attacks.
const WITHIN: Duration = Duration::from_millis(50);

pub(crate) struct Machine {
    pub(crate) home: tempfile::TempDir,
    pub(crate) device: Device,
    profile: PathBuf,
    pub(crate) gateway: Running,
}

impl Machine {
    /// A gateway with these arguments, under this limit of file descriptors, and with this in its profile.
    pub(crate) fn start(descriptors: Option<u32>, arguments: &[&str], web: &str) -> Machine {
        let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
        let home = tempfile::tempdir().unwrap();
        // Nobody is to hold up a poll but those who attack.
        let text = profile(device.address(), TIMES).replace("\"100ms\" }", "\"1ms\" }") + web;
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

    /// The axis holds the machine.
    pub(crate) fn is_held(&self) {
        self.device.asks(2000);
        let moves = self.device.wait(Duration::from_secs(30), |state| (state.writes() > 0).then_some(()));
        moves.expect("the axis does not move");
    }

    /// The device is up again, and polled; how long that took.
    pub(crate) fn comes_back(&self) -> Duration {
        let up = self.device.now();
        self.device.is_down(false);
        let polled = self.device.wait(Duration::from_secs(35), |state| {
            state.seen.last().filter(|seen| seen.at >= up).map(|seen| seen.at)
        });
        polled.expect("the device is not polled again").since(up)
    }

    /// When the device was polled.
    pub(crate) fn polls(&self) -> Vec<Moment> {
        let is_poll = |seen: &&Seen| matches!(seen.what, What::Asked { .. });
        self.device.state().seen.iter().filter(is_poll).map(|seen| seen.at).collect()
    }

    /// The polls of a span that came later than they may, where this computer itself was not late.
    pub(crate) fn late(&self, (from, to): (Moment, Moment), witness: &Witness) -> Vec<String> {
        let polls: Vec<Moment> = self.polls().into_iter().filter(|at| *at >= from && *at < to).collect();
        assert!(polls.len() > 5, "{} polls in {:?}", polls.len(), to.since(from));
        let gaps = polls.windows(2).filter_map(|pair| {
            let [one, next] = [pair[0], pair[1]];
            let over = next.since(one).saturating_sub(EVERY);
            let excused = witness.worst(one, next);
            (over > WITHIN + excused).then(|| format!("{over:?} late at {next}, the computer {excused:?}"))
        });
        gaps.collect()
    }
}

/// Somebody who only looks at the clock, and knows how late this computer lets anybody be.
pub(crate) struct Witness {
    clock: Clock,
    seen: Arc<Mutex<Vec<(Moment, Duration)>>>,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Witness {
    pub(crate) fn new() -> Witness {
        const TICK: Duration = Duration::from_millis(5);
        let (seen, ends, clock) =
            (Arc::new(Mutex::new(Vec::new())), Arc::new(AtomicBool::new(false)), Clock::wall());
        let (keeps, until, by) = (Arc::clone(&seen), Arc::clone(&ends), clock.clone());
        let thread = std::thread::spawn(move || {
            let mut last = by.now();
            while !until.load(Ordering::Relaxed) {
                std::thread::sleep(TICK);
                let now = by.now();
                keeps.lock().unwrap().push((now, now.since(last).saturating_sub(TICK)));
                last = now;
            }
        });
        Witness { clock, seen, ends, thread: Some(thread) }
    }

    pub(crate) fn now(&self) -> Moment {
        self.clock.now()
    }

    /// The latest that anybody was in this span.
    fn worst(&self, from: Moment, to: Moment) -> Duration {
        let seen = self.seen.lock().unwrap();
        let inside = seen.iter().filter(|(at, _)| *at >= from && *at <= to.after(WITHIN));
        inside.map(|(_, late)| *late).max().unwrap_or_default()
    }
}

impl Drop for Witness {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
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
