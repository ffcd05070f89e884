//! Reduction of a structure to modes, which a simulated machine (plant) uses instead of its finite elements. A mode is
//! a temperature field that decays at one rate.
//!
//! Heat enters through *ports* and films. A port is a patch of the surface with a heat flow in watts, which is
//! distributed like the fluxes of the patch. The temperature of a port is the mean over the patch, with the weights of
//! this distribution. Films connect the structure to *sinks* (such as the air), which have their own temperatures.
//!
//! K is the conduction with films, C the capacity, and F the inputs. The basis contains the uniform field, and (K +
//! s·C)⁻¹·F for some s. These fields describe the structure long after a change and soon after it (rational Krylov;
//! Grimme, Krylov projection methods for model reduction, 1997). The projection of K is symmetric like K, so that heat
//! flows equally well in both directions. If all sinks rise uniformly, the structure follows with the same uniform
//! rise.

use std::collections::BTreeMap;

use faer::Mat;
use nalgebra::{DMatrix, SymmetricEigen};
use serde::Serialize;

use crate::body::{Case, Flux, LoadCase, Progress};
use crate::fe_input::FeInput;
use crate::guide_line::GuideLine;
use crate::heat::{Heat, HeatError, add_fluxes, film_heat};
use crate::mesh::AXES;
use crate::structure::Adjoint;
use crate::system::System;

#[cfg(test)]
mod tests;

/// Periods T, s. The basis contains the fields (K + C/T)⁻¹·F for each period, in addition to the fields of the steady
/// state.
const PERIODS: [f64; 5] = [14_400.0, 3_600.0, 900.0, 180.0, 40.0];

/// Relative norm below which the new part of a vector is not added to the basis.
const NEW: f64 = 1e-7;

/// Reason why modes cannot be calculated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReducedError {
    /// Prescribed temperatures, or heat at single nodes; contains the card, for example `*CFLUX`.
    #[error(
        "{0} is not allowed in the plant of a virtual machine: heat may enter only through *DFLUX and *FILM"
    )]
    OtherHeat(&'static str),
    /// One name for a film and for a flux; contains the name.
    #[error("`{0}` is both a film and a flux: use a surface with another name for one of them")]
    Twice(String),
    /// The fluxes of a port are zero, or cancel each other.
    #[error(
        "`{0}`: the sum of its fluxes is zero. Write a number above 0 in each *DFLUX; only the ratios of these numbers matter"
    )]
    NoHeat(String),
    /// The heat conduction has no solution.
    #[error(transparent)]
    Heat(#[from] HeatError),
}

/// Modes of a structure, normalized by the heat capacity. The unit of an amplitude is therefore √(J·K).
#[derive(Debug, Clone, PartialEq)]
pub struct Modes {
    /// Decay rate of each mode, 1/s, ascending. The reciprocal is its time constant.
    pub rates: Vec<f64>,
    /// Amplitude of each mode if the whole structure is 1 K warmer.
    pub uniform: Vec<f64>,
    /// For each port, one number for each mode: the temperature of the port if the mode has the amplitude 1,
    /// K. The same number is the excitation of the mode by a heat flow of 1 W into the port.
    pub ports: BTreeMap<String, Vec<f64>>,
    /// For each sink, the excitation of each mode if the sink is 1 K warmer. The sum of these numbers times `uniform`
    /// is film coefficient times area, W/K.
    pub sinks: BTreeMap<String, Vec<f64>>,
    /// For each mode, the temperature of every node if the mode has the amplitude 1, K.
    pub shapes: Vec<Vec<f64>>,
}

impl Modes {
    /// Calculates the modes of a structure for a simulated plant. The films of `plant` are sinks and its fluxes are
    /// ports, by the names of their surfaces.
    ///
    /// # Errors
    /// Heat enters in another way than by films and fluxes, or cannot leave the structure.
    pub fn of(plant: &FeInput, progress: Progress<'_>) -> Result<Modes, ReducedError> {
        let load = &plant.load;
        if !load.held.is_empty() {
            return Err(ReducedError::OtherHeat("*BOUNDARY"));
        }
        if !load.nodal.is_empty() {
            return Err(ReducedError::OtherHeat("*CFLUX"));
        }
        // Any transient case is suitable, because only the capacity is needed.
        let load = LoadCase { case: Case::Transient { step: 1.0, period: 1.0 }, ..load.clone() };
        let heat = Heat::of(&plant.mesh, &plant.materials, &load)?;
        let capacity = heat.capacity.as_ref().ok_or(HeatError::Singular)?;
        let inputs = Inputs::of(plant, &heat.conduction)?;
        let uniform = vec![1.0; plant.mesh.nodes.len()];
        let mut basis = Basis { capacity, vectors: Vec::new() };
        basis.add(uniform.clone());
        let all = PERIODS.len() + 1;
        for (done, shift) in std::iter::once(0.0).chain(PERIODS.map(|period| 1.0 / period)).enumerate() {
            progress("modes", done, all);
            for vector in inputs.answers(&heat.conduction, capacity, shift)? {
                basis.add(vector);
            }
        }
        progress("modes", all, all);
        Ok(basis.modes(&heat.conduction, &uniform, inputs))
    }

