//! Targets for fuzzing: readers of bytes from outside. Each accepts any bytes, and panics only on an error in the
//! program.
//!
//! `tests/fuzz` searches for such bytes with a fuzzer. Every test run repeats the inputs that it kept.

use std::cell::Cell;
use std::fs::Permissions;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::fieldbus::kinds::can::canopen::NodeId;
use isotherm::fieldbus::kinds::can::canopen::master::{Master, Start, Supervision};
use isotherm::fieldbus::kinds::can::canopen::sdo::{Client, LONGEST, Progress};
use isotherm::fieldbus::kinds::modbus::rtu::Rtu;
use isotherm::fieldbus::kinds::modbus::tcp::ModbusTcp;
use isotherm::fieldbus::send_guard::SendGuard;
use isotherm::fieldbus::trace::Tap;
use isotherm::fieldbus::wire::{Answer, ModbusRequest, Request, Wire};
use isotherm::gateway::{Gateway, Options};
use isotherm::observe::http::{Admission, TokenFile, serve};
use isotherm::virtual_machine::answered;
use isotherm_core::codec::{
    Address, DataType, Encoding, Entry, Frame, Register, ScaleFrom, ScaleMeaning, checksum,
};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_identify::dataset::{Dataset, Split, every_column, explain, plain_log};
use isotherm_plant::sparkplug::{Address as Node, Sparkplug};
use isotherm_plant::{
    Command, Json, JsonSettings, Metric, Outcome, PrimaryHost, Publisher, Snapshot, Subject, Value,
};
use isotherm_profile::plan::plan;
use isotherm_profile::{Commands, Device, Profile, Quirks, Signal};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpSocket, TcpStream};
use tokio::runtime::Runtime;

mod bytes;
pub(crate) mod lines;
mod peer;

use bytes::Bytes;
use peer::{Peer, RTU};

