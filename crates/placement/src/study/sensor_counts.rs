//! Other divisions than the one that was asked for: the cut that helps most, fewer sensors and more.

use super::{Criteria, SensorCount, Study, root_mean_square, rows};
use crate::blocks::{Part, blocks};
use crate::body::Progress;
use crate::divisions::{Division, Floors};
use crate::methods::multi_case::{Effort, multi_case};
use crate::problem::Problem;

/// Blocks that are added for the curve over numbers.
const MORE: usize = 4;

/// The best further cut, and the error over the number of sensors; `rms_um` is what those that were placed leave.
pub(super) fn other_divisions(
    study: &Study,
    criteria: &Criteria,
    rms_um: f64,
    progress: Progress<'_>,
) -> (Option<(String, f64)>, Vec<SensorCount>) {
    let Some(adjoint) = &study.adjoint else { return (None, Vec::new()) };
    let floors = Floors::new(&study.mesh, adjoint, &study.loads, &criteria.components);
    let usable = |parts: &[Part]| blocks(&study.mesh, parts, &study.reach).is_ok();
    let counted = |division: &Division| {
        let blocks = blocks(&study.mesh, &division.parts, &study.reach).ok()?;
        let columns: Vec<Vec<f64>> = division.parts.iter().map(|part| adjoint.block(&part.nodes)).collect();
        let problem = Problem::new(blocks, &rows(&columns), &study.loads, &criteria.components);
        let cases: Vec<usize> = (0..problem.targets.len()).collect();
        let places = multi_case(&problem, &cases, criteria.tolerance, Effort::SHORT);
        Some(SensorCount {
            sensors: division.parts.len(),
            floor_um: division.floor_um,
            rms_um: root_mean_square(&problem.rms_of_each(&places)),
            cut: division.cut.as_ref().map(ToString::to_string),
        })
    };
    let own = study.parts.len();
    let all = own + MORE;
    let mut found = Vec::new();
    let mut parts = study.parts.clone();
    while let Some(joined) = floors.best_join(&parts, &usable) {
        progress("number of sensors", found.len(), all);
        found.extend(counted(&joined));
        parts = joined.parts;
    }
    found.reverse();
    // The blocks themselves, with the sensors that were looked for longest.
    found.push(SensorCount { sensors: own, floor_um: floors.of(&study.parts), rms_um, cut: None });
    let mut best_cut = None;
    let mut parts = study.parts.clone();
    for more in 0..MORE {
        progress("number of sensors", own + more, all);
        let Some(division) = floors.best_cut(&parts, &usable) else { break };
        if more == 0 {
            best_cut = division.cut.as_ref().map(|plane| (plane.to_string(), division.floor_um));
        }
        found.extend(counted(&division));
        parts = division.parts;
    }
    progress("number of sensors", all, all);
    (best_cut, found)
}
