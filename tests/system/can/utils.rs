//! Comparison with can-utils: the program receives what cansend and cangen send, and candump prints what the program
//! sends.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use isotherm::fieldbus::kinds::can::{ReceivedFrame, Socket};
use isotherm_core::codec::{BitField, BitKind, ByteOrder, CanId, CanMatch, Frame};
use isotherm_core::reading::Reason;

use crate::can::interface;
use crate::can::rig::{Interface, beside, load, receive, signal, wait_until};

/// Timeout of a test.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs a program of can-utils until it ends.
fn can_utils(program: &str, arguments: &[&str]) {
    let ended = Command::new(program).args(arguments).output();
    let ended = ended.unwrap_or_else(|error| panic!("{program}: {error}: apt-get install can-utils"));
    assert!(ended.status.success(), "{program} {arguments:?}: {}", String::from_utf8_lossy(&ended.stderr));
}

/// A running candump; killed when it is dropped.
struct Candump {
    child: Child,
    lines: BufReader<ChildStdout>,
}

impl Candump {
    /// Starts candump, and returns when it receives frames.
    fn start(interface: &str, options: &[&str]) -> Candump {
        let mut command = Command::new("candump");
        command.args(["-T", "60000"]).args(options).arg(interface).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("candump: {error}"));
        let lines = BufReader::new(child.stdout.take().unwrap());
        let mut candump = Candump { child, lines };
        // candump does not report when it is ready. Therefore frames are sent until it has received one, then a last
        // one as a mark.
        let ready = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for _ in 0..3000 {
                    if ready.load(Ordering::Relaxed) {
                        break;
                    }
                    can_utils("cansend", &[interface, "7A5#00"]);
                    std::thread::sleep(Duration::from_millis(20));
                }
                can_utils("cansend", &[interface, "7A5#FF"]);
            });
            candump.line();
            ready.store(true, Ordering::Relaxed);
        });
        while !candump.line().ends_with("FF") {}
        candump
    }

    /// Next line.
    fn line(&mut self) -> String {
        let mut line = String::new();
        self.lines.read_line(&mut line).unwrap();
        assert!(!line.is_empty(), "candump has heard nothing for 60 s");
        line.trim_end().to_owned()
    }
}

impl Drop for Candump {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Filter for all data frames.
fn everything() -> Vec<CanMatch> {
    let (short, long) = (CanId::standard(0).unwrap(), CanId::extended(0).unwrap());
    vec![CanMatch { id: short, mask: 0 }, CanMatch { id: long, mask: 0 }]
}

fn open(wanted: &[CanMatch]) -> Socket {
    Socket::open(&interface(), wanted).unwrap()
}

/// Next frame.
async fn heard(socket: &Socket) -> Frame {
    match tokio::time::timeout(PATIENCE, receive(socket))
        .await
        .unwrap_or_else(|_| panic!("no frame for 60 s"))
        .unwrap()
    {
        ReceivedFrame::Frame(frame) => frame,
        ReceivedFrame::Error(trouble) => panic!("a virtual interface has no trouble: {trouble:?}"),
    }
}

async fn sent(socket: &Socket, frame: &Frame) {
    socket.send_now(frame).unwrap();
}

fn standard(raw: u32) -> CanId {
    CanId::standard(raw).unwrap()
}

fn extended(raw: u32) -> CanId {
    CanId::extended(raw).unwrap()
}

/// Bytes that are all different.
fn counting(length: usize) -> Vec<u8> {
    (0..length).map(|at| u8::try_from(at + 1).unwrap()).collect()
}

#[tokio::test]
async fn a_frame_from_cansend_is_heard_as_it_was_sent() {
    let socket = open(&everything());
    for (text, frame) in [
        (
            "5A1#11.2233.44556677.88",
            Frame::classic(standard(0x5a1), &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88]),
        ),
        ("123#DEADBEEF", Frame::classic(standard(0x123), &[0xde, 0xad, 0xbe, 0xef])),
        ("5AA#", Frame::classic(standard(0x5aa), &[])),
        (
            "1F334455#1122334455667788",
            Frame::classic(extended(0x1f33_4455), &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88]),
        ),
        // The same number with 29 bits is another identifier.
        ("00000123#01", Frame::classic(extended(0x123), &[1])),
        ("123##1", Frame::fd(standard(0x123), &[])),
        ("213##311223344", Frame::fd(standard(0x213), &[0x11, 0x22, 0x33, 0x44])),
        (
            "18FEF100##0010203040506070809",
            Frame::fd(extended(0x18fe_f100), &[1, 2, 3, 4, 5, 6, 7, 8, 9, 0, 0, 0]),
        ),
    ] {
        can_utils("cansend", &[&interface(), text]);
        assert_eq!(heard(&socket).await, frame.unwrap(), "{text}");
    }
}

