//! Study of a structure under its load cases: the places of its sensors, and the residual error of each case.
//!
//! The matrix P contains the displacement of the guideway for each block that is 1 K warmer. δ1 is the
//! displacement of the guideway in a load case. The error of block temperatures θ is P·θ − δ1, µm RMS over
//! the guideway. The error is calculated for four sets of block temperatures:
//!
//! - *naive*: the temperature of the node at the centre of each block, or the mean of its nodes;
//! - *optimised*: the block temperatures θg that the method for sensor placement calculates;
//! - *read back*: the temperatures at the selected sensors;
//! - *floor*: the block temperatures with the smallest error. No sensors can give a smaller error.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use crate::blocks::{Part, Reach, blocks};
use crate::body::Progress;
use crate::mesh::{AXES, Mesh, count};
use crate::methods::multi_case::{Effort, Tolerance, multi_case, noise_um};
use crate::methods::patent::Round;
use crate::methods::{Method, central, nearest};
use crate::parallel::listening;
use crate::problem::{Block, Load, Problem};
use crate::structure::Adjoint;

mod misplaced;
mod on_one_case;
mod sensor_counts;

use on_one_case::OnOneCase;
use sensor_counts::{other_divisions, other_divisions_at_most};

/// Criteria by which the sensors are placed and evaluated.
#[derive(Clone, Debug)]
pub struct Criteria {
    /// Directions in which errors are evaluated together: 0 x, 1 y, 2 z.
    pub components: Vec<usize>,
    /// Method that selects the places of the sensors.
    pub method: Method,
    /// Load case for `patent` and `bounded`; `None` for the case with the largest displacement of the guideway.
    pub case: Option<usize>,
    /// Limits below which errors are negligible. A method ends when it reaches its limit.
    pub tolerance: Tolerance,
    /// Assumed distance of each sensor from its calculated place, mm. The study reports the additional error.
    pub misplaced: f64,
}

/// Structure with its blocks and load cases, for which the places of the sensors are selected.
#[derive(Clone, Debug)]
pub struct Study {
    /// Mesh of the structure.
    pub mesh: Mesh,
    /// Indices of the guideway nodes.
    pub guide: Vec<usize>,
    /// Matrix P, mm/K: displacement of the guideway if a block is 1 K warmer. P has three rows (x, y and z)
    /// for each guideway node, and one column for each block.
    pub p: Vec<Vec<f64>>,
    /// Displacement of the guideway nodes per kelvin of every node; `None` if other divisions into blocks are not to be
    /// evaluated.
    pub adjoint: Option<Adjoint>,
    /// Blocks of the structure: name and nodes of each block.
    pub parts: Vec<Part>,
    /// Nodes at which sensors may be mounted, and their minimum distance from other blocks.
    pub reach: Reach,
    /// Load cases; the list has at least one.
    pub loads: Vec<Load>,
}

impl Study {
    /// Returns the coordinates of the guideway nodes, mm.
    #[must_use]
    pub fn guide_xyz(&self) -> Vec<[f64; 3]> {
        self.guide.iter().map(|node| self.mesh.xyz[*node]).collect()
    }
}

/// Sensor with its node and position on the structure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensor {
    /// Number of the sensor's node in the FE input file.
    pub node: u32,
    /// Position of the sensor, mm.
    pub xyz: [f64; 3],
    /// Block whose temperature the sensor measures.
    pub block: String,
}

impl Sensor {
    fn at(mesh: &Mesh, node: usize, block: &Block) -> Sensor {
        Sensor { node: mesh.nodes[node].0, xyz: mesh.xyz[node], block: block.name.clone() }
    }
}

/// Error along the guideway (difference between predicted and actual displacement), µm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Residual {
    /// Root mean square of the error along the guideway.
    pub rms_um: f64,
    /// Largest absolute error along the guideway.
    pub max_um: f64,
}

