//! CAN lines: DBC files, process data, objects, frames, and conflicts on one line.

use super::*;

use isotherm_core::codec::{Address, CanId, DataType, Field, Object};
use isotherm_core::reading::Reason;
use isotherm_profile::{Device, DeviceId, Profile, Transport, Verify, parse_with};

pub(crate) const LATHE: &str = include_str!("can.toml");
pub(crate) const DBC: &str = include_str!("module.dbc");

pub(crate) fn lathe_with_dbc(text: &str, dbc: &str) -> Result<Loaded, Errors> {
    parse_with(Path::new("machine.toml"), text, &[("module.dbc", dbc.as_bytes())], &[], &[])
}

pub(crate) fn lathe(text: &str) -> Result<Loaded, Errors> {
    lathe_with_dbc(text, DBC)
}

pub(crate) fn changed(from: &str, to: &str) -> String {
    assert!(LATHE.contains(from), "{from}");
    LATHE.replacen(from, to, 1)
}

/// Checks the only error of the lathe after a replacement in its text.
#[track_caller]
pub(crate) fn wrong(from: &str, to: &str, key: &str, words: &[&str]) {
    let found = errors(lathe(&changed(from, to)));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert_eq!(found[0].key, key, "{}", found[0]);
    assert!(found[0].line.is_some() && found[0].help.is_some(), "{}", found[0]);
    for word in words {
        assert!(found[0].to_string().contains(word), "`{word}` is not in: {}", found[0]);
    }
}

pub(crate) fn device<'a>(loaded: &'a Loaded, name: &str) -> &'a Device {
    let found = loaded.profile.devices.iter().find(|device| device.name == name);
    found.unwrap_or_else(|| panic!("no {name}"))
}

/// Returns the field of a signal in its frames.
fn field<'a>(profile: &'a Profile, signal: &str) -> &'a Field {
    let mut found = profile.signals.iter().filter(|known| known.name == signal).map(|known| &known.address);
    let Some(Address::Frame(field)) = found.next() else { panic!("{signal} is in no frame") };
    field
}

#[test]
fn a_machine_on_can_is_taken_without_a_word() {
    match lathe(LATHE) {
        Ok(loaded) => assert_eq!(loaded.warnings, []),
        Err(errors) => panic!("{errors}"),
    }
}

#[test]
fn what_is_written_of_a_can_line_becomes_final_types() {
    let loaded = lathe(LATHE).unwrap();
    let bus = &loaded.profile.buses[0];
    assert_eq!((bus.transport, bus.address.as_str()), (Transport::Can, "vcan0"));
    assert_eq!(bus.sync.map(|sync| (sync.id.raw(), sync.every.as_millis())), Some((0x80, 100)));
    let axtc = device(&loaded, "axtc").can.as_ref().unwrap();
    assert_eq!((axtc.node, axtc.start, axtc.heartbeat.map(|span| span.as_secs())), (Some(5), true, Some(2)));
    assert_eq!(axtc.setup[1].object.to_string(), "1800:05");
    assert_eq!(axtc.setup[1].bytes(), [100, 0]);
    let place = loaded.profile.devices.iter().position(|device| device.name == "axtc").unwrap();
    let objects = loaded.profile.objects(DeviceId(place));
    assert_eq!(objects.iter().map(ToString::to_string).collect::<Vec<_>>(), ["6110:01", "6150:01"]);
    assert_eq!(
        (axtc.emergency(0xff01).as_str(), axtc.emergency(0x8130).as_str()),
        ("open thermocouple", "life guard error or heartbeat error",)
    );
    let verify = &device(&loaded, "axtc").verify[0];
    let object = Address::Object(Object::new(0x6110, 1, DataType::U16));
    assert_eq!((&verify.address, verify.equals), (&object, 3));
    assert!(verify.mismatch(&[4]).unwrap().to_string().starts_with("object 6110:01 reads 4 instead of 3"));
    let display = device(&loaded, "display").can.as_ref().unwrap();
    let id = CanId::standard(0x20c).unwrap();
    assert_eq!(display.written(id).unwrap().data(), [0, 0, 0, 0, 0, 0, 1, 0]);
    let output = &loaded.profile.outputs[1];
    assert!(matches!(output.address, Address::Frame(_)));
    assert_eq!(output.verify, Verify::Shown);
    let scale = field(&loaded.profile, "scale_x");
    assert_eq!(scale.to_string(), "0x1ff, 32 bits from 0 up (Intel), signed");
}

