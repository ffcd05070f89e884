//! Verbs that access a CAN line.

use std::path::PathBuf;
use std::process::{Command, Output};

use crate::can::gateway::{PROFILE, cnc, module, sender};
use crate::can::node::Node;
use crate::can::rig::Interface;

/// A profile in a temporary directory, which is removed when this value is dropped.
struct File(tempfile::TempDir);

impl File {
    fn new(interface: &Interface) -> File {
        let directory = tempfile::tempdir().unwrap();
        let text = PROFILE.replace("INTERFACE", interface.name());
        std::fs::write(directory.path().join("cell.toml"), text).unwrap();
        File(directory)
    }

    fn path(&self) -> PathBuf {
        self.0.path().join("cell.toml")
    }

    fn isotherm(&self, verb: &str, options: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
        command.arg(verb).arg(self.path()).args(options).output().unwrap()
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn read_and_check_show_what_comes_and_what_is_asked_for_and_write_nothing() {
    let interface = Interface::new("verbs");
    let mut prepared = module();
    prepared.objects.insert((0x1800, 5), vec![20, 0]);
    prepared.objects.insert((0x1017, 0), vec![100, 0]);
    let nodes = [prepared, sender(), cnc()].map(|state| Node::new(interface.name(), state));
    let file = File::new(&interface);
    let read = file.isotherm("read", &[]);
    let shown = text(&read.stdout);
    assert!(read.status.success(), "{shown}{}", text(&read.stderr));
    for value in ["25.0000", "24.0000", "123456789.0000"] {
        assert!(shown.contains(value), "{value}: {shown}");
    }
    let check = file.isotherm("check", &["--online"]);
    let shown = text(&check.stdout);
    assert!(check.status.success(), "{shown}{}", text(&check.stderr));
    for part in ["interface verbs: up", "device module (node 5): ok", "output cnc_z"] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    assert!(!shown.contains("warning"), "{shown}");
    let written: Vec<String> = nodes.iter().flat_map(|node| node.state().log.clone()).collect();
    assert!(written.iter().all(|line| !line.contains('=')), "{written:?}");
}

#[test]
fn check_names_the_command_for_an_interface_that_is_missing_or_down() {
    let interface = Interface::absent("vcan77");
    let file = File::new(&interface);
    let check = file.isotherm("check", &["--online"]);
    let shown = text(&check.stdout);
    assert!(!check.status.success());
    assert!(shown.contains("warning: as root: `ip link add dev vcan77 type vcan`"), "{shown}");
    interface.appears();
    interface.down();
    let shown = text(&file.isotherm("check", &["--online"]).stdout);
    assert!(shown.contains("warning: as root: `ip link set dev vcan77 up`"), "{shown}");
}

#[test]
fn on_a_can_line_there_are_no_registers_to_read() {
    let interface = Interface::absent("vcan78");
    let file = File::new(&interface);
    let read = file.isotherm("read", &["--device", "cnc", "--register", "holding:0", "--type", "i16"]);
    assert!(!read.status.success());
    assert!(text(&read.stderr).contains("CAN line"), "{}", text(&read.stderr));
}
