//! Thermal terms from a 1-D ball array: a row of balls that is clamped along one axis (Li, Yang, Zhang, Zhang 1998). A
//! probe touches the same balls in several rounds. The changes of their coordinates give origin drift, expansion and
//! tilts.
//!
//! ```text
//! touches (time, ball, x, y, z, stylus) ── rounds ── fit (least squares over the balls) ── log for identify
//! ```
//! p is the position along the array, p0 its origin, L the length of the stylus, and L0 the shorter stylus. The
//! coordinates of a ball change since the cold round by these amounts, in µm:
//! - along the array: d + k·(p − p0)
//! - across it, in two directions: d + A·(p − p0) + B·(L − L0)
//!
//! A is the tilt of the part that moves the spindle along the array: the column if the array is parallel to Z. B is the
//! tilt of the spindle. B requires styluses of two lengths.
//!
//! # Sign
//! The balls do not move: a machine whose tool has moved up by 5 µm measures them 5 µm lower. The error is e = −d.

use serde::Serialize;

use crate::dataset::{BadLog, Dataset};
use crate::statistics::range;
use isotherm_core::quantity::Moment;
use touches::{Touch, rounds};

mod fit;
mod log;
mod touches;

pub use log::log;

/// Names of the three coordinate directions. Every array of three values has this order.
pub const DIRECTIONS: [&str; 3] = ["x", "y", "z"];

/// Thermal terms of all rounds of a warm-up.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Terms {
    /// Direction of the array, as an index of [`DIRECTIONS`].
    #[serde(skip)]
    pub along: usize,
    /// Direction of the array as text: `x`, `y` or `z`.
    pub array: &'static str,
    /// Position p0 along the array that counts as the origin, mm. At p0, expansion and tilt add nothing to the drift d.
    pub origin_mm: f64,
    /// Terms of each round. The first round is the cold round: all its terms are zero.
    pub rounds: Vec<RoundTerms>,
    /// Remarks for the operator about unusual data.
    pub remarks: Vec<String>,
}

/// Thermal terms of one round of touches, relative to the cold round.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RoundTerms {
    /// Mean time of the touches in this round.
    #[serde(skip)]
    pub time: Moment,
    /// Mean time of the touches, h since the cold round.
    pub hours: f64,
    /// Number of touches from which the terms were calculated.
    pub touches: usize,
    /// Origin drift d of the coordinates x, y, z, µm.
    pub drift_um: [f64; 3],
    /// Slope of the coordinates in each direction, µm per mm along the array: the expansion k in the direction of the
    /// array, and the tilt A in the other two directions.
    pub slope_um_per_mm: [f64; 3],
    /// Tilt B of the spindle in each direction, µm per mm of stylus length; zero in the direction of the array. `None`
    /// if the touches do not determine B, for example because all styluses have one length.
    pub spindle_um_per_mm: Option<[f64; 3]>,
    /// Root mean square of the residuals over all touches and directions, µm.
    pub rms_um: f64,
}

/// Calculates the terms of every round. `origin` is in mm along the array; by default, it is the position of the first
/// ball.
///
/// # Errors
/// The terms cannot be calculated from these touches. Each message says how to correct the touches.
pub fn terms(dataset: &Dataset, origin: Option<f64>) -> Result<Terms, BadLog> {
    let rounds = rounds(dataset)?;
    let Some(cold) = rounds.first() else {
        return Err(one("there are no touches: write one row for each touch of a ball"));
    };
    let (along, extent) = direction(cold)?;
    let places = || cold.iter().map(|touch| touch.at_mm[along]);
    let origin_mm = origin.or(places().next()).unwrap_or_default();
    if rounds.len() == 1 {
        return Err(one(
            "the file contains one round only: touch the balls while the machine is cold, and again while the \
             machine warms up",
        ));
    }
    if places().all(|place| (place - origin_mm).abs() > 10.0 * extent) {
        return Err(one(&format!(
            "the origin {origin_mm} mm is far from every ball: state a position along {} that is near the \
             balls",
            DIRECTIONS[along]
        )));
    }
    let (mut found, mut remarks) = (Vec::new(), dataset.remarks.clone());
    for (number, round) in rounds.iter().enumerate() {
        match fit::fit(cold, round, along, origin_mm) {
            Ok(terms) => found.push(terms),
            Err(why) => remarks.push(format!("round {} is left out: {why}", number + 1)),
        }
    }
    if found.iter().all(|round| round.spindle_um_per_mm.is_none()) {
        remarks.push(
            "all touches have the same stylus length, so a tilt of the spindle cannot be distinguished from \
             its drift. Touch the balls with two lengths, and write them in stylus_mm"
                .to_owned(),
        );
    }
    Ok(Terms { along, array: DIRECTIONS[along], origin_mm, rounds: found, remarks })
}

/// Returns the direction of the array, as an index of [`DIRECTIONS`], and the length of the array in mm.
fn direction(cold: &[Touch]) -> Result<(usize, f64), BadLog> {
    let extents = [0, 1, 2].map(|direction| range(cold.iter().map(|touch| touch.at_mm[direction])));
    let along = (1..3).fold(0, |best, next| if extents[next] > extents[best] { next } else { best });
    let (axis, length) = (DIRECTIONS[along], extents[along]);
    let across = (0..3).filter(|other| *other != along).map(|other| extents[other]).fold(0.0, f64::max);
    if length < SHORTEST {
        return Err(one(&format!(
            "the balls of the first round are within {length:.3} mm of each other. A ball array has at least \
             two balls, several cm apart, each with its own number in the column `ball`"
        )));
    }
    if across > SKEWED * length {
        return Err(one(&format!(
            "the balls extend {length:.0} mm along {axis}, but also {across:.0} mm across this axis: clamp \
             the array parallel to one axis"
        )));
    }
    Ok((along, length))
}

/// Minimum length of a ball array, mm.
const SHORTEST: f64 = 5.0;
/// Maximum extent of a ball array across its direction, as a share of its length. With a larger extent, a thermal
/// expansion would look like a tilt.
const SKEWED: f64 = 0.1;

fn one(message: &str) -> BadLog {
    BadLog(vec![message.to_owned()])
}
