//! Evaluation of other divisions into blocks than the requested division: the best additional cut, and fewer or more
//! sensors.

use rayon::prelude::*;

use super::{Criteria, SensorCount, Study, root_mean_square, rows};
use crate::blocks::{Part, Surveyed};
use crate::divisions::{Division, Floors};
use crate::methods::multi_case::{Effort, multi_case};
use crate::problem::Problem;

/// Maximum number of further cuts. Each cut adds a block and a sensor.
const MORE: usize = 4;

/// Results for other divisions into blocks than the requested division.
#[derive(Default)]
pub(super) struct Divisions {
    best_cut: Option<(String, f64)>,
    fewer: Vec<SensorCount>,
    /// Lower bound of the error with the requested blocks, µm RMS over all cases.
    own_floor_um: Option<f64>,
    more: Vec<SensorCount>,
}

impl Divisions {
    /// Returns the best additional cut, and the error by number of sensors. `own` is the number of requested blocks.
    /// `rms_um` is the error with one sensor in each requested block.
    pub(super) fn with_own(self, own: usize, rms_um: f64) -> (Option<(String, f64)>, Vec<SensorCount>) {
        let placed =
            self.own_floor_um.map(|floor_um| SensorCount { sensors: own, floor_um, rms_um, cut: None });
        (self.best_cut, self.fewer.into_iter().chain(placed).chain(self.more).collect())
    }
}

/// Returns the maximum number of other divisions that are evaluated, for the progress report.
pub(super) fn other_divisions_at_most(study: &Study) -> usize {
    if study.adjoint.is_some() { study.parts.len().saturating_sub(1) + MORE } else { 0 }
}

/// Evaluates divisions into fewer and into more blocks. Calls `step` after each division.
pub(super) fn other_divisions(study: &Study, criteria: &Criteria, step: &(dyn Fn() + Sync)) -> Divisions {
    let Some(adjoint) = &study.adjoint else { return Divisions::default() };
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
    let count =
        |divisions: &[Division]| -> Vec<SensorCount> { divisions.par_iter().filter_map(counted).collect() };
    let fewer = || {
        let mut fewer: Vec<Division> = Vec::new();
        while let Some(joined) = {
            let parts = fewer.last().map_or(&study.parts, |division| &division.parts);
            floors.best_join(parts, &usable)
        } {
            fewer.push(joined);
            step();
        }
        fewer.reverse();
        count(&fewer)
    };
    let more = || {
        let mut more: Vec<Division> = Vec::new();
        while more.len() < MORE {
            let parts = more.last().map_or(&study.parts, |division| &division.parts);
            let Some(division) = floors.best_cut(parts, &usable) else { break };
            more.push(division);
            step();
        }
        let best_cut = more.first().and_then(|first| Some((first.cut.as_ref()?.to_string(), first.floor_um)));
        (best_cut, count(&more))
    };
    let (fewer, (best_cut, more)) = rayon::join(fewer, more);
    Divisions { best_cut, fewer, own_floor_um: Some(floors.of(&study.parts)), more }
}
