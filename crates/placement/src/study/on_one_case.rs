//! What a case takes the longest for, and needs nothing of the others for.

use crate::methods::bounded::bounded;
use crate::methods::multi_case::{Effort, Tolerance, multi_case};
use crate::methods::patent::{Iterated, patent};
use crate::problem::Problem;

/// What is found on one case without the others, and what those leave of it.
pub(super) struct OnOneCase {
    /// Block temperatures that leave least.
    pub(super) floor: Vec<f64>,
    /// Those of the patent's iteration.
    pub(super) iterated: Iterated,
    /// µm RMS.
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
