//! The method of JP 6507619 B2 (JTEKT), its steps S1 to S12 on one load case.
//!
//! - S1–S4, done before: mesh and blocks; nodal temperatures θ1; the displacement δ1 they cause.
//! - S5, S6: block temperatures θ2, at first the mean of each block's nodes; the displacement δ2 = P·θ2.
//! - S7: where δ2 is as close to δ1 as wanted, go to S11.
//! - S8: the displacement δ3 of each tendency pattern θ3; the pattern whose δ3 looks most like δ1 − δ2.
//! - S9: the difference degree r, by least squares of δ1 − δ2 on δ3.
//! - S10: θg = θ2 + r·θ3, each block within what its nodes offer; it is the next θ2: back to S6.
//! - S11, S12: in each block the node whose temperature is nearest to θg; there the sensor goes.

use nalgebra::DVector;

use super::patterns::{Pattern, patterns};
use crate::problem::{Problem, Target};

/// One round.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Round {
    /// The pattern that was chosen.
    pub pattern: String,
    /// How much its displacement looks like what was left: cosine of the angle between them, without its sign.
    pub likeness: f64,
    /// The difference degree r, K.
    pub r: f64,
    /// What is left afterwards, µm RMS.
    pub rms_um: f64,
}

/// Block temperatures and how they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct Iterated {
    /// θg: rises, K.
    pub theta: Vec<f64>,
    /// The rounds.
    pub rounds: Vec<Round>,
}

/// Rounds after which it is given up.
pub const MOST_ROUNDS: usize = 120;
/// The share of what is left by which a round must lower it.
const LEAST: f64 = 1e-4;

/// The iteration on one case, until `enough` µm RMS are left or no pattern helps any more.
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
        // Where the bounds of its blocks leave the likest pattern no room, the next one has its turn.
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
