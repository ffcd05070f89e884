//! Decoding of registers as the devices send them: values, negative values, sentinels of a broken sensor.

use isotherm_core::reading::Reason;
use isotherm_profile::Profile;

use super::{profile, signal};

/// Decodes the first signal of a profile from its registers.
fn decode(profile: &Profile, words: &[u16]) -> Result<f64, Reason> {
    profile.signals[0].encoding.decode(words)
}

#[track_caller]
fn reads(profile: &Profile, at: &str, cases: &[(&[u16], f64)]) {
    let signal = &profile.signals[0];
    assert_eq!(signal.address.register().unwrap().to_string(), at);
    for (words, value) in cases {
        let found = signal.encoding.decode(words).unwrap();
        assert!((found - value).abs() < 0.0006, "{words:04x?} is {found}, not {value}");
    }
}

/// Returns whether `fault_when` of the first signal holds if the other signal has this value.
fn condemned(profile: &Profile, by: f64) -> Option<bool> {
    profile.signals[0].fault_when.as_ref().unwrap().holds(&|_| Some(by))
}

#[test]
fn icp_das_modules_send_tenths_of_a_degree_and_the_ends_of_the_range_for_no_sensor() {
    for name in ["icp-das-m7018", "icp-das-m7019r"] {
        let device = format!("template = \"{name}\"");
        let machine = signal(&device, "3", "");
        reads(&machine, "input:3", &[(&[255], 25.5), (&[0xff01], -25.5)]);
        for bad in [0x8000, 0x7fff] {
            assert_eq!(decode(&machine, &[bad]), Err(Reason::Sentinel), "{name}");
        }
        let cjc = signal(&device, "\"cjc\"", "");
        reads(&cjc, "input:128", &[(&[2550], 25.50)]);
    }
}

#[test]
fn a_module_with_a_range_bit_for_each_channel_is_not_believed_while_it_is_set() {
    let machine = signal("template = \"icp-das-m7019r\"", "3", "");
    assert_eq!(machine.signals[1].name, "d_range_3");
    assert_eq!(machine.signals[1].address.register().unwrap().to_string(), "discrete:131");
    assert_eq!((condemned(&machine, 1.0), condemned(&machine, 0.0)), (Some(true), Some(false)));
}

#[test]
fn a_thermistor_module_leaves_its_scale_to_the_profile() {
    let machine = signal("template = \"icp-das-tm-th8\"", "0", "scale = 0.01");
    reads(&machine, "input:0", &[(&[2550], 25.5), (&[0xff9c], -1.0)]);
    assert_eq!(decode(&machine, &[0x8000]), Err(Reason::Sentinel));
}

#[test]
fn an_adam_6018_sends_the_share_of_its_types_range() {
    for (variant, raw, value) in
        [("T", 16384, 25.0), ("K", 1196, 25.0), ("T", 13107, 0.0), ("B", 32768, 1150.0), ("J", 2156, 25.0)]
    {
        let device = format!("template = \"advantech-adam-6018\"\nvariant = \"{variant}\"");
        let machine = signal(&device, "7", "");
        let found = decode(&machine, &[raw]).unwrap();
        // Half a count of the type.
        let half = machine.signals[0].encoding.scale.get() * 0.51;
        assert!((found - value).abs() <= half, "{variant}: {found}");
        assert_eq!(machine.signals[0].address.register().unwrap().to_string(), "holding:7");
        for end in [0, 65535] {
            assert_eq!(decode(&machine, &[end]), Err(Reason::Sentinel));
        }
        let check = &machine.devices[0].verify[0];
        assert_eq!(check.address.register().unwrap().to_string(), "holding:207");
    }
    let type_t = signal("template = \"advantech-adam-6018\"\nvariant = \"T\"", "0", "");
    assert_eq!(type_t.devices[0].verify[0].equals, 1088);
    assert!(decode(&type_t, &[6554]).unwrap() < -49.9, "below zero as well");
}

#[test]
fn a_wago_module_says_wire_break_with_the_largest_count_and_stays_at_its_lowest_below_range() {
    for name in ["wago-750-469", "wago-750-462"] {
        let machine = signal(&format!("template = \"{name}\"\nbase = 6"), "2", "");
        reads(&machine, "input:7", &[(&[0x00ff], 25.5), (&[0xff01], -25.5)]);
        for bad in [0x7fff, 0xfc18] {
            assert_eq!(decode(&machine, &[bad]), Err(Reason::Sentinel), "{name}");
        }
    }
}

