//! Methods that select the node for the sensor of each block.

pub mod bounded;
pub mod multi_case;
pub mod patent;
pub mod patterns;

use crate::element::{dot, minus};
use crate::problem::{Block, Problem, Target};

/// Method that selects the nodes of the sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Iteration of the patent JP 6507619 B2 on one load case.
    Patent,
    /// Least squares on one load case, with each block temperature within its bounds.
    Bounded,
    /// Search over all load cases together.
    #[default]
    MultiCase,
}

impl Method {
    /// Returns the name of the method on the command line and in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Method::Patent => "patent",
            Method::Bounded => "bounded",
            Method::MultiCase => "multi-case",
        }
    }
}

/// Returns for each block the index of the candidate node with the temperature nearest to `theta` (requested rises of
/// the blocks, K).
#[must_use]
pub fn nearest(target: &Target, theta: &[f64]) -> Vec<usize> {
    let place = |(offered, theta): (&Vec<f64>, &f64)| {
        let far = |place: &usize| (offered[*place] - theta).abs();
        (0..offered.len()).min_by(|one, other| far(one).total_cmp(&far(other))).unwrap_or(0)
    };
    target.offered.iter().zip(theta).map(place).collect()
}

/// Returns for each block the node nearest to the centre of its volume, whether a sensor can be mounted there or not.
/// These nodes represent a choice without a calculation, with which the methods are compared.
#[must_use]
pub fn central(problem: &Problem, xyz: &[[f64; 3]]) -> Vec<usize> {
    let central = |block: &Block| {
        let far = |node: &usize| {
            let way = minus(xyz[*node], block.centre);
            dot(way, way)
        };
        block.nodes.iter().copied().min_by(|one, other| far(one).total_cmp(&far(other))).unwrap_or(0)
    };
    problem.blocks.iter().map(central).collect()
}

#[cfg(test)]
mod tests;
