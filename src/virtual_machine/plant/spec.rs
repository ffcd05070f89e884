//! What a plant is made of: `profiles/<machine>.plant.toml`, checked, with every name turned into an index.

use std::time::Duration;

use serde::{Deserialize, Deserializer, de::Error as _};

use super::structure::{Point, Structure};
use isotherm_core::quantity::Moment;

mod file;

/// The modes of the shipped column: the name in its plant file, and the text.
const COLUMN: (&str, &str) =
    ("column-hmc/modes.json", include_str!("../../../profiles/column-hmc/modes.json"));

/// A plant file that cannot be used, in words; where TOML itself is wrong, with line and column.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PlantError(String);

/// A thermal network with everything that drives, measures and bends it.
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

/// The air: a day's curve and a weather that drifts.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AmbientSpec {
    pub(super) mean: f64,
    pub(super) amplitude: f64,
    pub(super) peak_hour: f64,
    pub(super) drift_per_day: f64,
    /// Largest swing of the slow weather, K.
    pub(super) weather: f64,
    #[serde(default)]
    pub(super) varies: AmbientVaries,
}

/// How far another seed's day may lie from this one, uniform, plus or minus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct AmbientVaries {
    pub(super) mean: f64,
    pub(super) amplitude: f64,
    pub(super) peak_hour: f64,
    pub(super) drift_per_day: f64,
}

/// When the machine is switched on, and how it works from then on.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DutySpec {
    /// Switched on this long after the run begins, at the earliest and at the latest.
    pub(super) on_after: Span,
    pub(super) work: Span,
    pub(super) pause: Span,
    /// How hard each spell of work is, smallest and largest: what the power of work is multiplied by.
    #[serde(default = "full_load")]
    pub(super) load: [f64; 2],
}

fn full_load() -> [f64; 2] {
    [1.0, 1.0]
}

/// A shortest and a longest duration; the seed draws between them.
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
    /// J/K
    pub(super) capacity: f64,
    /// °C before the soak.
    pub(super) initial: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Link {
    pub(super) node: usize,
    pub(super) other: Point,
    /// W/K
    pub(super) conductance: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Source {
    pub(super) name: String,
    pub(super) node: usize,
    pub(super) watts: f64,
    /// By how much of itself another seed's power may differ.
    pub(super) varies: f64,
    pub(super) when: When,
}

/// What the machine must be doing.
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
    /// Temperatures it feels, with their shares.
    pub(super) feels: Vec<(Point, f64)>,
    /// Seconds; zero: at once.
    pub(super) lag: f64,
    /// Smallest step it shows; zero: any.
    pub(super) resolution: f64,
    /// Standard deviation.
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
    /// Seconds.
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

/// An axis's true error: gains in µm/K on rises since the run began, and what grows with where the machine is.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Displacement {
    pub(super) axis: String,
    pub(super) gains: Vec<(Point, f64)>,
    pub(super) stretches: Vec<Stretch>,
    /// It moves with the structure's guideway, in this direction: 0 x, 1 y, 2 z.
    pub(super) guided: Option<usize>,
}

/// A part that lies along a travel. It adds the more, the more of it lies between a reference and the present position.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stretch {
    /// Place among the positions.
    pub(super) position: usize,
    /// Where it adds nothing, mm.
    pub(super) reference: f64,
    /// The part of the travel it lies along, mm.
    pub(super) from: f64,
    pub(super) to: f64,
    /// µm per mm and K.
    pub(super) gains: Vec<(Point, f64)>,
}

/// What the source of a machine reports about it, to be shown beside our own figures. The plants are ours.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Where they stand, and what they are.
    pub text: String,
    /// One for each figure it gives.
    #[serde(default, rename = "axis")]
    pub axes: Vec<PublishedAxis>,
}

/// One axis of a publication.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedAxis {
    /// Its name in the profile.
    pub name: String,
    /// The error without compensation, µm.
    pub uncompensated_um: Option<f64>,
    /// What is left with it, µm.
    pub compensated_um: Option<f64>,
}

impl TryFrom<[String; 2]> for Span {
    type Error = String;

