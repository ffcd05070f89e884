//! A structure under its load cases, and where its sensors belong: what they leave of each case.
//!
//! Four errors, each the RMS over the guideway of P·θ of block temperatures θ minus δ1, µm: *naive* (a node at the
//! block's centre, or the mean of its nodes), *optimised* (the temperatures θg a method asks for), *read back* (those
//! its sensors really have), and the *floor* (the best temperatures blocks can have: no sensor of theirs does better).

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use crate::blocks::{Part, Reach, blocks};
use crate::body::Progress;
use crate::each::listening;
use crate::mesh::{AXES, Mesh, count};
use crate::methods::multi_case::{Effort, Tolerance, multi_case, noise_um};
use crate::methods::patent::Round;
use crate::methods::{Method, central, nearest};
use crate::problem::{Block, Load, Problem};
use crate::structure::Adjoint;

mod misplaced;
mod on_one_case;
mod sensor_counts;

use on_one_case::OnOneCase;
use sensor_counts::{other_divisions, other_divisions_at_most};

/// By what sensors are placed and judged.
#[derive(Clone, Debug)]
pub struct Criteria {
    /// Directions in which errors are judged, together: 0 x, 1 y, 2 z.
    pub components: Vec<usize>,
    /// By which method.
    pub method: Method,
    /// The case that `patent` and `bounded` are placed by; none: the one that moves the guideway most.
    pub case: Option<usize>,
    /// What is as good as nothing.
    pub tolerance: Tolerance,
    /// How far a sensor may sit from its place, mm.
    pub misplaced: f64,
}

/// A structure under its load cases.
#[derive(Clone, Debug)]
pub struct Study {
    /// The mesh.
    pub mesh: Mesh,
    /// Places of the guideway's nodes.
    pub guide: Vec<usize>,
    /// P: rows 3·guide + component, one column per part, mm/K.
    pub p: Vec<Vec<f64>>,
    /// How the guideway follows every node; without it nothing is said of other divisions.
    pub adjoint: Option<Adjoint>,
    /// The blocks' nodes.
    pub parts: Vec<Part>,
    /// Where sensors may sit.
    pub reach: Reach,
    /// The load cases, at least one.
    pub loads: Vec<Load>,
}

impl Study {
    /// Coordinates of the guideway's nodes, mm.
    #[must_use]
    pub fn guide_xyz(&self) -> Vec<[f64; 3]> {
        self.guide.iter().map(|node| self.mesh.xyz[*node]).collect()
    }
}

/// A sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensor {
    /// Number of its node in the FE input file.
    pub node: u32,
    /// Where, mm.
    pub xyz: [f64; 3],
    /// The block whose temperature it measures.
    pub block: String,
}

impl Sensor {
    fn at(mesh: &Mesh, node: usize, block: &Block) -> Sensor {
        Sensor { node: mesh.nodes[node].0, xyz: mesh.xyz[node], block: block.name.clone() }
    }
}

/// An error along the guideway, µm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Residual {
    /// Root mean square.
    pub rms_um: f64,
    /// Largest, without its sign.
    pub max_um: f64,
}

/// A method on one case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodResult {
    /// Read back, root mean square.
    pub rms_um: f64,
    /// Read back, largest.
    pub max_um: f64,
    /// With the block temperatures asked for; the same as read back where a method asks for nodes directly.
    pub optimised_rms_um: f64,
    /// The sensors.
    pub sensors: Vec<Sensor>,
    /// θg, rises in K, where the method asks for temperatures.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub theta_k: Vec<f64>,
    /// The rounds of the iteration, where it has some.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rounds: Vec<Round>,
}

/// One load case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseResult {
    /// Its name.
    #[serde(skip)]
    pub name: String,
    /// δ1, mm, rows 3·guide + component.
    pub delta1_mm: Vec<f64>,
    /// The largest δ1 in a judged direction, µm.
    pub largest_um: f64,
    /// A node at each block's centre.
    pub naive_centroid: Residual,
    /// The mean of each block's nodes.
    pub naive_mean: Residual,
    /// The least that the blocks can leave.
    pub floor: Residual,
    /// The patent's iteration on this case.
    pub patent: MethodResult,
    /// Bounded least squares on this case.
    pub bounded: MethodResult,
    /// Nodes for all cases together.
    #[serde(rename = "multi-case")]
    pub multi_case: MethodResult,
    /// Nodes for all the other cases together, on this one, µm RMS; none where there is only one case.
    pub left_out_rms_um: Option<f64>,
    /// What misplaced sensors of the chosen method add, µm RMS.
    pub misplaced_um: f64,
    /// Displacement by nodes at the blocks' centres, mm, rows 3·guide + component.
    #[serde(skip)]
    pub naive_mm: Vec<f64>,
    /// Displacement by the chosen sensors, mm, rows 3·guide + component.
    #[serde(skip)]
    pub read_mm: Vec<f64>,
}

/// Sensors of a method on one case, judged on all.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CrossCase {
    /// The method.
    pub method: Method,
    /// The case it was placed by; none: by all.
    pub placed_by: Option<String>,
    /// µm RMS on each case, in their order.
    pub rms_um: Vec<f64>,
}

/// So many sensors, one per block, after the best joins and cuts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorCount {
    /// Sensors.
    pub sensors: usize,
    /// The least the blocks can leave, µm RMS over all cases.
    pub floor_um: f64,
    /// Read back by `multi-case`, µm RMS over all cases.
    pub rms_um: f64,
    /// The cut that made it; none for fewer sensors than blocks.
    pub cut: Option<String>,
}