/// Name of a target, which is that of its directory, and the target.
pub(crate) type Target = (&'static str, fn(&[u8]));

/// All targets.
pub(crate) const TARGETS: [Target; 17] = [
    ("codec", codec),
    ("plan", planner),
    ("profile", profile_text),
    ("templates", template),
    ("files", files),
    ("onnx", onnx),
    ("dbc", dbc),
    ("csv", csv),
    ("parquet", parquet),
    ("tables", tables),
    ("deck", deck),
    ("client", client),
    ("server", server),
    ("canopen", canopen),
    ("http", http),
    ("command", command),
    ("text", lines::text),
];

/// Converts registers to numbers and back.
pub(crate) fn codec(data: &[u8]) {
    let mut bytes = Bytes(data);
    let encoding = bytes.encoding();
    let count = usize::from(bytes.byte() % 6);
    let words: Vec<u16> = (0..count).map(|_| bytes.word()).collect();
    if let Ok(value) = encoding.decode(&words) {
        assert!(value.is_finite(), "{encoding:?} made {value} of {words:?}");
        let again = encoding.encode(value);
        assert_eq!(again.registers().len(), count);
    }
    if let Some(counts) = encoding.counts(&words).filter(|_| encoding.data_type != DataType::Bool) {
        let again = encoding.encode_counts(counts);
        let occupied = encoding.occupied();
        let own: Vec<u16> = words.iter().zip(occupied.registers()).map(|(word, mask)| word & mask).collect();
        assert_eq!((again.registers(), again.saturated), (own.as_slice(), false), "{encoding:?}");
    }
    let any = f64::from_bits(u64::from_be_bytes(bytes.take()));
    assert_eq!(encoding.encode(any).registers().len(), usize::from(encoding.data_type.registers()));
    if let Ok(text) = std::str::from_utf8(bytes.0)
        && let Ok(address) = text.parse::<Register>()
    {
        assert_eq!(address.to_string().parse(), Ok(address));
        assert_eq!(address.modicon().parse(), Ok(address));
    }
}

/// Plans requests for signals, and converts answers of any shape to values.
pub(crate) fn planner(data: &[u8]) {
    let mut bytes = Bytes(data);
    let quirks = Quirks {
        one_request_per_field: bytes.byte() & 7 == 7,
        max_registers_per_request: u16::from(bytes.byte() % 125) + 1,
        max_gap: u16::from(bytes.byte() % 125),
        ..Quirks::default()
    };
    let device = Device { quirks, ..USUAL.devices[0].clone() };
    let signals: Vec<Signal> =
        (0..bytes.byte() % 40).filter_map(|_| signal(&mut bytes, &USUAL.signals[0])).collect();
    let requests = plan(&device, signals.iter().enumerate().map(|(place, signal)| (SignalId(place), signal)));
    let (mut read, mut scales) = (vec![0; signals.len()], vec![0; signals.len()]);
    for request in &requests {
        assert!(Request::from(&request.asks).fits(), "{request:?}");
        let answer = bytes.answer();
        for field in request.scales() {
            scales[field.signal.0] += 1;
            let from = signals[field.signal.0].scale_from.as_ref().unwrap();
            if let Ok(words) = answer.encoded(field) {
                let exponent = from.exponent(words.registers());
                assert!(exponent.is_ok_and(|power| power.abs() <= ScaleFrom::LARGEST) || exponent.is_err());
            }
        }
        for field in request.values() {
            read[field.signal.0] += 1;
            let signal = &signals[field.signal.0];
            let (from, count) = request.span().unwrap();
            assert_eq!(Some(from.offset + field.at), signal.address.register().map(|own| own.offset));
            assert!(field.at + field.len <= count);
            if let Ok(value) = answer.decode(field, &signal.encoding) {
                assert!(value.is_finite(), "{value} of {answer:?} by {:?}", signal.encoding);
            }
        }
    }
    assert!(read.iter().all(|times| *times == 1), "{read:?}");
    assert!(scales.iter().zip(&signals).all(|(times, one)| *times == i32::from(one.scale_from.is_some())));
}

/// Returns a signal; `None` if a profile would reject it because it is beyond the last register.
fn signal(bytes: &mut Bytes<'_>, usual: &Signal) -> Option<Signal> {
    let address = bytes.address();
    let mut encoding = bytes.encoding();
    if address.table.is_bits() {
        encoding.data_type = DataType::Bool;
    }
    let fits = u32::from(address.offset) + u32::from(encoding.data_type.registers()) <= 65_536;
    let merge = bytes.byte() & 3 != 3;
    let scale = Some(bytes.address()).filter(|from| !from.table.is_bits() && from.offset & 3 == 3);
    let scale_from = scale.filter(|_| !address.table.is_bits()).map(|address| ScaleFrom {
        address,
        encoding: Encoding { data_type: DataType::I16, ..encoding.clone() },
        meaning: ScaleMeaning::PowerOfTen,
    });
    let scale_from = scale_from.map(Box::new);
    fits.then(|| Signal { address: address.into(), encoding, merge, scale_from, ..usual.clone() })
}

/// Loads the text of a profile, whole or as one line of a valid one.
pub(crate) fn profile_text(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    let path = Path::new("fuzz.toml");
    if let Err(errors) = isotherm_profile::parse(path, text, &[], &[]) {
        assert!(!errors.to_string().is_empty());
    }
    let within = format!("{PROFILE}\n{text}\n");
    if let Ok(loaded) = isotherm_profile::parse(path, &within, &[], &[]) {
        // The preview of an accepted profile never fails.
        let _ = isotherm_profile::preview::Preview::of(&loaded.profile).to_string();
    }
}

/// Loads the files of a profile: a network, a matrix, an envelope.
pub(crate) fn files(data: &[u8]) {
    let kind = ["n.json", "m.json", "e.json"][usize::from(data.first().copied().unwrap_or_default() % 3)];
    let bytes = data.get(1..).unwrap_or_default();
    let model = match kind {
        "n.json" => "kind = \"network\"\nfile = \"n.json\"\ninputs = [\"bed\"]",
        "m.json" => {
            "kind = \"matrix\"\nfile = \"m.json\"\ninputs = [\"bed\"]\nreference = \"start\"\nposition = \"bed\"\n\
             component = \"z\"\ncarries = \"tool\""
        }
        _ => {
            "kind = \"linear\"\nterms = [ { signal = \"bed\", gain = 1.0, reference = 20.0 } ]\n\
             envelope = \"e.json\""
        }
    };
    let text = format!("{PROFILE}\n[[axis.z.model]]\nname = \"fuzzed\"\n{model}\n");
    if let Err(errors) =
        isotherm_profile::parse_with(Path::new("fuzz.toml"), &text, &[(kind, bytes)], &[], &[])
    {
        assert!(!errors.to_string().is_empty());
    }
}

/// Loads a profile with a device template.
pub(crate) fn template(data: &[u8]) {
    let text = PROFILE.replace("unit = 1\n", "unit = 1\ntemplate = \"fuzzed\"\n");
    let files = [("devices/fuzzed.toml", data)];
    match isotherm_profile::parse_with(Path::new("fuzz.toml"), &text, &files, &[], &[]) {
        Err(errors) => assert!(!errors.to_string().is_empty()),
        Ok(loaded) => drop(isotherm_profile::preview::Preview::of(&loaded.profile).to_string()),
    }
}

/// Loads a network in an ONNX file.
pub(crate) fn onnx(data: &[u8]) {
    let model = "kind = \"network\"\nfile = \"n.onnx\"\ninputs = [\"bed\"]";
    let text = format!("{PROFILE}\n[[axis.z.model]]\nname = \"fuzzed\"\n{model}\n");
    match isotherm_profile::parse_with(Path::new("fuzz.toml"), &text, &[("n.onnx", data)], &[], &[]) {
        Err(errors) => assert!(!errors.to_string().is_empty()),
        Ok(loaded) => drop(isotherm_profile::preview::Preview::of(&loaded.profile).to_string()),
    }
}

thread_local! {
    /// Directory for readers that accept only files.
    static DIRECTORY: tempfile::TempDir = tempfile::tempdir().expect("a directory");
}

fn in_a_file(name: &str, data: &[u8], read: impl FnOnce(&Path)) {
    DIRECTORY.with(|directory| {
        let path = directory.path().join(name);
        std::fs::write(&path, data).expect("room for a file");
        read(&path);
    });
}

/// Reads a CSV log for identification, and replays it with the gateway's own steps.
pub(crate) fn csv(data: &[u8]) {
    in_a_file("fuzz.csv", data, |path| {
        learn(path);
        if let Ok(explanation) = explain(path, &Split::default()) {
            assert!(!explanation.to_string().is_empty());
        }
    });
    if let Err(why) = isotherm::cli::replay::replay(&USUAL, data, "fuzz.csv", None) {
        assert!(!why.to_string().is_empty());
    }
    in_a_file("fuzz.csv", data, replay_as_identify_reads);
    if let Err(why) = isotherm::cli::replay::replay_outputs(data, "fuzz.outputs.csv") {
        assert!(!why.to_string().is_empty());
    }
}

/// Replays a log in any encoding, and below the lines of a logger.
fn replay_as_identify_reads(path: &Path) {
    use isotherm::cli::replay::{Recording, replay};
    let file = std::fs::File::open(path).expect("a file");
    let split = Split { displacements: vec!["z_error_um".to_owned()], ..Split::default() };
    if let Ok(log) = plain_log(path, file, &split, (&|_: &str| None, &every_column)) {
        let (first_rows, left_out) = (log.first_rows, log.left_out);
        let recording = Recording { name: "fuzz.csv", first_rows, left_out, ..Recording::default() };
        if let Err(why) = replay(&USUAL, log.input, recording, None) {
            assert!(!why.to_string().is_empty());
        }
    }
}

/// Reads a Parquet log.
pub(crate) fn parquet(data: &[u8]) {
    in_a_file("fuzz.parquet", data, learn);
}

/// Reads a log in a workbook, and in a compressed file.
pub(crate) fn tables(data: &[u8]) {
    in_a_file("fuzz.xlsx", data, learn);
    in_a_file("fuzz.csv.gz", data, learn);
}

fn learn(path: &Path) {
    let split = Split { gap: Some(Duration::from_secs(3600)), ..Split::default() };
    // The log is read with all columns, and with some of them.
    let some = |name: &str| name.len().is_multiple_of(2);
    for uses in [&every_column as &dyn Fn(&str) -> bool, &some] {
        match Dataset::read(&[path.to_owned()], &split, &|_| None, uses) {
            Err(why) => assert!(!why.to_string().is_empty()),
            Ok(dataset) => {
                for run in &dataset.runs {
                    assert!(run.values.iter().all(|column| column.len() == run.times.len()), "{}", run.name);
                    assert!(run.times.is_sorted());
                }
            }
        }
    }
}

/// Reads an FE input file.
pub(crate) fn deck(data: &[u8]) {
    in_a_file("fuzz.inp", data, |path| {
        if let Err(faults) = isotherm_placement::fe_input::read(path) {
            assert!(!faults.to_string().is_empty());
        }
    });
}

/// Page of a gateway that polls nothing, on a loopback socket of this process. Server and client share one thread, so
/// that neither waits for the other to be woken.
struct Door {
    runtime: Runtime,
    address: SocketAddr,
    asked: Cell<u16>,
    /// Directory of the tokens, which are read again for each request.
    _files: tempfile::TempDir,
}

thread_local! {
    static DOOR: Door = Door::open();
}
static PANICKED: AtomicBool = AtomicBool::new(false);

impl Door {
    fn open() -> Door {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            // A task that panics closes its connection, and the panic would be lost.
            PANICKED.store(true, Ordering::Relaxed);
            before(panic);
        }));
        let files = tempfile::tempdir().expect("a directory");
        let token = |name: &str| {
            let path = files.path().join(name);
            std::fs::write(&path, format!("the-token-of-an-{name}")).expect("room for a file");
            std::fs::set_permissions(&path, Permissions::from_mode(0o600)).expect("it is ours");
            Some(TokenFile::read(&path).expect("a token"))
        };
        let (viewer, operator) = (token("onlooker"), token("operator"));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        let address = runtime.block_on(async {
            let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port");
            let address = listener.local_addr().expect("its address");
            let gateway = Gateway::new(USUAL.clone(), &Clock::wall(), Options::default());
            let admission = Admission { viewer, operator, commands: Commands::Local, ..Admission::default() };
            tokio::spawn(serve(listener, gateway.source(), admission, std::future::pending()));
            address
        });
        Door { runtime, address, asked: Cell::new(0), _files: files }
    }

    /// Connects from another address of this computer each time. A single address has too few ports for this many
    /// connections in a minute.
    async fn connect(&self) -> TcpStream {
        let [high, low] = self.asked.replace(self.asked.get().wrapping_add(1)).to_be_bytes();
        let socket = TcpSocket::new_v4().expect("a socket");
        socket.bind(([127, 1, high, low], 0).into()).expect("a port");
        socket.connect(self.address).await.expect("the page is there")
    }
}

