//! Temperature sensors that the kernel of this computer reads, and their notation in a profile.
//!
//! Examples are `hwmon:coretemp/Package id 0`, `iio:mcp9808`, `w1:28-0316a2794f01`. A sensor is named by the name of
//! its chip, the label of its channel, or its ROM ID. The numbers in names such as `hwmon3` and `iio:device0` do not
//! identify a sensor: the kernel assigns them at each boot, in the order in which drivers load.

use std::fmt;
use std::str::FromStr;

/// Family codes of 1-Wire temperature sensors that the kernel supports. A ROM ID begins with the family code.
const FAMILIES: [&str; 5] = ["10", "22", "28", "3b", "42"];
/// Family code of the thermocouple converter. Unlike a DS18B20, the converter has no fixed value at power-on.
const THERMOCOUPLE: &str = "3b";

/// Temperature sensor of this computer. Formatted in the notation of the profile.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PcSensor {
    /// Temperature of a chip that monitors hardware (hwmon of the kernel).
    Hwmon(Channel),
    /// Temperature of an industrial I/O device (IIO of the kernel).
    Iio(Channel),
    /// 1-Wire sensor with this ROM ID, which is unique: `28-0316a2794f01`.
    OneWire(String),
}

/// Temperature channel of a chip.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Channel {
    /// Name that the kernel gives to the chip, for example `coretemp`.
    pub chip: String,
    /// Device name of the chip, for example `1-0048` on an I2C bus. Required if several chips have the same name.
    pub device: Option<String>,
    /// Label of the channel, or its name in the driver, for example `temp1`. `None` if the chip has only one channel.
    pub channel: Option<String>,
}

impl PcSensor {
    /// Name that the kernel gives to every 1-Wire sensor in hwmon. In hwmon, a wrong checksum cannot be distinguished
    /// from other errors.
    pub const ONE_WIRE_IN_HWMON: &str = "w1_slave_temp";

    /// Returns whether the sensor is a DS18B20 or related to it. Such a sensor measures from −55 to 125 °C. It shows 85
    /// °C after power-on until its first measurement.
    pub fn is_ds18b20(&self) -> bool {
        matches!(self, PcSensor::OneWire(id) if !id.starts_with(THERMOCOUPLE))
    }

    /// Returns the path at which the kernel shows the sensor, for messages. For hwmon and IIO, the path is a
    /// directory, followed by the names of chip and channel. `root` is the directory of sysfs, usually
    /// `/sys`.
    pub fn sought_in(&self, root: &str) -> String {
        let root = root.trim_end_matches('/');
        match self {
            PcSensor::Hwmon(channel) => format!("{root}/class/hwmon, {channel}"),
            PcSensor::Iio(channel) => format!("{root}/bus/iio/devices, {channel}"),
            PcSensor::OneWire(id) => format!("{root}/bus/w1/devices/{id}/w1_slave"),
        }
    }
}

/// Formats the channel for messages, for example as "the chip with the name `coretemp`, its temperature `Package id
/// 0`".
impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the chip with the name `{}`", self.chip)?;
        if let Some(device) = &self.device {
            write!(f, " that is the device `{device}`")?;
        }
        match &self.channel {
            Some(channel) => write!(f, ", its temperature `{channel}`"),
            None => f.write_str(", its only temperature"),
        }
    }
}

impl fmt::Display for PcSensor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, Channel { chip, device, channel }) = match self {
            PcSensor::OneWire(id) => return write!(f, "w1:{id}"),
            PcSensor::Hwmon(channel) => ("hwmon", channel),
            PcSensor::Iio(channel) => ("iio", channel),
        };
        write!(f, "{kind}:{chip}")?;
        device.iter().try_for_each(|device| write!(f, "@{device}"))?;
        channel.iter().try_for_each(|channel| write!(f, "/{channel}"))
    }
}

impl FromStr for PcSensor {
    type Err = String;

    /// Parses a sensor in the notation of the profile, for example `w1:28-0316a2794f01`.
    ///
    /// # Errors
    /// Returns a sentence with the mistake and, after `; `, the correct notation.
    fn from_str(text: &str) -> Result<PcSensor, String> {
        const FORMS: &str = "write \"w1:28-0316a2794f01\", \"hwmon:NAME/LABEL\" or \"iio:NAME/LABEL\"";
        if text.starts_with('/') {
            return Err(format!(
                "`{text}` is a path, and the numbers of hwmon and IIO may change at each start of the \
                 computer; {FORMS}"
            ));
        }
        let (kind, rest) = text.split_once(':').ok_or_else(|| match is_rom_id(text) {
            true => format!("`{text}` is a ROM id without `w1:` before it; write \"w1:{text}\""),
            false => format!("`{text}` does not name a sensor of the computer; {FORMS}"),
        })?;
        match kind {
            "w1" => one_wire(rest),
            "hwmon" => channel(rest, "hwmon").map(PcSensor::Hwmon),
            "iio" => channel(rest, "iio").map(PcSensor::Iio),
            _ => Err(format!("`{kind}` is not a kind of computer sensor; {FORMS}")),
        }
    }
}

