//! Linear heat conduction: temperatures of all nodes in one load case.

use faer::Mat;
use rayon::prelude::*;

use crate::body::{Case, Film, Flux, LoadCase, Materials, Progress, SILENT};
use crate::element::{dot, face_points, for_each_element, for_each_point};
use crate::fe_input::FeInput;
use crate::graph::Graph;
use crate::mesh::{Face, Mesh, NodeId, count, parts};
use crate::system::{Factor, System};

/// Reason why a load case has no solution.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum HeatError {
    /// Part of the mesh without film and without prescribed temperature, in a steady case; contains one node of the
    /// part.
    #[error(
        "nothing determines the temperature of the part with node {0}. A steady case needs a film or a \
         prescribed temperature on every part of the mesh"
    )]
    Adrift(NodeId),
    /// A material has no heat capacity, which a transient case needs; contains the name of the material.
    #[error("material {0} has no density or no specific heat: a transient case needs both")]
    NoCapacity(String),
    /// The conduction matrix is singular, so the equations have no unique solution.
    #[error("the heat conduction has no solution: a conductivity or a film coefficient is not positive")]
    Singular,
}

/// Calculates the temperature rise of every node at the end of the load case, K, relative to its initial temperature.
///
/// # Errors
/// The load case has no solution.
pub fn temperatures(
    mesh: &Mesh,
    materials: &Materials,
    load: &LoadCase,
    progress: Progress<'_>,
) -> Result<Vec<f64>, HeatError> {
    reached(&Heat::of(mesh, materials, load)?, load, progress)
}

/// Calculates the temperature rises of several load cases, in parallel. If a load case has the same mesh, materials and
/// prescribed nodes as the first load case, it uses the conduction matrix of the first load case.
pub fn temperatures_of_each(inputs: &[FeInput]) -> Vec<Result<Vec<f64>, HeatError>> {
    let first = inputs.first().map(|first| (first, Conducts::of(&first.mesh, &first.materials, &first.load)));
    let one = |input: &FeInput| {
        let known = first.as_ref().filter(|(first, _)| {
            first.mesh.elements == input.mesh.elements
                && first.mesh.xyz == input.mesh.xyz
                && first.materials == input.materials
                && held(&first.mesh, &first.load) == held(&input.mesh, &input.load)
        });
        let FeInput { mesh, materials, load, .. } = input;
        let conducts = match known {
            Some((_, conducts)) => conducts.clone(),
            None => Conducts::of(mesh, materials, load),
        };
        reached(&Heat::assembled(mesh, materials, load, conducts)?, load, SILENT)
    };
    inputs.par_iter().map(one).collect()
}

/// Returns the temperature rises of all nodes at the end of the load case, K.
fn reached(heat: &Heat, load: &LoadCase, progress: Progress<'_>) -> Result<Vec<f64>, HeatError> {
    let reached = match load.case {
        Case::Steady => heat.steady()?,
        Case::Transient { step, period } => heat.transient(&load.initial, step, period, progress)?,
    };
    Ok(reached.iter().zip(&load.initial).map(|(reached, initial)| reached - initial).collect())
}

/// Returns for each node whether its temperature is prescribed.
fn held(mesh: &Mesh, load: &LoadCase) -> Vec<bool> {
    let mut held = vec![false; mesh.nodes.len()];
    load.held.iter().for_each(|(node, _)| held[*node] = true);
    held
}

/// Couplings between free nodes and nodes of prescribed temperature: number of the free node, index of the other node,
/// and conductance in mW/K.
type Coupling = Vec<(usize, usize, f64)>;

/// Conductances of a body by heat conduction alone (without films), mW/K.
#[derive(Clone)]
struct Conducts {
    system: System<1>,
    to_held: Coupling,
}

impl Conducts {
    fn of(mesh: &Mesh, materials: &Materials, load: &LoadCase) -> Self {
        let mut system = System::new(&Graph::of(mesh), &mesh.xyz, &held(mesh, load));
        let mut to_held = Coupling::new();
        for_each_element(mesh, |element, points| {
            let conductivity = materials.of(element).conductivity;
            let nodes = &mesh.elements[element].nodes;
            for (a, node) in nodes.iter().enumerate() {
                for (b, other) in nodes.iter().enumerate() {
                    let flows = points.iter().map(|at| at.volume * dot(at.gradient[a], at.gradient[b]));
                    add(&mut system, &mut to_held, *node, *other, conductivity * flows.sum::<f64>());
                }
            }
        });
        Self { system, to_held }
    }
}

