//! Lines to virtual servers, and what each fault makes of a reading. These tests do not need asyncua.

use std::collections::BTreeMap;
use std::time::Duration;

use super::process::{Running, free_port, isotherm};
use super::rig::{Line, SHORTLY, machine, profile, subscribing};
use isotherm::clock::Clock;
use isotherm::fieldbus::error::Fault;
use isotherm::fieldbus::wire::{Answer, Request};
use isotherm::virtual_machine::{FaultScript, Ports, Setup, VirtualMachine};
use isotherm_core::reading::{Reason, Status};
use isotherm_profile::DeviceId;

/// Timeout of a line. A virtual server answers within milliseconds.
const TIMEOUT: Duration = Duration::from_secs(1);

/// Signals in arrays, one of them in a namespace that the profile names by its URI.
const ELEMENTS: &str = r#"
[signal.third]
device  = "cnc"
node    = "ns=2;s=Temps"
element = 2
unit    = "degC"
[signal.corner]
device  = "cnc"
node    = "nsu=urn:plc;i=7"
type    = "f32"
element = [1, 2]
unit    = "degC"
[signal.own]
device  = "cnc"
node    = "ns=1;s=own"
unit    = "degC"
"#;

fn fault(kind: &str, more: &str) -> String {
    format!("[[fault]]\ndevice = \"cnc\"\nkind = \"{kind}\"\n{more}\n")
}

/// Starts the virtual server of a profile, and returns it with a line of the gateway to it.
async fn started(text: &str, faults: &str) -> (VirtualMachine, Line) {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("password"), "secret\n").unwrap();
    let profile = profile(text, directory.path());
    let faults = FaultScript::parse(faults, &profile).unwrap();
    let setup = Setup { ports: Ports::Free, faults, ..Setup::default() };
    let devices = VirtualMachine::start(&profile, setup, &Clock::wall()).await.unwrap();
    let profile = devices.serving(profile);
    (devices, Line::waiting(profile, TIMEOUT))
}

/// Reads all signals, and returns their values by name.
async fn values(line: &mut Line) -> Result<BTreeMap<String, Result<f64, Reason>>, Fault> {
    let requests = line.profile.requests(DeviceId(0));
    let answered = line.asks(Request::from(&requests[0].asks)).await?;
    let value = |field: &isotherm_profile::plan::Field| {
        let signal = line.profile.signal(field.signal);
        (signal.name.clone(), answered.answer.decode(field, &signal.encoding))
    };
    Ok(requests[0].fields.iter().map(value).collect())
}

