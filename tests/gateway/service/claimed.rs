//! Two gateways on one computer: the second one is refused if it writes to a register of the first.

use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::service::device::{Device, profile};
use crate::service::process::{PATIENCE, Running, file, isotherm};
use crate::service::rig::{Service, TIMES};

const RUNS: &str = "the gateway runs";

/// Device, and a directory for the gateways that write to it.
struct Cell {
    home: tempfile::TempDir,
    device: Device,
}

impl Cell {
    fn new() -> Cell {
        let device = Device::listen(TcpListener::bind("127.0.0.1:0").unwrap(), Duration::ZERO);
        Cell { home: tempfile::tempdir().unwrap(), device }
    }

    /// Starts a gateway of this name, with its own state directory and changed profile.
    fn gateway(&self, name: &str, change: impl FnOnce(String) -> String, options: &[&str]) -> Running {
        let text = profile(self.device.address(), TIMES).replace("\"walker\"", &format!("\"{name}\""));
        let path = file(self.home.path(), &format!("{name}.toml"), &change(text));
        Running::start(&mut run(self.home.path(), &path, &self.home.path().join(name), options))
    }

    fn starts(&self, name: &str, change: impl FnOnce(String) -> String, options: &[&str]) -> Running {
        let mut gateway = self.gateway(name, change, options);
        gateway.receives(RUNS);
        gateway
    }

    /// Checks that the gateway does not start. Returns what it prints.
    #[track_caller]
    fn is_refused(&self, name: &str, change: impl FnOnce(String) -> String) -> String {
        let mut gateway = self.gateway(name, change, &[]);
        let status = gateway.ends_within(PATIENCE);
        let said = gateway.said.join("\n");
        assert_eq!(status.code(), Some(1), "{said}");
        assert!(!said.contains(RUNS), "{said}");
        assert!(!self.home.path().join(name).join(format!("{name}.sock")).exists(), "it leaves no socket");
        said
    }
}

fn run(home: &Path, profile: &Path, state: &Path, options: &[&str]) -> Command {
    let mut command = isotherm(home);
    command.arg("run").arg(profile).arg("--state").arg(state).args(options);
    command
}

#[test]
fn a_second_gateway_with_the_same_register_is_refused_and_the_message_names_the_first() {
    let cell = Cell::new();
    let first = cell.starts("first", |text| text, &[]);
    let said = cell.is_refused("second", |text| text);
    let process = format!("process {}", first.id());
    let state = cell.home.path().join("first").display().to_string();
    for words in [process.as_str(), &state, "machine first", "unit 1 holding:10", "--dry-run"] {
        assert!(said.contains(words), "`{words}` is not in: {said}");
    }
}

#[test]
fn the_same_device_under_another_name_is_the_same() {
    let cell = Cell::new();
    let _first = cell.starts("first", |text| text, &[]);
    for (place, host) in ["localhost", "[::ffff:127.0.0.1]", "127.0.1.1"].into_iter().enumerate() {
        let said = cell.is_refused(&format!("second{place}"), |text| text.replace("127.0.0.1", host));
        assert!(said.contains("is written by another gateway"), "{host}: {said}");
    }
}

#[test]
fn values_that_overlap_by_one_register_are_refused() {
    let cell = Cell::new();
    let _first = cell.starts("first", |text| text.replace("\"holding:10\"", "\"holding:11\""), &[]);
    let wide = "\"holding:10\"\ntype = \"i32\"\nword_order = \"msw-first\"";
    let said = cell.is_refused("second", |text| text.replace("\"holding:10\"\ntype = \"i16\"", wide));
    assert!(said.contains("unit 1 holding:11"), "{said}");
}

#[test]
fn gateways_with_other_registers_and_dry_runs_start() {
    let cell = Cell::new();
    let mut first = cell.starts("first", |text| text, &[]);
    let mut others = [
        cell.starts("register", |text| text.replace("\"holding:10\"", "\"holding:11\""), &[]),
        cell.starts("unit", |text| text.replace("unit = 1", "unit = 2"), &[]),
        cell.starts("dry", |text| text, &["--dry-run"]),
    ];
    assert!(!first.has_ended() && others.iter_mut().all(|other| !other.has_ended()));
}

#[test]
fn a_dry_run_claims_nothing() {
    let cell = Cell::new();
    let _looks = cell.starts("looks", |text| text, &["--dry-run"]);
    cell.starts("writes", |text| text, &[]);
}

#[test]
fn a_gateway_that_was_killed_or_stopped_leaves_no_claim() {
    let cell = Cell::new();
    cell.starts("first", |text| text, &[]).killed();
    let mut second = cell.starts("second", |text| text, &[]);
    second.signal("TERM");
    assert_eq!(second.ends_within(PATIENCE).code(), Some(0));
    cell.starts("third", |text| text, &[]);
}

#[test]
fn a_suspended_gateway_keeps_its_claim() {
    let cell = Cell::new();
    let first = cell.starts("first", |text| text, &[]);
    first.stands_still();
    let said = cell.is_refused("second", |text| text);
    assert!(said.contains(&format!("process {}", first.id())), "{said}");
    first.resumes();
}

#[test]
fn one_of_several_gateways_that_start_at_once_runs() {
    let cell = Cell::new();
    let mut all: Vec<Running> =
        (0..4).map(|place| cell.gateway(&format!("at-once{place}"), |text| text, &[])).collect();
    let mut running = 0;
    for gateway in &mut all {
        let line = gateway.hears_one_of(&[RUNS, "is written by another gateway"]);
        running += usize::from(line.contains(RUNS));
    }
    assert_eq!(running, 1);
}

#[test]
fn a_successor_is_refused_by_a_third_gateway_and_not_by_the_one_it_replaces() {
    let service = Service::start(|text| text);
    let home = service.home.path();
    let text = std::fs::read_to_string(&service.profile).unwrap();
    let other = text.replace("\"walker\"", "\"other\"").replace("\"holding:10\"", "\"holding:11\"");
    let other = file(home, "other.toml", &other);
    let mut other = Running::start(&mut run(home, &other, &home.join("elsewhere"), &[]));
    other.receives(RUNS);
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(0), "{said}");
    service.rewrite(|text| text.replace("\"holding:10\"", "\"holding:11\""));
    let (code, said) = service.restart(&[]);
    assert_eq!(code, Some(1), "{said}");
    for words in [&format!("process {}", other.id()), "the gateway continues as before"] {
        assert!(said.contains(words), "`{words}` is not in: {said}");
    }
    assert_eq!(service.events("started").len(), 2);
    service.walks_to(50);
}
