//! Decoding of frames and objects as the devices send them.

use std::path::Path;

use isotherm_core::codec::{Address, CanId, Frame};
use isotherm_core::reading::Reason;
use isotherm_profile::preview::Preview;
use isotherm_profile::{DeviceId, Errors, Loaded, Profile, Verify, parse};

/// Templates of devices on CAN, with the key that a CANopen node needs.
const CAN: [(&str, &str); 6] = [
    ("axiomatic-axtc4co", "node = 5\n"),
    ("css-canmod-temp", ""),
    ("peak-mu-thermocouple1", ""),
    ("siko-ap10", "node = 12\n"),
    ("temposonics-e-canopen", "node = 127\n"),
    ("tr-la-46-k", "node = 3\n"),
];

/// Loads a machine with one device on CAN.
pub(crate) fn on_can(device: &str, rest: &str) -> Result<Loaded, Errors> {
    let text = format!(
        "[machine]\nname = \"bench\"\n[bus.field]\ntype = \"can\"\ninterface = \"vcan0\"\n\
         [device.d]\nbus = \"field\"\n{device}\n{rest}\n"
    );
    parse(Path::new("machine.toml"), &text, &[], &[])
}

/// Returns a profile with a device of one template and one signal.
#[track_caller]
fn signal(template: &str, channel: &str, more: &str) -> Profile {
    let (_, node) = CAN.iter().find(|(known, _)| *known == template).unwrap();
    let device = format!("{node}template = \"{template}\"");
    let rest = format!("[signal.s]\ndevice = \"d\"\nchannel = {channel}\n{more}");
    on_can(&device, &rest).unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Decodes the signal with this name from the bytes of a frame or an object.
fn read(profile: &Profile, name: &str, id: u32, bytes: &[u8]) -> Result<f64, Reason> {
    let signal = profile.signals.iter().find(|signal| signal.name == name).unwrap();
    let words = match &signal.address {
        Address::Frame(field) => {
            assert!(field.frames.takes(CanId::standard(id).unwrap()), "{field} is not of {id:#x}");
            field.read(bytes).unwrap()?
        }
        Address::Object(object) => {
            assert_eq!(u32::from(object.entry.index), id, "{object}");
            object.registers(bytes).ok_or(Reason::BadReply)?
        }
        other @ (Address::Modbus(_) | Address::Node(_) | Address::Sensor(_) | Address::Text(_)) => {
            panic!("{other}")
        }
    };
    signal.encoding.decode(words.registers())
}

/// Returns whether `fault_when` of the first signal holds for these values of the others.
fn condemned(profile: &Profile, values: &[(&str, f64)]) -> Option<bool> {
    let value = |id: isotherm_core::reading::SignalId| {
        values.iter().find(|(name, _)| *name == profile.signal(id).name).map(|(_, value)| *value)
    };
    profile.signals[0].fault_when.as_ref().unwrap().holds(&value)
}

#[test]
fn an_axiomatic_scanner_says_open_circuit_and_switched_off_by_counts_that_would_scale_to_temperatures() {
    let machine = signal("axiomatic-axtc4co", "3", "scale = 0.0625");
    let frame = |raw: i16| {
        let [low, high] = raw.to_le_bytes();
        [0, 0, 0, 0, low, high, 0, 0]
    };
    assert_eq!(read(&machine, "s", 0x185, &frame(400)), Ok(25.0));
    assert_eq!(read(&machine, "s", 0x185, &frame(-160)), Ok(-10.0));
    assert_eq!(read(&machine, "s", 0x185, &frame(-512)), Err(Reason::OpenCircuit));
    assert_eq!(Reason::OpenCircuit.to_string(), "open circuit");
    assert_eq!(read(&machine, "s", 0x185, &frame(-1)), Err(Reason::SwitchedOff));
    assert_eq!(read(&machine, "d_status_3", 0x6150, &[3]), Ok(3.0));
    assert_eq!(machine.objects(DeviceId(0))[0].to_string(), "6150:03");
    for (status, bad) in [(0.0, false), (3.0, true), (16.0, false), (32.0, false), (65.0, true)] {
        assert_eq!(condemned(&machine, &[("d_status_3", status)]), Some(bad), "{status}");
    }
    let junction = signal("axiomatic-axtc4co", "\"cold_junction\"", "");
    assert_eq!(read(&junction, "s", 0x285, &[0x68, 0x01, 0, 0]), Ok(22.5));
    let asked = signal("axiomatic-axtc4co", "\"value_2\"", "");
    assert_eq!(read(&asked, "s", 0x6100, &25.5f32.to_le_bytes()), Ok(25.5));
}

#[test]
fn an_axiomatic_scanner_is_set_up_watched_checked_and_its_emergencies_have_words() {
    let device = "node = 5\ntemplate = \"axiomatic-axtc4co\"\nexpect = { sensor_type = 3 }";
    let signals = "[signal.s]\ndevice = \"d\"\nchannel = 4\nscale = 0.0625";
    let machine = on_can(device, signals).unwrap_or_else(|errors| panic!("{errors}")).profile;
    let can = machine.devices[0].can.as_ref().unwrap();
    assert_eq!(can.heartbeat.map(|span| span.as_secs()), Some(2));
    let setup: Vec<String> = can.setup.iter().map(|one| format!("{} = {}", one.object, one.value)).collect();
    assert_eq!(setup, ["1017:00 = 500", "1800:05 = 100", "1801:05 = 1000"]);
    assert_eq!(machine.devices[0].verify[0].to_string(), "object 6110:04");
    assert!(can.emergency(0xf001).contains("open circuit"));
    assert_eq!(can.emergency(0x8130), "life guard error or heartbeat error");
    let unscaled = on_can(device, "[signal.s]\ndevice = \"d\"\nchannel = 1").unwrap_err();
    assert!(
        unscaled.to_string().contains("`scale` is missing: template `axiomatic-axtc4co` does not set it")
    );
    let own = device.to_owned()
        + "\nheartbeat = \"5s\"\nsetup = [{ sdo = \"1800:05\", type = \"u16\", value = 200 }]";
    let machine = on_can(&own, signals).unwrap_or_else(|errors| panic!("{errors}")).profile;
    let can = machine.devices[0].can.as_ref().unwrap();
    let setup: Vec<String> = can.setup.iter().map(|one| format!("{} = {}", one.object, one.value)).collect();
    assert_eq!(setup, ["1800:05 = 200", "1017:00 = 500", "1801:05 = 1000"]);
    assert_eq!(can.heartbeat.map(|span| span.as_secs()), Some(5));
}

/// The frame is published by the manufacturer.
#[test]
fn a_canmod_decodes_its_published_frame_with_each_temperature_beside_its_status() {
    const FRAME: [u8; 8] = [0x99, 0x04, 0x60, 0x0a, 0x28, 0x19, 0x8e, 0xbe];
    for (channel, value, status) in
        [("TL", 1.0, 0.0), ("TR", 10.0, 1.0), ("BL", 100.0, 2.0), ("BR", 1000.0, 3.0)]
    {
        let machine = signal("css-canmod-temp", &format!("\"{channel}_coarse\""), "");
        let beside = format!("d_{channel}_coarse_status");
        assert_eq!(read(&machine, "s", 1, &FRAME), Ok(value));
        assert_eq!(read(&machine, &beside, 1, &FRAME), Ok(status));
        assert_eq!(condemned(&machine, &[(&beside, status)]), Some(status > 0.0));
        assert_eq!(machine.signals[0].unit.0, "degC");
    }
    let junction = signal("css-canmod-temp", "\"cold_junction_coarse\"", "");
    assert_eq!(read(&junction, "s", 1, &FRAME), Ok(25.0));
}

#[test]
fn a_canmod_s_fine_frames_hold_22_bits_at_odd_places() {
    let place = |value: f64, status: u64| -> u64 {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole count above zero"
        )]
        let raw = ((value + 16384.0) * 128.0) as u64;
        raw << 2 | status
    };
    // The cold junction is in the first 16 bits. Two bits of status and 22 of temperature follow, twice.
    let frame = (34_320 | place(23.5, 0) << 16 | place(-4.25, 2) << 40).to_le_bytes();
    for (first, second, junction, id) in
        [("TL", "TR", "cold_junction_top", 2), ("BL", "BR", "cold_junction_bottom", 3)]
    {
        let one = signal("css-canmod-temp", &format!("\"{first}\""), "");
        assert_eq!(read(&one, "s", id, &frame), Ok(23.5));
        assert_eq!(read(&one, &format!("d_{first}_status"), id, &frame), Ok(0.0));
        let other = signal("css-canmod-temp", &format!("\"{second}\""), "");
        assert_eq!(read(&other, "s", id, &frame), Ok(-4.25));
        assert_eq!(read(&other, &format!("d_{second}_status"), id, &frame), Ok(2.0));
        assert_eq!(
            read(&signal("css-canmod-temp", &format!("\"{junction}\""), ""), "s", id, &frame),
            Ok(24.25)
        );
    }
}

