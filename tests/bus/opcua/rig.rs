//! Server of asyncua in a separate process, and a line to it.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::dial;
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::kinds::opcua::fault::OpcUaFault;
use isotherm::fieldbus::line::{CheckedAnswer, DeviceLine, RequestObserver};
use isotherm::fieldbus::send_guard::SendDeadline;
use isotherm::fieldbus::wire::{Answer, Request};
use isotherm_core::codec::DataType;
use isotherm_core::continuity::Break;
use isotherm_core::reading::Reason;
use isotherm_profile::{DeviceId, Profile};

fn here(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop").join(name)
}

/// Returns a command that runs a script in Python with asyncua.
pub(crate) fn python(script: &str) -> Command {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    let lacks = "asyncua is not installed: `tests/run opcua` does it";
    assert!(python.exists(), "{}: {lacks}", python.display());
    let mut command = Command::new(python);
    command.arg("-u").arg(here(script));
    command
}

/// OPC UA server. Dropping it kills the process.
pub(crate) struct Server {
    child: Child,
    says: ChildStdin,
    receives: BufReader<ChildStdout>,
    pub(crate) port: u16,
}

impl Server {
    pub(crate) fn start(arguments: &[&str]) -> Server {
        let mut command = python("opcua_server.py");
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let (says, receives) = (child.stdin.take().unwrap(), BufReader::new(child.stdout.take().unwrap()));
        let mut server = Server { child, says, receives, port: 0 };
        server.port = server.line().parse().unwrap();
        server
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.receives.read_line(&mut line).unwrap();
        line.trim().to_owned()
    }

    /// Sends a command to the server, and returns its answer.
    pub(crate) fn does(&mut self, what: &str) -> String {
        writeln!(self.says, "{what}").unwrap();
        self.line()
    }

    /// Returns the process number of the server.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Waits until the server has ended by itself.
    pub(crate) fn ends(&mut self) {
        self.child.wait().unwrap();
    }

