//! The methods: where the sensor of each block belongs.

pub mod bounded;
pub mod multi_case;
pub mod patent;
pub mod patterns;

use super::problem::{Aim, Problem};

/// For each block the candidate whose temperature is nearest to the wanted one: places in the lists of candidates.
#[must_use]
pub fn nearest(aim: &Aim, theta: &[f64]) -> Vec<usize> {
    let place = |(offered, theta): (&Vec<f64>, &f64)| {
        let far = |place: &usize| (offered[*place] - theta).abs();
        (0..offered.len()).min_by(|one, other| far(one).total_cmp(&far(other))).unwrap_or(0)
    };
    aim.offered.iter().zip(theta).map(place).collect()
}

/// For each block the candidate nearest to its centre: where one would put a sensor without computing.
#[must_use]
pub fn central(problem: &Problem, xyz: &[[f64; 3]]) -> Vec<usize> {
    let place = |block: &super::problem::Block| {
        let far = |place: &usize| {
            let at = xyz[block.candidates[*place]];
            (0..3).map(|axis| (at[axis] - block.centre[axis]).powi(2)).sum::<f64>()
        };
        (0..block.candidates.len()).min_by(|one, other| far(one).total_cmp(&far(other))).unwrap_or(0)
    };
    problem.blocks.iter().map(place).collect()
}
