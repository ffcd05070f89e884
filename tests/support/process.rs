//! The program as an operator starts it: a process with its output, ended by signals.

#![allow(dead_code, reason = "each of the tests uses its part")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use isotherm::clock::Clock;

/// Time limit of a test for any wait. It is long, because a busy computer is no failure.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);

/// Command for `isotherm` with a separate home, so that no test sees the state of another.
pub(crate) fn isotherm(home: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
    command.env_clear().env("HOME", home).env("PATH", std::env::var_os("PATH").unwrap_or_default());
    command
}

/// Process and the lines that it has printed. It is killed when it is dropped.
pub(crate) struct Running {
    child: Child,
    lines: Receiver<String>,
    pub(crate) said: Vec<String>,
}

impl Running {
    /// Starts the process. Its stdout and stderr are one stream of lines.
    pub(crate) fn start(command: &mut Command) -> Running {
        let begun = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut child = begun.unwrap_or_else(|error| panic!("{command:?} cannot be started: {error}"));
        let (tell, lines) = channel();
        let streams: [Box<dyn std::io::Read + Send>; 2] =
            [Box::new(child.stdout.take().unwrap()), Box::new(child.stderr.take().unwrap())];
        for stream in streams {
            let tell = tell.clone();
            std::thread::spawn(move || {
                for line in BufReader::new(stream).lines().map_while(Result::ok) {
                    if tell.send(line).is_err() {
                        return;
                    }
                }
            });
        }
        Running { child, lines, said: Vec::new() }
    }

    /// Waits for a line that contains this text.
    #[track_caller]
    pub(crate) fn receives(&mut self, text: &str) -> String {
        self.hears_one_of(&[text])
    }

    /// Waits for a line that contains one of these texts. It fails after a time limit, if no line or only other lines
    /// come.
    #[track_caller]
    pub(crate) fn hears_one_of(&mut self, texts: &[&str]) -> String {
        let clock = Clock::wall();
        let begun = clock.now();
        loop {
            let left = (10 * PATIENCE).saturating_sub(clock.now().since(begun));
            match self.lines.recv_timeout(left.min(PATIENCE)) {
                Ok(line) => {
                    self.said.push(line.clone());
                    if texts.iter().any(|text| line.contains(text)) {
                        return line;
                    }
                }
                Err(why) => {
                    let said = self.said.split_off(self.said.len().saturating_sub(200));
                    panic!("{texts:?} was not said ({why}); it said last:\n{}", said.join("\n"))
                }
            }
        }
    }

    /// Lines printed so far.
    pub(crate) fn so_far(&mut self) -> &[String] {
        self.said.extend(self.lines.try_iter());
        &self.said
    }

    /// Standard input of the process.
    pub(crate) fn stdin(&mut self) -> &mut ChildStdin {
        self.child.stdin.as_mut().unwrap()
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends it a signal by name: `TERM`.
    pub(crate) fn signal(&self, name: &str) {
        let sent = Command::new("kill").arg(format!("-{name}")).arg(self.child.id().to_string()).status();
        assert!(sent.is_ok_and(|status| status.success()), "the signal {name} could not be sent");
    }

    /// Stops it by SIGSTOP. Returns when it has stopped.
    #[track_caller]
    pub(crate) fn stands_still(&self) {
        self.signal("STOP");
        let stat = format!("/proc/{}/stat", self.child.id());
        // The format is "1234 (name) T ...". The name may contain any character, also a parenthesis.
        let stands = |stat: &str| stat.rsplit(") ").next().is_some_and(|rest| rest.starts_with('T'));
        until("it stands still", || match std::fs::read_to_string(&stat) {
            Ok(text) if stands(&text) => Ok(()),
            found => Err(format!("{found:?}")),
        });
    }

    /// Lets it continue.
    #[track_caller]
    pub(crate) fn resumes(&self) {
        self.signal("CONT");
    }

    /// Returns whether it has ended.
    pub(crate) fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// Kills it (SIGKILL). Returns what it had printed.
    pub(crate) fn killed(mut self) -> Vec<String> {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        self.said.extend(self.lines.iter());
        std::mem::take(&mut self.said)
    }

    /// Waits until it has ended.
    #[track_caller]
    pub(crate) fn ends_within(&mut self, span: Duration) -> ExitStatus {
        let tick = Duration::from_millis(20);
        let mut waited = Duration::ZERO;
        while waited < span {
            if let Some(status) = self.child.try_wait().unwrap() {
                self.said.extend(self.lines.iter());
                return status;
            }
            std::thread::sleep(tick);
            waited += tick;
        }
        self.said.extend(self.lines.try_iter());
        panic!("it has not ended within {span:?}; it said:\n{}", self.said.join("\n"));
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Calls `done` every 50 ms until it succeeds.
#[track_caller]
pub(crate) fn until(what: &str, mut done: impl FnMut() -> Result<(), String>) {
    let mut last = String::new();
    for _ in 0..PATIENCE.as_millis() / 50 {
        match done() {
            Ok(()) => return,
            Err(why) => last = why,
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("{what}: {last}");
}

/// Writes a file with this content to this directory.
pub(crate) fn file(directory: &Path, name: &str, text: &str) -> PathBuf {
    let path = directory.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

/// Address at which nothing listens, and which no other test uses. Gateways on one computer that write to the same
/// place refuse to start.
pub(crate) fn nowhere() -> String {
    static NAMED: AtomicU32 = AtomicU32::new(1);
    let [_, a, b, c] = std::process::id().to_be_bytes();
    format!("127.{}.{b}.{c}:{}", 100 + a, NAMED.fetch_add(1, Ordering::Relaxed))
}

/// Port that was free a moment ago. It is below the range from which the system assigns ports, so that no other test
/// gets it.
pub(crate) fn free_port() -> u16 {
    static TRIED: AtomicU32 = AtomicU32::new(0);
    // Each process begins with another port.
    let first = std::process::id().wrapping_mul(97);
    let ports = std::iter::repeat_with(|| {
        let tried = TRIED.fetch_add(1, Ordering::Relaxed);
        20_000 + u16::try_from(first.wrapping_add(tried) % 12_000).unwrap()
    });
    ports.take(12_000).find(|port| TcpListener::bind(("127.0.0.1", *port)).is_ok()).unwrap()
}
