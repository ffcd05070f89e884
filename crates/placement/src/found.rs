//! What was found: sensors, and what they leave of each load case.
//!
//! Four errors, each the RMS over the guideway of what block temperatures tell minus δ1, µm: *naive* (a node at the
//! block's centre, or the mean of its nodes), *optimised* (the temperatures θg a method asks for), *read back* (those
//! its sensors really have), and the *floor* (the best temperatures blocks can have: no sensor of theirs does better).

use serde::Serialize;

use crate::blocks::{AXES, Part, Reach, blocks};
use crate::body::Progress;
use crate::mesh::Mesh;
use crate::methods::bounded::bounded;
use crate::methods::multi_case::{Effort, Tolerated, multi_case, noise_um};
use crate::methods::patent::{Round, patent};
use crate::methods::{Method, central, nearest};
use crate::problem::{Block, Load, Problem, count};
use crate::structure::Adjoint;

mod divisions;
mod misplaced;

use divisions::other_divisions;

/// What is asked.
#[derive(Clone, Debug)]
pub struct Asked {
    /// Directions in which errors are judged, together: 0 x, 1 y, 2 z.
    pub components: Vec<usize>,
    /// By which method.
    pub method: Method,
    /// The case that `patent` and `bounded` are placed by; none: the one that moves the guideway most.
    pub case: Option<usize>,
    /// A sensor's noise, K.
    pub noise: f64,
    /// How far a sensor may sit from its place, mm.
    pub misplaced: f64,
    /// Below this `patent` looks no further, µm RMS.
    pub enough: f64,
}

impl Asked {
    fn tolerated(&self) -> Tolerated {
        Tolerated { noise: self.noise, enough: self.enough }
    }
}

/// A structure under its load cases.
#[derive(Clone, Copy, Debug)]
pub struct Study<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Places of the guideway's nodes.
    pub guide: &'a [usize],
    /// P: rows 3·guide + component, one column per part, mm/K.
    pub p: &'a [Vec<f64>],
    /// How the guideway follows every node; without it nothing is said of other divisions.
    pub adjoint: Option<&'a Adjoint>,
    /// The blocks' nodes.
    pub parts: &'a [Part],
    /// Where sensors may sit.
    pub reach: &'a Reach,
    /// The load cases, at least one.
    pub loads: &'a [Load],
}

/// A sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sensor {
    /// Number of its node in the deck.
    pub node: u32,
    /// Where, mm.
    pub xyz: [f64; 3],
    /// The block whose temperature it tells.
    pub block: String,
}

impl Sensor {
    fn at(mesh: &Mesh, node: usize, block: &Block) -> Sensor {
        Sensor { node: mesh.nodes[node].0, xyz: mesh.xyz[node], block: block.name.clone() }
    }
}

/// An error along the guideway, µm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Error {
    /// Root mean square.
    pub rms_um: f64,
    /// Largest, without its sign.
    pub max_um: f64,
}

/// A method on one case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Placed {
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
pub struct CaseFound {
    /// Its name.
    #[serde(skip)]
    pub name: String,
    /// δ1, mm, rows 3·guide + component.
    pub delta1_mm: Vec<f64>,
    /// The largest δ1 in a judged direction, µm.
    pub largest_um: f64,
    /// A node at each block's centre.
    pub naive_centroid: Error,
    /// The mean of each block's nodes.
    pub naive_mean: Error,
    /// The best that the blocks can tell.
    pub floor: Error,
    /// The patent's iteration on this case.
    pub patent: Placed,
    /// Bounded least squares on this case.
    pub bounded: Placed,
    /// Nodes for all cases together.
    #[serde(rename = "multi-case")]
    pub multi_case: Placed,
    /// Nodes for all the other cases together, on this one, µm RMS; none where there is only one case.
    pub left_out_rms_um: Option<f64>,
    /// What misplaced sensors of the chosen method add, µm RMS.
    pub misplaced_um: f64,
    /// Displacement that nodes at the blocks' centres tell, mm, rows 3·guide + component.
    #[serde(skip)]
    pub naive_mm: Vec<f64>,
    /// Displacement that the chosen sensors tell, mm, rows 3·guide + component.
    #[serde(skip)]
    pub read_mm: Vec<f64>,
}