/// Result of one method on one load case: selected sensors and residual error.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodResult {
    /// Error with the selected sensors: root mean square along the guideway, µm.
    pub rms_um: f64,
    /// Error with the selected sensors: largest absolute value along the guideway, µm.
    pub max_um: f64,
    /// Error with the requested block temperatures, µm RMS. For a method that selects nodes directly, it equals
    /// `rms_um`.
    pub optimised_rms_um: f64,
    /// Sensors at the nodes that the method has selected, one for each block.
    pub sensors: Vec<Sensor>,
    /// Block temperatures θg that the method requests (rises, K). Empty for a method that selects nodes directly.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub theta_k: Vec<f64>,
    /// Rounds of an iterative method, in their order. Empty for other methods.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rounds: Vec<Round>,
}

/// Results for one load case: displacement, and residual errors of all methods.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseResult {
    /// Name of the load case.
    #[serde(skip)]
    pub name: String,
    /// Displacement δ1 of the guideway in the case, mm: x, y and z of each guideway node.
    pub delta1_mm: Vec<f64>,
    /// Largest displacement of a guideway node in an evaluated direction, µm.
    pub largest_um: f64,
    /// Error with the temperature of the node at the centre of each block.
    pub naive_centroid: Residual,
    /// Error with the mean temperature of the nodes of each block.
    pub naive_mean: Residual,
    /// Lower bound of the error with these blocks.
    pub floor: Residual,
    /// Result of the patent's iteration on this case.
    pub patent: MethodResult,
    /// Result of bounded least squares on this case.
    pub bounded: MethodResult,
    /// Result of the nodes that were selected for all cases together.
    #[serde(rename = "multi-case")]
    pub multi_case: MethodResult,
    /// Error on this case with nodes that were selected for all other cases, µm RMS; `None` if there is only one case.
    pub left_out_rms_um: Option<f64>,
    /// Additional error if the sensors of the selected method are not exactly at their places, µm RMS.
    pub misplaced_um: f64,
    /// Displacement that the temperatures at the centres of the blocks predict, mm: x, y and z of each guideway node.
    #[serde(skip)]
    pub naive_mm: Vec<f64>,
    /// Displacement that the selected sensors predict, mm: x, y and z of each guideway node.
    #[serde(skip)]
    pub read_mm: Vec<f64>,
}

/// Sensors that a method has placed for one load case or for all load cases, with their error on every load case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CrossCase {
    /// Method that placed the sensors.
    pub method: Method,
    /// Case for which the sensors were placed; `None` for all cases.
    pub placed_by: Option<String>,
    /// Error on each case, µm RMS.
    pub rms_um: Vec<f64>,
}

/// Result for one number of sensors (one for each block), after the best joins or cuts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorCount {
    /// Number of sensors, which is also the number of blocks.
    pub sensors: usize,
    /// Lower bound of the error with these blocks, µm RMS over all cases.
    pub floor_um: f64,
    /// Error with the sensors that `multi-case` selects, µm RMS over all cases.
    pub rms_um: f64,
    /// Cut that added the last block; `None` if no block was added.
    pub cut: Option<String>,
}