/// Equations of heat conduction of a body: conductances, heat capacities, and heat sources.
pub(super) struct Heat {
    /// Conductances between the free nodes, from conduction and films, mW/K.
    pub(super) conduction: System<1>,
    /// Heat capacity matrix, mJ/K; `None` in a steady case.
    pub(super) capacity: Option<System<1>>,
    to_held: Coupling,
    /// Heat flow into each free node, mW.
    enters: Vec<f64>,
    /// Prescribed temperature of each node, °C; `None` for a free node.
    held: Vec<Option<f64>>,
}

impl Heat {
    pub(super) fn of(mesh: &Mesh, materials: &Materials, load: &LoadCase) -> Result<Self, HeatError> {
        Self::assembled(mesh, materials, load, Conducts::of(mesh, materials, load))
    }

    /// Assembles the equations of one load case from the conduction of a body.
    fn assembled(
        mesh: &Mesh,
        materials: &Materials,
        load: &LoadCase,
        conducts: Conducts,
    ) -> Result<Self, HeatError> {
        let mut held = vec![None; mesh.nodes.len()];
        load.held.iter().for_each(|(node, temperature)| held[*node] = Some(*temperature));
        if load.case == Case::Steady {
            anchored(mesh, load)?;
        }
        let Conducts { system: mut conduction, mut to_held } = conducts;
        let capacity = match load.case {
            Case::Steady => None,
            Case::Transient { .. } => Some(capacity(mesh, materials, conduction.zeroed())?),
        };
        let mut enters = vec![0.0; conduction.size()];
        for film in &load.films {
            for_each_face_point(mesh, film.face, |nodes, value, area| {
                for (a, node) in nodes.iter().enumerate() {
                    let weight = film.coefficient * area * value[a];
                    enter(&conduction, &mut enters, *node, weight * film.sink);
                    for (b, other) in nodes.iter().enumerate() {
                        add(&mut conduction, &mut to_held, *node, *other, weight * value[b]);
                    }
                }
            });
        }
        load.nodal.iter().for_each(|(node, heat)| enter(&conduction, &mut enters, *node, *heat));
        add_fluxes(mesh, &load.fluxes, &conduction, &mut enters);
        Ok(Self { conduction, capacity, to_held, enters, held })
    }

    fn steady(&self) -> Result<Vec<f64>, HeatError> {
        let factor = self.conduction.factor().ok_or(HeatError::Singular)?;
        Ok(self.solve(&factor, |_| 0.0))
    }

    fn transient(
        &self,
        initial: &[f64],
        step: f64,
        period: f64,
        progress: Progress<'_>,
    ) -> Result<Vec<f64>, HeatError> {
        let Some(capacity) = &self.capacity else { return Err(HeatError::Singular) };
        let mut reached = initial.to_vec();
        let mut steps = vec![step; whole_steps(period / step)];
        let rest = period - step * count(steps.len());
        if rest > 1e-9 * period {
            steps.push(rest);
        }
        let mut factored: Option<(f64, Factor<1>)> = None;
        for (done, length) in steps.iter().enumerate() {
            progress("heating", done, steps.len());
            let factor = match factored.take() {
                Some((of, factor)) if of.to_bits() == length.to_bits() => factor,
                _ => self.conduction.plus(1.0 / length, capacity).factor().ok_or(HeatError::Singular)?,
            };
            let brought = capacity.times(&reached);
            reached = self.solve(&factor, |row| brought[row] / length);
            factored = Some((*length, factor));
        }
        progress("heating", steps.len(), steps.len());
        Ok(reached)
    }

    /// Returns the temperatures of all nodes in the steady state or at the end of a time step, °C. `brought` returns
    /// the heat flow into each free node from the heat stored at the end of the previous step, mW. Nodes of prescribed
    /// temperature have this temperature from the start, and contribute no heat from their initial temperature.
    fn solve(&self, factor: &Factor<1>, brought: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut side = Mat::from_fn(self.enters.len(), 1, |row, _| self.enters[row] + brought(row));
        for (row, node, value) in &self.to_held {
            side[(*row, 0)] -= value * self.held[*node].unwrap_or_default();
        }
        factor.solve(side.as_mut());
        let each = factor.free().iter().zip(&self.held);
        each.map(|(free, held)| free.map_or(held.unwrap_or_default(), |number| side[(number, 0)])).collect()
    }
}

