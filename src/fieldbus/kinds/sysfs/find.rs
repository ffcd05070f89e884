//! Search for the files of a sensor, by the name of its chip and the label of its channel, or by its ROM id.

use std::fmt;
use std::fs::{read_dir, read_to_string};
use std::path::{Path, PathBuf};

use isotherm_core::codec::{Channel, PcSensor};
use isotherm_core::reading::Reason;

/// Maximum number of entries that are read in a directory. No computer has that many chips, and no chip has that many
/// files.
const MOST_CHIPS: usize = 1000;

/// Location of the files of one sensor, by the kernel interface that provides the sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Files {
    /// hwmon: directory of the chip, and the channel in it, for example `temp1`.
    Hwmon(PathBuf, String),
    /// IIO: directory of the chip, and the channel in it.
    Iio(PathBuf, String),
    /// 1-Wire: directory of the sensor.
    OneWire(PathBuf),
}

/// Path of the file to read; for an IIO sensor, a pattern for its several files.
impl fmt::Display for Files {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Files::Hwmon(chip, channel) => write!(f, "{}/{channel}_input", chip.display()),
            Files::Iio(chip, channel) => write!(f, "{}/in_{channel}_*", chip.display()),
            Files::OneWire(directory) => write!(f, "{}/w1_slave", directory.display()),
        }
    }
}

/// Temperature sensor that this computer has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PresentSensor {
    /// Shortest name that fits no other sensor of this computer.
    pub sensor: PcSensor,
    /// Location of the files that contain the temperature.
    pub files: Files,
    /// Complete name: chip, device, and the label of the channel. A channel without a label has its name in the driver
    /// instead.
    own: PcSensor,
    /// Name of the channel in the driver; empty for a 1-Wire sensor.
    driver: String,
}

/// Finds the files of a sensor.
///
/// # Errors
/// No sensor has this name, or several sensors have this name.
pub fn find(root: &Path, sensor: &PcSensor) -> Result<Files, Reason> {
    let chip = match sensor {
        PcSensor::Hwmon(Channel { chip, .. }) | PcSensor::Iio(Channel { chip, .. }) => chip,
        PcSensor::OneWire(id) => {
            let directory = one_wire(root).join(id);
            return if directory.is_dir() { Ok(Files::OneWire(directory)) } else { Err(Reason::NotFound) };
        }
    };
    let mut found = on_chips(root, Some(chip)).into_iter().filter(|present| present.is(sensor));
    match (found.next(), found.next()) {
        (Some(one), None) => Ok(one.files),
        (None, _) => Err(Reason::NotFound),
        (Some(_), Some(_)) => Err(Reason::SeveralFound),
    }
}

/// Returns every temperature sensor of this computer, each with its shortest unambiguous name.
pub fn all(root: &Path) -> Vec<PresentSensor> {
    let one_wire = entries(&one_wire(root)).into_iter().filter_map(|directory| {
        let sensor: PcSensor = format!("w1:{}", name_of(&directory)?).parse().ok()?;
        Some(PresentSensor::new(sensor, Files::OneWire(directory), String::new()))
    });
    let found: Vec<PresentSensor> = on_chips(root, None).into_iter().chain(one_wire).collect();
    let mut named: Vec<PresentSensor> = Vec::new();
    for present in &found {
        let names = present.names();
        let own = names.iter().find(|name| found.iter().filter(|other| other.is(name)).count() == 1);
        let Some(sensor) = own.or(names.last()) else { continue };
        named.push(PresentSensor { sensor: sensor.clone(), ..present.clone() });
    }
    named
}

impl PresentSensor {
    fn new(own: PcSensor, files: Files, driver: String) -> PresentSensor {
        PresentSensor { sensor: own.clone(), files, own, driver }
    }

    /// Returns whether this sensor matches `name`, which may leave out parts of the complete name.
    pub fn is(&self, name: &PcSensor) -> bool {
        let (own, asked) = match (&self.own, name) {
            (PcSensor::Hwmon(own), PcSensor::Hwmon(asked)) | (PcSensor::Iio(own), PcSensor::Iio(asked)) => {
                (own, asked)
            }
            (own, asked) => return own == asked,
        };
        let is_device = asked.device.is_none() || asked.device == own.device;
        let is_channel = asked.channel.is_none()
            || asked.channel == own.channel
            || asked.channel.as_deref() == Some(self.driver.as_str());
        own.chip == asked.chip && is_device && is_channel
    }

