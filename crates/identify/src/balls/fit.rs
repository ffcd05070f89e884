//! Thermal terms of one round of touches, by least squares. They describe how the balls moved since the cold round.

use nalgebra::{DMatrix, DVector};

use super::touches::{Touch, time};
use super::{DIRECTIONS, RoundTerms};
use crate::statistics::{count, range};

/// Largest movement of a ball that can be a drift, µm. A larger value means that a different ball was touched, or that
/// the unit of the file is wrong.
const NO_DRIFT: f64 = 1000.0;
/// Minimum difference of two positions or stylus lengths, mm. A smaller difference is treated as zero.
const APART: f64 = 1.0;

/// Movement of one ball between the cold round and a touch, µm, with the position along the array and the stylus length
/// in mm.
struct Moved {
    place: f64,
    stylus: f64,
    by: [f64; 3],
}

pub(super) fn fit(cold: &[Touch], round: &[Touch], along: usize, origin: f64) -> Result<RoundTerms, String> {
    let mut moved = Vec::new();
    for touch in round {
        moved.extend(since_cold(cold, touch, along)?);
    }
    let spread = |of: fn(&Moved) -> f64| range(moved.iter().map(of));
    if spread(|touch| touch.place) < APART {
        return Err("fewer than two balls of this round were touched in the first round".to_owned());
    }
    let shortest = moved.iter().map(|touch| touch.stylus).fold(f64::MAX, f64::min);
    let has_styli =
        moved.iter().all(|touch| touch.stylus.is_finite()) && spread(|touch| touch.stylus) >= APART;
    let all = DMatrix::from_fn(moved.len(), 3, |row, column| match column {
        0 => 1.0,
        1 => moved[row].place - origin,
        _ => moved[row].stylus - shortest,
    });
    // If the long stylus touched some balls and the short one the others, the columns of both tilts are dependent.
    let with_stylus = has_styli && least_squares(&all, &DVector::zeros(moved.len())).is_some();
    let without_stylus = all.columns(0, 2).into_owned();
    let (mut drift_um, mut slope_um_per_mm, mut spindle) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    let mut left = 0.0;
    for direction in 0..3 {
        let matrix = if with_stylus && direction != along { &all } else { &without_stylus };
        let by = DVector::from_fn(moved.len(), |row, _| moved[row].by[direction]);
        let terms = least_squares(matrix, &by).ok_or("the balls of this round are too near to each other")?;
        drift_um[direction] = terms[0];
        slope_um_per_mm[direction] = terms[1];
        spindle[direction] = terms.get(2).copied().unwrap_or(0.0);
        left += (by - matrix * terms).norm_squared();
    }
    let at = time(round);
    Ok(RoundTerms {
        time: at,
        hours: at.since(time(cold)).as_secs_f64() / 3600.0,
        touches: moved.len(),
        drift_um,
        slope_um_per_mm,
        spindle_um_per_mm: with_stylus.then_some(spindle),
        rms_um: (left / (3.0 * count(moved.len()))).sqrt(),
    })
}

/// Returns how far the ball of a touch moved since the cold round. The cold coordinates are the mean of the touches of
/// the same ball with the same stylus. `Ok(None)` if the cold round has no such touch; `Err` if the movement is too
/// large for a drift.
fn since_cold(cold: &[Touch], touch: &Touch, along: usize) -> Result<Option<Moved>, String> {
    let same: Vec<&Touch> = cold.iter().filter(|other| other.is_like(touch)).collect();
    if same.is_empty() {
        return Ok(None);
    }
    let mean =
        |direction: usize| same.iter().map(|other| other.at_mm[direction]).sum::<f64>() / count(same.len());
    let by = [0, 1, 2].map(|direction| 1000.0 * (touch.at_mm[direction] - mean(direction)));
    if let Some(far) = (0..3).find(|direction| by[*direction].abs() > NO_DRIFT) {
        return Err(format!(
            "ball {} is {:.3} mm away from its position in the cold round, along {}. This is too much \
             for a thermal drift. Check that the balls are numbered as in the first round, and that the \
             coordinates are in mm",
            touch.ball,
            by[far] / 1000.0,
            DIRECTIONS[far]
        ));
    }
    Ok(Some(Moved { place: mean(along), stylus: touch.stylus_mm, by }))
}

/// Returns the vector w that minimizes |matrix·w − target|². `None` if there are too few rows, or if columns are
/// linearly dependent.
fn least_squares(matrix: &DMatrix<f64>, target: &DVector<f64>) -> Option<DVector<f64>> {
    if matrix.nrows() < matrix.ncols() {
        return None;
    }
    let scales = DVector::from_fn(matrix.ncols(), |column, _| matrix.column(column).norm().max(1e-300));
    let scaled = DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] / scales[j]);
    let parts = scaled.svd(true, true);
    if parts.singular_values.min() < 1e-6 {
        return None;
    }
    Some(parts.solve(target, 0.0).ok()?.component_div(&scales))
}