fn add(system: &mut System<1>, to_held: &mut Coupling, row: usize, column: usize, value: f64) {
    match (system.free(row), system.free(column)) {
        (Some(row), Some(column)) => system.add(row, column, &[[value]]),
        (Some(row), None) => to_held.push((row, column, value)),
        (None, _) => {}
    }
}

fn enter(system: &System<1>, enters: &mut [f64], node: usize, heat: f64) {
    if let Some(number) = system.free(node) {
        enters[number] += heat;
    }
}

/// Adds the heat flow of the fluxes into each free node, mW.
pub(super) fn add_fluxes(mesh: &Mesh, fluxes: &[Flux], system: &System<1>, enters: &mut [f64]) {
    let mut in_volume = vec![0.0; mesh.elements.len()];
    for flux in fluxes {
        match flux {
            Flux::Volume(element, heat) => in_volume[*element] += heat,
            Flux::Face(face, heat) => for_each_face_point(mesh, *face, |nodes, value, area| {
                for (place, node) in nodes.iter().enumerate() {
                    enter(system, enters, *node, heat * area * value[place]);
                }
            }),
        }
    }
    if in_volume.iter().all(|heat| heat.abs() <= 0.0) {
        return;
    }
    for_each_point(mesh, |element, point, count| {
        for (place, node) in mesh.elements[element].nodes.iter().enumerate().take(count) {
            enter(system, enters, *node, in_volume[element] * point.volume * point.value[place]);
        }
    });
}

/// Returns the heat capacity matrix, mJ/K. `system` is a matrix of zeros over the free nodes.
fn capacity(mesh: &Mesh, materials: &Materials, mut system: System<1>) -> Result<System<1>, HeatError> {
    let mut used = materials.of_element.iter().map(|place| &materials.list[*place]);
    if let Some(without) = used.find(|material| material.capacity.is_none()) {
        return Err(HeatError::NoCapacity(without.name.clone()));
    }
    for_each_element(mesh, |element, points| {
        let capacity = materials.of(element).capacity.unwrap_or_default();
        let nodes = &mesh.elements[element].nodes;
        for (a, node) in nodes.iter().enumerate() {
            for (b, other) in nodes.iter().enumerate() {
                let stored = points.iter().map(|at| at.volume * at.value[a] * at.value[b]);
                if let (Some(row), Some(column)) = (system.free(*node), system.free(*other)) {
                    system.add(row, column, &[[capacity * stored.sum::<f64>()]]);
                }
            }
        }
    });
    Ok(system)
}

/// Calls `visit` for each node of a film, with the conductance between the node and the fluid, mW/K.
pub(super) fn film_heat(mesh: &Mesh, film: &Film, mut visit: impl FnMut(usize, f64)) {
    for_each_face_point(mesh, film.face, |nodes, value, area| {
        for (node, value) in nodes.iter().zip(value) {
            visit(*node, film.coefficient * area * value);
        }
    });
}

fn for_each_face_point(mesh: &Mesh, face: Face, mut visit: impl FnMut(&[usize], &[f64; 10], f64)) {
    let nodes: Vec<usize> = mesh.face_nodes(face).collect();
    let xyz: Vec<[f64; 3]> = nodes.iter().map(|node| mesh.xyz[*node]).collect();
    for (value, area) in face_points(mesh.elements[face.element].kind, &xyz) {
        visit(&nodes, &value, area);
    }
}

/// Checks a steady load case: every part of the mesh must have a film or a prescribed temperature. Returns an error
/// otherwise.
fn anchored(mesh: &Mesh, load: &LoadCase) -> Result<(), HeatError> {
    let joints = mesh.elements.iter().flat_map(|each| each.nodes.iter().map(|node| (each.nodes[0], *node)));
    let part = parts(mesh.nodes.len(), joints);
    let mut anchored = vec![false; mesh.nodes.len()];
    for film in load.films.iter().filter(|film| film.coefficient > 0.0) {
        anchored[part[mesh.elements[film.face.element].nodes[0]]] = true;
    }
    load.held.iter().for_each(|(node, _)| anchored[part[*node]] = true);
    match part.iter().position(|part| !anchored[*part]) {
        Some(node) => Err(HeatError::Adrift(mesh.nodes[node])),
        None => Ok(()),
    }
}

/// Returns the number of whole steps in a period. `steps` is the period divided by the length of a step. This quotient
/// may be slightly too small by rounding.
fn whole_steps(steps: f64) -> usize {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the reader rejects too many steps"
    )]
    let whole = (steps * (1.0 + 1e-9)).floor() as usize;
    whole
}

#[cfg(test)]
mod tests;
