//! The file that a plant reads.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Modes;
use crate::blocks::AXES;
use crate::structure::Adjoint;
use crate::written::Along;

/// What is to be told of the structure.
#[derive(Clone, Copy, Debug)]
pub struct Outputs<'a> {
    /// Names and nodes whose temperature is told.
    pub points: &'a [(String, usize)],
    /// How the guideway follows every node.
    pub adjoint: &'a Adjoint,
    /// The guideway as one line.
    pub along: &'a Along,
}

#[derive(Serialize)]
struct File<'a> {
    format: &'a str,
    version: u32,
    rate_per_s: Vec<f64>,
    uniform: Vec<f64>,
    ports: BTreeMap<&'a str, Vec<f64>>,
    sinks: BTreeMap<&'a str, Vec<f64>>,
    points: BTreeMap<&'a str, Vec<f64>>,
    guide_mm: &'a [f64],
    moves_um: BTreeMap<&'a str, Vec<Vec<f64>>>,
}

/// The modes as JSON, one row of numbers to a line.
#[must_use]
pub fn file(modes: &Modes, outputs: &Outputs<'_>) -> String {
    let point = |node: usize| short(modes.shapes.iter().map(|shape| shape[node]));
    let moved: Vec<Vec<f64>> =
        modes.shapes.iter().map(|shape| outputs.adjoint.displacements(shape)).collect();
    let moves = |component: usize| -> Vec<Vec<f64>> {
        let columns: Vec<Vec<f64>> = moved.iter().map(|moved| outputs.along.of(moved, component)).collect();
        let row = |at: usize| short(columns.iter().map(|column| 1000.0 * column[at]));
        (0..outputs.along.guide_mm.len()).map(row).collect()
    };
    let file = File {
        format: "isotherm-modes",
        version: 1,
        rate_per_s: short(modes.rates.iter().copied()),
        uniform: short(modes.uniform.iter().copied()),
        ports: modes.ports.iter().map(|(name, port)| (&name[..], short(port.iter().copied()))).collect(),
        sinks: modes.sinks.iter().map(|(name, sink)| (&name[..], short(sink.iter().copied()))).collect(),
        points: outputs.points.iter().map(|(name, node)| (&name[..], point(*node))).collect(),
        guide_mm: &outputs.along.guide_mm,
        moves_um: (0..3).map(|component| (AXES[component], moves(component))).collect(),
    };
    // Numbers and names only: this cannot fail.
    let text = serde_json::to_string(&file).unwrap_or_default();
    text.replace("],", "],\n").replace("},", "},\n").replace("{\"", "{\n\"") + "\n"
}

/// Seven digits: of a temperature in °C the last is a hundred-thousandth of a kelvin.
fn short(values: impl Iterator<Item = f64>) -> Vec<f64> {
    values.map(|value| format!("{value:.6e}").parse().unwrap_or(value)).collect()
}
