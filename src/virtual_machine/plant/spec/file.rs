//! Plant file in TOML, and its conversion to a checked [`PlantSpec`]. All errors are reported together.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::{Deserialize, Deserializer, de::Error as _};

use super::{
    AmbientSpec, DutySpec, Link, Node, PlantSpec, Position, Published, SensorSpec, Source, Structure, Switch,
    When, duration, seconds,
};
use crate::virtual_machine::plant::STEP;
use crate::virtual_machine::plant::structure::Point;
use isotherm_core::quantity::Moment;

mod check;
mod displacement;
mod structure;

use check::{AMBIENT, Check};
use displacement::{BendingFile, Displacements, ExpansionFile, StretchFile, TiltFile};
use structure::{ModesFile, StructureFile};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlantFile {
    #[serde(deserialize_with = "moment")]
    start: Moment,
    #[serde(deserialize_with = "duration")]
    soak: Duration,
    ambient: AmbientSpec,
    duty: DutySpec,
    node: BTreeMap<String, Node>,
    link: Vec<LinkFile>,
    #[serde(default)]
    source: BTreeMap<String, SourceFile>,
    sensor: BTreeMap<String, SensorFile>,
    #[serde(default)]
    position: BTreeMap<String, Position>,
    #[serde(default)]
    switch: BTreeMap<String, Switch>,
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
    when: When,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorFile {
    node: String,
    blend: Option<BlendFile>,
    #[serde(deserialize_with = "seconds")]
    lag: f64,
    resolution: f64,
    noise: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BlendFile {
    node: String,
    share: f64,
}

fn moment<'de, D: Deserializer<'de>>(input: D) -> Result<Moment, D::Error> {
    let text = String::deserialize(input)?;
    let stamp: jiff::Timestamp = text.parse().map_err(D::Error::custom)?;
    let nanos = u64::try_from(stamp.as_nanosecond()).map_err(|_| D::Error::custom("before 1970"))?;
    Ok(Moment::from_nanos(nanos))
}

impl PlantFile {
    /// Checks the file, and converts it. `read` returns the text of a file that the plant file names. The
    /// error is a list of the errors in the file, one sentence for each.
    pub(super) fn resolve(self, read: &dyn Fn(&str) -> Option<String>) -> Result<PlantSpec, Vec<String>> {
        let modes = self.structure.as_ref().map(|structure| structure.read(read));
        let modes = modes.transpose().map_err(|why| vec![why])?;
        let nodes = self.node.keys().cloned().zip((0..).map(Point::Node));
        let names = nodes.chain(modes.iter().flat_map(ModesFile::names)).collect();
        let mut check = Check { names, errors: Vec::new() };
        for (place, (name, _)) in check.names.clone().iter().enumerate() {
            let twice = check.names[..place].iter().any(|(other, _)| other == name);
            check.demand(!twice, || format!("`{name}` is used twice among the nodes, ports and points"));
        }
        let nodes: Vec<Node> = self.node.into_iter().map(|(name, node)| Node { name, ..node }).collect();
        nodes.iter().for_each(|node| node.check(&mut check));
        let links: Vec<Link> = self.link.iter().map(|file| file.resolve(&mut check)).collect();
        let sources = self.source.into_iter().map(|(name, file)| file.resolve(name, &mut check)).collect();
        let sensors = self.sensor.into_iter().map(|(name, file)| file.resolve(name, &mut check)).collect();
        let positions = self.position.into_iter().map(|(signal, position)| Position { signal, ..position });
        let positions: Vec<Position> = positions.collect();
        positions.iter().for_each(|position| position.check(&mut check));
        let structure = self.structure.as_ref().zip(modes);
        let structure = structure.map(|(file, modes)| file.resolve(modes, &positions, &mut check));
        stable(&nodes, &links, structure.as_ref(), &mut check);
        let switches = self.switch.into_iter().map(|(signal, switch)| Switch { signal, ..switch }).collect();
        let mut axes = Displacements::new(&positions, &mut check);
        self.expansion.iter().for_each(|file| axes.expansion(file));
        self.bending.iter().for_each(|file| axes.bending(file));
        self.stretch.iter().for_each(|file| axes.stretch(file));
        self.tilt.iter().for_each(|file| axes.tilt(file));
        let guided = self.structure.iter().flat_map(|file| &file.axes);
        guided.for_each(|(axis, direction)| axes.guided(axis, *direction as usize));
        let axes = axes.all();
        self.ambient.check(&mut check);
        check.demand(!self.duty.work.shortest.is_zero(), || "duty.work: must be longer than 0s".to_owned());
        let [lightest, hardest] = self.duty.load;
        check.demand(lightest >= 0.0 && lightest <= hardest && hardest.is_finite(), || {
            "duty.load: write the smallest and the largest load, each 0 or more".to_owned()
        });
        if !check.errors.is_empty() {
            return Err(check.errors);
        }
        Ok(PlantSpec {
            start: self.start,
            soak: self.soak,
            ambient: self.ambient,
            duty: self.duty,
            nodes,
            links,
            structure,
            sources,
            sensors,
            positions,
            switches,
            axes,
            published: self.published,
        })
    }
}

impl AmbientSpec {
    fn check(&self, check: &mut Check) {
        let varies = self.varies;
        let all = [self.mean, self.amplitude, self.peak_hour, self.drift_per_day, self.weather];
        let spread = [varies.mean, varies.amplitude, varies.peak_hour, varies.drift_per_day];
        check.demand(all.iter().all(|value| value.is_finite()), || {
            "ambient: every value must be a finite number".to_owned()
        });
        check.demand(spread.iter().all(|value| value.is_finite() && *value >= 0.0), || {
            "ambient.varies: every value must be 0 or more".to_owned()
        });
    }
}

impl Node {
    fn check(&self, check: &mut Check) {
        let Node { name, capacity, initial } = self;
        check.demand(name != AMBIENT, || format!("node.{AMBIENT}: this name is reserved for the air"));
        check.demand(capacity.is_finite() && *capacity > 0.0, || {
            format!("node.{name}.capacity: {capacity} J/K; must be more than 0")
        });
        check.demand(initial.is_finite(), || format!("node.{name}.initial: must be a finite number"));
    }
}

impl LinkFile {
    fn resolve(&self, check: &mut Check) -> Link {
        let [first, second] = &self.between;
        let place = format!("link between {first} and {second}");
        check.demand(first != second, || format!("{place}: a node must not be linked to itself"));
        check.demand(self.conductance.is_finite() && self.conductance > 0.0, || {
            format!("{place}: conductance {} W/K; must be more than 0", self.conductance)
        });
        let before = check.errors.len();
        let ends = (check.point(&place, first), check.point(&place, second));
        let (node, other) = match ends {
            (Point::Node(node), other) | (other, Point::Node(node)) => (node, other),
            (_, other) => {
                let wrong = check.errors.len() > before;
                check.demand(wrong, || format!("{place}: at least one of the two must be a node"));
                (0, other)
            }
        };
        check.demand(!matches!(other, Point::Spot(_)), || {
            format!("{place}: a measuring point of the structure cannot be linked; link a port")
        });
        Link { node, other, conductance: self.conductance }
    }
}

impl SourceFile {
    fn resolve(self, name: String, check: &mut Check) -> Source {
        let place = format!("source.{name}");
        check.demand(self.watts.is_finite(), || format!("{place}.watts: must be a finite number"));
        check.demand((0.0..1.0).contains(&self.varies), || format!("{place}.varies: must be from 0 to 1"));
        let node = check.node(&place, &self.node);
        Source { name, node, watts: self.watts, varies: self.varies, when: self.when }
    }
}

impl SensorFile {
    fn resolve(self, signal: String, check: &mut Check) -> SensorSpec {
        let place = format!("sensor.{signal}");
        check.demand(self.noise.is_finite() && self.noise >= 0.0, || {
            format!("{place}.noise: must be 0 or more")
        });
        check.demand(self.resolution.is_finite() && self.resolution >= 0.0, || {
            format!("{place}.resolution: must be 0 or more")
        });
        let first = check.point(&place, &self.node);
        let mut feels = vec![(first, 1.0)];
        if let Some(blend) = self.blend {
            check.demand((0.0..=1.0).contains(&blend.share), || {
                format!("{place}.blend.share: must be from 0 to 1")
            });
            feels = vec![(first, 1.0 - blend.share), (check.point(&place, &blend.node), blend.share)];
        }
        SensorSpec { signal, feels, lag: self.lag, resolution: self.resolution, noise: self.noise }
    }
}

impl Position {
    fn check(&self, check: &mut Check) {
        let place = format!("position.{}", self.signal);
        check.demand(self.middle.is_finite() && self.stroke.is_finite(), || {
            format!("{place}: middle and stroke must be finite numbers")
        });
        check.demand(self.period > 0.0, || format!("{place}.period: must be longer than 0s"));
    }
}

/// Checks that the explicit time steps are stable. A step must be short compared with the time constant of
/// every node. In one step, a port of the structure may warm only by a small fraction of the temperature
/// difference that heats the port.
fn stable(nodes: &[Node], links: &[Link], structure: Option<&Structure>, check: &mut Check) {
    for (index, node) in nodes.iter().enumerate() {
        let total: f64 = links
            .iter()
            .filter(|link| link.node == index || link.other == Point::Node(index))
            .map(|link| link.conductance)
            .sum();
        let sinks = structure.iter().flat_map(|structure| &structure.sinks);
        let sinks = sinks.filter(|sink| sink.point == Point::Node(index)).map(|sink| sink.conductance);
        let total = total + sinks.sum::<f64>();
        check.demand(total * STEP.as_secs_f64() < 0.1 * node.capacity, || {
            format!(
                "node.{}: links of {total} W/K in total are too much for a capacity of {} J/K: reduce the \
                 conductances, or raise the capacity",
                node.name, node.capacity
            )
        });
    }
    let ports = structure.map_or(0, |structure| structure.ports.len());
    for port in 0..ports {
        let mine = links.iter().filter(|link| link.other == Point::Port(port));
        let total: f64 = mine.map(|link| link.conductance).sum();
        let yields = structure.map_or(0.0, |structure| structure.yields(port));
        check.demand(total * yields < 0.1, || {
            format!(
                "structure: links of {total} W/K in total are too much for a port that 1 W warms by {yields} K \
                 in a step. Reduce the conductances"
            )
        });
    }
}
