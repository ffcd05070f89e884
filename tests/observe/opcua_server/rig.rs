//! A machine with temperatures that change with every read, its gateway with an OPC UA server, and clients in Python
//! and JavaScript.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::{Arc, Mutex};

use serde_json::Value;

use super::device::server::{Question, hang_up, serve};
use super::process::{Running, file, free_port, isotherm, until};

/// Number of signals.
pub(crate) const SIGNALS: usize = 100;
/// Offset register.
const OFFSET: u16 = 200;

fn tools() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap().join("tools")
}

fn path_of(script: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop").join(script)
}

/// Returns a command that runs a script in Python with asyncua.
pub(crate) fn python(script: &str) -> Command {
    let python = tools().join("venv/bin/python");
    let lacks = "asyncua is not installed: `tests/run opcua` does it";
    assert!(python.exists(), "{}: {lacks}", python.display());
    let mut command = Command::new(python);
    command.arg("-u").arg(path_of(script));
    command
}

/// Returns a command that runs the client of node-opcua.
pub(crate) fn node_opcua() -> Command {
    let modules = tools().join("node/node_modules");
    let lacks = "node-opcua-client is not installed: `tests/run opcua` does it";
    assert!(modules.join("node-opcua-client").exists(), "{}: {lacks}", modules.display());
    let mut command = Command::new("node");
    command.arg(path_of("opcua_client.cjs")).arg(modules);
    command
}

/// Behaviour of the device.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Behaviour {
    Answers,
    /// Reads of temperatures are answered with an exception.
    Refuses,
    /// Each request ends the connection.
    IsGone,
}

/// A gateway in a separate process, with its simulated machine and its OPC UA server.
pub(crate) struct Machine {
    pub(crate) running: Running,
    profile: PathBuf,
    home: tempfile::TempDir,
    port: u16,
    behaviour: Arc<Mutex<Behaviour>>,
}

/// Makes the machine's profile, with these lines of `[opcua_server]`.
pub(crate) fn profile(address: &str, port: u16, server: &str) -> String {
    let signals: String = (0..SIGNALS)
        .map(|place| {
            format!(
                "bed{place} = {{ device = \"cnc\", register = \"holding:{place}\", type = \"i16\", scale = 0.1, unit = \"degC\", \
                 max_age = \"5s\", max_rate = \"none\" }}\n"
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
every = "100ms"
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
[opcua_server]
listen = "127.0.0.1:{port}"
every = "100ms"
{server}
"#
    )
}

impl Machine {
    /// Starts a machine with these lines of `[opcua_server]`, and with files next to its profile.
    pub(crate) fn with(server: &str, files: impl FnOnce(&Path)) -> Machine {
        let (offset, reads) = (Arc::new(Mutex::new(0_u16)), Arc::new(AtomicU16::new(0)));
        let behaviour = Arc::new(Mutex::new(Behaviour::Answers));
        let behaves = behaviour.clone();
        let address = serve(move |question: &Question, stream| {
            let temperatures = question.is_read() && question.from() < OFFSET;
            match *behaves.lock().unwrap() {
                Behaviour::Refuses if temperatures => {
                    return stream.write_all(&question.answer(&question.denied(4)));
                }
                Behaviour::IsGone => return hang_up(),
                _ => {}
            }
            let round = if temperatures { reads.fetch_add(1, Ordering::Relaxed) } else { 0 };
            let mut bank: Vec<u16> = (0..=OFFSET).map(|place| 100 + (round + place) % 50).collect();
            let mut offset = offset.lock().unwrap();
            bank[0] = 100;
            bank[usize::from(OFFSET)] = *offset;
            if question.is_read() {
                return stream.write_all(&question.answer(&question.read(&bank)));
            }
            *offset = question.words()[0];
            stream.write_all(&question.answer(&question.done()))
        });
        let home = tempfile::tempdir().unwrap();
        files(home.path());
        let port = free_port();
        let profile = file(home.path(), "machine.toml", &profile(&address.to_string(), port, server));
        let mut running = Running::start(isotherm(home.path()).arg("run").arg(&profile));
        running.receives("OPC UA clients are served at opc.tcp://127.0.0.1:");
        let machine = Machine { running, profile, home, port, behaviour };
        machine.is_active();
        machine
    }

    /// Starts a machine without security, whose clients need no user.
    pub(crate) fn open() -> Machine {
        Machine::with("security = \"none\"\nanonymous = true", |_| ())
    }

    /// Kills the gateway, and starts it again with its state on disk.
    pub(crate) fn dies_and_begins(self) -> Machine {
        let Machine { running, profile, home, port, behaviour } = self;
        running.killed();
        let mut running = Running::start(isotherm(home.path()).arg("run").arg(&profile));
        running.receives("OPC UA clients are served at opc.tcp://127.0.0.1:");
        let machine = Machine { running, profile, home, port, behaviour };
        machine.is_active();
        machine
    }

    /// Directory of the profile and of the certificates.
    pub(crate) fn home(&self) -> &Path {
        self.home.path()
    }

    /// Sets the behaviour of the device.
    pub(crate) fn device(&self, behaviour: Behaviour) {
        *self.behaviour.lock().unwrap() = behaviour;
    }

    /// Lets this program be a client, with its files next to the profile.
    fn client(&self, mut program: Command, arguments: &[&str]) -> Command {
        program.arg(format!("opc.tcp://127.0.0.1:{}", self.port)).args(arguments);
        program.current_dir(self.home.path());
        program
    }

    /// Runs a client with asyncua to its end, and returns what it printed last.
    pub(crate) fn asks(&self, arguments: &[&str]) -> Value {
        self.asks_client(python("opcua_client.py"), arguments)
    }

    /// Runs this client to its end, and returns what it printed last.
    pub(crate) fn asks_client(&self, program: Command, arguments: &[&str]) -> Value {
        let done = self.client(program, arguments).stderr(Stdio::piped()).output().unwrap();
        let said = String::from_utf8_lossy(&done.stdout).into_owned();
        let last = said.lines().last().unwrap_or_default();
        serde_json::from_str(last)
            .unwrap_or_else(|_| panic!("{arguments:?}: {said}{}", String::from_utf8_lossy(&done.stderr)))
    }

    /// Starts a client with asyncua, and waits until it is ready.
    pub(crate) fn watched_by(&self, arguments: &[&str]) -> Running {
        self.watched_by_client(python("opcua_client.py"), arguments)
    }

    /// Starts this client, and waits until it is ready.
    pub(crate) fn watched_by_client(&self, program: Command, arguments: &[&str]) -> Running {
        let mut running = Running::start(&mut self.client(program, arguments));
        running.receives("ready");
        running
    }

    /// Runs `isotherm VERB` for this machine, and returns its output.
    pub(crate) fn verb(&self, verb: &str, more: &[&str]) -> String {
        let mut command = isotherm(self.home.path());
        let done = command.arg(verb).arg(&self.profile).args(more).output().unwrap();
        format!("{}{}", String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr))
    }

    /// Status of the gateway.
    pub(crate) fn status(&self) -> Value {
        let said = self.verb("status", &["--json"]);
        serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}"))
    }

    /// Waits until the axis follows its model and its register holds 10 µm.
    pub(crate) fn is_active(&self) {
        until("the offset has arrived", || {
            let said = self.verb("status", &["--json"]);
            let status: Value = serde_json::from_str(&said).map_err(|_| said.clone())?;
            let found = status["axes"]["z"]["verified_um"].as_f64();
            if found.is_some_and(|um| (um - 10.0).abs() < 0.01) { Ok(()) } else { Err(said) }
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
