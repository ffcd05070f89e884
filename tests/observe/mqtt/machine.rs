//! A machine with a hundred temperatures that change with every read, and its gateway.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU16, AtomicUsize, Ordering};

use serde_json::Value;

use super::device::server::{Question, serve};
use super::process::{Running, file, isotherm, until};

/// Number of signals.
pub(crate) const SIGNALS: usize = 100;
/// Offset register.
const OFFSET: u16 = 200;

/// Registers of the device, and its behaviour.
#[derive(Debug)]
pub(crate) struct Device {
    /// Whether reads of temperatures are answered with an exception.
    is_mute: AtomicBool,
    /// Temperature `bed0`, which the axis follows, in tenths of a degree. The others change with every read.
    bed0: AtomicU16,
    reads: AtomicU16,
    offset: AtomicU16,
    /// Number of writes of the offset.
    writes: AtomicUsize,
}

/// A gateway in a separate process, with its simulated machine.
pub(crate) struct Machine {
    pub(crate) running: Running,
    pub(crate) profile: PathBuf,
    home: tempfile::TempDir,
    device: Arc<Device>,
}

impl Device {
    fn new() -> Device {
        Device {
            is_mute: AtomicBool::new(false),
            bed0: AtomicU16::new(100),
            reads: AtomicU16::new(0),
            offset: AtomicU16::new(0),
            writes: AtomicUsize::new(0),
        }
    }

    fn answer(&self, question: &Question) -> Vec<u8> {
        if !question.is_read() {
            self.offset.store(question.words()[0], Ordering::Relaxed);
            self.writes.fetch_add(1, Ordering::Relaxed);
            return question.done();
        }
        let temperatures = question.from() < OFFSET;
        if temperatures && self.is_mute.load(Ordering::Relaxed) {
            return question.denied(4);
        }
        let round = if temperatures { self.reads.fetch_add(1, Ordering::Relaxed) } else { 0 };
        let mut bank: Vec<u16> = (0..=OFFSET).map(|place| 100 + (round + place) % 50).collect();
        bank[0] = self.bed0.load(Ordering::Relaxed);
        bank[usize::from(OFFSET)] = self.offset.load(Ordering::Relaxed);
        question.read(&bank)
    }
}

/// Makes the machine's profile, with this `[mqtt]`.
fn profile(address: &str, mqtt: &str) -> String {
    let signals: String = (0..SIGNALS)
        .map(|place| {
            format!(
                "bed{place} = {{ device = \"cnc\", register = \"holding:{place}\", type = \"i16\", scale = 0.1, unit = \"degC\", \
                 max_age = \"10s\", max_rate = \"none\" }}\n"
            )
        })
        .collect();
    format!(
        r#"
[machine]
name = "press"
arm = "auto"
[bus.cell]
type = "modbus-tcp"
address = "{address}"
timeout = "2s"
[device.cnc]
bus = "cell"
unit = 1
every = "50ms"
[signal]
{signals}
[axis.z]
limit = 40.0
step = 1.0
rate = 1000.0
every = "200ms"
on_fault = {{ action = "hold" }}
[[axis.z.model]]
name = "bed"
kind = "linear"
terms = [ {{ signal = "bed0", gain = 1.0, reference = 0.0 }} ]
[axis.z.probe]
limit = 20.0
max_error = 30.0
[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:{OFFSET}"
type = "i16"
scale = 0.1
{mqtt}
"#
    )
}

impl Machine {
    /// Starts a machine with this `[mqtt]`.
    pub(crate) fn with(mqtt: &str) -> Machine {
        Machine::beside(mqtt, |_| ())
    }

    /// Starts a machine with this `[mqtt]`, and with files next to its profile.
    pub(crate) fn beside(mqtt: &str, files: impl FnOnce(&Path)) -> Machine {
        let (profile, home, device) = Machine::prepared(mqtt, files);
        let running = Running::start(isotherm(home.path()).arg("run").arg(&profile));
        Machine { running, profile, home, device }
    }

    /// Makes the profile and the device, before the gateway runs.
    pub(crate) fn prepared(
        mqtt: &str,
        files: impl FnOnce(&Path),
    ) -> (PathBuf, tempfile::TempDir, Arc<Device>) {
        let device = Arc::new(Device::new());
        let answers = device.clone();
        let address = serve(move |question: &Question, stream| {
            stream.write_all(&question.answer(&answers.answer(question)))
        });
        let home = tempfile::tempdir().unwrap();
        files(home.path());
        let profile = file(home.path(), "machine.toml", &profile(&address.to_string(), mqtt));
        (profile, home, device)
    }

    /// Kills the gateway, and starts it again with its state on disk.
    pub(crate) fn dies_and_begins(self) -> Machine {
        let Machine { running, profile, home, device } = self;
        running.killed();
        let running = Running::start(isotherm(home.path()).arg("run").arg(&profile));
        Machine { running, profile, home, device }
    }

    /// Sets whether the device returns temperatures.
    pub(crate) fn answers(&self, answers: bool) {
        self.device.is_mute.store(!answers, Ordering::Relaxed);
    }

    /// Sets the temperature that the axis follows, in degrees, and waits until the offset has followed.
    pub(crate) fn follows(&self, degrees: u16) {
        self.device.bed0.store(10 * degrees, Ordering::Relaxed);
        until("the offset has followed", || {
            let found = self.status()["axes"]["z"]["verified_um"].clone();
            let is_there = found.as_f64().is_some_and(|um| (um - f64::from(degrees)).abs() < 0.01);
            if is_there { Ok(()) } else { Err(found.to_string()) }
        });
    }

    /// Number of writes of the offset that the device has received.
    pub(crate) fn writes(&self) -> usize {
        self.device.writes.load(Ordering::Relaxed)
    }

    /// Runs `isotherm VERB` for this machine, and returns its output.
    pub(crate) fn verb(&self, verb: &str, more: &[&str]) -> String {
        let mut command = isotherm(self.home.path());
        let done = command.arg(verb).arg(&self.profile).args(more).output().unwrap();
        format!("{}{}", String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr))
    }

    /// Status of the gateway.
    pub(crate) fn status(&self) -> Value {
        self.status_if_it_runs().unwrap_or_else(|said| panic!("{said}"))
    }

    /// Status of the gateway. While it does not accept commands yet, the error is what the verb says.
    pub(crate) fn status_if_it_runs(&self) -> Result<Value, String> {
        // Without it, the verb would look for the gateways of the same machine that other tests have started.
        let directory = self.home.path().join(".local/state/isotherm");
        let said = self.verb("status", &["--json", "--state", directory.to_str().unwrap()]);
        serde_json::from_str(&said).map_err(|_| said)
    }

    /// Waits until the axis follows its model.
    pub(crate) fn is_active(&self) {
        until("the axis is active", || {
            let status = self.status_if_it_runs()?;
            if status["axes"]["z"]["state"] == "active" { Ok(()) } else { Err(status.to_string()) }
        });
    }

    /// Number of polls that were late by more than `ms` milliseconds, and number of all polls.
    pub(crate) fn late(&self, ms: f64) -> (u64, u64) {
        let status = self.status();
        let mut counts = (0, 0);
        for bucket in status["buses"][0]["jitter_ms"].as_array().unwrap() {
            let count = bucket[1].as_u64().unwrap();
            counts.1 += count;
            if bucket[0].as_f64().is_none_or(|bound| bound > ms) {
                counts.0 += count;
            }
        }
        counts
    }
}