#[test]
fn frames_become_values_with_the_shared_sentinels_scales_and_conditions() {
    let profile = lathe(LATHE).unwrap().profile;
    let read = |name: &str, frame: &[u8]| {
        let signal = profile.signals.iter().find(|signal| signal.name == name).unwrap();
        let words = field(&profile, name).read(frame).unwrap()?;
        signal.encoding.decode(words.registers())
    };
    // 22 bits from bit 18: (25 + 16384) · 128 = 2,100,352 counts. The status in the two bits before is 2.
    let bits = (2_100_352u64 << 18 | 2 << 16).to_le_bytes();
    assert_eq!((read("wheelhead", &bits), read("wheelhead_status", &bits)), (Ok(25.0), Ok(2.0)));
    assert_eq!(read("column", &[0x90, 0x01, 0, 0]), Ok(25.0));
    assert_eq!(read("column", &[0x00, 0xfe]), Err(Reason::OpenCircuit));
    assert_eq!(read("column", &[0xff, 0xff]), Err(Reason::Sentinel));
    assert_eq!(read("column", &[0x90]), Err(Reason::ShortFrame));
    assert_eq!(read("coolant", &[0xff, 0x38]), Ok(-20.0));
    assert_eq!(read("scale_x", &[0x10, 0x27, 0, 0, 9, 9, 9]), Ok(10.0));
    let wheelhead = profile.signals.iter().find(|signal| signal.name == "wheelhead").unwrap();
    assert_eq!(wheelhead.fault_when.as_ref().unwrap().holds(&|_| Some(2.0)), Some(true));
}

#[test]
fn keys_of_one_kind_of_line_are_refused_on_the_other() {
    wrong("node = 127", "node = 127\nunit = 1", "device.encoder.unit", &["only for a Modbus device"]);
    wrong("unit = 1", "unit = 1\nnode = 5", "device.cnc.node", &["only for a device on a CAN line"]);
    wrong("unit = 1", "unit = 1\nheartbeat = \"1s\"", "device.cnc.heartbeat", &["on a CAN line"]);
    wrong(
        "interface = \"vcan0\"",
        "interface = \"vcan0\"\naddress = \"a:1\"",
        "bus.field.address",
        &["a TCP line"],
    );
    wrong("interface = \"vcan0\"\n", "", "bus.field.interface", &["is missing", "ip link"]);
    wrong("\"vcan0\"", "\"a name too long for it\"", "bus.field.interface", &["up to 15 characters"]);
    let register = "register = \"input:0\"\ntype = \"i16\"\n";
    wrong(
        "pdo    = { cob_id = 0x185, start = 0, length = 16, signed = true }",
        "register = \"input:0\"",
        "signal.column.register",
        &["only for a Modbus device", "write dbc, pdo, sdo or frame"],
    );
    let extra = |place: &str| format!("[signal.more]\ndevice = \"cnc\"\n{register}{place}\n\n[axis.x]");
    for place in
        ["sdo = \"7130:01\"", "pdo = { cob_id = 0x185, start = 0, length = 16 }", "dbc = \"Top.TL_Temp\""]
    {
        let found = errors(lathe(&changed("[axis.x]", &extra(place))));
        assert!(
            found.iter().any(|error| error.message.contains("only for a device on a CAN line")),
            "{found:?}"
        );
    }
    wrong(
        "word_order = \"msw-first\"",
        "word_order = \"msw-first\"\nread_back = \"6004:00\"",
        "output.cnc_x.read_back",
        &["is on a Modbus line"],
    );
    wrong(
        "position = \"scale_x\"",
        "position = \"scale_x\"\nword_order = \"msw-first\"",
        "output.shown_x.word_order",
        &["only for a Modbus device"],
    );
    wrong(
        "[device.cnc]",
        "[heartbeat]\ndevice = \"axtc\"\nregister = \"holding:1\"\nevery = \"1s\"\n\n[device.cnc]",
        "heartbeat.device",
        &["is written to a register"],
    );
}

