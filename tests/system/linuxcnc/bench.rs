//! Test bench: the mill, a thermometer with an adjustable temperature, and the gateway as the program that a user
//! starts.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicI16, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::linuxcnc::device::server::{self, Question};
use crate::linuxcnc::mill::Mill;
use crate::linuxcnc::modbus;
use crate::linuxcnc::process::{Running, file, free_port, isotherm, until};

/// Profile in which the target in µm equals the temperature: 0.1 °C is one count. The axis decides ten times per
/// second.
const PROFILE: &str = r#"
[machine]
name = "mill"
arm = "auto"
[bus.sensors]
type = "modbus-tcp"
address = "SENSORS"
timeout = "1s"
[bus.control]
type = "modbus-tcp"
address = "CONTROL"
timeout = "1s"
late = "2s"
[device.thermometer]
bus = "sensors"
unit = 1
every = "100ms"
[device.mill]
bus = "control"
unit = 1
every = "100ms"
template = "linuxcnc-eoffset"
[signal.bed]
device = "thermometer"
register = "holding:0"
type = "i16"
scale = 0.1
bad = [32767]
unit = "degC"
max_age = "1s"
max_rate = "none"
[signal.taking]
device = "mill"
channel = "taking"
unit = "bool"
max_age = "1s"
[axis.z]
limit = 100.0
step = 1.0
rate = 10.0
deadband = 0.0
every = "100ms"
on_fault = { action = "ramp", after = "8s" }
[[axis.z.model]]
name = "bed"
kind = "linear"
terms = [ { signal = "bed", gain = 1.0, reference = 0.0 } ]
[output.mill_z]
axis = "z"
device = "mill"
channel = "z"
refresh = "500ms"
read_back = { register = "input:6", type = "i32", word_order = "msw-first", scale = 0.1, tolerance = 0.05, settle = "1s" }
when = "taking == 1"
[web]
listen = "PAGE"
"#;

/// State of the thermometer.
#[derive(Default)]
struct Bed {
    counts: AtomicI16,
    is_silent: AtomicBool,
    is_broken: AtomicBool,
}

/// Mill, thermometer and gateway.
pub(crate) struct Bench {
    // The gateway is dropped before the mill.
    pub(crate) gateway: Option<Running>,
    pub(crate) mill: Mill,
    home: tempfile::TempDir,
    bed: Arc<Bed>,
    page: SocketAddr,
    said: Vec<String>,
}

impl Bench {
    /// Starts a mill at standstill, and a gateway with an armed and active axis.
    pub(crate) fn start() -> Bench {
        let mill = Mill::start();
        let port = mill.port;
        Bench::by(mill, port)
    }

    /// Starts the bench, with the control at another port.
    pub(crate) fn by(mill: Mill, control: u16) -> Bench {
        let bed = Arc::new(Bed::default());
        let asked = bed.clone();
        let sensors = server::serve(move |question, stream| answer(&asked, question, stream));
        let page = SocketAddr::from(([127, 0, 0, 1], free_port()));
        let text = PROFILE
            .replace("SENSORS", &sensors.to_string())
            .replace("CONTROL", &format!("127.0.0.1:{control}"))
            .replace("PAGE", &page.to_string());
        let home = tempfile::tempdir().unwrap();
        file(home.path(), "mill.toml", &text);
        let mut bench = Bench { gateway: None, mill, home, bed, page, said: Vec::new() };
        bench.gateway_starts();
        bench
    }

    pub(crate) fn gateway_starts(&mut self) {
        let mut command = isotherm(self.home.path());
        command.arg("run").arg(self.home.path().join("mill.toml"));
        command.arg("--state").arg(self.home.path().join("state"));
        let mut gateway = Running::start(&mut command);
        gateway.receives("the gateway runs");
        self.gateway = Some(gateway);
        self.follows("is active");
    }

    /// Kills the gateway with SIGKILL.
    pub(crate) fn gateway_is_killed(&mut self) {
        self.said.extend(self.gateway.take().unwrap().killed());
    }

    /// Stops the gateway, and waits for its end.
    pub(crate) fn gateway_stops(&mut self) {
        let mut gateway = self.gateway.take().unwrap();
        gateway.signal("TERM");
        let exit = gateway.ends_within(crate::linuxcnc::process::PATIENCE);
        self.said.append(&mut gateway.said);
        assert!(exit.success(), "{exit}: {:#?}", self.said);
    }

    /// Sets the target in µm.
    pub(crate) fn wants(&self, um: f64) {
        #[allow(clippy::cast_possible_truncation, reason = "tenths of a micrometre")]
        self.bed.counts.store((10.0 * um).round() as i16, Ordering::SeqCst);
    }

    pub(crate) fn thermometer_is_silent(&self, silent: bool) {
        self.bed.is_silent.store(silent, Ordering::SeqCst);
    }

    pub(crate) fn thermometer_is_broken(&self, broken: bool) {
        self.bed.is_broken.store(broken, Ordering::SeqCst);
    }

