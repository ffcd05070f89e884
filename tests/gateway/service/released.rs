//! `isotherm release`: a register that no output uses any more returns to its base, after the operator has decided it.

use std::fs::File;
use std::path::PathBuf;
use std::time::Duration;

use rustix::pty::OpenptFlags;

use crate::service::device::{STEP, What, profile};
use crate::service::process::{Running, file, isotherm, until};
use crate::service::rig::{Service, TIMES};

/// Another unit of the same line, to which the output moves. The device does not distinguish the units.
const OTHER: &str = "[device.other]\nbus = \"cell\"\nunit = 2\nevery = \"200ms\"\n[axis.z]";

/// Gateway with 50 counts of its own in a register whose output has moved.
fn moved() -> Service {
    let service = Service::start(|text| text);
    service.walks_to(50);
    service.rewrite(|text| {
        text.replace("[axis.z]", OTHER).replace("device = \"cnc\"\nwrites", "device = \"other\"\nwrites")
    });
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(service.events("register-left").len(), 1, "{said}");
    service.device.state().seen.clear();
    service
}

/// Values written to the register since the last call, from and to.
fn changes(service: &Service) -> Vec<(i16, i16)> {
    let seen = std::mem::take(&mut service.device.state().seen);
    let written = seen.iter().filter_map(|seen| match seen.what {
        What::Wrote { from, to } => Some((from, to)),
        _ => None,
    });
    written.filter(|(from, to)| from != to).collect()
}

/// Runs the verb. Returns its exit code and its output.
fn release(service: &Service, words: &[&str]) -> (Option<i32>, String) {
    let output = service.verb(&[&["release"], words].concat());
    let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    (output.status.code(), said)
}

/// Runs the verb at a terminal, where the operator types this text.
fn at_a_terminal(service: &Service, typed: &str) -> (Option<i32>, String) {
    let end = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    rustix::pty::grantpt(&end).unwrap();
    rustix::pty::unlockpt(&end).unwrap();
    let path = PathBuf::from(rustix::pty::ptsname(&end, Vec::new()).unwrap().into_string().unwrap());
    let terminal = File::options().read(true).write(true).open(path).unwrap();
    rustix::io::write(&end, typed.as_bytes()).unwrap();
    let mut command = isotherm(service.home.path());
    command.arg("release").arg(&service.profile).arg("cnc_z");
    command.arg("--state").arg(service.home.path().join("state")).stdin(terminal);
    let output = command.output().unwrap();
    let said = [output.stdout, output.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    (output.status.code(), said)
}

#[test]
fn a_person_who_says_no_changes_nothing_and_one_who_says_yes_has_the_register_back_at_its_base() {
    let service = moved();
    let (code, said) = release(&service, &["cnc_z"]);
    assert_eq!((code, said.contains("add --yes")), (Some(1), true), "{said}");
    assert!(
        said.contains("5.0 µm from the gateway were verified in holding:10 (40011) of unit 1 at"),
        "{said}"
    );
    assert!(
        said.contains("by at most 1 µm per update and 1000 µm/s, within ±2000 µm: this takes about 1s"),
        "{said}"
    );
    for typed in ["no\n", "\n", "yes please\n"] {
        let (code, said) = at_a_terminal(&service, typed);
        assert_eq!((code, said.contains("Type yes:")), (Some(1), true), "{typed:?}: {said}");
        assert!(said.contains("nothing is released"), "{typed:?}: {said}");
    }
    let (code, said) = release(&service, &["cnc_x", "--yes"]);
    assert_eq!((code, said.contains("these can be released: cnc_z")), (Some(1), true), "{said}");
    assert_eq!((changes(&service), service.device.offset()), (Vec::new(), 50));
    assert_eq!(service.events("started").len(), 2, "no gateway was restarted for it");

    let process = service.gateway.id();
    let (code, said) = at_a_terminal(&service, "yes\n");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("5.0 µm in holding:10 (40011)") && said.contains("has taken over"), "{said}");
    until("the register is back", || match service.device.offset() {
        0 => Ok(()),
        found => Err(found.to_string()),
    });
    let changes_back = changes(&service);
    assert!(changes_back.iter().all(|(from, to)| from - to > 0 && from - to <= STEP), "{changes_back:?}");
    assert_eq!(changes_back.iter().map(|(from, to)| from - to).sum::<i16>(), 50, "{changes_back:?}");
    until("it is reported", || match service.events("register-released").len() {
        1 => Ok(()),
        count => Err(count.to_string()),
    });
    assert_eq!(process, service.gateway.id(), "it is the same process");
    // Nothing more is written, whatever the axis requests, and nothing is left to release.
    service.device.asks(200);
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!((changes(&service), service.device.offset()), (Vec::new(), 0));
    let (code, said) = release(&service, &["cnc_z", "--yes"]);
    assert_eq!(
        (code, said.contains("the running gateway writes to output cnc_z")),
        (Some(1), true),
        "{said}"
    );
    assert!(said.contains("there is nothing to release now"), "{said}");
}

#[test]
fn a_script_releases_with_yes_and_gets_a_document() {
    let service = moved();
    let output = service.verb(&["release", "cnc_z", "--yes", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let answer: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(answer["done"], true, "{answer}");
    until("the register is back", || match service.device.offset() {
        0 => Ok(()),
        found => Err(found.to_string()),
    });
    let commands = service.events("command");
    let is_release = |event: &&serde_json::Value| event["data"]["command"] == "release cnc_z";
    assert_eq!(commands.iter().filter(is_release).count(), 1, "{commands:#?}");
}

#[test]
fn a_register_that_another_gateway_writes_to_by_now_is_left_to_it_and_the_gateway_runs_on() {
    let mut service = moved();
    let text = profile(service.device.address(), TIMES).replace("\"walker\"", "\"neighbour\"");
    let path = file(service.home.path(), "neighbour.toml", &text);
    let mut command = isotherm(service.home.path());
    command.arg("run").arg(&path).arg("--state").arg(service.home.path().join("neighbour"));
    let mut neighbour = Running::start(&mut command);
    neighbour.receives("the gateway runs");
    let process = service.gateway.id();
    let (code, said) = release(&service, &["cnc_z", "--yes"]);
    assert_eq!((code, said.contains("output cnc_z: nothing is released")), (Some(1), true), "{said}");
    assert!(
        said.contains("is written by another gateway")
            && said.contains("leave the register to the other gateway"),
        "{said}"
    );
    assert_eq!((service.gateway.id(), service.gateway.has_ended()), (process, false));
    // A later start does not request it either.
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    assert!(!neighbour.has_ended());
    assert_eq!(service.events("register-released").len(), 0);
}