#[test]
fn a_misspelt_key_of_a_can_device_is_one_error() {
    for (from, to, key) in [
        ("node      = 5", "noed      = 5", "device.axtc.noed"),
        ("type      = \"can\"", "tyep      = \"can\"", "bus.field.tyep"),
        ("dbc = \"module.dbc\"", "dcb = \"module.dbc\"", "device.canmod.dcb"),
        ("sdo    = \"6150:01\"", "sod    = \"6150:01\"", "signal.column_status.sod"),
    ] {
        wrong(from, to, key, &["did you mean"]);
    }
}

#[test]
fn what_only_a_node_has_needs_a_node_number() {
    let text = changed("node      = 5\n", "");
    let found = errors(lathe(&text));
    let keys: Vec<&str> = found.iter().map(|error| error.key.as_str()).collect();
    assert_eq!(
        keys,
        [
            "device.axtc.heartbeat",
            "device.axtc.setup",
            "device.axtc.verify",
            "device.axtc.emergency",
            "signal.column_status.sdo",
        ]
    );
    wrong("node      = 5", "node      = 128", "device.axtc.node", &["allowed: 1 to 127"]);
    wrong("pdo     = { number = 1,", "pdo     = { number = 5,", "signal.scale_x.pdo.number", &["1 to 4"]);
    wrong(
        "dbc = \"module.dbc\"",
        "dbc = \"module.dbc\"\nstart = false",
        "device.canmod.start",
        &["a CANopen node"],
    );
    wrong(
        "value = 500,",
        "value = 1500,",
        "device.axtc.heartbeat",
        &["one every 1s 500ms", "at least two heartbeats in this time"],
    );
    wrong("value = 100,", "value = 70000,", "device.axtc.setup[1].value", &["u16 cannot contain 70000"]);
    wrong("\"1800:05\"", "\"1800.5\"", "device.axtc.setup[1].sdo", &["as \"7130:01\""]);
    wrong("equals = 3", "equals = -3", "device.axtc.verify[0].equals", &["cannot contain -3"]);
}

#[test]
fn a_field_that_no_frame_holds_is_reported_with_how_many_bytes_it_needs() {
    wrong(
        "start = 0, length = 16",
        "start = 56, length = 16",
        "signal.column.pdo.length",
        &["needs 9 bytes"],
    );
    wrong("start = 7, length = 16", "start = 56, length = 16", "signal.coolant.frame.length", &["fd = true"]);
    wrong(
        "start = 0, length = 16",
        "start = 0, length = 65",
        "signal.column.pdo.length",
        &["allowed: 1 to 64"],
    );
    wrong("order = \"big\", ", "", "signal.coolant.frame.order", &["\"little\" (Intel", "Motorola"]);
    wrong(
        "length = 16, signed = true }\nscale  = 0.0625",
        "length = 16, float = true }\nscale  = 0.0625",
        "signal.column.pdo.length",
        &["allowed: 32 and 64"],
    );
    let fd = "frame  = { id = 0x18FF1234, fd = true, start = 511, length = 8, order = \"big\"";
    let loaded =
        lathe(&changed("frame  = { id = 0x100, start = 7, length = 16, order = \"big\"", fd)).unwrap();
    let field = field(&loaded.profile, "coolant");
    assert!(field.is_fd && field.frames.id.is_extended());
    wrong("id = 0x100,", "id = 0x800, extended = false,", "signal.coolant.frame.extended", &["29 bits"]);
    wrong("raw = -512, means", "raw = -70000, means", "signal.column.bad", &["i16 cannot contain -70000"]);
    wrong(
        "means = \"open circuit\"",
        "means = \"open cicuit\"",
        "signal.column.bad[1].means",
        &["did you mean `open circuit`?"],
    );
    wrong("type   = \"u8\"\n", "", "signal.column_status.type", &["does the object have"]);
    wrong(
        "dbc    = \"Top.TL_Temp\"",
        "dbc    = \"Top.TL_Temp\"\ntype = \"i16\"",
        "signal.wheelhead.type",
        &["the DBC file defines the bits"],
    );
}

