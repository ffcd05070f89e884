//! Temperature sensors that the kernel of this computer reads: how a profile names them.
//!
//! `hwmon:coretemp/Package id 0`, `iio:mcp9808`, `w1:28-0316a2794f01`. They go by what the chip is called, by what its
//! channel is labelled or by what is burnt into the sensor: the numbers of `hwmon3` and `iio:device0` are given at each start
//! of the computer in the order in which drivers are loaded.

use std::fmt;
use std::str::FromStr;

/// The families of 1-Wire sensors whose temperature the kernel knows how to read.
const FAMILIES: [&str; 5] = ["10", "22", "28", "3b", "42"];
/// The one among them that is no DS18B20 or relative of it: a thermocouple's, without a value of its own at power-on.
const THERMOCOUPLE: &str = "3b";

/// A temperature sensor of this computer. Prints as a profile has it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PcSensor {
    /// A temperature of a chip that monitors hardware (the kernel's hwmon).
    Hwmon(Channel),
    /// A temperature of an industrial I/O device (the kernel's IIO).
    Iio(Channel),
    /// A 1-Wire sensor, by its ROM id, which no other has: `28-0316a2794f01`.
    OneWire(String),
}

/// One channel of a chip.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Channel {
    /// What the kernel calls the chip.
    pub chip: String,
    /// The device that the chip is, as `1-0048` on an I2C bus; needed where several chips have one name.
    pub device: Option<String>,
    /// The channel's label, or what the driver calls it, as `temp1`; `None`: the chip has only one.
    pub channel: Option<String>,
}

impl PcSensor {
    /// What hwmon calls every 1-Wire sensor. It tells a wrong checksum from no other error.
    pub const ONE_WIRE_IN_HWMON: &str = "w1_slave_temp";

    /// It is a DS18B20 or a relative of it: it measures from −55 to 125 °C, and shows 85 °C after power-on, until it has measured.
    pub fn is_ds18b20(&self) -> bool {
        matches!(self, PcSensor::OneWire(id) if !id.starts_with(THERMOCOUPLE))
    }

    /// Where the kernel has it, below the directory of its sensors: for people.
    pub fn sought_in(&self, root: &str) -> String {
        let root = root.trim_end_matches('/');
        match self {
            PcSensor::Hwmon(channel) => format!("{root}/class/hwmon, {channel}"),
            PcSensor::Iio(channel) => format!("{root}/bus/iio/devices, {channel}"),
            PcSensor::OneWire(id) => format!("{root}/bus/w1/devices/{id}/w1_slave"),
        }
    }
}

/// For people: the chip with the name `coretemp`, the channel `Package id 0`.
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

    /// # Errors
    /// A sentence that says what is wrong, and behind `; ` what to write.
    fn from_str(text: &str) -> Result<PcSensor, String> {
        const FORMS: &str = "write \"w1:28-0316a2794f01\", \"hwmon:NAME/LABEL\" or \"iio:NAME/LABEL\"";
        if text.starts_with('/') {
            return Err(format!(
                "`{text}` is a path, and the kernel gives the numbers of hwmon and IIO anew at each start; {FORMS}"
            ));
        }
        let (kind, rest) = text.split_once(':').ok_or_else(|| match is_rom_id(text) {
            true => format!("`{text}` is a ROM id without its kind; write \"w1:{text}\""),
            false => format!("`{text}` is no sensor of a computer; {FORMS}"),
        })?;
        match kind {
            "w1" => one_wire(rest),
            "hwmon" => channel(rest, "hwmon").map(PcSensor::Hwmon),
            "iio" => channel(rest, "iio").map(PcSensor::Iio),
            _ => Err(format!("`{kind}` is no kind of sensor of a computer; {FORMS}")),
        }
    }
}

fn one_wire(id: &str) -> Result<PcSensor, String> {
    const FORM: &str = "write the ROM id, as \"w1:28-0316a2794f01\"";
    let id = id.to_ascii_lowercase();
    if !is_rom_id(&id) {
        return Err(format!(
            "`{id}` is no ROM id of a 1-Wire sensor: two digits, a dash, twelve digits; {FORM}"
        ));
    }
    let family = id.split('-').next().unwrap_or_default();
    if !FAMILIES.contains(&family) {
        let known = FAMILIES.join(", ");
        return Err(format!(
            "the family {family} of `{id}` is no thermometer; the ROM ids of those begin with {known}"
        ));
    }
    Ok(PcSensor::OneWire(id))
}

fn is_rom_id(text: &str) -> bool {
    let is_hex =
        |part: &str, len: usize| part.len() == len && part.bytes().all(|byte| byte.is_ascii_hexdigit());
    text.split_once('-').is_some_and(|(family, serial)| is_hex(family, 2) && is_hex(serial, 12))
}

/// `coretemp@coretemp.0/Package id 0`.
fn channel(text: &str, kind: &str) -> Result<Channel, String> {
    let (chip, label) = match text.split_once('/') {
        Some((chip, label)) => (chip, Some(label)),
        None => (text, None),
    };
    let (chip, device) = match chip.split_once('@') {
        Some((chip, device)) => (chip, Some(device)),
        None => (chip, None),
    };
    let form = format!("write its name, as \"{kind}:NAME/LABEL\"");
    if chip.is_empty() || [device, label].contains(&Some("")) {
        return Err(format!("something is missing in `{kind}:{text}`; {form}"));
    }
    if let Some(number) = [Some(chip), device].into_iter().flatten().find(|part| is_number(part)) {
        return Err(format!(
            "`{number}` is a number that the kernel gives anew at each start: it may be another chip then; {form}"
        ));
    }
    if chip == PcSensor::ONE_WIRE_IN_HWMON {
        return Err(format!(
            "`{chip}` is a 1-Wire sensor, whose checksum is not seen there; write its ROM id, as \"w1:28-0316a2794f01\""
        ));
    }
    let owned = |part: Option<&str>| part.map(str::to_owned);
    Ok(Channel { chip: chip.to_owned(), device: owned(device), channel: owned(label) })
}

/// `3`, `hwmon3`, `device0`, `iio:device0`.
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
            ("hwmon:hwmon3/temp1", "`hwmon3` is a number that the kernel gives anew at each start"),
            ("hwmon:3/temp1", "`3` is a number"),
            ("hwmon:lm75@hwmon3/temp1", "`hwmon3` is a number"),
            ("hwmon:w1_slave_temp@28-0316a2794f01/temp1", "whose checksum is not seen there"),
            ("iio:device0/temp", "`device0` is a number"),
            ("iio:iio:device0/temp", "`iio:device0` is a number"),
            ("/sys/class/hwmon/hwmon3/temp1_input", "is a path"),
            ("28-0316a2794f01", "write \"w1:28-0316a2794f01\""),
            ("w1:w1_bus_master1", "is no ROM id"),
            ("w1:28-0316a2", "is no ROM id"),
            ("w1:29-0316a2794f01", "the family 29"),
            ("hwmon:", "something is missing"),
            ("hwmon:lm75/", "something is missing"),
            ("input:0", "is no kind of sensor"),
            ("bed", "is no sensor of a computer"),
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
