//! What is not built yet is read, checked, and refused with these very words.

use super::*;

#[test]
fn what_is_not_built_yet_says_so_where_it_stands() {
    let cases = [
        (
            "type = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"",
            "type = \"can\"\ninterface = \"can0\"",
            "bus.cell.type",
        ),
        ("unit = 1", "unit = 1\nnode = 5", "device.module.node"),
        ("unit = 1", "unit = 1\nheartbeat = \"2s\"", "device.module.heartbeat"),
        (
            "unit = 1",
            "unit = 1\nsetup = [ { sdo = \"1800:05\", type = \"u16\", value = 100 } ]",
            "device.module.setup",
        ),
        (
            "unit = 1",
            "unit = 1\nverify = [ { sdo = \"6110:01\", type = \"u16\", equals = 3 } ]",
            "device.module.verify",
        ),
        ("register = \"input:0\"\ntype = \"i16\"", "dbc = \"Top.T\"", "signal.bed.dbc"),
        (
            "register = \"input:0\"\ntype = \"i16\"",
            "pdo = { cob_id = 0x185, start = 0, length = 16, signed = true }",
            "signal.bed.pdo",
        ),
        ("register = \"input:0\"\ntype = \"i16\"", "sdo = \"7130:01\"", "signal.bed.sdo"),
        (
            "register = \"input:0\"\ntype = \"i16\"",
            "frame = { id = 0x100, start = 0, length = 16, order = \"little\" }",
            "signal.bed.frame",
        ),
        ("[history]", "[mqtt]\nbroker = \"mqtt://127.0.0.1:1883\"\nformat = \"json\"\n\n[history]", "mqtt"),
    ];
    for (from, to, key) in cases {
        let found = errors(with(from, to));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert_eq!(found[0].key, key);
        assert!(found[0].message.starts_with("not built yet: "), "{}", found[0]);
    }
}

#[test]
fn what_is_not_built_yet_is_still_checked() {
    let found = errors(with("unit = 1", "unit = 1\nsetup = [ { sdo = \"1800:05\", type = \"u61\" } ]"));
    let told: Vec<&str> = found.iter().map(|error| error.key.as_str()).collect();
    assert_eq!(told, ["device.module.setup", "device.module.setup[0].value", "device.module.setup[0].type"]);
}