#[test]
fn two_signals_may_overlap_and_one_frame_may_hold_many() {
    let more =
        "[signal.half]\ndevice = \"axtc\"\npdo = { cob_id = 0x185, start = 8, length = 12 }\n\n[axis.x]";
    let loaded = lathe(&changed("[axis.x]", more)).unwrap();
    assert_eq!(
        (loaded.warnings.len(), loaded.profile.only_recorded.as_slice()),
        (0, &["half".to_owned()][..])
    );
}

#[test]
fn what_a_dbc_file_does_not_have_is_reported_with_the_nearest_word() {
    wrong("\"Top.TL_Temp\"", "\"Top.TL_Tmp\"", "signal.wheelhead.dbc", &["did you mean `TL_Temp`?"]);
    wrong("\"Top.TL_Temp\"", "\"Tpo.TL_Temp\"", "signal.wheelhead.dbc", &["did you mean `Top`?", "ET1"]);
    wrong("\"Top.TL_Temp\"", "\"TL_Temp\"", "signal.wheelhead.dbc", &["write \"Message.Signal\""]);
}

#[test]
fn the_units_and_scales_of_a_dbc_file_are_not_half_replaced() {
    let temp = "dbc    = \"Top.TL_Temp\"";
    wrong(
        temp,
        &format!("{temp}\nunit = \"mm\""),
        "signal.wheelhead.unit",
        &["the unit \"degC\" for this signal"],
    );
    wrong(temp, &format!("{temp}\nscale = 0.01"), "signal.wheelhead.scale", &["write `offset` as well"]);
    let own = format!("{temp}\nscale = 0.0078125\noffset = -16110.85\nunit = \"K\"");
    let loaded = lathe(&changed(temp, &own)).unwrap();
    assert_eq!(loaded.profile.signals[0].unit.0, "K");
    assert_eq!(lathe(LATHE).unwrap().profile.signals[0].unit.0, "degC");
}

#[test]
fn a_dbc_file_that_cannot_be_read_is_reported_at_its_own_line() {
    let found = errors(lathe_with_dbc(LATHE, &DBC.replace("16|2@1+", "16;2@1+")));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert_eq!((found[0].file.as_str(), found[0].line), ("module.dbc", Some(10)));
    assert!(found[0].excerpt.as_ref().unwrap().contains("16;2@1+"));
    let found = errors(lathe_with_dbc(LATHE, &DBC.replace("18|22@1+", "48|22@1+")));
    assert_eq!((found[0].file.as_str(), found[0].line), ("module.dbc", Some(11)));
    assert!(found[0].message.contains("ends beyond the 8 bytes"), "{}", found[0]);
    wrong("\"module.dbc\"", "\"modul.dbc\"", "device.canmod.dbc", &["modul.dbc is not among the files"]);
}

#[test]
fn a_parameter_group_is_taken_from_any_sender_or_from_the_one_that_the_device_is() {
    let signal = "[signal.oil]\ndevice = \"canmod\"\ndbc = \"ET1.Oil\"\n\n[axis.x]";
    let text = changed("[axis.x]", signal);
    let frames = |text: &str| {
        let loaded = lathe(text).unwrap();
        field(&loaded.profile, "oil").frames
    };
    let sent = |raw| CanId::extended(raw).unwrap();
    assert!(frames(&text).takes(sent(0x18fe_ee21)) && frames(&text).takes(sent(0x0cfe_ee00)));
    let only = text.replace(
        "[device.axtc]",
        "[device.engine]\nbus = \"field\"\ndbc = \"module.dbc\"\nsource_address = 0x21\n\n[device.axtc]",
    );
    let only =
        only.replace("device = \"canmod\"\ndbc = \"ET1.Oil\"", "device = \"engine\"\ndbc = \"ET1.Oil\"");
    let loaded = lathe(&only).unwrap();
    let own = field(&loaded.profile, "oil").frames;
    assert!(own.takes(sent(0x18fe_ee21)) && !own.takes(sent(0x18fe_ee22)));
    wrong(
        "node = 127",
        "node = 127\nsource_address = 3",
        "device.encoder.source_address",
        &["needs a DBC file"],
    );
}

