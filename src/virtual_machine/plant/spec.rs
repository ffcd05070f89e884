//! Description of a plant: the content of `profiles/<machine>.plant.toml`, checked, with an index instead of each name.

use std::time::Duration;

use serde::{Deserialize, Deserializer, de::Error as _};

use super::structure::{Point, Structure};
use isotherm_core::quantity::Moment;

mod file;

/// File of thermal modes that the shipped plant of the column machine names, with its content.
const COLUMN: (&str, &str) =
    ("column-hmc/modes.json", include_str!("../../../profiles/column-hmc/modes.json"));

/// Error of a plant file, as text. Errors of the TOML parser include line and column.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PlantError(String);

/// Thermal network with its inputs, its sensors and its displacements.
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

/// Air temperature: a daily curve, and slow changes of the weather.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AmbientSpec {
    pub(super) mean: f64,
    pub(super) amplitude: f64,
    pub(super) peak_hour: f64,
    pub(super) drift_per_day: f64,
    /// Largest amplitude of the slow changes by the weather, K.
    pub(super) weather: f64,
    #[serde(default)]
    pub(super) varies: AmbientVaries,
}

/// Largest deviations of a simulated day from the values of [`AmbientSpec`], in both directions. The seed of the day
/// determines the deviations, which are uniformly distributed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct AmbientVaries {
    pub(super) mean: f64,
    pub(super) amplitude: f64,
    pub(super) peak_hour: f64,
    pub(super) drift_per_day: f64,
}

/// Time at which the machine is switched on, and its operation after that.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DutySpec {
    /// Earliest and latest time at which the machine is switched on, since the start of the run.
    pub(super) on_after: Span,
    pub(super) work: Span,
    pub(super) pause: Span,
    /// Smallest and largest load of a work phase. The load multiplies the power of sources that depend on work.
    #[serde(default = "full_load")]
    pub(super) load: [f64; 2],
}

fn full_load() -> [f64; 2] {
    [1.0, 1.0]
}

/// Shortest and longest duration. The seed determines a duration between the two.
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
    /// Temperature of the node before the soak (the time before the run in which the machine is off), °C.
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
    /// Largest relative deviation of the power on a simulated day, from 0 to 1. The seed of the day determines the
    /// deviation.
    pub(super) varies: f64,
    pub(super) when: When,
}

/// State of the machine in which a heat source has power.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum When {
    Always,
    /// The machine is switched on.
    On,
    /// The machine is switched on and works, without a pause.
    Work,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct SensorSpec {
    pub(super) signal: String,
    /// Points whose temperatures the sensor measures, with their weights.
    pub(super) feels: Vec<(Point, f64)>,
    /// Time constant of the sensor's lag, s; zero: no lag.
    pub(super) lag: f64,
    /// Resolution of the sensor, in the unit of its signal; zero: no rounding.
    pub(super) resolution: f64,
    /// Standard deviation of the sensor's noise, in the unit of its signal.
    pub(super) noise: f64,
}

/// Position of an axis that moves back and forth: `middle + stroke/2 · sin(2π t / period)`, mm.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Position {
    #[serde(skip)]
    pub(super) signal: String,
    pub(super) middle: f64,
    pub(super) stroke: f64,
    /// Time of one movement back and forth, s.
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

/// True error of an axis. It has gains in µm/K for temperature rises since the start of the run, and parts that depend
/// on a position.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Displacement {
    pub(super) axis: String,
    pub(super) gains: Vec<(Point, f64)>,
    pub(super) stretches: Vec<Stretch>,
    /// Direction in which a deformation of the guideway displaces the axis: 0 is x, 1 is y, 2 is z. `None`: the
    /// guideway does not affect the axis.
    pub(super) guided: Option<usize>,
}

/// Machine part along a travel, whose expansion acts between a reference and the current position.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stretch {
    /// Index of the position in the plant's list of positions.
    pub(super) position: usize,
    /// Position at which the part has no effect, mm.
    pub(super) reference: f64,
    /// Start of the part along the travel, mm; `to` is its end.
    pub(super) from: f64,
    pub(super) to: f64,
    /// Gains in µm per mm of length and K, each with the point whose temperature rise it multiplies.
    pub(super) gains: Vec<(Point, f64)>,
}

/// Results that the published source of a machine reports. They are displayed next to the results of the virtual
/// machine. The plant itself was made for isotherm.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Reference of the publication and a summary of its content.
    pub text: String,
    /// Results for each axis.
    #[serde(default, rename = "axis")]
    pub axes: Vec<PublishedAxis>,
}

/// Results of a publication for one axis.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedAxis {
    /// Name of the axis in the profile.
    pub name: String,
    /// Reported error without compensation, µm; `None` if not published.
    pub uncompensated_um: Option<f64>,
    /// Reported error with compensation, µm; `None` if not published.
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
    /// Returns the position in mm at a time in seconds since the start of the run.
    pub(super) fn at(&self, seconds: f64) -> f64 {
        self.middle + 0.5 * self.stroke * (std::f64::consts::TAU * seconds / self.period).sin()
    }
}

impl Stretch {
    /// Returns the effective length at this position, mm: the length of the part between the position and the
    /// reference. It is negative below the reference.
    pub(super) fn effect(&self, position: f64) -> f64 {
        let within = |value: f64| value.clamp(self.from, self.to);
        within(position) - within(self.reference)
    }
}

impl PlantSpec {
    /// Parses a plant file. The plant file may name files that belong to the shipped plants.
    ///
    /// # Errors
    /// Same as for [`PlantSpec::parse_with`].
    pub fn parse(text: &str) -> Result<PlantSpec, PlantError> {
        let shipped = |name: &str| (name == COLUMN.0).then(|| COLUMN.1.to_owned());
        PlantSpec::parse_with(text, &shipped)
    }

    /// Parses a plant file. `read` returns the text of a file that the plant file names.
    ///
    /// # Errors
    /// A message of the TOML parser with line and column; or all invalid names and numbers, one on each line.
    pub fn parse_with(text: &str, read: &dyn Fn(&str) -> Option<String>) -> Result<PlantSpec, PlantError> {
        let file: file::PlantFile = toml::from_str(text).map_err(|error| PlantError(error.to_string()))?;
        file.resolve(read).map_err(|errors| PlantError(errors.join("\n")))
    }

    /// Returns the plant of a shipped machine; `None` if no shipped plant has this name.
    ///
    /// # Errors
    /// Same as for [`PlantSpec::parse`].
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

    /// Returns the moment at which a virtual clock starts for this plant. This moment determines the hour of
    /// the simulated day at the start of the run.
    pub fn start(&self) -> Moment {
        self.start
    }

    /// Returns the names of the signals for which the plant has values.
    pub fn signals(&self) -> impl Iterator<Item = &str> {
        let sensors = self.sensors.iter().map(|sensor| sensor.signal.as_str());
        let positions = self.positions.iter().map(|position| position.signal.as_str());
        sensors.chain(positions).chain(self.switches.iter().map(|switch| switch.signal.as_str()))
    }

    /// Returns the results that the published source of the machine reports; `None` if there is none.
    pub fn published(&self) -> Option<&Published> {
        self.published.as_ref()
    }

    /// Returns the names of the axes whose true error the plant knows.
    pub fn axes(&self) -> impl Iterator<Item = &str> {
        self.axes.iter().map(|displacement| displacement.axis.as_str())
    }
}
