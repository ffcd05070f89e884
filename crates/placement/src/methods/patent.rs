//! Method of JP 6507619 B2 (JTEKT): its steps S1 to S12 on one load case.
//!
//! - S1–S4, done before: mesh and blocks; nodal temperatures θ1; the displacement δ1 that they cause.
//! - S5, S6: block temperatures θ2, initially the mean of each block's nodes; the displacement δ2 = P·θ2. The
//!   matrix P is the displacement of the guideway for each block that is 1 K warmer.
//! - S7: if δ2 is close enough to δ1, continue with S11.
//! - S8: the displacement δ3 of each tendency pattern θ3; selects the pattern with the δ3 most similar to δ1 − δ2.
//! - S9: the difference degree r, by least squares of δ1 − δ2 on δ3.
//! - S10: θg = θ2 + r·θ3, with each block within the range of its nodes. θg is the next θ2; continue with S6.
//! - S11, S12: in each block, the node with the temperature nearest to θg gets the sensor.

use nalgebra::DVector;

use super::patterns::{Pattern, patterns};
use crate::problem::{Problem, Target};

/// One round of the iteration: steps S6 to S10.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Round {
    /// Name of the tendency pattern that was selected in step S8.
    pub pattern: String,
    /// Similarity of the displacement of the pattern to the residual: absolute cosine of the angle between them.
    pub likeness: f64,
    /// Difference degree r of the round, K: factor of the selected pattern, by least squares.
    pub r: f64,
    /// Residual after the round, µm RMS.
    pub rms_um: f64,
}

/// Result of the iteration: the block temperatures and the rounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Iterated {
    /// Block temperatures θg that the iteration has reached (rises, K).
    pub theta: Vec<f64>,
    /// Rounds of the iteration, in their order.
    pub rounds: Vec<Round>,
}

/// Maximum number of rounds, after which the iteration ends in any case.
pub const MOST_ROUNDS: usize = 120;
/// Minimum relative decrease of the residual error in a round. With a smaller decrease, the iteration ends.
const LEAST: f64 = 1e-4;

/// Iterates on one case, until the residual is at most `enough` µm RMS, no pattern reduces it, or [`MOST_ROUNDS`] is
/// reached.
#[must_use]
pub fn patent(problem: &Problem, target: &Target, enough: f64) -> Iterated {
    let patterns = patterns(&problem.blocks);
    let displacements: Vec<DVector<f64>> =
        patterns.iter().map(|pattern| displaced(problem, pattern)).collect();
    let mut theta = target.mean.clone();
    clamp(&mut theta, target);
    let mut rms = problem.rms(target, &theta);
    let mut rounds = Vec::new();
    while rms > enough && rounds.len() < MOST_ROUNDS {
        let left = &target.moved - problem.evaluate(&theta);
        let likeness = |place: usize| {
            let displaced = &displacements[place];
            let size = displaced.norm() * left.norm();
            if size > 0.0 { displaced.dot(&left).abs() / size } else { 0.0 }
        };
        let mut order: Vec<usize> = (0..patterns.len()).collect();
        order.sort_by(|one, other| likeness(*other).total_cmp(&likeness(*one)));
        // If the bounds of its blocks prevent the most similar pattern, the next one is tried.
        let step = order.into_iter().filter(|place| likeness(*place) > 0.0).find_map(|place| {
            let r = displacements[place].dot(&left) / displacements[place].norm_squared();
            let mut next = theta.clone();
            for (theta, warmed) in next.iter_mut().zip(&patterns[place].warmed) {
                *theta += if *warmed { r } else { 0.0 };
            }
            clamp(&mut next, target);
            let after = problem.rms(target, &next);
            let round = || Round {
                pattern: patterns[place].name.clone(),
                likeness: likeness(place),
                r,
                rms_um: after,
            };
            (after < rms * (1.0 - LEAST)).then(|| (round(), next))
        });
        let Some((round, next)) = step else { break };
        (theta, rms) = (next, round.rms_um);
        rounds.push(round);
    }
    Iterated { theta, rounds }
}

fn displaced(problem: &Problem, pattern: &Pattern) -> DVector<f64> {
    let theta: Vec<f64> = pattern.warmed.iter().map(|warmed| if *warmed { 1.0 } else { 0.0 }).collect();
    problem.evaluate(&theta)
}

fn clamp(theta: &mut [f64], target: &Target) {
    for (theta, (low, high)) in theta.iter_mut().zip(&target.bounds) {
        *theta = theta.clamp(*low, *high);
    }
}