#[test]
fn everything_wrong_on_a_can_line_is_reported_at_once() {
    let text = LATHE
        .replace("node = 127", "node = 5")
        .replace("\"Top.TL_Temp\"", "\"Top.TL_Tmp\"")
        .replace("start = 0, length = 16", "start = 60, length = 16")
        .replace("fill = \"00 00 00 00 00 00 01 00\"", "fill = \"00 0\"")
        .replace("equals = 3", "equals = 70000");
    let found = errors(lathe(&text));
    let keys: Vec<&str> = found.iter().map(|error| error.key.as_str()).collect();
    assert_eq!(
        keys,
        [
            "device.axtc.verify[0].equals",
            "device.encoder.node",
            "signal.wheelhead.dbc",
            "signal.column.pdo.length",
            "output.shown_x.pdo.fill",
        ]
    );
}

/// One name may be a prefix of the other.
#[test]
fn two_devices_with_values_in_one_frame_are_both_named() {
    let device = |name: &str, start: u8| {
        format!(
            "[device.{name}]\nbus = \"field\"\n[signal.of_{name}]\ndevice = \"{name}\"\nscale = 0.1\nunit = \"degC\"\n\
             frame = {{ id = 0x300, start = {start}, length = 16, order = \"little\", signed = true }}\n"
        )
    };
    let text = format!(
        "[machine]\nname = \"bench\"\n[bus.field]\ntype = \"can\"\ninterface = \"vcan0\"\n{}{}",
        device("axtc", 0),
        device("ax", 16)
    );
    let reported = isotherm_profile::preview::Preview::of(&parse(&text).unwrap().profile).to_string();
    assert!(reported.contains("    0x300: values of axtc, values of ax\n"), "{reported}");
}

#[test]
fn a_can_line_is_explained_in_words_and_figures() {
    let machine = lathe(LATHE).unwrap().profile;
    let explanation = isotherm_profile::preview::Preview::of(&machine);
    let reported = explanation.to_string();
    for words in [
        "bus field: CAN at vcan0, timeout 500ms",
        "sends SYNC 0x080 every 100ms",
        "    0x002: values of canmod",
        "    0x085: emergencies of axtc",
        "    0x585: SDO answers of axtc",
        "    0x705: boot-up and heartbeat of axtc",
        "  canmod: sends frames by itself",
        "    frame 0x002: wheelhead (22 bits from 18 up (Intel), unsigned), wheelhead_status (2 bits from 16 up (Intel), unsigned)",
        "  axtc: CANopen node 5",
        "    the gateway starts node 5 by NMT at each start of the gateway and after each boot-up of the node",
        "    the heartbeat of the node counts as missing after 2s, also if none was ever received",
        "    before each start of the node, the gateway writes 1800:05 = 100 (u16): TPDO1 every 100 ms",
        "    object 6150:01, u8, every 1s: column_status",
        "    before arming and every 1m, object 6110:01 must read 3: sensor type of channel 1",
        "    emergency 0xff01: open thermocouple",
        "    sends 0x20c, 8 bytes: 00 00 00 00 00 00 01 00, into which the values of shown_x are inserted",
        "  column: 0x185, 16 bits from 0 up (Intel), signed, from axtc, 0.0625 °C per count; rejected at raw \
         -1 or -512 (open circuit)",
        "  coolant: 0x100, 16 bits from 7 down (Motorola), signed, from canmod, 0.1 °C per count",
        "  shown_x: 0x20c, 32 bits from 0 up (Intel), signed, to display, 0.001 mm per count\n",
        "    accepted as soon as the value is sent: it is only displayed, and not verified",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    let document = serde_json::to_value(&explanation).unwrap();
    assert_eq!(document["devices"][1]["can"]["node"], 5);
    assert_eq!(document["buses"][0]["can"]["filters"][0], "0x002: values of canmod");
    assert_eq!(document["buses"][1]["can"], serde_json::Value::Null);
}