/// Result of the study: places of the sensors, and residual errors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Placement {
    /// Matrix P, mm/K: displacement of the guideway if a block is 1 K warmer. P has three rows (x, y and z)
    /// for each guideway node, and one column for each block.
    #[serde(rename = "P")]
    pub p: Vec<Vec<f64>>,
    /// Names of the blocks.
    pub blocks: Vec<String>,
    /// Numbers of the guideway nodes in the FE input file.
    pub guide_nodes: Vec<u32>,
    /// Directions that are evaluated: 0 x, 1 y, 2 z.
    #[serde(skip)]
    pub axes: Vec<usize>,
    /// Names of the evaluated directions, for example `z` or `y, z`.
    pub component: String,
    /// Method that was selected for the placement.
    pub method: Method,
    /// Case for which the method placed the sensors; `None` for all cases.
    pub placed_by: Option<String>,
    /// Sensors of the selected method.
    pub sensors: Vec<Sensor>,
    /// Nodes at the centres of the blocks, which [`CaseResult::naive_centroid`] uses.
    pub centres: Vec<Sensor>,
    /// Results of each case.
    #[serde(serialize_with = "by_name")]
    pub cases: Vec<CaseResult>,
    /// Placements for a single load case and for all cases, each with its error on every case.
    pub cross_case: Vec<CrossCase>,
    /// Assumed noise of each sensor, K.
    pub noise_k: f64,
    /// Effect of the sensor noise on the predicted displacement of the guideway, µm RMS.
    pub noise_um: f64,
    /// Assumed distance of each sensor from its calculated place, mm.
    pub misplaced_mm: f64,
    /// Lower bound of the error with these blocks, µm RMS over all cases.
    pub floor_um: f64,
    /// Error with the selected sensors, µm RMS over all cases.
    pub rms_um: f64,
    /// Whether the division into blocks limits the result more than the places of the sensors.
    pub blocks_limit: bool,
    /// Best further cut in the form of the option `--cut`, and the lower bound of the error after this cut, µm RMS over
    /// all cases.
    pub best_cut: Option<(String, f64)>,
    /// Error for each number of sensors. Empty if [`Study::adjoint`] is `None`.
    pub by_number: Vec<SensorCount>,
    /// Coordinates of the guideway nodes, mm.
    pub guide_xyz: Vec<[f64; 3]>,
    /// Remarks about the result, for the reader of the report.
    pub remarks: Vec<String>,
}

fn by_name<S: serde::Serializer>(cases: &[CaseResult], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(cases.iter().map(|case| (&case.name, case)))
}

/// Ratio of the lower bound to the error, above which the division into blocks limits the result.
const LIMITS: f64 = 0.7;