#[test]
fn a_peak_unit_sends_sixteenths_of_a_degree_in_three_frames() {
    let frame = [0x90, 0x01, 0x9c, 0xff, 0x94, 0x01, 0x00, 0x00];
    for (channel, id, value) in [
        ("1A", 0x100, 25.0),
        ("1B", 0x100, -6.25),
        ("2A", 0x100, 25.25),
        ("2B", 0x100, 0.0),
        ("3A", 0x101, 25.0),
        ("3B", 0x101, -6.25),
        ("4A", 0x101, 25.25),
        ("4B", 0x101, 0.0),
        ("reference_1", 0x102, 25.0),
        ("reference_3", 0x102, 25.25),
    ] {
        let machine = signal("peak-mu-thermocouple1", &format!("\"{channel}\""), "");
        assert_eq!(read(&machine, "s", id, &frame), Ok(value), "{channel}");
        assert_eq!(read(&machine, "s", id, &frame[..1]), Err(Reason::ShortFrame), "{channel}");
    }
    assert_eq!(signal("peak-mu-thermocouple1", "\"1A\"", "").signals[0].range, Some((-20.0, 120.0)));
}

#[test]
fn encoders_send_their_position_in_four_bytes_whatever_follows_and_are_checked_for_their_step() {
    for (template, id) in [("temposonics-e-canopen", 0x1ff), ("tr-la-46-k", 0x183)] {
        let machine = signal(template, "\"position\"", "scale = 0.005\ncounter = { max_speed = 1000.0 }");
        for frame in [
            [0x18, 0xfc, 0xff, 0xff, 0x2c, 0x01].as_slice(),
            &[0x18, 0xfc, 0xff, 0xff],
            &[0x18, 0xfc, 0xff, 0xff, 0, 0, 1],
        ] {
            assert_eq!(read(&machine, "s", id, frame), Ok(-5.0), "{template}");
        }
        assert_eq!(read(&machine, "s", id, &[0x18, 0xfc]), Err(Reason::ShortFrame));
        assert_eq!(condemned(&machine, &[("d_alarms", 1.0)]), Some(true));
        assert_eq!(read(&machine, "d_alarms", 0x6503, &[1, 0]), Ok(1.0));
        let can = machine.devices[0].can.as_ref().unwrap();
        assert_eq!((can.setup[1].object.to_string().as_str(), can.setup[1].value), ("1800:05", 50));
        assert!(machine.devices[0].verify.is_empty());
        let (_, node) = CAN.iter().find(|(known, _)| *known == template).unwrap();
        let device = format!("{node}template = \"{template}\"\nexpect = {{ step = 5000 }}");
        let machine = on_can(&device, "[signal.s]\ndevice = \"d\"\nchannel = \"position\"\nscale = 0.005")
            .unwrap()
            .profile;
        let check = &machine.devices[0].verify[0];
        assert_eq!((check.to_string().as_str(), check.mismatch(&[0, 5000])), ("object 6005:01", None));
        assert!(check.mismatch(&[0, 1000]).unwrap().to_string().contains("reads 1000 instead of 5000"));
    }
}