/// Sensors of a method on one case, judged on all.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Crossed {
    /// The method.
    pub method: Method,
    /// The case it was placed by; none: by all.
    pub placed_by: Option<String>,
    /// µm RMS on each case, in their order.
    pub rms_um: Vec<f64>,
}

/// So many sensors, one per block, after the best joins and cuts.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Numbered {
    /// Sensors.
    pub sensors: usize,
    /// The best the blocks can tell, µm RMS over all cases.
    pub floor_um: f64,
    /// Read back by `multi-case`, µm RMS over all cases.
    pub rms_um: f64,
    /// The cut that made it; none for fewer sensors than blocks.
    pub cut: Option<String>,
}

/// Everything.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Rows 3·guide + component, columns blocks, mm/K.
    #[serde(rename = "P")]
    pub p: Vec<Vec<f64>>,
    /// Names of the blocks.
    pub blocks: Vec<String>,
    /// Numbers of the guideway's nodes in the deck.
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
    /// The nodes at the blocks' centres, which `naive_centroid` is told by.
    pub centres: Vec<Sensor>,
    /// The cases.
    #[serde(serialize_with = "by_name")]
    pub cases: Vec<CaseFound>,
    /// Each placement on every case.
    pub cross_case: Vec<Crossed>,
    /// The sensors' noise, K, and what it does, µm RMS.
    pub noise_k: f64,
    /// See there.
    pub noise_um: f64,
    /// How far sensors may be misplaced, mm.
    pub misplaced_mm: f64,
    /// Over all cases: what the blocks can tell at best, µm RMS.
    pub floor_um: f64,
    /// Over all cases: what the chosen sensors leave, µm RMS.
    pub rms_um: f64,
    /// Whether the division into blocks limits, and not where the sensors sit.
    pub blocks_limit: bool,
    /// The cut that helps most, as `--cut` takes it, and the floor after it, µm RMS over all cases.
    pub best_cut: Option<(String, f64)>,
    /// Error against number of sensors; empty without the guideway's sensitivity to every node.
    pub by_number: Vec<Numbered>,
}

fn by_name<S: serde::Serializer>(cases: &[CaseFound], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(cases.iter().map(|case| (&case.name, case)))
}

/// More than this share of the error is the blocks' own: they limit.
const LIMITS: f64 = 0.7;