/// Sends requests to the page. Each must be answered in HTTP, or not at all.
pub(crate) fn http(data: &[u8]) {
    PANICKED.store(false, Ordering::Relaxed);
    let answer = DOOR.with(|door| {
        door.runtime.block_on(async {
            let mut stream = door.connect().await;
            let mut answer = Vec::new();
            // The rest of a rejected request is not read.
            if stream.write_all(data).await.is_ok() {
                let _ = stream.shutdown().await;
            }
            let read = tokio::time::timeout(Duration::from_secs(30), stream.read_to_end(&mut answer)).await;
            assert!(read.is_ok(), "it is neither answered nor closed");
            answer
        })
    });
    assert!(answer.is_empty() || answer.starts_with(b"HTTP/1."), "{}", String::from_utf8_lossy(&answer));
    assert!(!PANICKED.load(Ordering::Relaxed), "the server panicked");
}

/// Parses commands of hosts from a broker, as Sparkplug B and as JSON. Each is a number for a known axis, or is
/// rejected with one line.
pub(crate) fn command(data: &[u8]) {
    let now = Moment::from_nanos(1_800_000_000_000_000_000);
    let armed = Metric {
        subject: Subject::Axis("z".to_owned()),
        name: "is_armed",
        value: Some(Value::Flag(true)),
        kind: Value::Flag(false),
        unit: "",
        resolution: 0.0,
        at: now,
    };
    let snapshot = Snapshot { metrics: vec![armed], ..Snapshot::default() };
    let mut node = Sparkplug::new(Node::new("shop", "press").expect("an address"), None, true);
    node.will();
    node.connected(now, &snapshot);
    let topic = node.subscriptions()[0].filter.clone();
    let reaction = node.received(now, &snapshot, &topic, data);
    assert!(reaction.messages.iter().all(|message| message.topic.starts_with("spBv1.0/shop/")));
    match reaction.outcome {
        Some(Outcome::Asked(Command::Measured { axis, report })) => {
            assert!(axis == "z" && report.error_um.is_finite(), "{axis}: {report}");
            assert!(!report.to_string().contains(char::is_control), "{report:?}");
        }
        Some(Outcome::Refused { command, why }) => {
            assert!(!why.is_empty() && command.len() < 1000, "{command}: {why}");
            assert!(!format!("{command}{why}").contains(char::is_control), "{command}: {why}");
        }
        None => {}
    }
    let state = Node::state_topic("scada").expect("a topic");
    let mut waiting = node.waiting_for(state.clone());
    match waiting.received(now, &snapshot, &state, data).outcome {
        Some(Outcome::Refused { why, .. }) => {
            assert!(!waiting.host().is_present() && !why.contains(char::is_control), "{why}");
        }
        outcome => assert!(outcome.is_none() && waiting.host() != PrimaryHost::Unknown, "{outcome:?}"),
    }
    let mut json = Json::new(JsonSettings {
        group: "shop".to_owned(),
        machine: "press".to_owned(),
        version: "0".to_owned(),
        refresh: Duration::from_secs(60),
        takes_measured: true,
        home_assistant: false,
    });
    match json.received(now, &snapshot, "shop/press/command/measured", data).outcome {
        Some(Outcome::Asked(Command::Measured { report, .. })) => assert!(report.error_um.is_finite()),
        Some(Outcome::Refused { why, .. }) => assert!(!why.is_empty()),
        None => panic!("it comes to nothing"),
    }
}

