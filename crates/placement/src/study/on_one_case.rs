//! Results for one load case that require most of the computing time. They are independent of the other
//! results, and are calculated in parallel.

use crate::methods::bounded::bounded;
use crate::methods::multi_case::{Effort, Tolerance, multi_case};
use crate::methods::patent::{Iterated, patent};
use crate::problem::Problem;

/// Results for one load case alone, and the residual error with sensors that were placed for all other cases.
pub(super) struct OnOneCase {
    /// Block temperatures with the smallest residual error (rises, K).
    pub(super) floor: Vec<f64>,
    /// Block temperatures of the patent's iteration.
    pub(super) iterated: Iterated,
    /// Residual error of this case with sensors that were placed for the other cases, µm RMS; `None` if there are no
    /// other cases.
    pub(super) left_out_rms_um: Option<f64>,
}

impl OnOneCase {
    pub(super) fn new(problem: &Problem, case: usize, tolerance: Tolerance) -> OnOneCase {
        let target = &problem.targets[case];
        let others: Vec<usize> = (0..problem.targets.len()).filter(|other| *other != case).collect();
        let left_out = || problem.rms_of(target, &multi_case(problem, &others, tolerance, Effort::SHORT));
        OnOneCase {
            floor: bounded(problem, target),
            iterated: patent(problem, target, tolerance.enough),
            left_out_rms_um: (!others.is_empty()).then(left_out),
        }
    }
}