#[test]
fn a_siko_indicator_is_written_with_its_control_word_and_condemned_by_its_status_word() {
    let rest = "[signal.s]\ndevice = \"d\"\nchannel = \"position\"\nscale = 0.01\nrange = [-900.0, 900.0]\n\
                [axis.z]\nlimit = 30.0\nstep = 1.0\nrate = 1.0\ndeadband = 0.0\nevery = \"2s\"\non_fault = { action = \"hold\" }\n\
                [[axis.z.model]]\nname = \"m\"\nkind = \"linear\"\nterms = [{ signal = \"s\", gain = 0.1, reference = 0.0 }]\n\
                [device.e]\nbus = \"field\"\nnode = 3\ntemplate = \"tr-la-46-k\"\n\
                [signal.z]\ndevice = \"e\"\nchannel = \"position\"\nscale = 0.005\nrange = [-900.0, 900.0]\n\
                [output.shown]\naxis = \"z\"\ndevice = \"d\"\nchannel = \"value\"\nposition = \"z\"\nscale = 0.01";
    let loaded =
        on_can("node = 12\ntemplate = \"siko-ap10\"", rest).unwrap_or_else(|errors| panic!("{errors}"));
    let machine = loaded.profile;
    // Position 123.45 mm, dummy, status word with bits 7 (battery empty) and 12 (sensor error).
    let frame = [0x39, 0x30, 0, 0, 0, 0, 0x80, 0x10];
    assert_eq!(read(&machine, "s", 0x18c, &frame), Ok(123.45));
    assert_eq!(read(&machine, "d_battery_empty", 0x18c, &frame), Ok(1.0));
    assert_eq!(read(&machine, "d_sensor_error", 0x18c, &frame), Ok(1.0));
    let well = [("d_battery_empty", 0.0), ("d_sensor_error", 0.0)];
    let ill = [("d_battery_empty", 0.0), ("d_sensor_error", 1.0)];
    assert_eq!((condemned(&machine, &well), condemned(&machine, &ill)), (Some(false), Some(true)));
    let output = &machine.outputs[0];
    assert_eq!(output.verify, Verify::Shown);
    let can = machine.devices[0].can.as_ref().unwrap();
    let mut frame: Frame = *can.written(CanId::standard(0x20c).unwrap()).unwrap();
    let words = output.encoding.encode(-12.34);
    let Address::Frame(field) = &output.address else { panic!("{}", output.address) };
    field.bits.insert(frame.data_mut(), words.bits()).unwrap();
    assert_eq!(frame.to_string(), "20C#2EFBFFFF00000000");
    let reported = Preview::of(&machine).to_string();
    assert!(reported.contains("not verified: the control word in bytes 6 and 7 of RPDO1"), "{reported}");
    let marked = rest.to_owned() + "\npdo = { fill = \"00 00 00 00 00 00 04 00\" }";
    let machine = on_can("node = 12\ntemplate = \"siko-ap10\"", &marked)
        .unwrap_or_else(|errors| panic!("{errors}"))
        .profile;
    let can = machine.devices[0].can.as_ref().unwrap();
    assert_eq!(can.written[0].data(), [0, 0, 0, 0, 0, 0, 4, 0]);
}

#[test]
fn a_template_for_one_kind_of_line_is_refused_on_the_other() {
    let errors =
        on_can("template = \"icp-das-m7018\"", "[signal.s]\ndevice = \"d\"\nchannel = 0").unwrap_err();
    assert!(
        errors.to_string().contains("this value comes from channel `0` of template `icp-das-m7018`"),
        "{errors}"
    );
    let errors =
        super::taken("template = \"peak-mu-thermocouple1\"", "[signal.s]\ndevice = \"d\"\nchannel = \"1A\"");
    let reported = errors.unwrap_err().to_string();
    assert!(reported.contains("`frame` is only for a device on a CAN line"), "{reported}");
}
