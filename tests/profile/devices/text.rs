//! Templates of devices that send text, with the texts of their manuals.

use std::path::Path;

use isotherm_core::reading::Reason;
use isotherm_profile::{Errors, Loaded, Profile, parse};

/// Loads a machine with one device that sends text.
pub(crate) fn on_text(device: &str, rest: &str) -> Result<Loaded, Errors> {
    let text = format!(
        "[machine]\nname = \"bench\"\n[bus.line]\ntype = \"serial-ascii\"\naddress = \"127.0.0.1:4001\"\n\
         [device.d]\nbus = \"line\"\n{device}\n{rest}\n"
    );
    parse(Path::new("machine.toml"), &text, &[], &[])
}

/// Returns a profile with a device of one template and one signal.
#[track_caller]
fn signal(device: &str, channel: &str) -> Profile {
    let rest = format!("[signal.s]\ndevice = \"d\"\nchannel = {channel}\n");
    on_text(device, &rest).unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// Returns the number of the signal in a line, and whether it is plausible.
fn read(profile: &Profile, line: &str) -> Result<(f64, bool), Reason> {
    let signal = &profile.signals[0];
    let value = signal.address.text().unwrap().pattern.read(line)?;
    let value = signal.encoding.scale.get() * value + signal.encoding.offset;
    Ok((value, signal.is_plausible(value)))
}

fn request(profile: &Profile) -> &str {
    &profile.signals[0].address.text().unwrap().request
}

#[test]
fn a_heidenhain_readout_is_read_in_millimetres_only() {
    let profile = signal("template = \"heidenhain-nd-281b\"", "\"position\"");
    assert_eq!((request(&profile), profile.signals[0].unit.0), ("\u{2}", "mm"));
    assert_eq!(read(&profile, "-      5.23  =A"), Ok((-5.23, true)));
    assert_eq!(read(&profile, "+  123.4567    "), Ok((123.4567, true)));
    for line in [
        "-      5.23 \"=A",
        "-      5.23 ?  ",
        "FORMAT.ERR.",
        "-      5.23  =",
        "-     5.23  =A",
        "\u{2}+123456789",
    ] {
        assert_eq!(read(&profile, line), Err(Reason::BadReply), "{line}");
    }
}

#[test]
fn a_sylvac_gauge_is_read_with_the_decimals_of_millimetres() {
    let profile = signal("template = \"sylvac-opto-rs\"", "\"value\"");
    assert_eq!(request(&profile), "?\r");
    assert_eq!(read(&profile, "+012.345"), Ok((12.345, true)));
    assert_eq!(read(&profile, "  0.250"), Ok((0.25, true)));
    for line in ["+0.48602", "+0.4860", "ERR3", "+012.345=", "SY233.1"] {
        assert_eq!(read(&profile, line), Err(Reason::BadReply), "{line}");
    }
}

#[test]
fn mitutoyo_gauges_are_read_in_millimetres_only() {
    let profile = signal("template = \"mitutoyo-usb-itn\"", "\"value\"");
    assert_eq!(request(&profile), "1\r");
    assert_eq!(read(&profile, "01A+0000.123"), Ok((0.123, true)));
    assert_eq!(read(&profile, "01A-0012.345"), Ok((-12.345, true)));
    for line in ["01A+00.12345", "01A+000.1234", "01A+000.123", "911", "918", "1"] {
        assert_eq!(read(&profile, line), Err(Reason::BadReply), "{line}");
    }
    let profile = signal("template = \"mitutoyo-id-h\"\nunit = 0x10", "\"value\"");
    assert_eq!(request(&profile), "GA10\r\n");
    assert_eq!(read(&profile, "GN10,+0016.2345"), Ok((16.2345, true)));
    assert_eq!(read(&profile, "GN10,-0016.2345"), Ok((-16.2345, true)));
    for line in ["GX10,+0016.2345", "GN01,+0016.2345", "GN10,+016.23450", "GN10,+016.2345", "CH10"] {
        assert_eq!(read(&profile, line), Err(Reason::BadReply), "{line}");
    }
}

#[test]
fn a_givi_readout_is_read_by_the_command_for_its_position() {
    let profile = signal("template = \"givi-vision-518\"", "\"position\"");
    assert_eq!(request(&profile), "Q\r\n");
    assert_eq!(read(&profile, "    5708.65"), Ok((5708.65, true)));
    assert_eq!(read(&profile, "-0.05"), Ok((-0.05, true)));
    for line in ["=DIGITAL READOUT=", "AXIS X: 223.99", "UNIT : MM", "8.8185"] {
        assert_eq!(read(&profile, line), Err(Reason::BadReply), "{line}");
    }
}

#[test]
fn a_dcon_module_is_read_by_its_address_with_and_without_a_checksum() {
    let device = |variant| format!("template = \"icp-das-i7018-dcon\"\nvariant = \"{variant}\"\nunit = 4");
    let plain = signal(&device("checksum-off"), "3");
    assert_eq!(request(&plain), "#04\r");
    let line = ">+05.123+04.153+07.234-02.356+10.000-05.133+02.345+08.234";
    assert_eq!(read(&plain, line), Ok((-2.356, true)));
    assert_eq!(
        read(&plain, ">+05.123+04.153+07.234+9999.9+10.000-05.133+02.345+08.234"),
        Ok((9999.9, false))
    );
    assert_eq!(read(&plain, "?04"), Err(Reason::BadReply));
    let lost = ">+05.123+04.153+07.234-2.356+10.000-05.133+02.345+08.234";
    assert_eq!(read(&plain, lost), Err(Reason::BadReply), "a digit is missing");
    let summed = signal(&device("checksum-on"), "0");
    assert_eq!(request(&summed), "#0487\r", "0x23 + 0x30 + 0x34");
    assert_eq!(read(&summed, line), Err(Reason::Checksum));
    let answer = summed.signals[0].address.text().unwrap().pattern.line(25.0);
    assert_eq!(read(&summed, &answer), Ok((25.0, true)));
    let rest = "[signal.s]\ndevice = \"d\"\nchannel = 0\n";
    let refused =
        on_text("template = \"icp-das-i7018-dcon\"\nvariant = \"checksum-off\"", rest).err().unwrap();
    assert!(
        refused.to_string().contains("the address of `d`, but the profile states no `unit` for it"),
        "{refused}"
    );
}