#[test]
fn a_moxa_module_takes_two_registers_a_channel() {
    let machine = signal("template = \"moxa-iologik-e1262\"", "7", "word_order = \"msw-first\"");
    reads(&machine, "input:2062", &[(&[0, 253], 25.3), (&[0xffff, 0xff03], -25.3)]);
    let counter = signal("template = \"moxa-iologik-e1200-counter\"", "0", "register = \"input:16\"");
    reads(&counter, "input:16", &[(&[1, 2], 65538.0)]);
}

#[test]
fn advantechs_counters_send_the_low_word_first() {
    let machine = signal("template = \"advantech-adam-60xx-counter\"", "1", "");
    reads(&machine, "holding:2", &[(&[2, 1], 65538.0)]);
}

#[test]
fn an_exemys_channel_is_not_believed_while_its_status_is_not_normal() {
    let machine = signal("template = \"exemys-rme1-tc\"\nvariant = \"K\"", "8", "");
    reads(&machine, "holding:7", &[(&[255], 25.5), (&[0xff01], -25.5)]);
    assert_eq!(machine.signals[1].address.register().unwrap().to_string(), "holding:15");
    for (status, bad) in [(0.0, false), (1.0, true), (2.0, true)] {
        assert_eq!(condemned(&machine, status), Some(bad));
    }
    let check = &machine.devices[0].verify[0];
    assert_eq!((check.address.register().unwrap().to_string().as_str(), check.equals), ("holding:207", 3));
}

#[test]
fn floats_and_long_integers_come_in_the_word_order_that_the_profile_gives() {
    let omega = signal("template = \"omega-iserver-2\"", "2", "word_order = \"msw-first\"");
    reads(&omega, "holding:2", &[(&[0x41c8, 0], 25.0), (&[0xc1c8, 0], -25.0)]);
    let excelog = signal("template = \"excelog-6\"\nvariant = \"T\"", "6", "word_order = \"lsw-first\"");
    reads(&excelog, "input:4106", &[(&[255, 0], 25.5), (&[0xff01, 0xffff], -25.5)]);
    let junction = "\"cold_junction_1\"";
    let excelog = signal("template = \"excelog-6\"\nvariant = \"T\"", junction, "word_order = \"lsw-first\"");
    reads(&excelog, "input:4120", &[(&[231, 0], 23.1)]);
    let checks: Vec<String> = excelog.devices[0].verify.iter().map(ToString::to_string).collect();
    assert_eq!(checks, ["input:4206 (34207)"], "a channel that is not used is not checked");
}

#[test]
fn a_bitmap_of_connected_sensors_condemns_each_channel_by_its_own_bit() {
    let machine = signal("template = \"isma-sfar-s-6ti\"", "4", "scale = 0.1");
    reads(&machine, "input:55", &[(&[255], 25.5), (&[0xff01], -25.5)]);
    let connected = &machine.signals[1];
    assert_eq!(connected.address.register().unwrap().to_string(), "input:50");
    assert_eq!(
        (connected.encoding.decode(&[0b01000]), connected.encoding.decode(&[0b10111])),
        (Ok(1.0), Ok(0.0))
    );
    assert_eq!((condemned(&machine, 0.0), condemned(&machine, 1.0)), (Some(true), Some(false)));
}

#[test]
fn loggers_say_not_connected_and_error_by_values_outside_the_range() {
    let inside = |machine: &Profile, raw: u16| {
        let value = decode(machine, &[raw]).unwrap();
        let (low, high) = machine.signals[0].range.unwrap();
        (low..=high).contains(&value)
    };
    let cwt = signal("template = \"comwintop-tc-logger\"", "16", "");
    reads(&cwt, "holding:47", &[(&[255], 25.5), (&[0xff01], -25.5)]);
    assert!(inside(&cwt, 9999) && !inside(&cwt, 10000) && !inside(&cwt, 30000));
    let atal = signal("template = \"atal-awp-c\"", "1", "");
    reads(&atal, "holding:40000", &[(&[238], 23.8), (&[0xff12], -23.8)]);
    assert!(inside(&atal, 238) && !inside(&atal, 0x82fb), "-32005 is error 5");
    let fine = signal("template = \"atal-awp-c\"", "\"fine_2\"", "");
    reads(&fine, "holding:40042", &[(&[0, 23812], 23.812), (&[0xffff, 0xfc18], -1.0)]);
    assert_eq!(fine.devices[0].verify[0].address.register().unwrap().to_string(), "holding:40033");
}