    /// Returns the modes file for a simulated plant: JSON with one row of numbers per line. It contains the
    /// temperatures of `points` (names and nodes), and the displacement along the guideway.
    #[must_use]
    pub fn to_json(&self, points: &[(String, usize)], adjoint: &Adjoint, line: &GuideLine) -> String {
        let at = |node: usize| short(self.shapes.iter().map(|shape| shape[node]));
        let all = |group: &BTreeMap<String, Vec<f64>>| -> BTreeMap<String, Vec<f64>> {
            group.iter().map(|(name, values)| (name.clone(), short(values.iter().copied()))).collect()
        };
        let moved: Vec<Vec<f64>> = self.shapes.iter().map(|shape| adjoint.displacements(shape)).collect();
        let moves = |component: usize| -> Vec<Vec<f64>> {
            let columns: Vec<Vec<f64>> = moved.iter().map(|moved| line.mean(moved, component)).collect();
            let row = |point: usize| short(columns.iter().map(|column| 1000.0 * column[point]));
            (0..line.guide_mm.len()).map(row).collect()
        };
        let file = File {
            format: "isotherm-modes",
            version: 1,
            rate_per_s: short(self.rates.iter().copied()),
            uniform: short(self.uniform.iter().copied()),
            ports: all(&self.ports),
            sinks: all(&self.sinks),
            points: points.iter().map(|(name, node)| (&name[..], at(*node))).collect(),
            guide_mm: &line.guide_mm,
            moves_um: (0..3).map(|component| (AXES[component], moves(component))).collect(),
        };
        // Serialization cannot fail, because there are only numbers and names.
        let text = serde_json::to_string(&file).unwrap_or_default();
        text.replace("],", "],\n").replace("},", "},\n").replace("{\"", "{\n\"") + "\n"
    }
}

#[derive(Serialize)]
struct File<'a> {
    format: &'a str,
    version: u32,
    rate_per_s: Vec<f64>,
    uniform: Vec<f64>,
    ports: BTreeMap<String, Vec<f64>>,
    sinks: BTreeMap<String, Vec<f64>>,
    points: BTreeMap<&'a str, Vec<f64>>,
    guide_mm: &'a [f64],
    moves_um: BTreeMap<&'a str, Vec<Vec<f64>>>,
}

/// Rounds numbers to seven digits. For a temperature in °C, the last digit is then 0.00001 K.
fn short(values: impl Iterator<Item = f64>) -> Vec<f64> {
    values.map(|value| format!("{value:.6e}").parse().unwrap_or(value)).collect()
}

/// Right-hand sides of the heat equation: heat flows into each node. They are in mW for 1 W into a port, and in mW/K
/// for 1 K at a sink.
struct Inputs {
    ports: BTreeMap<String, Vec<f64>>,
    sinks: BTreeMap<String, Vec<f64>>,
}

impl Inputs {
    fn of(plant: &FeInput, system: &System<1>) -> Result<Inputs, ReducedError> {
        let (mesh, load) = (&plant.mesh, &plant.load);
        let mut sinks: BTreeMap<String, Vec<f64>> = BTreeMap::new();
        for (film, name) in load.films.iter().zip(&plant.surfaces.films) {
            let sink = sinks.entry(name.clone()).or_insert_with(|| vec![0.0; mesh.nodes.len()]);
            film_heat(mesh, film, |node, heat| sink[node] += heat);
        }
        let mut fluxes: BTreeMap<String, Vec<Flux>> = BTreeMap::new();
        for (flux, name) in load.fluxes.iter().zip(&plant.surfaces.fluxes) {
            fluxes.entry(name.clone()).or_default().push(*flux);
        }
        if let Some(name) = fluxes.keys().find(|name| sinks.contains_key(*name)) {
            return Err(ReducedError::Twice(name.clone()));
        }
        let port = |(name, fluxes): (String, Vec<Flux>)| {
            let mut heat = vec![0.0; mesh.nodes.len()];
            add_fluxes(mesh, &fluxes, system, &mut heat);
            let all: f64 = heat.iter().sum();
            let passing: f64 = heat.iter().map(|heat| heat.abs()).sum();
            if all.abs() <= NEW * passing {
                return Err(ReducedError::NoHeat(name));
            }
            // Weights of a port in mW for an input of one watt.
            Ok((name, heat.iter().map(|heat| 1000.0 * heat / all).collect()))
        };
        Ok(Inputs { ports: fluxes.into_iter().map(port).collect::<Result<_, _>>()?, sinks })
    }