fn one_wire(id: &str) -> Result<PcSensor, String> {
    const FORM: &str = "write the ROM id, as \"w1:28-0316a2794f01\"";
    let id = id.to_ascii_lowercase();
    if !is_rom_id(&id) {
        return Err(format!(
            "`{id}` is not a ROM id of a 1-Wire sensor: two digits, a dash, twelve digits; {FORM}"
        ));
    }
    let family = id.split('-').next().unwrap_or_default();
    if !FAMILIES.contains(&family) {
        let known = FAMILIES.join(", ");
        return Err(format!(
            "the family code {family} of `{id}` does not belong to a thermometer; ROM ids of thermometers begin with \
             {known}"
        ));
    }
    Ok(PcSensor::OneWire(id))
}

fn is_rom_id(text: &str) -> bool {
    let is_hex =
        |part: &str, len: usize| part.len() == len && part.bytes().all(|byte| byte.is_ascii_hexdigit());
    text.split_once('-').is_some_and(|(family, serial)| is_hex(family, 2) && is_hex(serial, 12))
}

/// Parses a channel such as `coretemp@coretemp.0/Package id 0`: the name of the chip, optionally its device name after
/// `@` and a label after `/`. `kind` is `hwmon` or `iio`, for messages.
fn channel(text: &str, kind: &str) -> Result<Channel, String> {
    let (chip, label) = match text.split_once('/') {
        Some((chip, label)) => (chip, Some(label)),
        None => (text, None),
    };
    let (chip, device) = match chip.split_once('@') {
        Some((chip, device)) => (chip, Some(device)),
        None => (chip, None),
    };
    let form = format!("write the names of chip and channel, as \"{kind}:NAME/LABEL\"");
    if chip.is_empty() || [device, label].contains(&Some("")) {
        return Err(format!("a name in `{kind}:{text}` is empty; {form}"));
    }
    if let Some(number) = [Some(chip), device].into_iter().flatten().find(|part| is_number(part)) {
        return Err(format!(
            "`{number}` is not a fixed name: after the next start of the computer, it may belong to another \
             chip; {form}"
        ));
    }
    if chip == PcSensor::ONE_WIRE_IN_HWMON {
        return Err(format!(
            "`{chip}` is a 1-Wire sensor: `{kind}` does not provide its checksum; write its ROM id, as \
             \"w1:28-0316a2794f01\""
        ));
    }
    let owned = |part: Option<&str>| part.map(str::to_owned);
    Ok(Channel { chip: chip.to_owned(), device: owned(device), channel: owned(label) })
}

/// Returns whether a name is only a number that the kernel assigns: `3`, `hwmon3`, `device0`, `iio:device0`.
fn is_number(name: &str) -> bool {
    let rest =
        ["hwmon", "iio:device", "iio_device", "device"].iter().find_map(|kind| name.strip_prefix(kind));
    let digits = rest.unwrap_or(name);
    !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_is_read_and_printed_as_a_profile_writes_it() {
        for text in [
            "w1:28-0316a2794f01",
            "hwmon:coretemp/Package id 0",
            "hwmon:nct6775/temp7",
            "hwmon:lm75@1-0048/temp1",
            "hwmon:nvme@0000:01:00.0/Composite",
            "hwmon:acpitz",
            "iio:mcp9808",
            "iio:mlx90614@1-005a/temp_object",
            "iio:ad7124/bed left/right",
        ] {
            assert_eq!(text.parse::<PcSensor>().unwrap().to_string(), text);
        }
        assert_eq!("w1:28-0316A2794F01".parse::<PcSensor>().unwrap().to_string(), "w1:28-0316a2794f01");
    }

    #[test]
    fn what_is_no_name_is_refused_with_what_to_write() {
        for (text, words) in [
            ("hwmon:hwmon3/temp1", "`hwmon3` is not a fixed name: after the next start of the computer"),
            ("hwmon:3/temp1", "`3` is not a fixed name"),
            ("hwmon:lm75@hwmon3/temp1", "`hwmon3` is not a fixed name"),
            ("hwmon:w1_slave_temp@28-0316a2794f01/temp1", "`hwmon` does not provide its checksum"),
            ("iio:device0/temp", "`device0` is not a fixed name"),
            ("iio:iio:device0/temp", "`iio:device0` is not a fixed name"),
            ("/sys/class/hwmon/hwmon3/temp1_input", "is a path"),
            ("28-0316a2794f01", "write \"w1:28-0316a2794f01\""),
            ("w1:w1_bus_master1", "is not a ROM id"),
            ("w1:28-0316a2", "is not a ROM id"),
            ("w1:29-0316a2794f01", "the family code 29"),
            ("hwmon:", "a name in `hwmon:` is empty"),
            ("hwmon:lm75/", "a name in `hwmon:lm75/` is empty"),
            ("input:0", "is not a kind of computer sensor"),
            ("bed", "does not name a sensor of the computer"),
        ] {
            let why = text.parse::<PcSensor>().unwrap_err();
            assert!(why.contains(words), "{text}: {why}");
            assert!(why.contains("; "), "{text}: {why}");
        }
    }

    #[test]
    fn a_thermocouple_has_no_value_of_its_own_at_power_on() {
        let sensor = |text: &str| text.parse::<PcSensor>().unwrap();
        assert!(sensor("w1:28-0316a2794f01").is_ds18b20());
        assert!(!sensor("w1:3b-0000001b2c3d").is_ds18b20());
        assert!(!sensor("hwmon:lm75").is_ds18b20());
    }
}
