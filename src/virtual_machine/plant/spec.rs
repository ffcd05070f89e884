//! Description of a plant: `profiles/<machine>.plant.toml`, checked, with an index in place of each name.

use std::time::Duration;

use serde::{Deserialize, Deserializer, de::Error as _};

use super::structure::{Point, Structure};
use isotherm_core::quantity::Moment;

mod file;

/// Modes of the shipped column: the name in its plant file, and the content.
const COLUMN: (&str, &str) =
    ("column-hmc/modes.json", include_str!("../../../profiles/column-hmc/modes.json"));

/// A plant file that cannot be used, in words. Errors of TOML have line and column.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PlantError(String);

/// A thermal network with its inputs, its sensors and its displacements.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantSpec {
    pub(super) start: Moment,
    pub(super) soak: Duration,
    pub(super) ambient: AmbientSpec,
    pub(super) duty: DutySpec,
    pub(super) nodes: Vec<Node>,
    pub(super) links: Vec<Link>,
    pub(super) structure: Option<Structure>,
    pub(super) sources: Vec<Source>,
    pub(super) sensors: Vec<SensorSpec>,
    pub(super) positions: Vec<Position>,
    pub(super) switches: Vec<Switch>,
    pub(super) axes: Vec<Displacement>,
    published: Option<Published>,
}

/// Air temperature: a daily curve with slow weather.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AmbientSpec {
    pub(super) mean: f64,
    pub(super) amplitude: f64,
    pub(super) peak_hour: f64,
    pub(super) drift_per_day: f64,
    /// Largest amplitude of the slow weather, K.
    pub(super) weather: f64,
    #[serde(default)]
    pub(super) varies: AmbientVaries,
}

/// Largest difference between the days of different seeds, plus or minus, uniformly distributed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct AmbientVaries {
    pub(super) mean: f64,
    pub(super) amplitude: f64,
    pub(super) peak_hour: f64,
    pub(super) drift_per_day: f64,
}

/// Time of switching on, and operation after it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DutySpec {
    /// Earliest and latest time of switching on, since the start of the run.
    pub(super) on_after: Span,
    pub(super) work: Span,
    pub(super) pause: Span,
    /// Smallest and largest load of a work phase, by which the power of work is multiplied.
    #[serde(default = "full_load")]
    pub(super) load: [f64; 2],
}

fn full_load() -> [f64; 2] {
    [1.0, 1.0]
}

/// A shortest and a longest duration. The seed determines a duration between them.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(try_from = "[String; 2]")]
pub(super) struct Span {
    pub(super) shortest: Duration,
    pub(super) longest: Duration,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Node {
    #[serde(skip)]
    pub(super) name: String,
    /// Heat capacity of the node, J/K.
    pub(super) capacity: f64,
    /// Temperature before the soak, °C.
    pub(super) initial: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Link {
    pub(super) node: usize,
    pub(super) other: Point,
    /// Thermal conductance of the link, W/K.
    pub(super) conductance: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Source {
    pub(super) name: String,
    pub(super) node: usize,
    pub(super) watts: f64,
    /// Largest relative difference of the power between seeds.
    pub(super) varies: f64,
    pub(super) when: When,
}

/// Required state of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum When {
    Always,
    /// Switched on.
    On,
    /// Switched on and working, not pausing.
    Work,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct SensorSpec {
    pub(super) signal: String,
    /// Measured temperatures with their weights.
    pub(super) feels: Vec<(Point, f64)>,
    /// Lag in seconds; zero means none.
    pub(super) lag: f64,
    /// Resolution; zero means none.
    pub(super) resolution: f64,
    /// Standard deviation of the noise.
    pub(super) noise: f64,
}

/// A scale that moves up and down: `middle + stroke/2 · sin(2π t / period)`, mm.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Position {
    #[serde(skip)]
    pub(super) signal: String,
    pub(super) middle: f64,
    pub(super) stroke: f64,
    /// Period of one stroke up and down, s.
    #[serde(deserialize_with = "seconds")]
    pub(super) period: f64,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Switch {
    #[serde(skip)]
    pub(super) signal: String,
    pub(super) when: When,
}

/// True error of an axis: gains in µm/K for temperature rises since the start of the run, and parts that depend on a
/// position.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Displacement {
    pub(super) axis: String,
    pub(super) gains: Vec<(Point, f64)>,
    pub(super) stretches: Vec<Stretch>,
    /// Direction of the structure's guideway with which the axis moves: 0 x, 1 y, 2 z.
    pub(super) guided: Option<usize>,
}

/// A part along a travel. Its effect grows with its length between a reference and the current position.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stretch {
    /// Index in the positions.
    pub(super) position: usize,
    /// Position without an effect, mm.
    pub(super) reference: f64,
    /// Start of the part along the travel, mm. `to` is its end.
    pub(super) from: f64,
    pub(super) to: f64,
    /// Gains in µm per mm and K.
    pub(super) gains: Vec<(Point, f64)>,
}

/// Results that the source of a machine reports, shown next to those of the virtual machine. The plant itself is part
/// of isotherm.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Reference of the publication, with its content.
    pub text: String,
    /// Results for each axis.
    #[serde(default, rename = "axis")]
    pub axes: Vec<PublishedAxis>,
}