    /// Solves (K + shift·C)·x = F for each right-hand side F. K is the conduction, C the heat capacity.
    fn answers(
        &self,
        conduction: &System<1>,
        capacity: &System<1>,
        shift: f64,
    ) -> Result<Vec<Vec<f64>>, HeatError> {
        let factor = conduction.plus(shift, capacity).factor().ok_or(HeatError::Singular)?;
        let inputs: Vec<&Vec<f64>> = self.ports.values().chain(self.sinks.values()).collect();
        let mut sides = Mat::from_fn(factor.rows(), inputs.len(), |row, input| inputs[input][row]);
        factor.solve(sides.as_mut());
        Ok((0..inputs.len()).map(|input| sides.col(input).iter().copied().collect()).collect())
    }
}

/// Basis of temperature fields that are orthonormal with respect to the heat capacity C, mJ/K.
struct Basis<'a> {
    capacity: &'a System<1>,
    vectors: Vec<Vec<f64>>,
}

/// Converts mJ to J, because the energy of modes is in J.
const MILLI: f64 = 1e-3;

impl Basis<'_> {
    /// Adds the part of a field that the basis does not contain.
    fn add(&mut self, mut field: Vec<f64>) {
        let norm = |field: &[f64]| (MILLI * dot(field, &self.capacity.times(field))).max(0.0).sqrt();
        let before = norm(&field);
        // Two passes of orthogonalization are sufficient.
        for _ in 0..2 {
            let stored = self.capacity.times(&field);
            let shares: Vec<f64> = self.vectors.iter().map(|vector| MILLI * dot(vector, &stored)).collect();
            for (vector, share) in self.vectors.iter().zip(shares) {
                field.iter_mut().zip(vector).for_each(|(field, value)| *field -= share * value);
            }
        }
        let left = norm(&field);
        if left > NEW * before {
            field.iter_mut().for_each(|value| *value /= left);
            self.vectors.push(field);
        }
    }

    fn modes(self, conduction: &System<1>, uniform: &[f64], inputs: Inputs) -> Modes {
        let count = self.vectors.len();
        let conducted: Vec<Vec<f64>> = self.vectors.iter().map(|vector| conduction.times(vector)).collect();
        let product = |a: usize, b: usize| MILLI * dot(&self.vectors[a], &conducted[b]);
        let projected = DMatrix::from_fn(count, count, |a, b| 0.5 * (product(a, b) + product(b, a)));
        let eigen = SymmetricEigen::new(projected);
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|one, other| eigen.eigenvalues[*one].total_cmp(&eigen.eigenvalues[*other]));
        let shape = |place: &usize| {
            let mut shape = vec![0.0; uniform.len()];
            for (vector, share) in self.vectors.iter().zip(eigen.eigenvectors.column(*place).iter()) {
                shape.iter_mut().zip(vector).for_each(|(shape, value)| *shape += share * value);
            }
            // The choice of the sign is the same on every computer.
            let most = inputs.ports.values().map(|port| dot(port, &shape));
            let most = most.fold(0.0, |most: f64, at| if at.abs() > most.abs() { at } else { most });
            if most < 0.0 { shape.iter().map(|value| -value).collect() } else { shape }
        };
        let shapes: Vec<Vec<f64>> = order.iter().map(shape).collect();
        let along =
            |field: &[f64]| shapes.iter().map(|shape| MILLI * dot(shape, field)).collect::<Vec<f64>>();
        Modes {
            rates: order.iter().map(|place| eigen.eigenvalues[*place]).collect(),
            uniform: along(&self.capacity.times(uniform)),
            ports: inputs.ports.iter().map(|(name, field)| (name.clone(), along(field))).collect(),
            sinks: inputs.sinks.iter().map(|(name, field)| (name.clone(), along(field))).collect(),
            shapes,
        }
    }
}

fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}
