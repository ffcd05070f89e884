//! Content of the files of a sensor, and checks of its validity.
//!
//! The formats are those of the kernel's documentation: `sysfs-bus-iio`, `hwmon/sysfs-interface`, `w1/slaves/w1_therm`.

use std::fs::File;
use std::io::{Error, ErrorKind, Read};
use std::path::Path;

use super::find::Files;
use isotherm_core::codec::PcSensor;
use isotherm_core::reading::Reason;

/// Maximum number of bytes that are read from a file.
const LONGEST: u64 = 4096;
/// Number of bytes in the memory of a 1-Wire thermometer, including the checksum.
const SCRATCHPAD: usize = 9;
/// Value in m°C that a 1-Wire sensor has after power-on, before its first measurement.
const POWER_ON: f64 = 85_000.0;
/// Measuring range of a 1-Wire sensor in m°C. A sensor without enough power reports 127.94 °C, which is outside.
const MEASURES: (f64, f64) = (-55_000.0, 125_000.0);
/// Linux error numbers for a device that was removed. [`NOTHING_NOW`] has the error numbers for a device that has no
/// value at present.
const GONE: [i32; 2] = [6, 19];
const NOTHING_NOW: [i32; 3] = [11, 16, 61];

/// Reads the temperature of a sensor in °C.
///
/// # Errors
/// The reason why the sensor has no valid temperature.
pub(super) fn read(files: &Files, sensor: &PcSensor) -> Result<f64, Reason> {
    let milli = match files {
        Files::Hwmon(chip, channel) => hwmon(chip, channel)?,
        Files::Iio(chip, channel) => iio(chip, channel)?,
        Files::OneWire(directory) => one_wire(directory)?,
    };
    let celsius = milli / 1000.0;
    match sensor.is_ds18b20() {
        true if (milli - POWER_ON).abs() < 0.5 => Err(Reason::PowerOnValue),
        true if milli < MEASURES.0 => Err(Reason::BelowRange),
        true if milli > MEASURES.1 => Err(Reason::AboveRange),
        _ => Ok(celsius),
    }
}

fn hwmon(chip: &Path, channel: &str) -> Result<f64, Reason> {
    let fault = chip.join(format!("{channel}_fault"));
    if optional(&fault)?.is_some_and(|fault| fault.abs() > 0.0) {
        return Err(Reason::SensorFault);
    }
    number(&text(&chip.join(format!("{channel}_input")))?)
}

/// Returns the temperature of an IIO channel in m°C: `(raw + offset) · scale`. Offset and scale belong to the channel,
/// or to all channels of its type. If the driver provides the calculated value, that value is used.
fn iio(chip: &Path, channel: &str) -> Result<f64, Reason> {
    if let Some(milli) = optional(&chip.join(format!("in_{channel}_input")))? {
        return Ok(milli);
    }
    let raw = number(&text(&chip.join(format!("in_{channel}_raw")))?)?;
    let shared = |what: &str, usual: f64| -> Result<f64, Reason> {
        let own = optional(&chip.join(format!("in_{channel}_{what}")))?;
        let of_all = || optional(&chip.join(format!("in_temp_{what}")));
        Ok(own.map_or_else(of_all, |own| Ok(Some(own)))?.unwrap_or(usual))
    };
    let milli = (raw + shared("offset", 0.0)?) * shared("scale", 1.0)?;
    if milli.is_finite() { Ok(milli) } else { Err(Reason::NotANumber) }
}

/// Reads the temperature of a 1-Wire sensor in m°C from the file `w1_slave`, which includes the result of the checksum.
/// If that file does not exist, reads the file `temperature`, which has no checksum result.
fn one_wire(directory: &Path) -> Result<f64, Reason> {
    match text(&directory.join("w1_slave")) {
        Ok(text) => scratchpad(&text),
        Err(Reason::NotFound) => number(&text(&directory.join("temperature"))?),
        Err(reason) => Err(reason),
    }
}

/// Parses two lines: `50 05 4b 46 7f ff 0c 10 1c : crc=1c YES`, and the same bytes with `t=85000`. Returns the
/// temperature in m°C.
fn scratchpad(text: &str) -> Result<f64, Reason> {
    let mut lines = text.lines();
    let (bytes, verdict) = lines.next().and_then(|line| line.split_once(':')).ok_or(Reason::BadReply)?;
    let bytes: Vec<&str> = bytes.split_whitespace().collect();
    if bytes.len() != SCRATCHPAD {
        return Err(Reason::BadReply);
    }
    if !verdict.trim_end().ends_with(" YES") {
        return Err(Reason::Checksum);
    }
    // The checksum of zeros is zero, and therefore correct.
    if bytes.iter().all(|byte| *byte == "00") {
        return Err(Reason::AllZero);
    }
    let milli = lines.next().and_then(|line| line.split_once("t=")).ok_or(Reason::BadReply)?;
    number(milli.1)
}

