//! Other divisions than the one that was asked for: the cut that helps most, fewer sensors and more.

use rayon::prelude::*;

use super::{Criteria, SensorCount, Study, root_mean_square, rows};
use crate::blocks::{Part, Surveyed};
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
    let surveyed = Surveyed::new(&study.mesh, &study.reach);
    let usable = |parts: &[Part]| surveyed.blocks(parts).is_ok();
    let counted = |division: &Division| {
        let blocks = surveyed.blocks(&division.parts).ok()?;
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
    let mut fewer = Vec::new();
    while let Some(joined) = {
        let parts = fewer.last().map_or(&study.parts, |division: &Division| &division.parts);
        floors.best_join(parts, &usable)
    } {
        progress("number of sensors", fewer.len(), all);
        fewer.push(joined);
    }
    let mut more: Vec<Division> = Vec::new();
    while more.len() < MORE {
        progress("number of sensors", own + more.len(), all);
        let parts = more.last().map_or(&study.parts, |division| &division.parts);
        let Some(division) = floors.best_cut(parts, &usable) else { break };
        more.push(division);
    }
    let best_cut = more.first().and_then(|first| Some((first.cut.as_ref()?.to_string(), first.floor_um)));
    fewer.reverse();
    let count =
        |divisions: &[Division]| -> Vec<SensorCount> { divisions.par_iter().filter_map(counted).collect() };
    // The blocks themselves, with the sensors that were looked for longest.
    let placed = SensorCount { sensors: own, floor_um: floors.of(&study.parts), rms_um, cut: None };
    let (fewer, more) = rayon::join(|| count(&fewer), || count(&more));
    progress("number of sensors", all, all);
    (best_cut, fewer.into_iter().chain([placed]).chain(more).collect())
}
