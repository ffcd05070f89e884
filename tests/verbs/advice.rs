//! Devices that refuse, shorten or garble answers. Each verb names the key of the profile that helps, and the chapter.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fs::File;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use isotherm_core::codec::checksum;
use rustix::pty::OpenptFlags;

use crate::support::process;

use process::{Running, file, isotherm};

/// Answer of a peer to a request without its frame: unit, function, and the rest. `None`: no answer.
type Answer = fn(&[u8]) -> Option<Vec<u8>>;

/// Output on both streams.
fn said(command: &mut Command) -> String {
    let output = command.output().unwrap();
    [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat()
}

/// Starts a server. `live` serves each connection until it fails.
fn server(live: impl Fn(TcpStream) -> std::io::Result<()> + Send + Sync + 'static) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, live) = (listener.local_addr().unwrap(), Arc::new(live));
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let (stream, live) = (stream.unwrap(), live.clone());
            stream.set_nodelay(true).unwrap();
            // The end of a connection is no error.
            std::thread::spawn(move || live(stream));
        }
    });
    address
}

/// Starts a server of Modbus TCP.
fn modbus_tcp(answer: Answer) -> SocketAddr {
    server(move |mut stream| {
        loop {
            let mut head = [0; 6];
            stream.read_exact(&mut head)?;
            let mut asked = vec![0; usize::from(head[5])];
            stream.read_exact(&mut asked)?;
            if let Some(answer) = answer(&asked) {
                let length = u8::try_from(answer.len()).unwrap();
                stream.write_all(&[&[head[0], head[1], 0, 0, 0, length], answer.as_slice()].concat())?;
            }
        }
    })
}

/// Starts a server of RTU frames, all of eight bytes. `answer` gets the whole request, and returns the bytes to send.
fn rtu(answer: fn(&[u8; 8]) -> Vec<Vec<u8>>) -> SocketAddr {
    server(move |mut stream| {
        loop {
            let mut asked = [0; 8];
            stream.read_exact(&mut asked)?;
            for part in answer(&asked) {
                stream.write_all(&part)?;
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    })
}

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &checksum(body).to_le_bytes()].concat()
}

/// Number of registers of a read.
fn count(asked: &[u8]) -> u8 {
    asked[5]
}

/// Answer with this value in each register.
fn values(asked: &[u8], value: u8) -> Vec<u8> {
    let registers = [0, value].repeat(usize::from(count(asked)));
    [&[asked[0], asked[1], 2 * count(asked)], registers.as_slice()].concat()
}

/// Profile with signals in these input registers, all of type i16.
fn profile(bus: &str, registers: &[u16]) -> String {
    let signals = registers.iter().map(|register| {
        format!(
            "[signal.t{register}]\ndevice = \"module\"\nregister = \"input:{register}\"\ntype = \"i16\"\nunit = \"degC\"\n"
        )
    });
    format!(
        "[machine]\nname = \"advised\"\narm = \"auto\"\n[bus.cell]\n{bus}\ntimeout = \"500ms\"\n[device.module]\n\
         bus = \"cell\"\nunit = 1\n{}",
        signals.collect::<String>()
    )
}

fn tcp(address: SocketAddr) -> String {
    format!("type = \"modbus-tcp\"\naddress = \"{address}\"")
}