/// One axis of a publication.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedAxis {
    /// Name in the profile.
    pub name: String,
    /// Error without compensation, µm.
    pub uncompensated_um: Option<f64>,
    /// Error with compensation, µm.
    pub compensated_um: Option<f64>,
}

impl TryFrom<[String; 2]> for Span {
    type Error = String;

    fn try_from([shortest, longest]: [String; 2]) -> Result<Span, String> {
        let parse = |text: &str| humantime::parse_duration(text).map_err(|error| error.to_string());
        let (shortest, longest) = (parse(&shortest)?, parse(&longest)?);
        if shortest > longest {
            return Err("write the shortest duration first".to_owned());
        }
        Ok(Span { shortest, longest })
    }
}

fn duration<'de, D: Deserializer<'de>>(input: D) -> Result<Duration, D::Error> {
    let text = String::deserialize(input)?;
    humantime::parse_duration(&text).map_err(D::Error::custom)
}

fn seconds<'de, D: Deserializer<'de>>(input: D) -> Result<f64, D::Error> {
    duration(input).map(|span| span.as_secs_f64())
}

impl Position {
    /// Position at this time in seconds since the start of the run, mm.
    pub(super) fn at(&self, seconds: f64) -> f64 {
        self.middle + 0.5 * self.stroke * (std::f64::consts::TAU * seconds / self.period).sin()
    }
}

impl Stretch {
    /// Effective length at this position in mm: the part between position and reference. It is negative below the
    /// reference.
    pub(super) fn effect(&self, position: f64) -> f64 {
        let within = |value: f64| value.clamp(self.from, self.to);
        within(position) - within(self.reference)
    }
}

impl PlantSpec {
    /// Parses a plant file, which may name files of the shipped plants.
    ///
    /// # Errors
    /// As [`PlantSpec::parse_with`].
    pub fn parse(text: &str) -> Result<PlantSpec, PlantError> {
        let shipped = |name: &str| (name == COLUMN.0).then(|| COLUMN.1.to_owned());
        PlantSpec::parse_with(text, &shipped)
    }

    /// Parses a plant file. `read` returns the text of a file that it names.
    ///
    /// # Errors
    /// TOML's own message with line and column, or every name and number that does not fit, one on each line.
    pub fn parse_with(text: &str, read: &dyn Fn(&str) -> Option<String>) -> Result<PlantSpec, PlantError> {
        let file: file::PlantFile = toml::from_str(text).map_err(|error| PlantError(error.to_string()))?;
        file.resolve(read).map_err(|errors| PlantError(errors.join("\n")))
    }

    /// Plant of a shipped profile; `None` if there is none with this name.
    ///
    /// # Errors
    /// As [`PlantSpec::parse`].
    pub fn shipped(machine: &str) -> Option<Result<PlantSpec, PlantError>> {
        let text = match machine {
            "surface-grinder" => include_str!("../../../profiles/surface-grinder.plant.toml"),
            // The same machine with another bus.
            "xc100-lathe" | "xc100-lathe-can" => include_str!("../../../profiles/xc100-lathe.plant.toml"),
            "ram-mc" => include_str!("../../../profiles/ram-mc.plant.toml"),
            "parts-vmc" => include_str!("../../../profiles/parts-vmc.plant.toml"),
            // The same machine with another control.
            "spindle-hmc" | "linuxcnc-mill" => include_str!("../../../profiles/spindle-hmc.plant.toml"),
            "jcs018a-vmc" => include_str!("../../../profiles/jcs018a-vmc.plant.toml"),
            "screw-axis" => include_str!("../../../profiles/screw-axis.plant.toml"),
            "sinker-edm" => include_str!("../../../profiles/sinker-edm.plant.toml"),
            "column-hmc" => include_str!("../../../profiles/column-hmc.plant.toml"),
            _ => return None,
        };
        Some(PlantSpec::parse(text))
    }

    /// Start time of a virtual clock. It determines the hour of the day at the start.
    pub fn start(&self) -> Moment {
        self.start
    }

    /// Signals for which the plant has values.
    pub fn signals(&self) -> impl Iterator<Item = &str> {
        let sensors = self.sensors.iter().map(|sensor| sensor.signal.as_str());
        let positions = self.positions.iter().map(|position| position.signal.as_str());
        sensors.chain(positions).chain(self.switches.iter().map(|switch| switch.signal.as_str()))
    }

    /// Results of the machine's source; `None` without a publication.
    pub fn published(&self) -> Option<&Published> {
        self.published.as_ref()
    }

    /// Axes with a known true error.
    pub fn axes(&self) -> impl Iterator<Item = &str> {
        self.axes.iter().map(|displacement| displacement.axis.as_str())
    }
}
