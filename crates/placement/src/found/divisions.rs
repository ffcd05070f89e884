//! Other divisions than the one that was asked for: the cut that helps most, fewer sensors and more.

use super::{Asked, Numbered, Study, rows, together_rms};
use crate::blocks::{Part, blocks};
use crate::body::Progress;
use crate::layout::{Changed, Floors};
use crate::methods::multi_case::{Effort, multi_case};
use crate::problem::Problem;

/// Blocks that are added for the curve over numbers.
const MORE: usize = 4;

/// The best further cut, and the error over the number of sensors.
pub(super) fn other_divisions(
    study: &Study<'_>,
    asked: &Asked,
    problem: &Problem,
    rms_um: &f64,
    progress: Progress<'_>,
) -> (Option<(String, f64)>, Vec<Numbered>) {
    let Some(adjoint) = study.adjoint else { return (None, Vec::new()) };
    let floors = Floors::new(study.mesh, adjoint, study.loads, &asked.components);
    let usable = |parts: &[Part]| blocks(study.mesh, parts, study.reach).is_ok();
    let numbered = |changed: &Changed| {
        let blocks = blocks(study.mesh, &changed.parts, study.reach).ok()?;
        let columns: Vec<Vec<f64>> = changed.parts.iter().map(|part| adjoint.block(&part.nodes)).collect();
        let problem = Problem::new(blocks, &rows(&columns), study.loads, &asked.components);
        let cases: Vec<usize> = (0..problem.aims.len()).collect();
        let places = multi_case(&problem, &cases, asked.tolerated(), Effort::SHORT);
        let rms: Vec<f64> = problem.aims.iter().map(|aim| problem.rms_of(aim, &places)).collect();
        Some(Numbered {
            sensors: changed.parts.len(),
            floor_um: changed.floor_um,
            rms_um: together_rms(&rms),
            cut: changed.cut.as_ref().map(ToString::to_string),
        })
    };
    let all = study.parts.len() + MORE;
    let mut found = Vec::new();
    let mut parts = study.parts.to_vec();
    while let Some(joined) = floors.best_join(&parts, &usable) {
        progress("number of sensors", found.len(), all);
        found.extend(numbered(&joined));
        parts = joined.parts;
    }
    found.reverse();
    // The blocks themselves, with the sensors that were looked for longest.
    let own = problem.blocks.len();
    found.push(Numbered { sensors: own, floor_um: floors.of(study.parts), rms_um: *rms_um, cut: None });
    let mut best_cut = None;
    let mut parts = study.parts.to_vec();
    for more in 0..MORE {
        progress("number of sensors", own + more, all);
        let Some(cut) = floors.best_cut(&parts, &usable) else { break };
        if more == 0 {
            best_cut = cut.cut.as_ref().map(|plane| (plane.to_string(), cut.floor_um));
        }
        found.extend(numbered(&cut));
        parts = cut.parts;
    }
    progress("number of sensors", all, all);
    (best_cut, found)
}
