//! Sensors of this computer: names, read-only use, and keys that belong to another kind of line.

use super::*;
use isotherm_core::codec::Address;
use isotherm_profile::plan::ReadTarget;
use isotherm_profile::{DeviceId, Transport};

const PC: &str = r#"[machine]
name = "pc"

[bus.pc]
type = "sysfs"

[device.probes]
bus = "pc"
every = "5s"

[signal.bed]
device = "probes"
sensor = "w1:28-0316a2794f01"
offset = -0.25
range = [-10.0, 80.0]

[signal.cabinet]
device = "probes"
sensor = "hwmon:lm75@1-0048/temp1"

[signal.column]
device = "probes"
sensor = "iio:mcp9808"
scale = 1.01
"#;

/// Checks the only error of the computer's profile after a replacement in its text.
#[track_caller]
fn no_pc(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    assert!(PC.contains(from), "{from}");
    let error = only_error(&PC.replacen(from, to, 1), key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn the_sensors_of_a_device_are_one_request_in_degrees_celsius() {
    let loaded = parse(PC).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let profile = &loaded.profile;
    let bus = &profile.buses[0];
    assert_eq!((bus.transport, bus.address.as_str(), bus.timeout.as_secs()), (Transport::Sysfs, "/sys", 2));
    let requests = profile.requests(DeviceId(0));
    let ReadTarget::Sensors(sensors) = &requests[0].asks else { panic!("{requests:?}") };
    let names: Vec<String> = sensors.iter().map(ToString::to_string).collect();
    assert_eq!(names, ["w1:28-0316a2794f01", "hwmon:lm75@1-0048/temp1", "iio:mcp9808"]);
    assert_eq!((requests.len(), requests[0].fields[2].at), (1, 2));
    let signal = &profile.signals[0];
    assert!(matches!(signal.address, Address::Sensor(_)), "{:?}", signal.address);
    assert_eq!((signal.unit.0, profile.devices[0].at().as_str()), ("degC", ""));
}

#[test]
fn check_says_which_sensor_is_read_and_where_it_is_looked_for() {
    let profile = parse(PC).unwrap().profile;
    let text = isotherm_profile::preview::Preview::of(&profile).to_string();
    for said in [
        "bus pc: sensors of this computer at /sys, timeout 2s",
        "only read; all sensors of a device at the same time; a sensor that does not answer is read again \
         when its kernel driver responds",
        "probes: every 5s: 1 request touching 3 sensors for 3 signals",
        "read 3 sensors at once: bed, cabinet, column",
        "bed: sensor w1:28-0316a2794f01 of probes, plus -0.25; rejected with a wrong checksum, or with all \
         bits zero, at exactly 85 °C",
        "read in /sys/bus/w1/devices/28-0316a2794f01/w1_slave",
        "read in /sys/class/hwmon, the chip with the name `lm75` that is the device `1-0048`, its temperature `temp1`",
        "column: sensor iio:mcp9808 of probes, times 1.01",
        "read in /sys/bus/iio/devices, the chip with the name `mcp9808`, its only temperature",
    ] {
        assert!(text.contains(said), "`{said}` is not in:\n{text}");
    }
    for said in ["unit 0", "register", "may still arrive", "load"] {
        assert!(!text.contains(said), "`{said}` is in:\n{text}");
    }
}

#[test]
fn the_numbers_that_the_kernel_gives_at_each_start_are_no_names() {
    let (lm75, at) = ("hwmon:lm75@1-0048/temp1", "signal.cabinet.sensor");
    for number in ["hwmon:hwmon3/temp1", "hwmon:3/temp1", "hwmon:lm75@hwmon3/temp1"] {
        no_pc(lm75, number, at, "\"hwmon", &["is not a fixed name", "isotherm scan --bus /sys"]);
    }
    no_pc(lm75, "/sys/class/hwmon/hwmon3/temp1_input", at, "\"/sys", &["is a path", "hwmon:NAME/LABEL"]);
    no_pc("iio:mcp9808", "iio:iio:device0", "signal.column.sensor", "\"iio", &["is not a fixed name"]);
    no_pc("w1:28-0316a2794f01", "w1:w1_bus_master1", "signal.bed.sensor", "\"w1", &["is not a ROM id"]);
}

#[test]
fn what_is_wrong_with_a_sensor_is_told_at_its_key() {
    no_pc("sensor = \"iio:mcp9808\"\n", "", "signal.column.sensor", "column]", &["`sensor` is missing"]);
    no_pc("scale = 1.01", "unit = \"K\"", "signal.column.unit", "\"K\"", &["is read in °C"]);
    no_pc("scale = 1.01", "type = \"f64\"", "signal.column.type", "type", &["another kind of line"]);
    no_pc(
        "sensor = \"iio:mcp9808\"",
        "register = \"input:0\"",
        "signal.column.register",
        "register",
        &["sensors of this computer"],
    );
    no_pc("every = \"5s\"", "every = \"5s\"\nunit = 1", "device.probes.unit", "unit", &["a Modbus device"]);
    no_pc("\"sysfs\"", "\"sysfs\"\nlate = \"5s\"", "bus.pc.late", "late", &["with writes"]);
    no_pc(
        "\"sysfs\"",
        "\"sysfs\"\naddress = \"sys\"",
        "bus.pc.address",
        "\"sys\"",
        &["not the absolute path"],
    );
    no_pc(
        "\"sysfs\"",
        "\"sysfs\"\naddress = \"/sys/class/hwmon\"",
        "bus.pc.address",
        "\"/sys/class",
        &["write the directory above: \"/sys\""],
    );
    let on_modbus = GRINDER.replacen("[signal.bed]\n", "[signal.bed]\nsensor = \"iio:mcp9808\"\n", 1);
    let said = Errors(errors(parse(&on_modbus))).to_string();
    for words in ["more than one place", "`sensor` is only for a sensor of this computer"] {
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn nothing_is_written_to_a_sensor_of_this_computer() {
    let axis = "\n[axis.z]\nlimit = 40.0\nstep = 1.0\nrate = 0.5\nevery = \"10s\"\non_fault = { action = \"hold\" }\n\
                [[axis.z.model]]\nname = \"bed\"\nkind = \"linear\"\nterms = [{ signal = \"bed\", gain = 2.4, reference = 20.0 }]\n";
    let output = "[output.z]\naxis = \"z\"\ndevice = \"probes\"\nwrites = \"offset\"\nregister = \"holding:0\"\ntype = \"i16\"\nscale = 0.1\n";
    let error = only_error(&format!("{PC}{axis}{output}"), "output.z.device", "\"probes");
    assert!(error.to_string().contains("only read"), "{error}");
    let heartbeat = "\n[heartbeat]\ndevice = \"probes\"\nregister = \"holding:0\"\nevery = \"1s\"\n";
    let error = only_error(&format!("{PC}{heartbeat}"), "heartbeat.device", "\"probes");
    assert!(error.to_string().contains("only read"), "{error}");
}

#[test]
fn a_1_wire_sensor_is_given_the_time_that_it_takes() {
    let warned = |from: &str, to: &str| {
        let loaded = parse(&PC.replacen(from, to, 1)).unwrap_or_else(|errors| panic!("{errors}"));
        loaded.warnings.iter().map(ToString::to_string).collect::<String>()
    };
    let short = warned("\"sysfs\"", "\"sysfs\"\ntimeout = \"500ms\"");
    assert!(short.contains("measures for up to 750 ms (12 bits), but `timeout` is 500ms"), "{short}");
    let often = warned("every = \"5s\"", "every = \"200ms\"");
    assert!(often.contains("but is read every 200ms"), "{often}");
}
