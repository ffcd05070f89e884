//! Every verb reports the same fault with the same text and the same remedy.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fs::File;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::Command;

use rustix::fs::FlockOperation;
use rustix::pty::OpenptFlags;

use crate::support::process;

use process::{Running, file, free_port, isotherm, until};

/// Output on both streams.
fn said(command: &mut Command) -> String {
    let output = command.output().unwrap();
    [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat()
}

fn profile(bus: &str, bad: &str) -> String {
    format!(
        "[machine]\nname = \"explained\"\n[bus.cell]\n{bus}\ntimeout = \"200ms\"\n[device.module]\nbus = \"cell\"\nunit = 1\n\
         [signal.bed]\ndevice = \"module\"\nregister = \"input:0\"\ntype = \"i16\"\nunit = \"degC\"\n{bad}"
    )
}

fn tcp(address: impl std::fmt::Display) -> String {
    format!("type = \"modbus-tcp\"\naddress = \"{address}\"")
}

/// Output of `check --online`, `read` and a scan of the same line.
fn verbs(home: &Path, text: &str, line: &str) -> Vec<(&'static str, String)> {
    let profile = file(home, "machine.toml", text);
    let scan = ["scan", "--bus", line, "--units", "1", "--timeout", "200ms"];
    let register = ["read", "--bus", line, "--unit", "1", "--register", "input:0", "--timeout", "200ms"];
    vec![
        ("check --online", said(isotherm(home).arg("check").arg(&profile).arg("--online"))),
        ("read", said(isotherm(home).arg("read").arg(&profile))),
        ("scan", said(isotherm(home).args(scan))),
        ("read --register", said(isotherm(home).args(register))),
    ]
}

/// Returns whether a verb says these words. Cause and hint are one sentence, or two lines.
fn says(said: &str, words: &str) -> bool {
    let joined = |mark: &str| said.replace("\n      to do: ", mark).replace("\n  to do: ", mark);
    ["; ", ": "].iter().any(|mark| joined(mark).contains(words))
}

#[track_caller]
fn all_say(verbs: &[(&str, String)], words: &str) {
    for (verb, said) in verbs {
        assert!(says(said, words), "{verb} does not say `{words}`:\n{said}");
        assert!(!said.contains("os error"), "{verb}:\n{said}");
    }
}

/// Starts a server that answers every request with this protocol data unit. An exception gets the function code of the
/// request.
fn answers(pdu: &'static [u8]) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            std::thread::spawn(move || {
                let mut question = [0; 12];
                while stream.read_exact(&mut question).is_ok() {
                    let length = u8::try_from(pdu.len() + 1).unwrap();
                    let mut pdu = pdu.to_vec();
                    if pdu[0] > 0x80 {
                        pdu[0] = question[7] | 0x80;
                    }
                    let head = [question[0], question[1], 0, 0, 0, length, question[6]];
                    if stream.write_all(&[&head[..], &pdu].concat()).is_err() {
                        return;
                    }
                }
            });
        }
    });
    address
}

#[test]
fn a_port_that_nothing_listens_on_is_the_same_to_all() {
    let home = tempfile::tempdir().unwrap();
    let address = format!("127.0.0.1:{}", free_port());
    let verbs = verbs(home.path(), &profile(&tcp(&address), ""), &format!("tcp://{address}"));
    all_say(&verbs, "no program listens at this port: is the port right (Modbus TCP: 502, OPC UA: 4840)");
}

#[test]
fn a_name_that_does_not_resolve_is_no_host_that_cannot_be_reached() {
    let home = tempfile::tempdir().unwrap();
    let verbs = verbs(home.path(), &profile(&tcp("module.invalid:502"), ""), "tcp://module.invalid:502");
    all_say(&verbs, "no such host name: is the host name written right");
}

#[test]
fn a_serial_port_that_another_program_has_is_the_same_to_all() {
    let home = tempfile::tempdir().unwrap();
    let hardware = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    rustix::pty::grantpt(&hardware).unwrap();
    rustix::pty::unlockpt(&hardware).unwrap();
    let path = rustix::pty::ptsname(&hardware, Vec::new()).unwrap().into_string().unwrap();
    let holder = File::options().read(true).write(true).open(&path).unwrap();
    rustix::fs::flock(&holder, FlockOperation::LockExclusive).unwrap();
    let bus =
        format!("type = \"modbus-rtu\"\nport = \"{path}\"\nbaud = 9600\nparity = \"none\"\nstop_bits = 1");
    let verbs = verbs(home.path(), &profile(&bus, ""), &format!("rtu://{path}?baud=9600&parity=none"));
    all_say(
        &verbs,
        "another program uses the serial port; end the other program. It may be a gateway that is running",
    );
}

