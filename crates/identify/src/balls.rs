//! Thermal terms of a 1-D ball array (Li, Yang, Zhang, Zhang 1998): from the coordinates of the same balls, touched round
//! after round, to origin drift, expansion, and tilts.
//!
//! ```text
//! touches (time, ball, x, y, z, stylus) ── rounds ── fit (least squares over the balls) ── log that identify takes
//! ```
//! With p the place along the array, p0 its origin and L the length of the stylus, what a ball's coordinates have moved
//! since the cold round is, in µm:
//! - along the array: d + k·(p − p0)
//! - across it, twice: d + A·(p − p0) + B·(L − L0); A tilts what carries the spindle along the array (the column, where the
//!   array stands along Z), B the spindle itself. B needs two lengths of stylus; L0 is the shorter one.
//!
//! # Sign
//! The balls stand still: a machine whose tool has gone up by 5 µm meets them 5 µm lower. The error is e = −d.

use serde::Serialize;

use crate::dataset::{BadLog, Dataset};
use crate::statistics::range;
use isotherm_core::quantity::Moment;
use touches::{Touch, rounds};

mod fit;
mod log;
mod touches;

pub use log::log;

/// The directions, in the order of every array of three.
pub const DIRECTIONS: [&str; 3] = ["x", "y", "z"];

/// What a ball array says about a warm-up.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Terms {
    /// The direction that the balls stand along: its place in [`DIRECTIONS`].
    #[serde(skip)]
    pub along: usize,
    /// The same in words.
    pub array: &'static str,
    /// Where d is the whole drift, mm along the array.
    pub origin_mm: f64,
    /// The first is the cold one, all zeros.
    pub rounds: Vec<RoundTerms>,
    /// What is odd.
    pub remarks: Vec<String>,
}

/// The terms of one round.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RoundTerms {
    /// The mean time of its touches.
    #[serde(skip)]
    pub time: Moment,
    /// The same, h since the cold round.
    pub hours: f64,
    /// Touches that were used.
    pub touches: usize,
    /// Origin drift d of the coordinates x, y, z, µm.
    pub drift_um: [f64; 3],
    /// By direction, µm per mm along the array: k in the array's own, the tilt A in the others.
    pub slope_um_per_mm: [f64; 3],
    /// The spindle's tilt B, µm per mm of stylus, zero in the array's direction; none where it was touched with one length.
    pub spindle_um_per_mm: Option<[f64; 3]>,
    /// What the terms leave over, root mean square over all touches and directions, µm.
    pub rms_um: f64,
}

/// The terms of every round. `origin`: mm along the array; `None`: the first ball's place.
///
/// # Errors
/// Sentences that say what to do.
pub fn terms(dataset: &Dataset, origin: Option<f64>) -> Result<Terms, BadLog> {
    let rounds = rounds(dataset)?;
    let Some(cold) = rounds.first() else { return Err(one("there are no touches")) };
    let (along, extent) = direction(cold)?;
    let places = || cold.iter().map(|touch| touch.at_mm[along]);
    let origin_mm = origin.or(places().next()).unwrap_or_default();
    if rounds.len() == 1 {
        return Err(one(
            "there is one round only: touch the balls cold, and again while the machine warms up",
        ));
    }
    if places().all(|place| (place - origin_mm).abs() > 10.0 * extent) {
        return Err(one(&format!(
            "the origin {origin_mm} mm is far from every ball: give it along {}",
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
            "every touch has one length of stylus, which cannot distinguish a tilt of the spindle from its drift: touch \
             the balls with two lengths, and write them in stylus_mm"
                .to_owned(),
        );
    }
    Ok(Terms { along, array: DIRECTIONS[along], origin_mm, rounds: found, remarks })
}

/// The direction of the array, and its length.
fn direction(cold: &[Touch]) -> Result<(usize, f64), BadLog> {
    let extents = [0, 1, 2].map(|direction| range(cold.iter().map(|touch| touch.at_mm[direction])));
    let along = (1..3).fold(0, |best, next| if extents[next] > extents[best] { next } else { best });
    let (axis, length) = (DIRECTIONS[along], extents[along]);
    let across = (0..3).filter(|other| *other != along).map(|other| extents[other]).fold(0.0, f64::max);
    if length < SHORTEST {
        return Err(one(&format!(
            "the balls of the first round stand within {length:.3} mm: a ball array has two balls at least, some cm apart, \
             each with its number in `ball`"
        )));
    }
    if across > SKEWED * length {
        return Err(one(&format!(
            "the balls run along {axis} ({length:.0} mm), but {across:.0} mm across it too: clamp the array along one axis"
        )));
    }
    Ok((along, length))
}

/// mm.
const SHORTEST: f64 = 5.0;
/// An array that is off its axis by more than a tenth mixes expansion into the tilts.
const SKEWED: f64 = 0.1;

fn one(message: &str) -> BadLog {
    BadLog(vec![message.to_owned()])
}
