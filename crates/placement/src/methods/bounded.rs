//! Smallest residual of one load case that block temperatures can reach: least squares, with each temperature within
//! the range of its block.

use nalgebra::{DMatrix, DVector};

use crate::problem::{Problem, Target};

/// State of a block temperature relative to its bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BoundState {
    Free,
    Low,
    High,
}

/// Returns the block temperatures θg (rises, K) with the least residual error in a load case.
#[must_use]
pub fn bounded(problem: &Problem, target: &Target) -> Vec<f64> {
    least_squares(&problem.square, &target.cross, &target.bounds)
}

/// Minimises θ'Aθ − 2·θ'b with each θ within its bounds. `square` is the matrix A, and `cross` the vector b. The
/// active-set method frees or fixes one variable at a time, as in the bounded-variable algorithm of Stark and Parker
/// (Computational Statistics 10, 1995).
pub(crate) fn least_squares(square: &DMatrix<f64>, cross: &DVector<f64>, bounds: &[(f64, f64)]) -> Vec<f64> {
    let width = bounds.len();
    let mut theta: DVector<f64> = DVector::from_iterator(width, bounds.iter().map(|(low, _)| *low));
    let mut held = vec![BoundState::Low; width];
    // Many more rounds than necessary: each round frees one variable.
    for _ in 0..50 * width.max(1) {
        let downhill = cross - square * &theta;
        let scale = downhill.amax().max(cross.amax()).max(f64::MIN_POSITIVE);
        let wants = |place: &usize| match held[*place] {
            BoundState::Free => 0.0,
            BoundState::Low => downhill[*place],
            BoundState::High => -downhill[*place],
        };
        let best = (0..width)
            .filter(|place| bounds[*place].0 < bounds[*place].1)
            .max_by(|one, other| wants(one).total_cmp(&wants(other)));
        let Some(best) = best.filter(|place| wants(place) > 1e-11 * scale) else { break };
        held[best] = BoundState::Free;
        if !settle(square, cross, bounds, &mut theta, &mut held, best) {
            break;
        }
    }
    theta.as_slice().to_vec()
}

/// Solves for the free variables. If variables would leave their bounds, the first of these variables is fixed at its
/// bound, and the other variables are solved again. Returns `false` if no variable changes.
fn settle(
    square: &DMatrix<f64>,
    cross: &DVector<f64>,
    bounds: &[(f64, f64)],
    theta: &mut DVector<f64>,
    held: &mut [BoundState],
    freed: usize,
) -> bool {
    let before = theta.clone();
    loop {
        let free: Vec<usize> = (0..held.len()).filter(|place| held[*place] == BoundState::Free).collect();
        if free.is_empty() {
            break;
        }
        let Some(wanted) = solved(square, cross, theta, &free) else {
            held[freed] = BoundState::Low;
            return false;
        };
        // Largest fraction of the step for which all variables stay within their bounds.
        let mut step = 1.0;
        let mut first = None;
        for (place, wanted) in free.iter().zip(wanted.iter()) {
            let (low, high) = bounds[*place];
            let edge = if *wanted < low {
                low
            } else if *wanted > high {
                high
            } else {
                continue;
            };
            let way = wanted - theta[*place];
            let share = if way.abs() > 0.0 { ((edge - theta[*place]) / way).clamp(0.0, 1.0) } else { 0.0 };
            if share <= step {
                step = share;
                first = Some((*place, if *wanted < low { BoundState::Low } else { BoundState::High }));
            }
        }
        for (place, wanted) in free.iter().zip(wanted.iter()) {
            let (low, high) = bounds[*place];
            theta[*place] = (theta[*place] + step * (wanted - theta[*place])).clamp(low, high);
        }
        let Some((place, side)) = first else { break };
        held[place] = side;
        theta[place] = if side == BoundState::Low { bounds[place].0 } else { bounds[place].1 };
    }
    (&*theta - before).amax() > 0.0
}

/// Returns the solution for the free variables, with all other variables fixed; `None` if the system is singular.
fn solved(
    square: &DMatrix<f64>,
    cross: &DVector<f64>,
    theta: &DVector<f64>,
    free: &[usize],
) -> Option<DVector<f64>> {
    let largest = free.iter().map(|place| square[(*place, *place)]).fold(0.0, f64::max);
    let inner = DMatrix::from_fn(free.len(), free.len(), |i, j| {
        // The small ridge makes the system solvable if two blocks have the same effect.
        let ridge = if i == j { 1e-13 * largest } else { 0.0 };
        square[(free[i], free[j])] + ridge
    });
    let right = DVector::from_fn(free.len(), |i, _| {
        let others = (0..theta.len()).filter(|place| !free.contains(place));
        cross[free[i]] - others.map(|place| square[(free[i], place)] * theta[place]).sum::<f64>()
    });
    inner.cholesky().map(|factor| factor.solve(&right))
}

#[cfg(test)]
mod tests;