/// Sends requests to a virtual device, in frames of TCP or RTU. Each is answered within a frame, or rejected.
pub(crate) fn server(data: &[u8]) {
    let Some((how, bytes)) = data.split_first() else { return };
    let is_rtu = how & 1 == 1;
    let mut bytes = bytes.to_vec();
    if is_rtu && how & 2 == 2 {
        // The content is only parsed if the checksum is right.
        let sum = checksum(&bytes).to_le_bytes();
        bytes.extend_from_slice(&sum);
    }
    // The shortest request over TCP has eight bytes, and the longest answer has 260.
    assert!(answered(&bytes, is_rtu).len() <= (bytes.len() / 4 + 1) * 260);
}

/// Parses frames of CANopen: answers of a node while an entry is read or written, and messages that its master
/// receives.
pub(crate) fn canopen(data: &[u8]) {
    let mut bytes = Bytes(data);
    let how = bytes.byte();
    let node = NodeId::new(how & 3 | 4).expect("4 to 7");
    let entry = Entry::new(bytes.word(), bytes.byte());
    let mut client = Client::new(node);
    let written = [how; 40];
    let _ = if how & 8 == 0 {
        client.read(entry)
    } else {
        client.write(entry, &written[..usize::from(how % 41)])
    };
    let care = Supervision { heartbeat: Some(Duration::from_secs(1)), start: Start::AtOnce };
    let mut now = Moment::from_nanos(0);
    let mut master = Master::new([(node, care)], None, now);
    let mut outputs = Vec::new();
    for _ in 0..64 {
        if bytes.0.is_empty() {
            break;
        }
        let services = [0x580, 0x580, 0x580, 0x700, 0x080, 0x180];
        let kind = bytes.byte();
        let id = node.identifier(services[usize::from(kind % 6)]);
        let data: [u8; 8] = bytes.take();
        let length = if kind & 0x40 == 0 { 8 } else { usize::from(kind & 7) };
        let Some(frame) = Frame::classic(id, &data[..length]) else { continue };
        now = now.after(Duration::from_millis(u64::from(kind)));
        master.take(&frame, now, &mut outputs);
        master.tick(now, &mut outputs);
        match client.take(&frame) {
            Some(Progress::Read(data)) => assert!(data.bytes().len() <= LONGEST, "{}", data.bytes().len()),
            Some(Progress::Failed(fault, _)) => assert!(!fault.to_string().is_empty()),
            Some(Progress::Send(_) | Progress::Begin(_) | Progress::Written) | None => {}
        }
    }
    assert!(outputs.len() <= 64 * 8, "{}", outputs.len());
}