/// Places the sensors.
///
/// # Errors
/// A block without a place for a sensor.
pub fn place(study: &Study<'_>, asked: &Asked, progress: Progress<'_>) -> Result<Found, Vec<String>> {
    let blocks = blocks(study.mesh, study.parts, study.reach)?;
    let problem = Problem::new(blocks, study.p, study.loads, &asked.components);
    let all: Vec<usize> = (0..problem.aims.len()).collect();
    progress("sensors", 0, all.len() + 2);
    let together = multi_case(&problem, &all, asked.tolerated(), Effort::FULL);
    progress("sensors", 1, all.len() + 2);
    let central = central(&problem, &study.mesh.xyz);
    let mut cross = Vec::new();
    let mut cases = Vec::new();
    for (case, aim) in problem.aims.iter().enumerate() {
        let error = |theta: &[f64]| Error {
            rms_um: problem.rms(aim, theta),
            max_um: largest(&problem.left(aim, theta)),
        };
        let placed = |places: &[usize], theta: Option<Vec<f64>>, rounds: Vec<Round>| {
            let read = error(&problem.read(aim, places));
            Placed {
                rms_um: read.rms_um,
                max_um: read.max_um,
                optimised_rms_um: theta.as_ref().map_or(read.rms_um, |theta| problem.rms(aim, theta)),
                sensors: sensors(study.mesh, &problem, places),
                theta_k: theta.unwrap_or_default(),
                rounds,
            }
        };
        let naive: Vec<f64> = central.iter().map(|node| study.loads[case].rise[*node]).collect();
        let floor = bounded(&problem, aim);
        let iterated = patent(&problem, aim, asked.enough);
        let (by_patent, by_bounded) = (nearest(aim, &iterated.theta), nearest(aim, &floor));
        let others: Vec<usize> = all.iter().copied().filter(|other| *other != case).collect();
        let left_out = (!others.is_empty())
            .then(|| problem.rms_of(aim, &multi_case(&problem, &others, asked.tolerated(), Effort::SHORT)));
        cases.push(CaseFound {
            name: aim.name.clone(),
            delta1_mm: study.loads[case].moved_mm.clone(),
            largest_um: largest(aim.moved.as_slice()),
            naive_centroid: error(&naive),
            naive_mean: error(&aim.mean),
            floor: error(&floor),
            patent: placed(&by_patent, Some(iterated.theta), iterated.rounds),
            bounded: placed(&by_bounded, Some(floor), Vec::new()),
            multi_case: placed(&together, None, Vec::new()),
            left_out_rms_um: left_out,
            misplaced_um: 0.0,
            naive_mm: told(study.p, &naive),
            read_mm: Vec::new(),
        });
        cross.push((Method::Patent, Some(case), by_patent));
        cross.push((Method::Bounded, Some(case), by_bounded));
        progress("sensors", case + 2, all.len() + 2);
    }
    cross.push((Method::MultiCase, None, together));
    let by = (asked.method != Method::MultiCase).then(|| asked.case.unwrap_or_else(|| moves_most(&cases)));
    let chosen = cross.iter().find(|(method, case, _)| *method == asked.method && *case == by);
    let chosen = chosen.map(|(_, _, places)| places.clone()).unwrap_or_default();
    for (case, found) in cases.iter_mut().enumerate() {
        found.read_mm = told(study.p, &problem.read(&problem.aims[case], &chosen));
        found.misplaced_um = misplaced::added(study, &problem, &chosen, case, asked.misplaced);
    }
    let rms: Vec<f64> = problem.aims.iter().map(|aim| problem.rms_of(aim, &chosen)).collect();
    let floors: Vec<f64> = cases.iter().map(|case| case.floor.rms_um).collect();
    let (rms_um, floor_um) = (together_rms(&rms), together_rms(&floors));
    let (best_cut, by_number) = other_divisions(study, asked, &problem, &rms_um, progress);
    progress("sensors", all.len() + 2, all.len() + 2);
    let name = |case: &usize| cases[*case].name.clone();
    Ok(Found {
        p: study.p.to_vec(),
        blocks: problem.blocks.iter().map(|block| block.name.clone()).collect(),
        guide_nodes: study.guide.iter().map(|node| study.mesh.nodes[*node].0).collect(),
        axes: asked.components.clone(),
        component: asked.components.iter().map(|axis| AXES[*axis]).collect::<Vec<_>>().join(", "),
        method: asked.method,
        placed_by: by.as_ref().map(name),
        sensors: sensors(study.mesh, &problem, &chosen),
        centres: central
            .iter()
            .zip(&problem.blocks)
            .map(|(node, block)| Sensor::at(study.mesh, *node, block))
            .collect(),
        cross_case: cross
            .iter()
            .map(|(method, case, places)| Crossed {
                method: *method,
                placed_by: case.as_ref().map(name),
                rms_um: problem.aims.iter().map(|aim| problem.rms_of(aim, places)).collect(),
            })
            .collect(),
        noise_k: asked.noise,
        noise_um: noise_um(&problem, asked.noise),
        misplaced_mm: asked.misplaced,
        blocks_limit: floor_um > LIMITS * rms_um,
        floor_um,
        rms_um,
        best_cut,
        by_number,
        cases,
    })
}

/// Rows of a matrix given by its columns.
#[must_use]
pub fn rows(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let height = columns.first().map_or(0, Vec::len);
    (0..height).map(|row| columns.iter().map(|column| column[row]).collect()).collect()
}

fn sensors(mesh: &Mesh, problem: &Problem, places: &[usize]) -> Vec<Sensor> {
    let one = |(block, place): (&Block, &usize)| Sensor::at(mesh, block.candidates[*place], block);
    problem.blocks.iter().zip(places).map(one).collect()
}

/// Displacement of the guideway that block temperatures tell, in all directions.
fn told(p: &[Vec<f64>], theta: &[f64]) -> Vec<f64> {
    p.iter().map(|row| row.iter().zip(theta).map(|(each, theta)| each * theta).sum()).collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| value.abs().max(largest))
}

fn together_rms(each: &[f64]) -> f64 {
    (each.iter().map(|rms| rms.powi(2)).sum::<f64>() / count(each.len().max(1))).sqrt()
}

fn moves_most(cases: &[CaseFound]) -> usize {
    (0..cases.len())
        .max_by(|one, other| cases[*one].largest_um.total_cmp(&cases[*other].largest_um))
        .unwrap_or(0)
}