    fn try_from([shortest, longest]: [String; 2]) -> Result<Span, String> {
        let parse = |text: &str| humantime::parse_duration(text).map_err(|error| error.to_string());
        let (shortest, longest) = (parse(&shortest)?, parse(&longest)?);
        if shortest > longest {
            return Err("the shortest duration comes first".to_owned());
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
    /// Where it is this many seconds after the run began, mm.
    pub(super) fn at(&self, seconds: f64) -> f64 {
        self.middle + 0.5 * self.stroke * (std::f64::consts::TAU * seconds / self.period).sin()
    }
}

impl Stretch {
    /// How much of it counts at this position: in mm what lies between there and its reference, negative on the
    /// reference's other side.
    pub(super) fn effect(&self, position: f64) -> f64 {
        let within = |value: f64| value.clamp(self.from, self.to);
        within(position) - within(self.reference)
    }
}

impl PlantSpec {
    /// Reads a plant file. Of other files it may name those of the shipped plants.
    ///
    /// # Errors
    /// As [`PlantSpec::parse_with`].
    pub fn parse(text: &str) -> Result<PlantSpec, PlantError> {
        let shipped = |name: &str| (name == COLUMN.0).then(|| COLUMN.1.to_owned());
        PlantSpec::parse_with(text, &shipped)
    }

    /// Reads a plant file; `read` gives the text of a file that it names.
    ///
    /// # Errors
    /// What is wrong with it: TOML's own message with its line and column, or every name and number that does not
    /// fit, one to a line.
    pub fn parse_with(text: &str, read: &dyn Fn(&str) -> Option<String>) -> Result<PlantSpec, PlantError> {
        let file: file::PlantFile = toml::from_str(text).map_err(|error| PlantError(error.to_string()))?;
        file.resolve(read).map_err(|errors| PlantError(errors.join("\n")))
    }

    /// The plant that belongs to a shipped profile; `None` where there is none of that name.
    ///
    /// # Errors
    /// As [`PlantSpec::parse`].
    pub fn shipped(machine: &str) -> Option<Result<PlantSpec, PlantError>> {
        let text = match machine {
            "surface-grinder" => include_str!("../../../profiles/surface-grinder.plant.toml"),
            // The same machine with other cables.
            "xc100-lathe" | "xc100-lathe-can" => include_str!("../../../profiles/xc100-lathe.plant.toml"),
            "ram-mc" => include_str!("../../../profiles/ram-mc.plant.toml"),
            "parts-vmc" => include_str!("../../../profiles/parts-vmc.plant.toml"),
            // The same machine under another control.
            "spindle-hmc" | "linuxcnc-mill" => include_str!("../../../profiles/spindle-hmc.plant.toml"),
            "jcs018a-vmc" => include_str!("../../../profiles/jcs018a-vmc.plant.toml"),
            "screw-axis" => include_str!("../../../profiles/screw-axis.plant.toml"),
            "sinker-edm" => include_str!("../../../profiles/sinker-edm.plant.toml"),
            "column-hmc" => include_str!("../../../profiles/column-hmc.plant.toml"),
            _ => return None,
        };
        Some(PlantSpec::parse(text))
    }

    /// The moment at which a virtual clock begins, so that the day's curve is where the machine's story wants it.
    pub fn start(&self) -> Moment {
        self.start
    }

    /// The signals it gives values to.
    pub fn signals(&self) -> impl Iterator<Item = &str> {
        let sensors = self.sensors.iter().map(|sensor| sensor.signal.as_str());
        let positions = self.positions.iter().map(|position| position.signal.as_str());
        sensors.chain(positions).chain(self.switches.iter().map(|switch| switch.signal.as_str()))
    }

    /// What the machine's source reports; `None` where the plant is nobody's.
    pub fn published(&self) -> Option<&Published> {
        self.published.as_ref()
    }

    /// The axes it knows the true error of.
    pub fn axes(&self) -> impl Iterator<Item = &str> {
        self.axes.iter().map(|displacement| displacement.axis.as_str())
    }
}