/// Loads a DBC file, and decodes frames of every length for its signals.
pub(crate) fn dbc(data: &[u8]) {
    let text = "[machine]\nname = \"fuzzed\"\n[bus.can]\ntype = \"can\"\ninterface = \"vcan0\"\n\
                [device.d]\nbus = \"can\"\ndbc = \"f.dbc\"\n\
                [signal.a]\ndevice = \"d\"\ndbc = \"Top.TL_Temp\"\n[signal.b]\ndevice = \"d\"\ndbc = \"Muxed.Deep\"\n";
    match isotherm_profile::parse_with(Path::new("fuzz.toml"), text, &[("f.dbc", data)], &[], &[]) {
        Err(errors) => assert!(!errors.to_string().is_empty()),
        Ok(loaded) => {
            for signal in &loaded.profile.signals {
                let Address::Frame(field) = &signal.address else { panic!("it is on CAN") };
                for length in 0..=data.len().min(64) {
                    if let Some(Ok(words)) = field.read(&data[..length])
                        && let Ok(value) = signal.encoding.decode(words.registers())
                    {
                        assert!(value.is_finite(), "{field}");
                    }
                }
            }
        }
    }
}

static USUAL: LazyLock<Profile> = LazyLock::new(|| {
    isotherm_profile::parse(Path::new("fuzz.toml"), PROFILE, &[], &[]).expect("it is a good one").profile
});

