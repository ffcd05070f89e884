//! The displacement matrix of a guideway, as a finite-element model gives it.
//!
//! ```json
//! { "format": "isotherm-matrix", "version": 1, "blocks": ["base", "column"], "guide_mm": [0, 400, 800],
//!   "P": [[…], …] }
//! ```
//! `P`: rows 3·guide + component (x, y, z), one column per block, mm/K. `guide_mm`: where the points lie along the
//! axis, ascending. `guide_nodes` and `cases` may be there too: they are for people and not read.

use serde::Deserialize;
use serde::de::IgnoredAny;

/// A matrix file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MatrixFile {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    #[serde(rename = "guide_nodes", default)]
    _guide_nodes: IgnoredAny,
    #[serde(rename = "cases", default)]
    _cases: IgnoredAny,
    pub(crate) blocks: Vec<String>,
    pub(crate) guide_mm: Vec<f64>,
    #[serde(rename = "P")]
    rows: Vec<Vec<f64>>,
}

impl MatrixFile {
    pub(crate) fn parse(bytes: &[u8]) -> Result<MatrixFile, String> {
        let file: MatrixFile = super::read(bytes, "isotherm-matrix")?;
        let (rows, points) = (file.rows.len(), file.guide_mm.len());
        if rows != 3 * points {
            return Err(format!(
                "P has {rows} rows; {points} points in guide_mm want {}, x, y and z of each",
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

    /// One component (0 x, 1 y, 2 z) times a factor: for each point of the guideway one number per block.
    pub(crate) fn component(&self, component: usize, factor: f64) -> Vec<f64> {
        let rows = self.rows.iter().skip(component).step_by(3);
        rows.flatten().map(|entry| entry * factor).collect()
    }
}