    /// Returns the possible names of the sensor, the preferred one first.
    fn names(&self) -> Vec<PcSensor> {
        let (Channel { chip, device, channel }, named): (_, fn(Channel) -> PcSensor) = match &self.own {
            PcSensor::Hwmon(own) => (own, PcSensor::Hwmon),
            PcSensor::Iio(own) => (own, PcSensor::Iio),
            PcSensor::OneWire(_) => return vec![self.own.clone()],
        };
        let driver = Some(self.driver.clone());
        let each = [
            (None, channel.clone()),
            (None, driver.clone()),
            (device.clone(), channel.clone()),
            (device.clone(), driver),
        ];
        each.into_iter()
            .map(|(device, channel)| named(Channel { chip: chip.clone(), device, channel }))
            .collect()
    }
}

/// Returns the temperature channels of all chips, with their complete names. `only` limits the result to chips with
/// this name.
fn on_chips(root: &Path, only: Option<&str>) -> Vec<PresentSensor> {
    let hwmon = chips(&root.join("class/hwmon"), only).into_iter().flat_map(|(name, chip)| {
        let device = last_of(&chip.join("device"));
        let channels =
            channels(&chip, |file| file.strip_suffix("_input").filter(|name| name.starts_with("temp")));
        channels.into_iter().map(move |driver| {
            let channel = label(&chip.join(format!("{driver}_label")), &driver);
            let own = Channel { chip: name.clone(), device: device.clone(), channel };
            PresentSensor::new(PcSensor::Hwmon(own), Files::Hwmon(chip.clone(), driver.clone()), driver)
        })
    });
    let iio = chips(&root.join("bus/iio/devices"), only).into_iter().flat_map(|(name, chip)| {
        let device = chip.canonicalize().ok().and_then(|real| last_of(real.parent()?));
        let channels = channels(&chip, |file| {
            let value = file.strip_suffix("_raw").or(file.strip_suffix("_input"))?;
            value.strip_prefix("in_").filter(|name| name.starts_with("temp"))
        });
        channels.into_iter().map(move |driver| {
            let channel = label(&chip.join(format!("in_{driver}_label")), &driver);
            let own = Channel { chip: name.clone(), device: device.clone(), channel };
            PresentSensor::new(PcSensor::Iio(own), Files::Iio(chip.clone(), driver.clone()), driver)
        })
    });
    hwmon.chain(iio).collect()
}

/// Returns the names and directories of the chips in the directory `class`. `only` limits the result to chips with this
/// name.
fn chips(class: &Path, only: Option<&str>) -> Vec<(String, PathBuf)> {
    let named = entries(class).into_iter().filter_map(|chip| Some((text(&chip.join("name"))?, chip)));
    let is_asked_for = |name: &str| only.map_or(name != PcSensor::ONE_WIRE_IN_HWMON, |only| only == name);
    named.filter(|(name, _)| is_asked_for(name)).collect()
}

fn label(file: &Path, driver: &str) -> Option<String> {
    Some(text(file).unwrap_or_else(|| driver.to_owned()))
}

fn one_wire(root: &Path) -> PathBuf {
    root.join("bus/w1/devices")
}

/// Returns the entries of a directory, sorted by name; empty if the directory is unreadable.
fn entries(place: &Path) -> Vec<PathBuf> {
    let entries = read_dir(place).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> = entries.take(MOST_CHIPS).map(|entry| entry.path()).collect();
    found.sort();
    found
}

/// Returns the names of the channels of a chip. `of` extracts the channel from a file name, and returns `None` for
/// other files.
fn channels(chip: &Path, of: impl Fn(&str) -> Option<&str>) -> Vec<String> {
    let files = entries(chip);
    let mut found: Vec<String> =
        files.iter().filter_map(|file| of(file.file_name()?.to_str()?).map(str::to_owned)).collect();
    found.sort();
    found.dedup();
    found
}

/// Returns the last component of the path to which the symbolic link `path` points; `None` if the link is broken.
fn last_of(path: &Path) -> Option<String> {
    name_of(&path.canonicalize().ok()?)
}

fn name_of(path: &Path) -> Option<String> {
    path.file_name()?.to_str().map(str::to_owned)
}

/// Returns the content of a file without white space at its ends; `None` if the file is unreadable or empty.
fn text(path: &Path) -> Option<String> {
    let text = read_to_string(path).ok()?.trim().to_owned();
    (!text.is_empty()).then_some(text)
}