const PROFILE: &str = r#"
[machine]
name = "fuzzed"
[bus.cell]
type = "modbus-tcp"
address = "127.0.0.1:502"
[device.module]
bus = "cell"
unit = 1
every = "1s"
[signal.bed]
device = "module"
register = "input:0"
type = "i16"
unit = "degC"
max_age = "5s"
[output.cnc_z]
axis = "z"
device = "module"
writes = "offset"
register = "holding:104"
type = "i16"
scale = 0.1
[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
every = "10s"
on_fault = { action = "zero" }
[[axis.z.model]]
name = "first"
kind = "linear"
terms = [ { signal = "bed", gain = -4.0, reference = 20.0 } ]
"#;

/// Sends any bytes as an answer to the Modbus client, in frames of TCP or RTU. The result is the expected answer or a
/// fault, never a panic.
pub(crate) fn client(data: &[u8]) {
    let mut bytes = Bytes(data);
    let how = bytes.byte();
    let from = bytes.address();
    let count = u16::from(bytes.byte() % 125) + 1;
    let words = [bytes.word(), bytes.word()];
    let request = match how % 8 {
        0 => Request::Modbus(ModbusRequest::WriteSingle { at: from.offset, value: words[0] }),
        1 => Request::Modbus(ModbusRequest::WriteMultiple { at: from.offset, values: &words }),
        2 => Request::write_coil(from.offset, words[0] & 1 == 1),
        _ => Request::read_registers(from, count),
    };
    if !request.fits() {
        return;
    }
    let unit = bytes.byte();
    let peer = Peer { asked: Vec::new(), answer: bytes.0.to_vec(), at: 0, how, calls: 0 };
    let runtime = tokio::runtime::Builder::new_current_thread().build().expect("a runtime without drivers");
    let mut send_guard = SendGuard::without_deadline(&Clock::wall());
    let tap = Tap::default();
    let answer = if how & RTU == 0 {
        runtime.block_on(ModbusTcp::new(peer, &tap).exchange(unit, request, &mut send_guard))
    } else {
        runtime.block_on(Rtu::new(peer, None, &tap).exchange(unit, request, &mut send_guard))
    };
    match (answer, request) {
        (Ok(Answer::Registers(words)), Request::Modbus(ModbusRequest::Read { from, count })) => {
            assert!(!from.table.is_bits() && words.len() == usize::from(count), "{words:?}");
        }
        (Ok(Answer::Bits(bits)), Request::Modbus(ModbusRequest::Read { from, count })) => {
            assert!(from.table.is_bits() && bits.len() == usize::from(count), "{bits:?}");
        }
        (Ok(Answer::Done), request) => assert!(!request.is_read()),
        (Ok(answer), request) => panic!("{answer:?} to {request:?}"),
        (Err(fault), _) => assert!(!fault.to_string().is_empty()),
    }
}