/// Waits until the line reads good values again, and returns them. Returns `None` if it does not.
async fn recovers(line: &mut Line) -> Option<[f64; 2]> {
    for _ in 0..50 {
        if let Ok([Ok(bed), Ok(scale)]) = line.signals().await {
            return Some([bed, scale]);
        }
        tokio::time::sleep(SHORTLY).await;
    }
    None
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn numbers_elements_and_texts_are_read_from_their_nodes() {
    let user = "security = \"none\"\nuser = { name = \"isotherm\", password_file = \"password\" }";
    let text = machine(4840, user) + ELEMENTS;
    let expected = [("bed", 27.5), ("corner", 31.0), ("own", 18.0), ("scale", -0.25), ("third", 22.5)];
    let value =
        |(signal, value): &(&str, f64)| fault("value", &format!("signal = \"{signal}\"\nvalue = {value:?}"));
    let mut faults: String = expected.iter().map(value).collect();
    for signal in ["bed", "third"] {
        faults += &fault("text", &format!("signal = \"{signal}\""));
    }
    let (devices, mut line) = started(&text, &faults).await;
    let found: Vec<(String, Result<f64, Reason>)> = values(&mut line).await.unwrap().into_iter().collect();
    assert_eq!(found, expected.map(|(signal, value)| (signal.to_owned(), Ok::<f64, Reason>(value))));
    devices.stop().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_fault_of_a_signal_is_the_quality_of_its_reading_alone() {
    for (kind, more, signal, expected) in [
        ("status", "", "bed", Err(Reason::Status(0x808c_0000))),
        ("status", "code = 0x80310000", "bed", Err(Reason::Status(0x8031_0000))),
        ("nan", "", "bed", Err(Reason::NotANumber)),
        ("value", "value = 31.0", "bed", Ok(31.0)),
        ("text", "", "scale", Err(Reason::WrongType)),
        ("sentinel", "raw = 1000", "scale", Ok(1.0)),
    ] {
        let faults = fault(kind, &format!("signal = \"{signal}\"\n{more}"));
        let (devices, mut line) = started(&machine(4840, ""), &faults).await;
        let found = values(&mut line).await.unwrap();
        assert_eq!(found[signal], expected, "{kind}");
        let other = if signal == "bed" { "scale" } else { "bed" };
        assert!(found[other].is_ok(), "{kind}: {found:?}");
        devices.stop().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_fault_of_an_answer_costs_one_call_and_no_value_is_wrong() {
    for (kind, more, expected) in [
        ("silent", "", Some(Fault::Timeout)),
        ("late", "delay = \"3s\"", Some(Fault::Timeout)),
        ("half-open", "", Some(Fault::Timeout)),
        ("close", "", None),
        ("garbage", "", None),
    ] {
        let faults = fault(kind, &format!("for = 1\n{more}"))
            + &fault("value", "signal = \"bed\"\nvalue = 27.5")
            + &fault("value", "signal = \"scale\"\nvalue = -0.25");
        let (devices, mut line) = started(&machine(4840, ""), &faults).await;
        let failed = line.signals().await.unwrap_err();
        assert!(expected.is_none_or(|expected| failed == expected), "{kind}: {failed}");
        assert_eq!(recovers(&mut line).await, Some([27.5, -0.25]), "{kind}");
        devices.stop().await.unwrap();
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_status_for_a_whole_call_makes_each_reading_bad_and_executes_no_write() {
    let faults = fault("status", "code = 0x801F0000\nfor = 2");
    let (devices, mut line) = started(&machine(4840, ""), &faults).await;
    let bad = Err(Reason::Status(0x801f_0000));
    assert_eq!(line.signals().await, Ok([bad, bad]));
    assert_eq!(line.writes(5).await, Err(Fault::Status(Status(0x801f_0000))));
    assert_eq!(line.stands().await, Ok(0));
    devices.stop().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_write_is_read_back_and_an_ignored_one_is_not() {
    let faults = fault("ignored-write", "after = 2\nfor = 1");
    let (devices, mut line) = started(&machine(4840, ""), &faults).await;
    assert_eq!(line.stands().await, Ok(0));
    assert_eq!(line.writes(-37).await, Ok(Answer::Done));
    assert_eq!(line.stands().await, Ok(-37));
    assert_eq!(line.writes(5).await, Ok(Answer::Done));
    assert_eq!(line.stands().await, Ok(-37), "the write was ignored");
    assert_eq!(line.writes(6).await, Ok(Answer::Done));
    assert_eq!(line.stands().await, Ok(6));
    devices.stop().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_restart_loses_what_was_written_and_the_session() {
    let (devices, mut line) = started(&machine(4840, ""), &fault("restart", "after = 2")).await;
    assert_eq!(line.writes(-37).await, Ok(Answer::Done));
    assert_eq!(line.stands().await, Ok(-37));
    assert_eq!(line.exchanges(), 0);
    assert_eq!(line.stands().await, Ok(0), "the third call starts the server again");
    assert!(recovers(&mut line).await.is_some());
    assert_eq!(line.stands().await, Ok(0));
    assert!(line.exchanges() > 0, "the server does not know the session");
    devices.stop().await.unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_closed_listener_refuses_connections_until_it_is_open_again() {
    // On a busy computer, the first request may come seconds after the start of the server.
    let faults = fault("refuse", "for_time = \"5s\"");
    let (devices, mut line) = started(&machine(4840, ""), &faults).await;
    let mut failed = false;
    for _ in 0..500 {
        failed = line.signals().await.is_err();
        if failed {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    assert!(failed && recovers(&mut line).await.is_some(), "failed: {failed}");
    devices.stop().await.unwrap();
}

/// Calls fail after the change. Only the subscription can therefore bring the new value.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_subscription_receives_a_value_that_changes() {
    const CALLS: usize = 60;
    let faults = fault("value", &format!("signal = \"bed\"\nvalue = 31.0\nafter = {CALLS}"))
        + &fault("status", &format!("code = 0x801F0000\nafter = {CALLS}"));
    let (devices, mut line) = started(&subscribing(4840), &faults).await;
    assert!(recovers(&mut line).await.is_some());
    for _ in 0..CALLS {
        let _ = line.writes(5).await;
    }
    assert_eq!(line.writes(5).await, Err(Fault::Status(Status(0x801f_0000))));
    let mut seen = Vec::new();
    for _ in 0..300 {
        seen.push(line.signals().await);
        if matches!(seen.last(), Some(Ok([Ok(31.0), Ok(_)]))) {
            break;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    assert!(matches!(seen.last(), Some(Ok([Ok(31.0), Ok(_)]))), "{seen:?}");
    devices.stop().await.unwrap();
}

#[test]
fn the_verbs_read_and_check_a_virtual_server() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("machine.toml");
    std::fs::write(&path, machine(free_port(), "")).unwrap();
    let mut devices = Running::start(isotherm(home.path()).arg("virtual").arg(&path));
    devices.receives("bus control listens on opc.tcp://127.0.0.1:");
    devices.receives("stop with Ctrl-C");
    let read = isotherm(home.path()).arg("read").arg(&path).arg("--json").output().unwrap();
    let said = String::from_utf8_lossy(&read.stdout);
    assert!(read.status.success(), "{said}\n{}", String::from_utf8_lossy(&read.stderr));
    let document: serde_json::Value = serde_json::from_str(&said).unwrap();
    let signals = document["signals"].as_array().unwrap();
    assert!(signals.len() == 2 && signals.iter().all(|signal| signal["value"].is_f64()), "{said}");
    let check = isotherm(home.path()).arg("check").arg(&path).arg("--online").output().unwrap();
    let said = String::from_utf8_lossy(&check.stdout);
    assert!(check.status.success(), "{said}\n{}", String::from_utf8_lossy(&check.stderr));
}