    /// Stops the process of the server, which then exists but does nothing.
    pub(crate) fn stops(&self) {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args(["-STOP", &pid]).status().unwrap().success());
    }

    /// Kills the server, and starts another one on the same port.
    pub(crate) fn dies(self, arguments: &[&str]) -> Server {
        self.dies_for(Duration::ZERO, arguments)
    }

    /// Kills the server, and starts another one on the same port after `span`.
    pub(crate) fn dies_for(mut self, span: Duration, arguments: &[&str]) -> Server {
        let port = self.port.to_string();
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        drop(self);
        std::thread::sleep(span);
        Server::start(&[&["--port", port.as_str()], arguments].concat())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Returns the profile of a machine on the server at this port. `bus` has more keys of its bus; if it is empty, there
/// is no security.
pub(crate) fn machine(port: u16, bus: &str) -> String {
    let bus = if bus.is_empty() { "security = \"none\"" } else { bus };
    format!(
        r#"
[machine]
name = "server"
[bus.control]
type = "opcua"
address = "opc.tcp://127.0.0.1:{port}"
timeout = "1s"
{bus}
[device.cnc]
bus = "control"
every = "100ms"
[signal.bed]
device = "cnc"
node = "ns=2;s=bed"
unit = "degC"
max_age = "2s"
max_rate = "none"
[signal.scale]
device = "cnc"
node = "ns=2;s=scale"
type = "i32"
scale = 0.001
unit = "mm"
[axis.z]
limit = 40.0
step = 1.0
rate = 100.0
every = "200ms"
on_fault = {{ action = "hold" }}
[[axis.z.model]]
name = "bed"
kind = "linear"
terms = [ {{ signal = "bed", gain = 1.0, reference = 20.0 }} ]
[output.offset]
axis = "z"
device = "cnc"
writes = "offset"
node = "ns=2;s=offset"
type = "i32"
scale = 0.1
"#
    )
}

/// Returns the same machine with a subscription of its signals.
pub(crate) fn subscribing(port: u16) -> String {
    let every = "every = \"100ms\"";
    machine(port, "").replacen(every, &format!("{every}\nread = \"subscription\""), 1)
}

/// Returns the profile with so many signals more: `many0`, `many1`, …
pub(crate) fn with_many(text: &str, count: usize) -> String {
    let signal = |place| {
        let node = format!("device = \"cnc\"\nnode = \"ns=2;s=many{place}\"\n");
        format!("[signal.many{place}]\n{node}unit = \"degC\"\nmax_age = \"5s\"\n")
    };
    let more: String = (0..count).map(signal).collect();
    format!("{text}{more}")
}

/// Returns the profile of this text. Its files are in this directory.
pub(crate) fn profile(text: &str, directory: &Path) -> Profile {
    let path = directory.join("machine.toml");
    std::fs::write(&path, text).unwrap();
    isotherm_profile::load(&path, &[], &[]).unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Line of a machine.
pub(crate) struct Line {
    pub(crate) profile: Profile,
    line: DeviceLine,
    exchanges: Arc<Exchanges>,
}

/// Counts how often another server may have replaced the one before.
#[derive(Default)]
struct Exchanges(AtomicU32);

impl RequestObserver for Exchanges {
    fn note(&self, _: DeviceId, _: Request<'_>, _: Result<(), Fault>, _: (u32, Fault)) {}

    fn breaks(&self, _: Option<DeviceId>, _: Break) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

impl Line {
    pub(crate) fn new(profile: Profile) -> Line {
        Line::waiting(profile, ANSWERS_WITHIN)
    }

    /// Returns a line that waits for each answer for this time.
    pub(crate) fn waiting(mut profile: Profile, timeout: Duration) -> Line {
        profile.buses[0].timeout = timeout;
        let bus = &profile.buses[0];
        let devices: Vec<_> = profile.devices.iter().map(|device| (DeviceId(0), device)).collect();
        let exchanges = Arc::new(Exchanges::default());
        let line = DeviceLine::new(bus, &devices, dial(bus).unwrap(), &Clock::wall());
        Line { line: line.witnessed(exchanges.clone()), profile, exchanges }
    }

    /// Returns how often another server may have replaced the one before, since the last call.
    pub(crate) fn exchanges(&self) -> u32 {
        self.exchanges.0.swap(0, Ordering::Relaxed)
    }

    /// Returns a line to a server without security.
    pub(crate) fn to(server: &Server) -> Line {
        let directory = tempfile::tempdir().unwrap();
        Line::new(profile(&machine(server.port, ""), directory.path()))
    }

    /// Returns a line to a server with a subscription of its signals.
    pub(crate) fn subscribed(server: &Server) -> Line {
        let directory = tempfile::tempdir().unwrap();
        Line::new(profile(&subscribing(server.port), directory.path()))
    }

    pub(crate) async fn asks(&mut self, request: Request<'_>) -> Result<CheckedAnswer, Fault> {
        self.line.revive(None);
        self.line.request(DeviceId(0), request, SendDeadline::None).await
    }

    /// Reads both signals in one request, and returns their values.
    pub(crate) async fn signals(&mut self) -> Result<[Result<f64, Reason>; 2], Fault> {
        let requests = self.profile.requests(DeviceId(0));
        assert_eq!(requests.len(), 1, "all nodes of a server are one request");
        let answered = self.asks(Request::from(&requests[0].asks)).await?;
        let signals = &self.profile.signals;
        let value =
            |place: usize| answered.answer.decode(&requests[0].fields[place], &signals[place].encoding);
        Ok([value(0), value(1)])
    }

    /// Writes counts to the output.
    pub(crate) async fn writes(&mut self, counts: i32) -> Result<Answer, Fault> {
        let output = self.profile.outputs[0].clone();
        let value = DataType::I32.encode(u64::from(counts.cast_unsigned()));
        let functions = self.profile.devices[0].functions;
        let request = Request::write(&output.address, value.registers(), functions);
        self.asks(request).await.map(|answered| answered.answer)
    }

    /// Reads the counts of the output.
    pub(crate) async fn stands(&mut self) -> Result<i32, Fault> {
        let output = self.profile.outputs[0].clone();
        let request = Request::read(&output.address, output.encoding.data_type).unwrap();
        let answered = self.asks(request).await?.answer.accepted()?;
        Ok(i32::try_from(output.encoding.counts(answered.registers()).unwrap().0).unwrap())
    }
}

pub(crate) fn no_session(why: OpcUaFault) -> Fault {
    Fault::Link(isotherm::fieldbus::error::LinkFault::OpcUa(why))
}

pub(crate) const SHORTLY: Duration = Duration::from_millis(300);
/// Timeout of a line: longer than the server needs on a busy computer.
pub(crate) const ANSWERS_WITHIN: Duration = Duration::from_secs(5);