/// Output of `check --online` and `read` with this profile. A verb that has read nothing in its time is repeated: the
/// computer ran other programs.
fn online(home: &Path, text: &str) -> [(&'static str, String); 2] {
    let profile = file(home, "machine.toml", text);
    let repeated = |run: &dyn Fn() -> String| {
        let mut all = (0..20).map(|_| run());
        all.find(|output| !output.contains("never read")).unwrap()
    };
    [
        ("check --online", repeated(&|| said(isotherm(home).arg("check").arg(&profile).arg("--online")))),
        ("read", repeated(&|| said(isotherm(home).arg("read").arg(&profile)))),
    ]
}

/// Output of `read --register` for values of type u16 from this register.
fn register(home: &Path, line: &str, register: &str, count: &str) -> (&'static str, String) {
    let read = ["read", "--bus", line, "--unit", "1", "--register", register, "--count", count];
    ("read --register", said(isotherm(home).args(read).args(["--timeout", "500ms"])))
}

fn scan(home: &Path, line: &str, units: &str) -> (&'static str, String) {
    ("scan", said(isotherm(home).args(["scan", "--bus", line, "--units", units, "--timeout", "500ms"])))
}

/// Checks that each verb says all these words. Cause and hint are one sentence, or two lines.
#[track_caller]
fn all_say(verbs: &[(&str, String)], words: &[&str]) {
    for ((verb, said), word) in verbs.iter().flat_map(|verb| words.iter().map(move |word| (verb, word))) {
        let is_said = ["; ", ": "].iter().any(|mark| said.replace("\n      to do: ", mark).contains(word));
        assert!(is_said, "{verb} does not say `{word}`:\n{said}");
    }
}

#[test]
fn a_refused_read_over_a_gap_leads_to_max_gap() {
    let home = tempfile::tempdir().unwrap();
    let address = modbus_tcp(|asked| {
        let refused = vec![asked[0], asked[1] | 0x80, 2];
        Some(if count(asked) > 1 { refused } else { values(asked, 20) })
    });
    let text = profile(&tcp(address), &[0, 4]);
    let words = [
        "exception 2 (illegal data address): the device has no such register",
        "max_gap = 0",
        "docs/serial.md#quirks",
    ];
    let verbs = online(home.path(), &text);
    all_say(&verbs, &words);
    all_say(&verbs[..1], &["write quirks = { max_gap = 0 } at the device: all its values can then be read"]);
    let several = register(home.path(), &format!("tcp://{address}"), "input:0", "5");
    all_say(
        &[several],
        &["input:0..4", "`quirks = { one_request_per_field = true }`", "Try a smaller --count"],
    );

    // The advice helps.
    let mended = text.replace("unit = 1\n", "unit = 1\nquirks = { max_gap = 0 }\n");
    for (verb, said) in online(home.path(), &mended) {
        assert!(!said.contains("illegal data") && said.contains("20.0000"), "{verb}:\n{said}");
    }
}

#[test]
fn a_read_of_several_values_without_an_answer_leads_to_max_registers_per_request() {
    let home = tempfile::tempdir().unwrap();
    let address = modbus_tcp(|asked| (count(asked) < 4).then(|| values(asked, 20)));
    let text = profile(&tcp(address), &[0, 1, 2, 3, 4]);
    let words = ["no answer in time: is the unit number right", "`max_registers_per_request`", "`max_gap`"];
    let verbs = online(home.path(), &text);
    all_say(&verbs, &words);
    let found = [
        "the device answers other requests, but not this read of several values",
        "write quirks = { max_registers_per_request = 2 } at the device: all its values can then be read",
    ];
    all_say(&verbs[..1], &found);
    let several = register(home.path(), &format!("tcp://{address}"), "input:0", "5");
    all_say(&[several], &["`max_registers_per_request`", "Try a smaller --count"]);

    let mended = text.replace("unit = 1\n", "unit = 1\nquirks = { max_registers_per_request = 2 }\n");
    for (verb, said) in online(home.path(), &mended) {
        assert!(!said.contains("no answer in time") && said.contains("20.0000"), "{verb}:\n{said}");
    }
}

#[test]
fn a_refused_write_with_function_06_leads_to_functions() {
    const AXIS: &str = "[axis.z]\nlimit = 10.0\nstep = 1.0\nrate = 1.0\ndeadband = 0.1\nevery = \"1s\"\n\
                        on_fault = { action = \"hold\" }\n[[axis.z.model]]\nname = \"bed\"\nkind = \"linear\"\n\
                        offset = 0.0\nterms = [{ signal = \"t0\", gain = 1.0, reference = 10.0 }]\n\
                        [output.z]\naxis = \"z\"\ndevice = \"module\"\nwrites = \"offset\"\nregister = \"holding:0\"\n\
                        type = \"i16\"\nscale = 0.1\nverify = \"read-back\"\n";
    let home = tempfile::tempdir().unwrap();
    let address = modbus_tcp(|asked| {
        Some(match asked[1] {
            4 => values(asked, 20),
            3 => values(asked, 0),
            function => vec![asked[0], function | 0x80, 1],
        })
    });
    let bus = tcp(address) + "\nlate = \"1s\"";
    let text = profile(&bus, &[0]) + AXIS;
    let machine = file(home.path(), "machine.toml", &text);
    let mut gateway = isotherm(home.path());
    let mut gateway =
        Running::start(gateway.arg("run").arg(&machine).arg("--state").arg(home.path().join("state")));
    let said = gateway.receives("the device does not know function 06");
    let words =
        ["exception 1 (illegal function)", "write `functions` at the device without \"write-single\""];
    all_say(&[("run", said)], &words);
}

#[test]
fn a_server_that_answers_with_its_own_unit_number_is_named_with_that_number() {
    let home = tempfile::tempdir().unwrap();
    let address = modbus_tcp(|asked| {
        let mut answer = values(asked, 20);
        answer[0] = 7;
        Some(answer)
    });
    let line = format!("tcp://{address}");
    let mut verbs = online(home.path(), &profile(&tcp(address), &[0])).to_vec();
    verbs.push(register(home.path(), &line, "input:0", "1"));
    verbs.push(scan(home.path(), &line, "1..3"));
    let words =
        ["the reply names unit 7, which was not requested; if this is the right device", "its `unit`"];
    all_say(&verbs, &words);
    let (_, alone) = &verbs[3];
    assert_eq!(alone.matches("names unit 7").count(), 1, "said once: {alone}");
    assert!(alone.contains("Try --units 7") && !alone.contains("[device."), "{alone}");
    let (_, found) = scan(home.path(), &line, "6..8");
    assert_eq!(found.matches("[device.").count(), 1, "{found}");
    assert!(found.contains("unit 7 answers") && found.contains("[device.unit7]"), "{found}");
}

#[test]
fn another_number_of_registers_leads_to_the_type_or_to_the_length_of_the_request() {
    let home = tempfile::tempdir().unwrap();
    // The module has no values of two registers. It serves at most two registers in a request.
    let address = modbus_tcp(|asked| {
        let most = [0, 0, 0, 0, 0, count(asked).min(2)];
        let mut answer = values(&most, 20);
        (answer[0], answer[1]) = (asked[0], asked[1]);
        Some(answer)
    });
    let several = profile(&tcp(address), &[0, 1, 2, 3]);
    all_say(
        &online(home.path(), &several),
        &["the wrong number of registers; the device sends another number", "`max_registers_per_request`"],
    );
    let double = profile(&tcp(address), &[0]).replace("\"i16\"", "\"f64\"\nword_order = \"msw-first\"");
    all_say(&online(home.path(), &double), &["the wrong number of registers: does `type`"]);
}

#[test]
fn text_on_the_line_is_named_with_its_protocol() {
    let home = tempfile::tempdir().unwrap();
    let ascii = rtu(|_| vec![b":0104020000F9\r\n".to_vec()]);
    let dcon = rtu(|_| vec![b"?01\r".to_vec()]);
    for (address, words) in [
        (
            ascii,
            "Modbus ASCII arrives instead of Modbus RTU; write type = \"modbus-ascii\" at the bus; or set the device",
        ),
        (
            dcon,
            "text of the protocol DCON arrives instead of Modbus; set the protocol of the device from DCON",
        ),
    ] {
        let line = format!("rtu+tcp://{address}");
        let bus = format!("type = \"modbus-rtu-over-tcp\"\naddress = \"{address}\"");
        let mut verbs = online(home.path(), &profile(&bus, &[0])).to_vec();
        verbs.push(register(home.path(), &line, "input:0", "1"));
        verbs.push(scan(home.path(), &line, "1..3"));
        all_say(&verbs, &[words, "docs/serial.md#another-protocol-on-the-line"]);
        let (_, found) = &verbs[3];
        assert!(found.contains("no unit answered") && !found.contains("invalid answer"), "{found}");
    }
}

#[test]
fn an_exception_of_four_bytes_has_the_words_of_the_exception() {
    let home = tempfile::tempdir().unwrap();
    let address = modbus_tcp(|asked| Some(vec![asked[0], asked[1] | 0x80, 2, 0, 0]));
    let mut verbs = online(home.path(), &profile(&tcp(address), &[0])).to_vec();
    verbs.push(register(home.path(), &format!("tcp://{address}"), "input:0", "1"));
    all_say(
        &verbs,
        &["exception 2 (illegal data address), with surplus bytes: the device has no such register"],
    );
    let (_, found) = scan(home.path(), &format!("tcp://{address}"), "1");
    assert!(found.contains("unit 1 answers (exception 2: no such register)"), "{found}");
}

/// Echo of the request in parts, then the answer of unit 4.
fn echoing(asked: &[u8; 8], noise: &[u8], size: usize) -> Vec<Vec<u8>> {
    let mut bytes = [noise, asked].concat();
    if asked[0] == 4 {
        bytes.extend(framed(&[4, asked[1], 2, 0, 42]));
    }
    bytes.chunks(size).map(<[u8]>::to_vec).collect()
}

#[test]
fn on_an_adapter_that_echoes_only_units_that_exist_are_found() {
    let home = tempfile::tempdir().unwrap();
    for (name, adapter) in [
        ("byte by byte", rtu(|asked| echoing(asked, &[], 1))),
        ("in parts of seven bytes", rtu(|asked| echoing(asked, &[], 7))),
        ("whole", rtu(|asked| echoing(asked, &[], 64))),
        ("with noise before it", rtu(|asked| echoing(asked, &[0, 0xff], 64))),
    ] {
        for first in ["holding:0", "input:768"] {
            let line = format!("rtu+tcp://{adapter}");
            let mut scan = isotherm(home.path());
            scan.args(["scan", "--bus", &line, "--units", "3..6", "--timeout", "500ms", "--register", first]);
            let found = said(&mut scan);
            assert!(found.contains(&format!("unit 4 answers: {first} = 42 (0x002A)")), "{name}:\n{found}");
            assert_eq!(found.matches("[device.").count(), 1, "{name}:\n{found}");
            assert!(!found.contains("invalid answer"), "{name}:\n{found}");
        }
    }
}

#[test]
fn a_server_that_returns_each_request_is_no_unit() {
    let home = tempfile::tempdir().unwrap();
    let address = modbus_tcp(|asked| Some(asked.to_vec()));
    let (_, found) = scan(home.path(), &format!("tcp://{address}"), "1..5");
    assert!(found.contains("the request itself comes back instead of a reply"), "{found}");
    assert!(found.contains("no unit answered") && !found.contains("[device."), "{found}");
}

#[test]
fn on_a_line_that_returns_each_request_the_echo_is_named() {
    let home = tempfile::tempdir().unwrap();
    let line = format!("rtu+tcp://{}", rtu(|asked| vec![asked.to_vec()]));
    let verbs = [scan(home.path(), &line, "1..5"), register(home.path(), &line, "holding:0", "1")];
    let words = ["the request itself comes back instead of a reply; ", "no device answers"];
    all_say(&verbs, &words);
    let (_, found) = &verbs[0];
    assert!(found.contains("no unit answered") && !found.contains("[device."), "{found}");
    let address = line.trim_start_matches("rtu+tcp://");
    let text = profile(&format!("type = \"modbus-rtu-over-tcp\"\naddress = \"{address}\""), &[0]);
    all_say(&online(home.path(), &text), &words);
}

#[test]
fn the_type_of_line_may_be_missing() {
    let home = tempfile::tempdir().unwrap();
    let address = modbus_tcp(|asked| Some(values(asked, 20)));
    let (_, found) = scan(home.path(), &address.to_string(), "1..2");
    assert!(found.contains(&format!("on tcp://{address} by reading")), "{found}");
    assert!(found.contains("unit 1 answers: holding:0 = 20"), "{found}");
    let (_, read) = register(home.path(), &address.to_string(), "input:0", "1");
    assert!(read.contains("input:0 (30001)  0014  20"), "{read}");
    for (bus, words) in [
        ("/dev/not-there", "/dev/not-there at 9600 baud 8N1: no such serial port"),
        ("/dev/not-there?baud=19200", "/dev/not-there at 19200 baud 8N1: no such serial port"),
        ("module.invalid", "tcp://module.invalid:502: no such host name"),
        ("module.invalid:1502", "tcp://module.invalid:1502: no such host name"),
    ] {
        let (_, failed) = scan(home.path(), bus, "1");
        assert!(failed.contains(words), "{bus}:\n{failed}");
    }
}

/// An earlier program may have sent a request on the line. Before the first request, the gateway therefore waits for a
/// late answer, and the verbs wait for the gateway.
#[test]
fn a_silent_serial_line_is_reported_after_its_first_request_has_ended() {
    let home = tempfile::tempdir().unwrap();
    let hardware = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    rustix::pty::grantpt(&hardware).unwrap();
    rustix::pty::unlockpt(&hardware).unwrap();
    let path = rustix::pty::ptsname(&hardware, Vec::new()).unwrap().into_string().unwrap();
    let _open = File::options().read(true).write(true).open(&path).unwrap();
    let serial =
        format!("type = \"modbus-rtu\"\nport = \"{path}\"\nbaud = 9600\nparity = \"none\"\nstop_bits = 1");
    let words = [
        "no answer in time",
        "waiting for device module on bus cell, ",
        "no device on bus cell answers: testing whether device module answers after a pause",
    ];
    all_say(&online(home.path(), &profile(&serial, &[0])), &words);
}

#[test]
fn a_device_that_loses_the_first_request_is_named_although_it_answers_the_next_ones() {
    let home = tempfile::tempdir().unwrap();
    let address = server(|mut stream| {
        for place in 0.. {
            let mut asked = [0; 12];
            stream.read_exact(&mut asked)?;
            let answer = values(&asked[6..], 42);
            let length = u8::try_from(answer.len()).unwrap();
            if place > 0 {
                stream.write_all(&[&asked[..2], &[0, 0, 0, length], answer.as_slice()].concat())?;
            }
        }
        Ok(())
    });
    let text = profile(&tcp(address), &[0])
        + "[axis.z]\nlimit = 40.0\nstep = 1.0\nrate = 1.0\nevery = \"1s\"\non_fault = { action = \"hold\" }\n\
           [[axis.z.model]]\nname = \"one\"\nkind = \"linear\"\n\
           terms = [{ signal = \"t0\", gain = 1.0, reference = 20.0 }]\n\
           [output.cz]\naxis = \"z\"\ndevice = \"module\"\nwrites = \"offset\"\nregister = \"holding:104\"\n\
           type = \"i16\"\nscale = 0.1\n";
    for verb in 0..2 {
        // A test in which the computer ran other programs for longer than `timeout` shows nothing.
        let mut all = (0..20).map(|_| online(home.path(), &text)[verb].1.clone());
        assert!(all.any(|output| output.contains("write quirks = { loses_first_request = true }")));
    }
}