/// Where the sensors belong, and what they leave.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Placement {
    /// Rows 3·guide + component, columns blocks, mm/K.
    #[serde(rename = "P")]
    pub p: Vec<Vec<f64>>,
    /// Names of the blocks.
    pub blocks: Vec<String>,
    /// Numbers of the guideway's nodes in the FE input file.
    pub guide_nodes: Vec<u32>,
    /// The directions that are judged: 0 x, 1 y, 2 z.
    #[serde(skip)]
    pub axes: Vec<usize>,
    /// Their names: `z`, `y, z`.
    pub component: String,
    /// The chosen method.
    pub method: Method,
    /// The case it was placed by; none: by all.
    pub placed_by: Option<String>,
    /// Its sensors.
    pub sensors: Vec<Sensor>,
    /// The nodes at the blocks' centres, which `naive_centroid` goes by.
    pub centres: Vec<Sensor>,
    /// The cases.
    #[serde(serialize_with = "by_name")]
    pub cases: Vec<CaseResult>,
    /// Each placement on every case.
    pub cross_case: Vec<CrossCase>,
    /// The sensors' noise, K.
    pub noise_k: f64,
    /// What it does to the guideway, µm RMS.
    pub noise_um: f64,
    /// How far sensors may be misplaced, mm.
    pub misplaced_mm: f64,
    /// Over all cases: what the blocks leave at best, µm RMS.
    pub floor_um: f64,
    /// Over all cases: what the chosen sensors leave, µm RMS.
    pub rms_um: f64,
    /// Whether the division into blocks limits, and not where the sensors sit.
    pub blocks_limit: bool,
    /// The cut that helps most, as `--cut` takes it, and the floor after it, µm RMS over all cases.
    pub best_cut: Option<(String, f64)>,
    /// Error against number of sensors; empty without the guideway's sensitivity to every node.
    pub by_number: Vec<SensorCount>,
    /// Coordinates of the guideway's nodes, mm.
    pub guide_xyz: Vec<[f64; 3]>,
    /// What a reader must know, in sentences.
    pub remarks: Vec<String>,
}

fn by_name<S: serde::Serializer>(cases: &[CaseResult], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(cases.iter().map(|case| (&case.name, case)))
}

/// More than this share of the error is the blocks' own: they limit.
const LIMITS: f64 = 0.7;

/// Places the sensors.
///
/// # Errors
/// Blocks without a place for a sensor.
pub fn place(study: &Study, criteria: &Criteria, progress: Progress<'_>) -> Result<Placement, Vec<String>> {
    let Study { mesh, p, loads, .. } = study;
    let Criteria { components, method, tolerance, .. } = criteria;
    let blocks = blocks(mesh, &study.parts, &study.reach)?;
    let problem = Problem::new(blocks, p, loads, components);
    let all: Vec<usize> = (0..problem.targets.len()).collect();
    // None of them needs another one's answer.
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
    Ok(placement)
}

/// Rows of a matrix given by its columns.
#[must_use]
pub fn rows(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let height = columns.first().map_or(0, Vec::len);
    (0..height).map(|row| columns.iter().map(|column| column[row]).collect()).collect()
}

/// P·θ, the displacement of the guideway by block temperatures, in all directions.
fn evaluate(p: &[Vec<f64>], theta: &[f64]) -> Vec<f64> {
    p.iter().map(|row| row.iter().zip(theta).map(|(each, theta)| each * theta).sum()).collect()
}

/// The root of the mean of the squares.
pub(super) fn root_mean_square(each: &[f64]) -> f64 {
    (each.iter().map(|rms| rms.powi(2)).sum::<f64>() / count(each.len().max(1))).sqrt()
}

/// The case that moves the guideway most.
pub(super) fn moves_most(cases: &[CaseResult]) -> usize {
    let largest = |place: &usize| cases[*place].largest_um;
    (0..cases.len()).max_by(|one, other| largest(one).total_cmp(&largest(other))).unwrap_or(0)
}

fn remarks(placement: &Placement) -> Vec<String> {
    let mut remarks = Vec::new();
    let (rms, floor) = (placement.rms_um, placement.floor_um);
    remarks.push(if placement.blocks_limit {
        format!(
            "The division into blocks limits, not where the sensors sit: with the best temperature for every block {floor:.2} µm \
             RMS would be left, with these sensors {rms:.2}."
        )
    } else {
        format!(
            "Where the sensors sit limits, not the division into blocks: {rms:.2} µm RMS are left, and the blocks could tell \
             all but {floor:.2}."
        )
    });
    if let Some((cut, after)) = &placement.best_cut {
        remarks.push(format!(
            "The cut that helps most: --cut {cut} lowers what the blocks leave at best from {floor:.2} to {after:.2} µm RMS."
        ));
    }
    if placement.noise_um > rms {
        remarks.push(format!(
            "Noise of {} K at every sensor alone is {:.2} µm RMS, more than the model leaves: readings must be averaged.",
            placement.noise_k, placement.noise_um
        ));
    }
    let left_out = placement.cases.iter().filter_map(|case| Some((case, case.left_out_rms_um?)));
    if let Some((case, left)) = left_out.max_by(|(_, one), (_, other)| one.total_cmp(other)) {
        remarks.push(format!(
            "A load that no case knows is predicted worse: placed without the case {}, the sensors leave {left:.2} µm RMS of it.",
            case.name
        ));
    }
    if placement.cases.len() == 1 {
        let only = "There is one load case only: what the sensors leave under another load is not known.";
        remarks.push(only.to_owned());
    }
    remarks
}
