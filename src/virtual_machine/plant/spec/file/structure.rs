//! Structure that is reduced to thermal modes: its keys in the plant file, the file with its modes, and their checks.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::super::Position;
use super::check::Check;
use crate::virtual_machine::plant::structure::{Point, Sink, Structure, dot};

/// Settings of the structure in the plant file of its machine.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StructureFile {
    /// Name of the file with the modes.
    modes: String,
    initial: f64,
    /// Name of the position signal that selects the point of the guideway.
    position: String,
    /// Axes that follow the guideway. For each axis, the direction in which a displacement of the guideway is
    /// the error of the axis.
    pub(super) axes: BTreeMap<String, Direction>,
    /// For each sink: name of the node, or the air, that determines its temperature.
    sinks: BTreeMap<String, String>,
}

/// Direction of a displacement, in the order of [`Structure::moves`].
#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "lowercase")]
pub(super) enum Direction {
    X,
    Y,
    Z,
}

/// File of modes as `isotherm place --modes` writes it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModesFile {
    format: String,
    version: u32,
    rate_per_s: Vec<f64>,
    uniform: Vec<f64>,
    ports: BTreeMap<String, Vec<f64>>,
    sinks: BTreeMap<String, Vec<f64>>,
    points: BTreeMap<String, Vec<f64>>,
    guide_mm: Vec<f64>,
    moves_um: Moves,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Moves {
    x: Vec<Vec<f64>>,
    y: Vec<Vec<f64>>,
    z: Vec<Vec<f64>>,
}

impl StructureFile {
    /// Reads the file with the modes, through `read`.
    ///
    /// # Errors
    /// The file does not exist or is invalid.
    pub(super) fn read(&self, read: &dyn Fn(&str) -> Option<String>) -> Result<ModesFile, String> {
        let name = &self.modes;
        let text = read(name).ok_or_else(|| format!("structure.modes: there is no file `{name}`"))?;
        let modes: ModesFile = serde_json::from_str(&text).map_err(|why| format!("{name}: {why}"))?;
        let wrong: Vec<String> = modes.wrong().iter().map(|why| format!("{name}: {why}")).collect();
        if wrong.is_empty() { Ok(modes) } else { Err(wrong.join("\n")) }
    }

    pub(super) fn resolve(&self, modes: ModesFile, positions: &[Position], check: &mut Check) -> Structure {
        check.demand(self.initial.is_finite(), || "structure.initial: must be a finite number".to_owned());
        let position = positions.iter().position(|known| known.signal == self.position);
        check.demand(position.is_some(), || {
            format!("structure.position: there is no position `{}`", self.position)
        });
        for name in self.sinks.keys().filter(|name| !modes.sinks.contains_key(*name)) {
            let known = modes.sinks.keys().cloned().collect::<Vec<_>>().join(", ");
            check.demand(false, || format!("structure.sinks: there is no sink `{name}`; allowed: {known}"));
        }
        let mut sinks = Vec::new();
        for (name, drives) in modes.sinks {
            let place = format!("structure.sinks.{name}");
            let point = match self.sinks.get(&name) {
                Some(around) => check.surroundings(&place, around),
                None => {
                    check.demand(false, || {
                        format!("{place}: is missing; write the name of a node, or ambient")
                    });
                    Point::Ambient
                }
            };
            sinks.push(Sink { point, conductance: dot(&drives, &modes.uniform), modes: drives });
        }
        let (keep, gain) = modes.rate_per_s.iter().map(|rate| Structure::step(*rate)).unzip();
        Structure {
            initial: self.initial,
            position: position.unwrap_or_default(),
            keep,
            gain,
            uniform: modes.uniform,
            ports: modes.ports.into_values().collect(),
            sinks,
            spots: modes.points.into_values().collect(),
            guide: modes.guide_mm,
            moves: [modes.moves_um.x, modes.moves_um.y, modes.moves_um.z],
        }
    }
}

impl ModesFile {
    /// Returns the names of the points of the structure: ports, which links can use, and spots, which sensors can use.
    pub(super) fn names(&self) -> Vec<(String, Point)> {
        let ports = self.ports.keys().enumerate().map(|(place, name)| (name.clone(), Point::Port(place)));
        let spots = self.points.keys().enumerate().map(|(place, name)| (name.clone(), Point::Spot(place)));
        ports.chain(spots).collect()
    }

    fn wrong(&self) -> Vec<String> {
        let mut wrong = Vec::new();
        if self.format != "isotherm-modes" || self.version != 1 {
            wrong.push(format!(
                "format {:?}, version {}: this program reads isotherm-modes, version 1",
                self.format, self.version
            ));
        }
        let count = self.rate_per_s.len();
        if count == 0 || !self.rate_per_s.iter().all(|rate| rate.is_finite() && *rate > 0.0) {
            wrong.push("rate_per_s: every rate must be more than 0, because every mode decays".to_owned());
        }
        let mut rows = |what: String, row: &[f64]| {
            if row.len() != count || !row.iter().all(|value| value.is_finite()) {
                wrong.push(format!("{what}: {count} finite numbers are required, one for each mode"));
            }
        };
        rows("uniform".to_owned(), &self.uniform);
        self.ports.iter().for_each(|(name, row)| rows(format!("ports.{name}"), row));
        self.sinks.iter().for_each(|(name, row)| rows(format!("sinks.{name}"), row));
        self.points.iter().for_each(|(name, row)| rows(format!("points.{name}"), row));
        let directions = [("x", &self.moves_um.x), ("y", &self.moves_um.y), ("z", &self.moves_um.z)];
        for (name, moves) in directions {
            moves.iter().for_each(|row| rows(format!("moves_um.{name}"), row));
        }
        for (name, _) in directions.iter().filter(|(_, moves)| moves.len() != self.guide_mm.len()) {
            wrong.push(format!(
                "moves_um.{name}: {} rows are required, one for each point of guide_mm",
                self.guide_mm.len()
            ));
        }
        let ascends = self.guide_mm.windows(2).all(|pair| pair[0] < pair[1]);
        if self.guide_mm.is_empty() || !ascends {
            wrong.push("guide_mm: ascending points in mm are required".to_owned());
        }
        wrong
    }
}