#[test]
fn an_exception_has_its_code_and_its_words_and_a_device_behind_a_gateway_that_says_11_is_not_ok() {
    let home = tempfile::tempdir().unwrap();
    let address = answers(&[0x84, 2]);
    let all = verbs(home.path(), &profile(&tcp(address), ""), &format!("tcp://{address}"));
    let asked: Vec<_> = all.iter().filter(|(verb, _)| *verb != "scan").cloned().collect();
    all_say(&asked, "exception 2 (illegal data address): the device has no such register");

    let address = answers(&[0x84, 11]);
    let all = verbs(home.path(), &profile(&tcp(address), ""), &format!("tcp://{address}"));
    let asked: Vec<_> = all.into_iter().filter(|(verb, _)| *verb != "scan").collect();
    all_say(
        &asked,
        "exception 11 (gateway target does not respond): the Modbus gateway answers, but not the device",
    );
    assert!(!asked[0].1.contains("module: ok"), "{}", asked[0].1);
}

/// Checks the running gateway: its log, its status, and its answer to `arm`.
#[test]
fn a_fault_of_the_running_gateway_is_explained_as_the_other_verbs_explain_it() {
    const AXIS: &str = "[axis.z]\nlimit = 10.0\nstep = 1.0\nrate = 1.0\ndeadband = 0.1\nevery = \"1s\"\n\
                        on_fault = { action = \"hold\" }\n[[axis.z.model]]\nname = \"bed\"\nkind = \"linear\"\n\
                        offset = 0.0\nterms = [{ signal = \"bed\", gain = 1.0, reference = 20.0 }]\n\
                        [output.z]\naxis = \"z\"\ndevice = \"module\"\nwrites = \"offset\"\nregister = \"holding:0\"\n\
                        type = \"i16\"\nscale = 0.1\nverify = \"read-back\"\n[web]\nlisten = \"127.0.0.1:0\"\n";
    let home = tempfile::tempdir().unwrap();
    let closed = format!("127.0.0.1:{}", free_port()).parse().unwrap();
    for (index, (address, words)) in [
        (closed, "no program listens at this port: is the port right (Modbus TCP: 502, OPC UA: 4840)"),
        (answers(&[0x84, 2]), "exception 2 (illegal data address): the device has no such register"),
        (
            answers(&[0x84, 11]),
            "exception 11 (gateway target does not respond): the Modbus gateway answers, but not the device",
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let text = profile(&tcp(address), "").replace("unit = 1\n", "unit = 1\nevery = \"200ms\"\n") + AXIS;
        let machine = file(home.path(), "machine.toml", &text);
        let state = home.path().join(index.to_string());
        let mut gateway =
            Running::start(isotherm(home.path()).arg("run").arg(&machine).arg("--state").arg(&state));
        gateway.receives(words);
        let asked =
            |verb: &[&str]| said(isotherm(home.path()).args(verb).arg(&machine).arg("--state").arg(&state));
        until("the status says it", || {
            let said = asked(&["status"]);
            if says(&said, words) { Ok(()) } else { Err(said) }
        });
        // The gateway answers after waiting for three seconds.
        let mut armed = (0..4).map(|_| asked(&["arm", "--no-wait"]));
        assert!(armed.any(|said| said.contains(words)), "arm does not say `{words}`");
    }
}

#[test]
fn a_raw_value_that_means_no_measurement_is_shown_with_what_it_means() {
    let home = tempfile::tempdir().unwrap();
    let address = answers(&[4, 2, 0x7f, 0xff]);
    for (bad, words) in [
        ("bad = [{ raw = 32767, means = \"open circuit\" }]\n", "open circuit (raw 32767)"),
        ("bad = [-32768, 32767]\n", "no measurement (raw -32768 or 32767)"),
    ] {
        let all = verbs(home.path(), &profile(&tcp(address), bad), &format!("tcp://{address}"));
        all_say(&all[..2], words);
    }
}

#[test]
fn a_page_s_port_that_is_taken_says_who_may_have_it() {
    let home = tempfile::tempdir().unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let profile = file(home.path(), "machine.toml", &profile(&tcp("127.0.0.1:1"), ""));
    let mut run = Running::start(isotherm(home.path()).arg("run").arg(profile).args(["--listen", &address]));
    let said = run.receives("the web page cannot listen");
    assert!(said.contains("perhaps a gateway that is running") && !said.contains("os error"), "{said}");
}