/// Returns the number in a file; `None` if the file does not exist.
fn optional(path: &Path) -> Result<Option<f64>, Reason> {
    match text(path) {
        Ok(text) => number(&text).map(Some),
        Err(Reason::NotFound) => Ok(None),
        Err(reason) => Err(reason),
    }
}

fn number(text: &str) -> Result<f64, Reason> {
    let number: f64 = text.trim().parse().map_err(|_| Reason::BadReply)?;
    if number.is_finite() { Ok(number) } else { Err(Reason::NotANumber) }
}

fn text(path: &Path) -> Result<String, Reason> {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(LONGEST).read_to_string(&mut text));
    read.map_err(|error| reason(&error))?;
    // The file is empty if the 1-Wire driver has received nothing from the sensor.
    if text.trim().is_empty() { Err(Reason::Unreadable) } else { Ok(text) }
}

fn reason(error: &Error) -> Reason {
    match (error.kind(), error.raw_os_error()) {
        (ErrorKind::NotFound, _) => Reason::NotFound,
        (_, Some(code)) if GONE.contains(&code) => Reason::NotFound,
        (_, Some(code)) if NOTHING_NOW.contains(&code) => Reason::NotAvailable,
        (ErrorKind::InvalidData, _) => Reason::BadReply,
        _ => Reason::Unreadable,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(milli: &str, name: &str) -> Result<f64, Reason> {
        let home = tempfile::tempdir().unwrap();
        std::fs::write(home.path().join("w1_slave"), milli).unwrap();
        read(&Files::OneWire(home.path().to_owned()), &name.parse().unwrap())
    }

    fn pad(bytes: &str, verdict: &str, milli: i32) -> String {
        format!("{bytes} : crc={} {verdict}\n{bytes} t={milli}\n", bytes.split(' ').next_back().unwrap())
    }

    const DS18B20: &str = "w1:28-0316a2794f01";

    #[test]
    fn a_1_wire_sensor_is_believed_where_its_checksum_is_right_and_it_has_measured() {
        let good = pad("72 01 4b 46 7f ff 0e 10 57", "YES", 23_125);
        assert_eq!(sensor(&good, DS18B20), Ok(23.125));
        assert_eq!(sensor(&good.replace("YES", "NO"), DS18B20), Err(Reason::Checksum));
        let frost = pad("5e ff 4b 46 7f ff 02 10 4d", "YES", -10_125);
        assert_eq!(sensor(&frost, DS18B20), Ok(-10.125));
        let after_power_on = pad("50 05 4b 46 7f ff 0c 10 1c", "YES", 85_000);
        assert_eq!(sensor(&after_power_on, DS18B20), Err(Reason::PowerOnValue));
        assert_eq!(
            sensor(&after_power_on, "w1:3b-0000001b2c3d"),
            Ok(85.0),
            "a thermocouple may be that warm"
        );
        let without_power = pad("ff 07 4b 46 7f ff 0c 10 31", "YES", 127_937);
        assert_eq!(sensor(&without_power, DS18B20), Err(Reason::AboveRange));
        let shorted = pad("00 00 00 00 00 00 00 00 00", "YES", 0);
        assert_eq!(sensor(&shorted, DS18B20), Err(Reason::AllZero));
        let open = pad("ff ff ff ff ff ff ff ff ff", "NO", -62);
        assert_eq!(sensor(&open, DS18B20), Err(Reason::Checksum));
    }

    #[test]
    fn what_is_no_answer_of_a_1_wire_sensor_is_no_value() {
        let good = pad("72 01 4b 46 7f ff 0e 10 57", "YES", 23_125);
        for end in 0..good.len() - 7 {
            assert!(sensor(&good[..end], DS18B20).is_err(), "{:?}", &good[..end]);
        }
        for text in ["", "\n\n", "23125", &good.replace("t=", "t=x"), &good.replace("23125", "nan")] {
            assert!(sensor(text, DS18B20).is_err(), "{text:?}");
        }
    }

    #[test]
    fn where_the_driver_has_not_heard_of_a_sensor_it_says_nothing() {
        assert_eq!(sensor("", DS18B20), Err(Reason::Unreadable));
        assert_eq!(sensor("\n", DS18B20), Err(Reason::Unreadable));
    }

    #[test]
    fn where_the_kernel_only_gives_a_temperature_that_is_taken_and_85_degrees_are_not() {
        let home = tempfile::tempdir().unwrap();
        let read = |milli: &str| {
            std::fs::write(home.path().join("temperature"), milli).unwrap();
            read(&Files::OneWire(home.path().to_owned()), &DS18B20.parse().unwrap())
        };
        assert_eq!(read("23125\n"), Ok(23.125));
        assert_eq!(read("85000\n"), Err(Reason::PowerOnValue));
    }

    #[test]
    fn what_a_driver_says_by_an_error_is_a_reason() {
        for (code, expected) in [
            (2, Reason::NotFound),
            (19, Reason::NotFound),
            (61, Reason::NotAvailable),
            (5, Reason::Unreadable),
            (13, Reason::Unreadable),
        ] {
            assert_eq!(reason(&Error::from_raw_os_error(code)), expected, "{code}");
        }
    }
}
