use std::path::Path;
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;

use super::answer::{Content, Sender, SentText, TextAnswer};
use super::*;
use crate::clock::Clock;
use crate::virtual_machine::fault::ReplyFault;
use crate::virtual_machine::{FaultScript, Ports, Setup, VirtualMachine};
use isotherm_core::codec::TextPattern;
use isotherm_profile::{BusId, DeviceId, Profile};

const PROFILE: &str = r##"
[machine]
name = "text"

[bus.gauges]
type    = "serial-ascii"
address = "127.0.0.1:4001"

[device.module]
bus  = "gauges"
unit = 0x1a

[device.readout]
bus   = "gauges"
every = "100ms"

[signal.bed]
device  = "module"
text    = ">{number}{any}"
request = "#{unit}\r"
unit    = "degC"

[signal.column]
device  = "module"
text    = ">{skip}{number}{any}"
request = "#{unit}\r"
scale   = 2.0
unit    = "degC"

[signal.z]
device = "readout"
text   = "Z={number.4} mm"
unit   = "mm"
"##;

fn profile() -> Profile {
    let loaded = isotherm_profile::parse(Path::new("text.toml"), PROFILE, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

fn group(request: &str, patterns: &[&str]) -> TextGroup {
    TextGroup {
        bus: BusId(0),
        device: DeviceId(0),
        unit: 0x1a,
        request: request.to_owned(),
        patterns: patterns.iter().map(|pattern| pattern.parse().unwrap()).collect(),
        first: 0,
        every: Duration::from_secs(1),
    }
}

fn sent(sender: &mut Sender, group: &TextGroup, values: &[f64], fault: Option<ReplyFault>) -> SentText {
    sender.send(group, &TextAnswer { content: Content::Values(values.to_vec()), fault })
}

#[test]
fn each_text_has_registers_and_each_request_its_group() {
    let profile = profile();
    let (changed, groups) = in_registers(&profile);
    let offsets: Vec<u16> =
        changed.signals.iter().map(|signal| signal.address.register().unwrap().offset).collect();
    let of = |name: &str| offsets[profile.signals.iter().position(|signal| signal.name == name).unwrap()];
    assert_eq!((of("bed"), of("column"), of("z")), (0, 4, 8));
    let requests: Vec<(&str, u16, usize)> =
        groups.iter().map(|group| (group.request.as_str(), group.first, group.patterns.len())).collect();
    assert_eq!(requests, [("#1A\r", 0, 2), ("", 8, 1)]);
}

#[test]
fn a_fault_changes_the_text_as_a_broken_device_would() {
    let readout = group("", &["Z={number.3} mm"]);
    let module = group("#1A\r", &[">{number}{any}{sum}"]);
    let mut sender = Sender::default();
    let mut text = |group, fault| {
        let sent = sent(&mut sender, group, &[25.4], fault);
        (String::from_utf8_lossy(&sent.bytes).into_owned(), sent.delay, sent.pause.is_some(), sent.closes)
    };
    let plain = |text: &str| (text.to_owned(), Duration::ZERO, false, false);
    let late = Duration::from_millis(300);
    assert_eq!(text(&readout, None), plain("Z=+025.400 mm\r\n"));
    assert_eq!(text(&readout, Some(ReplyFault::WrongUnit)), plain("Z=+001.000 mm\"\r\n"));
    assert_eq!(text(&readout, Some(ReplyFault::ShortRead)), plain("Z=+025\r\n"));
    assert_eq!(text(&readout, Some(ReplyFault::LongRead)), plain("Z=+025.400 mmZ=+025.400 mm\r\n"));
    assert_eq!(
        text(&readout, Some(ReplyFault::Late(late))),
        ("Z=+025.400 mm\r\n".to_owned(), late, false, false)
    );
    assert!(text(&readout, Some(ReplyFault::OneByteAtATime)).2, "byte by byte");
    assert_eq!(text(&readout, Some(ReplyFault::Close)), (String::new(), Duration::ZERO, false, true));
    let right = text(&module, None).0;
    let wrong = text(&module, Some(ReplyFault::WrongChecksum)).0;
    let read = |text: &str| module.patterns[0].read(text.trim_end_matches('\r'));
    assert_eq!(read(&right), Ok(25.4));
    assert_eq!(read(&wrong), Err(isotherm_core::reading::Reason::Checksum));
    let behind = text(&readout, Some(ReplyFault::OneBehind { stale_transaction: false }));
    assert_eq!(behind.0, right, "the text that was due before");
    assert_eq!(text(&readout, Some(ReplyFault::HalfOpen)), plain(""));
    assert_eq!(text(&readout, None), plain(""), "the connection stays mute");
}

#[test]
fn a_refusal_has_the_form_of_the_device() {
    let refused = |group: &TextGroup| {
        let answer = TextAnswer { content: Content::Refused(2), fault: None };
        String::from_utf8(Sender::default().send(group, &answer).bytes).unwrap()
    };
    assert_eq!(refused(&group("#1A\r", &[">{number}"])), "?1A\r");
    assert_eq!(refused(&group("?\r", &["{number}"])), "ERR2\r");
}

#[tokio::test]
async fn a_line_answers_requests_and_sends_what_needs_none() {
    let profile = profile();
    let script = "[[fault]]\ndevice = \"module\"\nkind = \"value\"\nsignal = \"column\"\nvalue = 42.0\n";
    let faults = FaultScript::parse(script, &profile).unwrap();
    let setup = Setup { ports: Ports::Free, faults, ..Setup::default() };
    let machine = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
    let mut stream = TcpStream::connect(machine.address(BusId(0)).unwrap()).await.unwrap();
    stream.write_all(b"#1A\r$1AM\r").await.unwrap();
    let mut lines = BufReader::new(stream);
    let (mut module, mut readout, mut name) = (None, None, None);
    while module.is_none() || readout.is_none() || name.is_none() {
        let mut line = Vec::new();
        assert!(lines.read_until(b'\r', &mut line).await.unwrap() > 0);
        let line = String::from_utf8(line).unwrap().trim().to_owned();
        match line.chars().next() {
            Some('>') => module = Some(line),
            Some('!') => name = Some(line),
            _ => readout = Some(line),
        }
    }
    assert_eq!(name.unwrap(), "!1A7018");
    let column: TextPattern = ">{skip}{number}{any}".parse().unwrap();
    assert_eq!(column.read(&module.unwrap()), Ok(21.0), "42 °C at a scale of 2");
    let z: TextPattern = "Z={number.4} mm".parse().unwrap();
    assert!(z.read(&readout.unwrap()).is_ok());
    machine.stop().await.unwrap();
}