/// Selects the places of the sensors, and evaluates them on every load case.
///
/// # Errors
/// A block has no possible place for a sensor. The messages contain a remedy.
pub fn place(study: &Study, criteria: &Criteria, progress: Progress<'_>) -> Result<Placement, Vec<String>> {
    let Study { mesh, p, loads, .. } = study;
    let Criteria { components, method, tolerance, .. } = criteria;
    let blocks = blocks(mesh, &study.parts, &study.reach)?;
    let problem = Problem::new(blocks, p, loads, components);
    let all: Vec<usize> = (0..problem.targets.len()).collect();
    // The three tasks are independent.
    let (together, (alone, divisions)) = listening(progress, |says| {
        let (done, steps) = (AtomicUsize::new(0), 1 + all.len() + other_divisions_at_most(study));
        let step = || says("sensors", done.fetch_add(1, Ordering::Relaxed) + 1, steps);
        let of_all = || {
            let together = multi_case(&problem, &all, *tolerance, Effort::FULL);
            step();
            together
        };
        let of_each = || {
            let of_one = |case: &usize| {
                let alone = OnOneCase::new(&problem, *case, *tolerance);
                step();
                alone
            };
            all.par_iter().map(of_one).collect::<Vec<OnOneCase>>()
        };
        says("sensors", 0, steps);
        let others = rayon::join(of_all, || rayon::join(of_each, || other_divisions(study, criteria, &step)));
        says("sensors", steps, steps);
        others
    });
    let central = central(&problem, &mesh.xyz);
    let sensors = |places: &[usize]| -> Vec<Sensor> {
        let each = problem.blocks.iter().zip(places);
        each.map(|(block, place)| Sensor::at(mesh, block.candidates[*place], block)).collect()
    };
    let mut cross = Vec::new();
    let mut cases = Vec::new();
    for ((case, target), alone) in problem.targets.iter().enumerate().zip(alone) {
        let residual = |theta: &[f64]| Residual {
            rms_um: problem.rms(target, theta),
            max_um: (problem.evaluate(theta) - &target.moved).amax(),
        };
        let result = |places: &[usize], theta: Option<Vec<f64>>, rounds: Vec<Round>| {
            let Residual { rms_um, max_um } = residual(&problem.readings(target, places));
            MethodResult {
                rms_um,
                max_um,
                optimised_rms_um: theta.as_ref().map_or(rms_um, |theta| problem.rms(target, theta)),
                sensors: sensors(places),
                theta_k: theta.unwrap_or_default(),
                rounds,
            }
        };
        let naive: Vec<f64> = central.iter().map(|node| loads[case].rise[*node]).collect();
        let OnOneCase { floor, iterated, left_out_rms_um } = alone;
        let (by_patent, by_bounded) = (nearest(target, &iterated.theta), nearest(target, &floor));
        cases.push(CaseResult {
            name: target.name.clone(),
            delta1_mm: loads[case].moved_mm.clone(),
            largest_um: target.moved.amax(),
            naive_centroid: residual(&naive),
            naive_mean: residual(&target.mean),
            floor: residual(&floor),
            patent: result(&by_patent, Some(iterated.theta), iterated.rounds),
            bounded: result(&by_bounded, Some(floor), Vec::new()),
            multi_case: result(&together, None, Vec::new()),
            left_out_rms_um,
            misplaced_um: 0.0,
            naive_mm: evaluate(p, &naive),
            read_mm: Vec::new(),
        });
        cross.push((Method::Patent, Some(case), by_patent));
        cross.push((Method::Bounded, Some(case), by_bounded));
    }
    cross.push((Method::MultiCase, None, together));
    let by = (*method != Method::MultiCase).then(|| criteria.case.unwrap_or_else(|| moves_most(&cases)));
    let chosen = cross.iter().find(|(known, case, _)| known == method && *case == by);
    let chosen = chosen.map(|(_, _, places)| places.clone()).unwrap_or_default();
    for (case, result) in cases.iter_mut().enumerate() {
        result.read_mm = evaluate(p, &problem.readings(&problem.targets[case], &chosen));
        result.misplaced_um = misplaced::added(study, &problem, &chosen, case, criteria.misplaced);
    }
    let floors: Vec<f64> = cases.iter().map(|case| case.floor.rms_um).collect();
    let (rms_um, floor_um) = (root_mean_square(&problem.rms_of_each(&chosen)), root_mean_square(&floors));
    let (best_cut, by_number) = divisions.with_own(study.parts.len(), rms_um);
    let name = |case: &usize| cases[*case].name.clone();
    let centres = central.iter().zip(&problem.blocks);
    let cross_case = cross.iter().map(|(method, case, places)| CrossCase {
        method: *method,
        placed_by: case.as_ref().map(name),
        rms_um: problem.rms_of_each(places),
    });
    let mut placement = Placement {
        p: p.clone(),
        blocks: problem.blocks.iter().map(|block| block.name.clone()).collect(),
        guide_nodes: study.guide.iter().map(|node| mesh.nodes[*node].0).collect(),
        axes: components.clone(),
        component: components.iter().map(|axis| AXES[*axis]).collect::<Vec<_>>().join(", "),
        method: *method,
        placed_by: by.as_ref().map(name),
        sensors: sensors(&chosen),
        centres: centres.map(|(node, block)| Sensor::at(mesh, *node, block)).collect(),
        cross_case: cross_case.collect(),
        noise_k: tolerance.noise,
        noise_um: noise_um(&problem, tolerance.noise),
        misplaced_mm: criteria.misplaced,
        blocks_limit: floor_um > LIMITS * rms_um,
        floor_um,
        rms_um,
        best_cut,
        by_number,
        guide_xyz: study.guide_xyz(),
        remarks: Vec::new(),
        cases,
    };
    placement.remarks = remarks(&placement);
    placement.remarks.extend(study.loads.iter().filter_map(implausible));
    Ok(placement)
}

/// Converts the columns of a matrix to rows.
#[must_use]
pub fn rows(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let height = columns.first().map_or(0, Vec::len);
    (0..height).map(|row| columns.iter().map(|column| column[row]).collect()).collect()
}

/// Returns the displacement P·θ of the guideway for the block temperatures θ, in all directions, mm.
fn evaluate(p: &[Vec<f64>], theta: &[f64]) -> Vec<f64> {
    p.iter().map(|row| row.iter().zip(theta).map(|(each, theta)| each * theta).sum()).collect()
}

