//! Conflicts on one CAN line, and the frames written there.

use isotherm_profile::Verify;

use super::can::{LATHE, changed, device, lathe, wrong};
use super::*;

#[test]
fn one_number_names_one_node_and_one_identifier_one_sender() {
    let there = |what: &str| {
        let line = LATHE.lines().position(|line| line.starts_with(what)).unwrap() + 1;
        format!("machine.toml:{line}")
    };
    wrong(
        "node = 127",
        "node = 5",
        "device.encoder.node",
        &["already has the node number 5", &there("node      = 5")],
    );
    let sync = "every = \"100ms\", cob_id = 0x285 }";
    wrong("every = \"100ms\" }", sync, "bus.field.sync.cob_id", &["0x285 is TPDO2 of node 5", "0x80"]);
    wrong("cob_id = 0x185", "cob_id = 0x18C", "signal.column.pdo.cob_id", &["TPDO1 of node 12, `display`"]);
    wrong("cob_id = 0x185", "cob_id = 0x80", "signal.column.pdo.cob_id", &["the SYNC of this line"]);
    wrong(
        "cob_id = 0x185",
        "cob_id = 0x705",
        "signal.column.pdo.cob_id",
        &["the heartbeat of node 5, `axtc`"],
    );
    wrong("cob_id = 0x185", "cob_id = 0x6E5", "signal.column.pdo.cob_id", &["reserved by CiA 301"]);
    wrong("id = 0x100", "id = 0x085", "signal.coolant.frame.id", &["the emergency message of node 5"]);
    wrong("id = 0x100", "id = 0", "signal.coolant.frame.id", &["starts and stops"]);
    wrong(
        "cob_id = 0x20C",
        "cob_id = 0x18C",
        "output.shown_x.pdo.cob_id",
        &["which the node itself sends", "0x200"],
    );
    wrong("cob_id = 0x20C", "cob_id = 0x205", "output.shown_x.pdo.cob_id", &["RPDO1 of node 5, `axtc`"]);
    wrong(
        "cob_id = 0x20C",
        "cob_id = 0x100",
        "output.shown_x.pdo.cob_id",
        &["signal `coolant` is read from 0x100"],
    );
    wrong(
        "[bus.cell]",
        "[bus.other]\ntype = \"can\"\ninterface = \"vcan0\"\n\n[bus.cell]",
        "bus.other.interface",
        &["already has this interface"],
    );
}

#[test]
fn an_offset_over_can_is_read_back_and_a_display_need_not_be() {
    let display = "writes   = \"corrected\"\nposition = \"scale_x\"";
    let offset = "writes   = \"offset\"";
    wrong(
        display,
        offset,
        "output.shown_x.read_back",
        &["an offset must be read back", "a display of a corrected position"],
    );
    let text = changed(display, &format!("{offset}\nread_back = \"2000:01\""));
    let loaded = lathe(&text).unwrap();
    let Verify::ReadBackAt(object) = loaded.profile.outputs[1].verify else { panic!("read back") };
    assert_eq!((object.to_string().as_str(), object.data_type.name()), ("2000:01", "i32"));
    let reported = "verify   = \"echo\"\nwrites   = \"corrected\"\nposition = \"scale_x\"";
    wrong(display, reported, "output.shown_x.verify", &["no device answers a CAN frame"]);
    let by_object = changed(
        "pdo      = { cob_id = 0x20C, start = 0, length = 32, signed = true, fill = \"00 00 00 00 00 00 01 00\" }",
        "sdo      = \"2000:01\"\ntype     = \"i32\"",
    );
    assert_eq!(lathe(&by_object).unwrap().profile.outputs[1].verify, Verify::ReadBack);
}

#[test]
fn several_outputs_share_a_frame_but_no_bit_and_no_object() {
    let second = |pdo: &str| {
        format!(
            "{LATHE}\n[output.second]\naxis = \"x\"\ndevice = \"display\"\nwrites = \"corrected\"\nposition = \"scale_x\"\nscale = 0.1\npdo = {pdo}\n"
        )
    };
    let loaded = lathe(&second("{ cob_id = 0x20C, start = 32, length = 16, signed = true }")).unwrap();
    assert_eq!(device(&loaded, "display").can.as_ref().unwrap().written.len(), 1);
    let one = |pdo: &str| {
        let found = errors(lathe(&second(pdo)));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        found[0].to_string()
    };
    assert!(
        one("{ cob_id = 0x20C, start = 24, length = 24, signed = true }")
            .contains("a bit must have one writer")
    );
    let other =
        one("{ cob_id = 0x20C, start = 32, length = 16, signed = true, fill = \"01 00 00 00 00 00 01 00\" }");
    assert!(other.contains("write `fill` at one output"), "{other}");
    assert!(
        one("{ cob_id = 0x30C, start = 0, length = 16, fill = \"0\" }")
            .contains("`0` is not the content of a frame")
    );
    assert!(one("{ cob_id = 0x30C, start = 0, length = 16, fill = \"00\" }").contains("needs 2 bytes"));
    let objects = LATHE.replace(
        "pdo      = { cob_id = 0x20C, start = 0, length = 32, signed = true, fill = \"00 00 00 00 00 00 01 00\" }",
        "sdo      = \"2000:01\"\ntype     = \"i32\"",
    );
    let twice = format!(
        "{objects}\n[output.second]\naxis = \"x\"\ndevice = \"display\"\nwrites = \"corrected\"\nposition = \"scale_x\"\nscale = 0.001\nsdo = \"2000:01\"\ntype = \"i32\"\n"
    );
    assert!(errors(lathe(&twice))[0].message.contains("writes the same object"));
}