    /// Waits until Z has this offset in addition to its program, and the register has the same value.
    #[track_caller]
    pub(crate) fn arrives_at(&mut self, um: f64) {
        let port = self.mill.port;
        let mill = &mut self.mill;
        until("Z arrives", || {
            let (offset, block) = (mill.offset_um(), modbus::block(port));
            let stands = f64::from(modbus::z(&block)) / 10.0;
            let is_there = (offset - um).abs() < 1e-3 && (stands - um).abs() < 1e-9;
            if is_there { Ok(()) } else { Err(format!("{offset} µm, the register {stands}, not {um}")) }
        });
    }

    /// Waits until the axis is active.
    #[track_caller]
    pub(crate) fn follows(&mut self, what: &str) {
        self.is_in_state("active", what);
    }

    #[track_caller]
    pub(crate) fn is_in_state(&mut self, state: &str, what: &str) {
        until(what, || {
            let status = self.status()?;
            let found = status["axes"][0]["state"].as_str().unwrap_or_default().to_owned();
            if found == state { Ok(()) } else { Err(format!("{found}: {}", status["events"])) }
        });
    }

    /// Status on the page.
    pub(crate) fn status(&self) -> Result<serde_json::Value, String> {
        let mut stream = TcpStream::connect(self.page).map_err(|error| error.to_string())?;
        let request = format!("GET /api/status HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.page);
        stream.write_all(request.as_bytes()).map_err(|error| error.to_string())?;
        let mut text = String::new();
        stream.read_to_string(&mut text).map_err(|error| error.to_string())?;
        let body = text.split_once("\r\n\r\n").map(|(_, body)| body).unwrap_or_default();
        serde_json::from_str(body).map_err(|error| format!("{error}: {text}"))
    }

    /// Output of all gateways so far.
    pub(crate) fn said(&mut self) -> Vec<String> {
        let now = self.gateway.iter_mut().flat_map(|gateway| gateway.so_far().to_vec());
        self.said.iter().cloned().chain(now.collect::<Vec<_>>()).collect()
    }

    /// Checks that no change by another client was reported.
    #[track_caller]
    pub(crate) fn blames_nobody(&mut self) {
        let said = self.said();
        for blame in ["this gateway did not write", "to zero; the CNC", "off:"] {
            assert!(!said.iter().any(|line| line.contains(blame)), "{blame}: {said:#?}");
        }
    }
}

fn answer(bed: &Bed, question: &Question, stream: &mut TcpStream) -> std::io::Result<()> {
    if bed.is_silent.load(Ordering::SeqCst) {
        return Ok(());
    }
    let counts = bed.counts.load(Ordering::SeqCst);
    let counts = if bed.is_broken.load(Ordering::SeqCst) { i16::MAX } else { counts };
    let pdu = question.read(&[counts.cast_unsigned()]);
    stream.write_all(&question.answer(&pdu))
}

/// Proxy to the component. It can delay a write while others pass.
pub(crate) struct Way {
    pub(crate) port: u16,
    held: Arc<Mutex<Held>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Held {
    #[default]
    Nothing,
    /// The next write will be delayed.
    Next,
    /// A write is being delayed.
    One,
}

impl Way {
    pub(crate) fn to(port: u16) -> Way {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let way = Way { port: listener.local_addr().unwrap().port(), held: Arc::default() };
        let held = way.held.clone();
        std::thread::spawn(move || {
            for near in listener.incoming().map_while(Result::ok) {
                let far = TcpStream::connect(("127.0.0.1", port)).unwrap();
                let (back, from) = (near.try_clone().unwrap(), far.try_clone().unwrap());
                let held = held.clone();
                std::thread::spawn(move || passes(near, far, |bytes| waits(&held, bytes)));
                std::thread::spawn(move || passes(from, back, |_| {}));
            }
        });
        way
    }

    /// Delays the next write until it is released, and waits for it.
    #[track_caller]
    pub(crate) fn holds_a_write(&self) {
        *self.held.lock().unwrap() = Held::Next;
        until("a write is held", || match *self.held.lock().unwrap() {
            Held::One => Ok(()),
            other => Err(format!("{other:?}")),
        });
    }

    pub(crate) fn lets_it_go(&self) {
        *self.held.lock().unwrap() = Held::Nothing;
    }
}

fn waits(held: &Mutex<Held>, bytes: &[u8]) {
    const FUNCTION: usize = 7;
    let mut state = held.lock().unwrap();
    if *state != Held::Next || bytes.get(FUNCTION) != Some(&16) {
        return;
    }
    *state = Held::One;
    drop(state);
    while *held.lock().unwrap() == Held::One {
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Forwards bytes, however late they are. They are forwarded even if the sender has closed its connection.
fn passes(mut from: TcpStream, mut to: TcpStream, waits: impl Fn(&[u8])) {
    let mut bytes = [0; 512];
    while let Ok(count @ 1..) = from.read(&mut bytes) {
        waits(&bytes[..count]);
        if to.write_all(&bytes[..count]).is_err() {
            return;
        }
    }
}