/// Combines root mean squares of equally many values, such as one error for each case, to the root mean square of all
/// values.
pub(super) fn root_mean_square(each: &[f64]) -> f64 {
    (each.iter().map(|rms| rms.powi(2)).sum::<f64>() / count(each.len().max(1))).sqrt()
}

/// Returns the index of the case with the largest displacement of the guideway.
pub(super) fn moves_most(cases: &[CaseResult]) -> usize {
    let largest = |place: &usize| cases[*place].largest_um;
    (0..cases.len()).max_by(|one, other| largest(one).total_cmp(&largest(other))).unwrap_or(0)
}

/// Largest plausible change of a temperature, K: a machine is between -40 and 200 °C.
const LARGEST_RISE: f64 = 240.0;

/// Returns a remark about a load case with temperatures that no machine has; `None` if the temperatures are plausible.
/// A wrong unit of a load or of a material has this effect.
fn implausible(load: &Load) -> Option<String> {
    let larger = |one: f64, other: f64| if other.abs() > one.abs() { other } else { one };
    let rise = load.rise.iter().copied().fold(0.0, larger);
    (rise.abs() > LARGEST_RISE).then(|| {
        format!(
            "The temperatures of {} change by {rise:.0} K, which no machine has. Check the units: 1 W/m² is 0.001 mW/mm², \
             1 W/(m²·K) is 0.001 mW/(mm²·K), and 1 W/(m·K) is 1 mW/(mm·K).",
            load.name
        )
    })
}

fn remarks(placement: &Placement) -> Vec<String> {
    let mut remarks = Vec::new();
    let (rms, floor) = (placement.rms_um, placement.floor_um);
    remarks.push(if placement.blocks_limit {
        format!(
            "The blocks limit the result, not the places of the sensors. The residual error is {floor:.2} µm \
             RMS with the best temperature for every block, and {rms:.2} µm with these sensors."
        )
    } else {
        format!(
            "The places of the sensors limit the result, not the blocks. The residual error is {rms:.2} µm \
             RMS, and {floor:.2} µm with the best temperature for every block."
        )
    });
    if let Some((cut, after)) = &placement.best_cut {
        remarks.push(format!(
            "The best further cut is --cut {cut}. It lowers the smallest possible residual error of the \
             division from {floor:.2} to {after:.2} µm RMS."
        ));
    }
    if placement.noise_um > rms {
        remarks.push(format!(
            "Noise of {} K at every sensor causes {:.2} µm RMS, more than the residual error of the model: \
             readings must be averaged.",
            placement.noise_k, placement.noise_um
        ));
    }
    let left_out = placement.cases.iter().filter_map(|case| Some((case, case.left_out_rms_um?)));
    if let Some((case, left)) = left_out.max_by(|(_, one), (_, other)| one.total_cmp(other)) {
        remarks.push(format!(
            "A load that is in no case is predicted less well: with sensors placed without the case {}, its \
             residual error is {left:.2} µm RMS.",
            case.name
        ));
    }
    if placement.cases.len() == 1 {
        let only = "There is only one load case: the residual error under another load is not known.";
        remarks.push(only.to_owned());
    }
    remarks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temperatures_that_no_machine_has_are_named_with_the_units() {
        let of = |rise: &[f64]| {
            implausible(&Load { name: "spindle".to_owned(), rise: rise.to_vec(), moved_mm: Vec::new() })
        };
        for rise in [&[0.0, 12.5][..], &[-60.0, 0.0], &[240.0], &[]] {
            assert_eq!(of(rise), None, "{rise:?}");
        }
        let said = of(&[3.0, 94_000.0, 20.0]).unwrap();
        assert!(
            said.contains("The temperatures of spindle change by 94000 K") && said.contains("W/m²"),
            "{said}"
        );
        assert!(of(&[-1000.0, 20.0]).unwrap().contains("by -1000 K"));
    }
}