#[tokio::test]
async fn a_request_for_data_from_cansend_is_no_frame_with_data() {
    let socket = open(&everything());
    for text in ["123#R", "1F334455#R8", "124#"] {
        can_utils("cansend", &[&interface(), text]);
    }
    assert_eq!(heard(&socket).await, Frame::classic(standard(0x124), &[]).unwrap());
}

#[tokio::test]
async fn candump_prints_what_we_send_word_for_word() {
    let mut candump = Candump::start(&interface(), &[]);
    let socket = open(&[]);
    let name = interface();
    for (frame, line) in [
        (Frame::classic(standard(0x20c), &[0x0f, 0, 0xff, 0xfe]), "20C [4] 0F 00 FF FE"),
        (Frame::classic(standard(0), &[1, 5]), "000 [2] 01 05"),
        (Frame::classic(standard(0x7ff), &[]), "7FF [0]"),
        (Frame::classic(extended(0x18fe_f121), &counting(8)), "18FEF121 [8] 01 02 03 04 05 06 07 08"),
        (Frame::classic(extended(0x20c), &[7]), "0000020C [1] 07"),
        (Frame::fd(standard(0x20c), &[7]), "20C [01] 07"),
        (
            Frame::fd(extended(0x1abc_def0), &counting(16)),
            "1ABCDEF0 [16] 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F 10",
        ),
    ] {
        sent(&socket, &frame.unwrap()).await;
        // candump moves its columns after it has received a long identifier.
        let printed: Vec<String> = candump.line().split_whitespace().map(str::to_owned).collect();
        assert_eq!(printed.join(" "), format!("{name} {line}"));
    }
}

#[tokio::test]
async fn every_length_that_can_fd_has_goes_both_ways() {
    let mut candump = Candump::start(&interface(), &["-L"]);
    let socket = open(&everything());
    let lengths: Vec<usize> = (0..=64).filter(|length| Frame::fd_length(*length) == Some(*length)).collect();
    assert_eq!(lengths.len(), 16);
    for length in lengths {
        let frame = Frame::fd(standard(0x345), &counting(length)).unwrap();
        sent(&socket, &frame).await;
        assert_eq!(logged(&candump.line()).unwrap(), frame.to_string());
        can_utils("cansend", &[&interface(), &frame.to_string()]);
        assert_eq!(heard(&socket).await, frame, "{length} bytes");
        candump.line();
    }
}

/// Frame in candump's log, `(1700000000.000000) vcan0 123##1AABB`, in the notation of this test: without the CAN FD
/// flags, which describe the transmission of the bits. `None` for a remote frame.
fn logged(line: &str) -> Option<String> {
    let text = line.split(' ').nth(2).unwrap_or_else(|| panic!("{line:?}"));
    let (id, data) = text.split_once('#').unwrap();
    match data.strip_prefix('#') {
        Some(fd) => Some(format!("{id}##0{}", &fd[1..])),
        None if data.starts_with('R') => None,
        None => Some(text.to_owned()),
    }
}