#[test]
fn encoder_counters_count_below_zero_and_are_checked_to_be_encoders() {
    let speed = "counter = { max_speed = 1e6 }";
    let aspar = signal("template = \"aspar-sdm-8i8o\"", "\"encoder_1\"", speed);
    assert_eq!(
        aspar.signals[0].capture.map(|capture| capture.address.to_string()).as_deref(),
        Some("holding:132")
    );
    reads(&aspar, "holding:84", &[(&[0x0001, 0x0002], 131_073.0), (&[0xffff, 0xffff], -1.0)]);
    let check = &aspar.devices[0].verify[0];
    assert_eq!((check.to_string().as_str(), check.mismatch(&[0x0020])), ("holding:116.5 (40117.5)", None));
    assert!(check.mismatch(&[0x001f]).unwrap().to_string().contains("reads 0 instead of 1"));
    let icp = signal("template = \"icp-das-m7084\"", "2", "word_order = \"lsw-first\"");
    reads(&icp, "input:4", &[(&[0xfffe, 0xffff], -2.0)]);
}

#[test]
fn an_absolute_encoder_is_not_believed_while_it_says_so_itself() {
    let device = "template = \"lika-em58\"\nexpect = { counts_per_turn = 8192 }";
    let machine = signal(device, "\"position\"", "register = \"input:2\"");
    reads(&machine, "input:2", &[(&[1, 2], 65538.0)]);
    assert_eq!(machine.signals[1].encoding.decode(&[0x0801]), Ok(1.0));
    assert_eq!(machine.signals[1].encoding.decode(&[0x0802]), Ok(0.0));
    assert_eq!((condemned(&machine, 1.0), condemned(&machine, 0.0)), (Some(true), Some(false)));
    let check = &machine.devices[0].verify[0];
    assert_eq!(check.mismatch(&[0, 8192]), None);
    assert!(check.mismatch(&[0, 4096]).unwrap().to_string().contains("reads 4096 instead of 8192"));
}

/// The values written to LinuxCNC are tested together with LinuxCNC.
#[test]
fn what_linuxcnc_applies_is_read_in_tenths_of_a_micrometre() {
    let device = "template = \"linuxcnc-eoffset\"";
    reads(&signal(device, "\"applied_z\"", ""), "input:6", &[(&[0xffff, 0xff38], -20.0), (&[0, 123], 12.3)]);
    reads(&signal(device, "\"machine_z\"", ""), "input:18", &[(&[0xfffe, 0x7960], -10.0)]);
    reads(&signal(device, "\"spindle\"", ""), "input:26", &[(&[0xfda8], -600.0)]);
    let taking = signal(device, "\"taking\"", "");
    assert_eq!(taking.signals[0].address.register().unwrap().to_string(), "discrete:2");
}

#[test]
fn what_a_control_tells_back_is_read_by_bits_and_by_values() {
    for name in ["plc-block", "fanuc-modbus-server"] {
        let device = format!("template = \"{name}\"\nbase = 100");
        let referenced = signal(&device, "\"referenced\"", "");
        assert_eq!(referenced.signals[0].address.register().unwrap().to_string(), "holding:116");
        assert_eq!((decode(&referenced, &[0b00100]), decode(&referenced, &[0b11011])), (Ok(1.0), Ok(0.0)));
        let echo = signal(&device, "\"echo_z\"", "");
        reads(&echo, "holding:122", &[(&[0xffff, 0xffac], -8.4)]);
    }
    let machine = profile("template = \"fanuc-modbus-server\"\nbase = 100", "");
    let functions = machine.devices[0].functions;
    assert!(
        functions.write_multiple
            && functions.read_holding
            && !functions.write_single
            && !functions.read_input
    );
}
