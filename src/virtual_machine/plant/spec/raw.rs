//! The plant file as TOML has it.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::{Deserialize, Deserializer, de::Error as _};

use super::{Published, Span};
use isotherm_core::quantity::Moment;

mod check;
mod displacement;
mod resolve;
mod structure;

use displacement::{BendingFile, ExpansionFile, StretchFile, TiltFile};
use structure::StructureFile;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlantFile {
    #[serde(deserialize_with = "moment")]
    start: Moment,
    #[serde(deserialize_with = "duration")]
    soak: Duration,
    ambient: AmbientFile,
    duty: DutyFile,
    node: BTreeMap<String, NodeFile>,
    link: Vec<LinkFile>,
    #[serde(default)]
    source: BTreeMap<String, SourceFile>,
    sensor: BTreeMap<String, SensorFile>,
    #[serde(default)]
    position: BTreeMap<String, PositionFile>,
    #[serde(default)]
    switch: BTreeMap<String, SwitchFile>,
    #[serde(default)]
    expansion: Vec<ExpansionFile>,
    #[serde(default)]
    bending: Vec<BendingFile>,
    #[serde(default)]
    stretch: Vec<StretchFile>,
    #[serde(default)]
    tilt: Vec<TiltFile>,
    structure: Option<StructureFile>,
    published: Option<Published>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AmbientFile {
    mean: f64,
    amplitude: f64,
    peak_hour: f64,
    drift_per_day: f64,
    weather: f64,
    #[serde(default)]
    varies: AmbientVaries,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct AmbientVaries {
    mean: f64,
    amplitude: f64,
    peak_hour: f64,
    drift_per_day: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DutyFile {
    #[serde(deserialize_with = "span")]
    on_after: Span,
    #[serde(deserialize_with = "span")]
    work: Span,
    #[serde(deserialize_with = "span")]
    pause: Span,
    #[serde(default = "full_load")]
    load: [f64; 2],
}

fn full_load() -> [f64; 2] {
    [1.0, 1.0]
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NodeFile {
    capacity: f64,
    initial: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LinkFile {
    between: [String; 2],
    conductance: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SourceFile {
    node: String,
    watts: f64,
    #[serde(default)]
    varies: f64,
    when: WhenFile,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "lowercase")]
enum WhenFile {
    Always,
    On,
    Work,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorFile {
    node: String,
    blend: Option<BlendFile>,
    #[serde(deserialize_with = "duration")]
    lag: Duration,
    resolution: f64,
    noise: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BlendFile {
    node: String,
    share: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PositionFile {
    middle: f64,
    stroke: f64,
    #[serde(deserialize_with = "duration")]
    period: Duration,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SwitchFile {
    when: WhenFile,
}

fn moment<'de, D: Deserializer<'de>>(input: D) -> Result<Moment, D::Error> {
    let text = String::deserialize(input)?;
    let stamp: jiff::Timestamp = text.parse().map_err(D::Error::custom)?;
    let nanos = u64::try_from(stamp.as_nanosecond()).map_err(|_| D::Error::custom("before 1970"))?;
    Ok(Moment::from_nanos(nanos))
}

fn duration<'de, D: Deserializer<'de>>(input: D) -> Result<Duration, D::Error> {
    let text = String::deserialize(input)?;
    humantime::parse_duration(&text).map_err(D::Error::custom)
}

fn span<'de, D: Deserializer<'de>>(input: D) -> Result<Span, D::Error> {
    let [shortest, longest] = <[String; 2]>::deserialize(input)?;
    let parse = |text: &str| humantime::parse_duration(text).map_err(D::Error::custom);
    let (shortest, longest) = (parse(&shortest)?, parse(&longest)?);
    if shortest > longest {
        return Err(D::Error::custom("the shortest duration comes first"));
    }
    Ok(Span { shortest, longest })
}