/// Random identifiers of both lengths, classic and FD, of any length, including remote frames.
#[tokio::test]
async fn we_hear_of_cangen_what_candump_hears_to_the_last_byte() {
    const FRAMES: usize = 2000;
    let mut candump = Candump::start(&interface(), &["-L", "-r", "4000000"]);
    let socket = open(&everything());
    let generator = std::thread::spawn(|| {
        can_utils("cangen", &[&interface(), "-m", "-g", "0", "-p", "10", "-n", &FRAMES.to_string()]);
    });
    let frames = tokio::task::spawn_blocking(move || {
        (0..FRAMES).filter_map(|_| logged(&candump.line())).collect::<Vec<_>>()
    });
    let mut ours = Vec::new();
    let theirs = frames.await.unwrap();
    while ours.len() < theirs.len() {
        ours.push(heard(&socket).await.to_string());
    }
    generator.join().unwrap();
    assert!(
        theirs.len() > FRAMES / 3 && theirs.iter().any(|text| text.contains("##")),
        "{} frames",
        theirs.len()
    );
    assert_eq!(ours, theirs);
    assert_eq!((socket.lost(), socket.receive_now().unwrap()), (0, None));
}

/// At full speed, no frame is lost, and the filter keeps unwanted frames from the program.
#[tokio::test]
async fn a_flood_of_cangen_is_survived_and_the_kernel_keeps_it_from_who_does_not_want_it() {
    // Nothing is read before the last frame was sent. The receive buffer has room for this number of frames, also on
    // Linux 6.12.
    const FRAMES: usize = 8_000;
    let wanted = CanMatch::exactly(standard(0x185));
    let (all, one) = (open(&everything()), open(&[wanted]));
    can_utils(
        "cangen",
        &[&interface(), "-g", "0", "-p", "10", "-I", "300", "-L", "8", "-D", "i", "-n", &FRAMES.to_string()],
    );
    can_utils("cansend", &[&interface(), "185#01FE"]);
    assert_eq!(heard(&one).await, Frame::classic(standard(0x185), &[1, 0xfe]).unwrap());
    let mut last = None;
    for at in 0..FRAMES {
        let frame = heard(&all).await;
        assert_eq!(frame.id(), standard(0x300), "frame {at}");
        let count = u64::from_le_bytes(frame.data().try_into().unwrap());
        assert!(last.is_none_or(|last| count == last + 1), "frame {at}: {count} after {last:?}");
        last = Some(count);
    }
    assert_eq!(heard(&all).await.id(), standard(0x185));
    assert_eq!((all.lost(), one.lost()), (0, 0));
}

/// Test vector in the documentation of a CANmod.temp: cold junction and four thermocouples, each with its status.
#[tokio::test]
async fn the_vector_of_the_canmod_decodes_to_its_temperatures() {
    let socket = open(&[CanMatch::exactly(standard(1))]);
    can_utils("cansend", &[&interface(), "001#9904600A28198EBE"]);
    let frame = heard(&socket).await;
    let read = |start, length| {
        let field = BitField::new(start, length, ByteOrder::Intel, BitKind::Unsigned).unwrap();
        i64::try_from(field.bits(frame.data()).unwrap()).unwrap()
    };
    assert_eq!(read(0, 8) - 128, 25);
    let channels: Vec<(i64, i64)> =
        [8, 22, 36, 50].into_iter().map(|start| (read(start + 2, 12) - 2048, read(start, 2))).collect();
    assert_eq!(channels, [(1, 0), (10, 1), (100, 2), (1000, 3)]);
}

#[tokio::test]
async fn a_longer_frame_than_needed_is_read_and_a_shorter_one_is_bad() {
    let socket = open(&[CanMatch::exactly(standard(0x1ff))]);
    let position = BitField::new(0, 32, ByteOrder::Intel, BitKind::Signed).unwrap();
    let mut read = Vec::new();
    for text in ["1FF#FEFFFFFF", "1FF#FEFFFFFF01020304", "1FF##0FEFFFFFF0102030405060708", "1FF#FEFFFF"] {
        can_utils("cansend", &[&interface(), text]);
        read.push(position.bits(heard(&socket).await.data()));
    }
    let minus_two = Ok(0xffff_fffe);
    assert_eq!(read, [minus_two, minus_two, minus_two, Err(Reason::ShortFrame)]);
}

