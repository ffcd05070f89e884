//! `kind = "matrix"`: displacements of a guideway from a finite-element model.
//!
//! ```json
//! { "format": "isotherm-matrix", "version": 1, "blocks": ["base", "column"], "guide_mm": [0, 400, 800],
//!   "P": [[…], …] }
//! ```
//! A block is a part of the machine with one temperature. Row 3·point + component of `P` (0 x, 1 y, 2 z) has one column
//! for each block, in mm/K. `guide_mm` contains the positions of the points along the axis, ascending. `guide_nodes`
//! and `cases` are optional and ignored.

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::effect::{effect, figure, late, rises};
use super::file::{bytes, fit, read, taken};
use super::inputs::in_order;
use super::kind::{Computation, KindOfModel, Places};
use super::raw::{Carries, Component, MATRIX, RawModel};
use crate::tables::KeyContext;
use crate::tables::signal::Signal;
use isotherm_core::compensation::model::{Kind, Matrix};
use isotherm_core::quantity::Millimetre;

/// Number of µm in a mm. A matrix file contains mm, and a gain is in µm.
const MICRONS: f64 = 1000.0;

pub(super) const KIND: KindOfModel = KindOfModel {
    word: MATRIX,
    one: "a matrix",
    keys: &["inputs", "file", "reference", "position", "component", "carries"],
    resolve,
    preview,
    places,
};

/// Content of a matrix file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MatrixFile {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    #[serde(rename = "guide_nodes", default)]
    _guide_nodes: IgnoredAny,
    #[serde(rename = "cases", default)]
    _cases: IgnoredAny,
    blocks: Vec<String>,
    guide_mm: Vec<f64>,
    #[serde(rename = "P")]
    rows: Vec<Vec<f64>>,
}

impl MatrixFile {
    fn parse(bytes: &[u8]) -> Result<MatrixFile, String> {
        let file: MatrixFile = read(bytes, "isotherm-matrix")?;
        let (rows, points) = (file.rows.len(), file.guide_mm.len());
        if rows != 3 * points {
            return Err(format!(
                "P has {rows} rows; {points} points in guide_mm need {} rows: x, y and z of each point",
                3 * points
            ));
        }
        let blocks = file.blocks.len();
        if let Some(row) = file.rows.iter().position(|row| row.len() != blocks) {
            let columns = file.rows[row].len();
            return Err(format!("row {} of P has {columns} columns; there are {blocks} blocks", row + 1));
        }
        Ok(file)
    }

    /// Returns the gains of one displacement component (0 x, 1 y, 2 z), multiplied by `factor`. The list contains for
    /// each point of the guideway one number per block.
    fn component(&self, component: usize, factor: f64) -> Vec<f64> {
        let rows = self.rows.iter().skip(component).step_by(3);
        rows.flatten().map(|entry| entry * factor).collect()
    }
}

fn resolve(raw: &RawModel, at: &KeyContext<'_>) -> Option<Kind> {
    let needs = [
        ("inputs", "write inputs = [ … ], the signal of each block in the file's order"),
        ("file", "write file = \"column.json\", a matrix next to the profile"),
        ("position", "write position = \"…\" with the signal of the axis position in mm"),
        ("component", "write which displacement acts along the axis: \"x\", \"y\", \"z\" or \"-x\", …"),
        ("carries", "write what the guideway carries: \"tool\" or \"work\""),
    ];
    for (key, help) in needs.into_iter().filter(|(key, _)| !at.has(key)) {
        at.key(key).missing(format!("`{key}` is missing: a model of kind \"matrix\" needs this key"), help);
    }
    let position = at.key("position").position(raw.position.as_ref());
    let inputs = in_order((raw.inputs.as_ref(), raw.reference), at, None);
    let (name, at) = (raw.file.as_deref()?, at.key("file"));
    let bytes = bytes(raw.sha256.as_ref(), "file", &at, name)?;
    let file = taken(&at, name, MatrixFile::parse(&bytes))?;
    let (inputs, names) = inputs?;
    taken(&at, name, fit("blocks", &file.blocks, &names))?;
    let (component, along) = match raw.component? {
        Component::X => (0, 1.0),
        Component::Y => (1, 1.0),
        Component::Z => (2, 1.0),
        Component::MinusX => (0, -1.0),
        Component::MinusY => (1, -1.0),
        Component::MinusZ => (2, -1.0),
    };
    // Cz is the negative error. A displacement of the tool is an error of the same sign, one of the workpiece of the
    // opposite sign.
    let acts = match raw.carries? {
        Carries::Tool => -1.0,
        Carries::Work => 1.0,
    };
    let gains = file.component(component, MICRONS * along * acts);
    let position = position?;
    let matrix = quantities(file.guide_mm)
        .and_then(|guide| Ok((guide, quantities(gains)?)))
        .and_then(|(guide, gains)| Matrix::new(name, inputs, position, guide, gains));
    taken(&at, name, matrix).map(Kind::Matrix)
}

/// Converts the numbers of a file into values with a unit, such as millimetres. A number that is not finite is an
/// error.
fn quantities<Q: TryFrom<f64, Error = &'static str>>(numbers: Vec<f64>) -> Result<Vec<Q>, String> {
    numbers.into_iter().map(Q::try_from).collect::<Result<_, _>>().map_err(str::to_owned)
}

/// Returns the position signal of a matrix, with the two ends of the guideway in mm. `None` for another kind of model.
fn places(kind: &Kind) -> Option<Places> {
    let Kind::Matrix(matrix) = kind else { return None };
    Some((matrix.position(), vec![matrix.ends().0.get(), matrix.ends().1.get()]))
}

/// Returns the calculation as text for the preview, with the effect of each block's temperature in the middle
/// of the guideway. `None` for another kind of model.
fn preview(signals: &[Signal], kind: &Kind) -> Option<Computation> {
    let Kind::Matrix(matrix) = kind else { return None };
    let position = &signals[matrix.position().0].name;
    let (first, last) = (matrix.ends().0.get(), matrix.ends().1.get());
    let formula = format!(
        "Cz = P·ΔT µm at {position}, P of {} from {} to {} mm (beyond an end, the value at this \
         end), over \
         {}",
        matrix.source(),
        figure(first),
        figure(last),
        rises(signals, matrix.blocks())
    );
    let at = f64::midpoint(first, last);
    let place = format!(" (at {position} = {} mm)", figure(at));
    let blocks = matrix.blocks().iter().zip(matrix.gains_at(Millimetre::new(at).unwrap_or_default()));
    let effects =
        blocks.map(|(block, gain)| effect(signals, block.signal, gain.get(), &late(signals, block, &place)));
    Some(Computation { formula, effects: effects.collect() })
}
