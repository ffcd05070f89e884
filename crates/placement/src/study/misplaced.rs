//! Effect of sensors that are not exactly at their calculated places.

use nalgebra::{Matrix3, Vector3};

use super::Study;
use crate::mesh::count;
use crate::problem::Problem;

/// Returns the additional error of a load case if the sensors are `far` mm from their places, each in any direction
/// along the surface. The result is in µm RMS over the guideway and the directions.
pub(super) fn added(study: &Study, problem: &Problem, places: &[usize], case: usize, far: f64) -> f64 {
    let rise = &study.loads[case].rise;
    let squares = problem.blocks.iter().zip(places).enumerate().map(|(block, (own, place))| {
        let node = own.candidates[*place];
        // The mean of the squared cosine over all directions in the surface is one half.
        let wanders = gradient(study, node, rise).norm_squared() * far.powi(2) / 2.0;
        let column = problem.matrix.column(block);
        wanders * column.norm_squared() / count(column.len().max(1))
    });
    squares.sum::<f64>().sqrt()
}

/// Returns the gradient of the temperature along the surface, K/mm: least squares over the neighbours on the surface.
fn gradient(study: &Study, node: usize, rise: &[f64]) -> Vector3<f64> {
    let mesh = &study.mesh;
    let around = mesh.elements.iter().filter(|element| element.nodes.contains(&node));
    let mut near: Vec<usize> = around.flat_map(|element| element.nodes.iter().copied()).collect();
    near.sort_unstable();
    near.dedup();
    near.retain(|other| *other != node && study.reach.allowed[*other]);
    let (mut square, mut cross) = (Matrix3::zeros(), Vector3::zeros());
    for other in near {
        let way: Vector3<f64> = Vector3::from_fn(|axis, _| mesh.xyz[other][axis] - mesh.xyz[node][axis]);
        square += way * way.transpose();
        cross += way * (rise[other] - rise[node]);
    }
    // If all neighbours are in one plane, the gradient perpendicular to this plane is unknown.
    let least = 1e-6 * square.norm();
    square.pseudo_inverse(least).map(|inverse| inverse * cross).unwrap_or_default()
}