/// Two modules by their templates, and a display with the position of an encoder plus a constant.
const MACHINE: &str = r#"
[machine]
name = "utils"
arm = "auto"

[bus.field]
type = "can"
interface = "INTERFACE"
timeout = "50ms"

[device.canmod]
bus = "field"
template = "css-canmod-temp"
[device.axtc]
bus = "field"
[device.display]
bus = "field"

[signal.cold_junction]
device = "canmod"
channel = "cold_junction_coarse"
[signal.tl]
device = "canmod"
channel = "TL_coarse"
[signal.tr]
device = "canmod"
channel = "TR_coarse"
[signal.status_tr]
device = "canmod"
channel = "TR_coarse_status"
unit = "1"
[signal.status_bl]
device = "canmod"
channel = "BL_coarse_status"
unit = "1"
[signal.status_br]
device = "canmod"
channel = "BR_coarse_status"
unit = "1"

[signal.bed]
device = "axtc"
pdo = { cob_id = 0x185, start = 0, length = 16, signed = true }
scale = 0.0625
bad = [{ raw = -512, means = "open circuit" }, -1]
unit = "degC"
max_rate = "none"
[signal.wall]
device = "axtc"
pdo = { cob_id = 0x185, start = 16, length = 16, signed = true }
scale = 0.0625
bad = [{ raw = -512, means = "open circuit" }, -1]
unit = "degC"
max_rate = "none"

[signal.scale_z]
device = "display"
frame = { id = 0x1FF, start = 0, length = 32, order = "little", signed = true }
scale = 0.001
unit = "mm"
[axis.z]
limit = 40.0
step = 40.0
rate = 1000.0
every = "100ms"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "constant"
kind = "linear"
offset = 8.0
terms = [{ signal = "wall", gain = 1.0, reference = 25.0 }]

[output.readout_z]
axis = "z"
device = "display"
writes = "corrected"
position = "scale_z"
frame = { id = 0x20C, start = 0, length = 32, order = "little", signed = true, fill = "00 00 00 00 00 00 01 00" }
scale = 0.001
"#;

/// The gateway accepts the correct values that cansend sends, and no others. candump prints what the gateway sends.
#[test]
fn the_gateway_decodes_what_cansend_sends_and_candump_reads_the_corrected_position() {
    let field = Interface::new("utils");
    let mut candump = Candump::start(field.name(), &[]);
    beside(load(MACHINE, &field), false, |source| {
        let status = wait_until(source, "the gateway listens", |status| {
            // −512 is an open circuit, not −32 °C. The next value is 25 °C.
            for frame in ["185#00FE9001", "001#9904600A28198EBE", "1FF#40E20100"] {
                can_utils("cansend", &["utils", frame]);
            }
            std::thread::sleep(Duration::from_millis(20));
            status.axes[0].state == "active" && (status.axes[0].cz_um - 8.0).abs() < 1e-9
        });
        let bed = signal(&status, "bed");
        assert!(
            bed.value.is_none() && bed.reason.starts_with("open circuit (raw -512); look for"),
            "{bed:?}"
        );
        let values = ["wall", "cold_junction", "tl", "status_tr", "status_bl", "status_br"];
        let read = values.map(|name| signal(&status, name).value);
        assert_eq!(read, [25.0, 25.0, 1.0, 1.0, 2.0, 3.0].map(Some));
        let broken = signal(&status, "tr");
        assert!(broken.value.is_none() && broken.quality != "good", "{broken:?}");
    });
    // 123.456 mm and 8 µm: 123464 = 0x1E248.
    let wanted = "utils 20C [8] 48 E2 01 00 00 00 01 00";
    while candump.line().split_whitespace().collect::<Vec<_>>().join(" ") != wanted {}
}
