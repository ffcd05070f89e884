//! What one tetrahedron contributes: shape functions, their gradients and the integration points.
//!
//! The rules are those of CalculiX (four points in a `C3D10`, one in a `C3D4`; three and one on their faces), so that
//! both engines compute the same discrete problem and can be compared to the last digit, not only to mesh accuracy.

use crate::mesh::Kind;

/// Shape functions and their derivatives in the coordinates of the reference tetrahedron, at one point.
pub(super) struct Shape {
    pub(super) value: [f64; 10],
    derivative: [[f64; 3]; 10],
}

/// One integration point of one element in space.
pub(super) struct Point {
    /// Weight times the determinant of the Jacobian, mm³.
    pub(super) volume: f64,
    /// Shape functions.
    pub(super) value: [f64; 10],
    /// Their gradients, 1/mm.
    pub(super) gradient: [[f64; 3]; 10],
}

/// A place in the reference tetrahedron and its weight; the weights of a rule sum to its volume, 1/6.
pub(super) type Gauss = ([f64; 3], f64);

/// One point: exact for linear functions.
const ONE: [Gauss; 1] = [([0.25; 3], 1.0 / 6.0)];

const NEAR: f64 = 0.138_196_601_125_010_5;
const FAR: f64 = 0.585_410_196_624_968_5;

/// Four points: exact for quadratic functions.
const FOUR: [Gauss; 4] = [
    ([NEAR, NEAR, NEAR], 1.0 / 24.0),
    ([FAR, NEAR, NEAR], 1.0 / 24.0),
    ([NEAR, FAR, NEAR], 1.0 / 24.0),
    ([NEAR, NEAR, FAR], 1.0 / 24.0),
];

/// Points at which everything in the volume is integrated. For heat capacity they are few, but they are what the referee
/// takes, and the heat that is stored stays exact.
pub(super) const fn stiffness_rule(kind: Kind) -> &'static [Gauss] {
    match kind {
        Kind::Tet4 => &ONE,
        Kind::Tet10 => &FOUR,
    }
}

/// Corners of the edges in whose middle the nodes 5 to 10 lie.
pub(super) const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];

impl Shape {
    pub(super) fn at(kind: Kind, [x, y, z]: [f64; 3]) -> Self {
        let corner = [1.0 - x - y - z, x, y, z];
        let slope = [[-1.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let (mut value, mut derivative) = ([0.0; 10], [[0.0; 3]; 10]);
        if kind == Kind::Tet4 {
            value[..4].copy_from_slice(&corner);
            derivative[..4].copy_from_slice(&slope);
            return Self { value, derivative };
        }
        for node in 0..4 {
            value[node] = corner[node] * (2.0 * corner[node] - 1.0);
            derivative[node] = slope[node].map(|slope| slope * (4.0 * corner[node] - 1.0));
        }
        for (edge, [a, b]) in EDGES.into_iter().enumerate() {
            value[4 + edge] = 4.0 * corner[a] * corner[b];
            for axis in 0..3 {
                derivative[4 + edge][axis] = 4.0 * (slope[a][axis] * corner[b] + corner[a] * slope[b][axis]);
            }
        }
        Self { value, derivative }
    }

    /// The columns of the Jacobian: how the place in space follows the three reference coordinates.
    fn jacobian(&self, xyz: &[[f64; 3]]) -> [[f64; 3]; 3] {
        let mut jacobian = [[0.0; 3]; 3];
        for (node, place) in xyz.iter().enumerate() {
            for (along, column) in jacobian.iter_mut().enumerate() {
                for axis in 0..3 {
                    column[axis] += self.derivative[node][along] * place[axis];
                }
            }
        }
        jacobian
    }
}

/// The shapes of a rule, computed once for all elements of a kind.
pub(super) fn shapes(kind: Kind, rule: &[Gauss]) -> Vec<(Shape, f64)> {
    rule.iter().map(|(at, weight)| (Shape::at(kind, *at), *weight)).collect()
}

/// An integration point in the element whose nodes lie at `xyz`.
pub(super) fn point(shape: &Shape, weight: f64, xyz: &[[f64; 3]]) -> Point {
    let [u, v, w] = shape.jacobian(xyz);
    let reciprocal = [cross(v, w), cross(w, u), cross(u, v)];
    let determinant = dot(u, reciprocal[0]);
    let mut gradient = [[0.0; 3]; 10];
    for (gradient, derivative) in gradient.iter_mut().zip(&shape.derivative).take(xyz.len()) {
        for axis in 0..3 {
            let along = (0..3).map(|along| derivative[along] * reciprocal[along][axis]).sum::<f64>();
            gradient[axis] = along / determinant;
        }
    }
    Point { volume: weight * determinant, value: shape.value, gradient }
}

/// The smallest determinant of the Jacobian at the integration points, mm³: not positive where the nodes are numbered
/// inside out or the element is folded.
pub(super) fn worst_determinant(kind: Kind, xyz: &[[f64; 3]]) -> f64 {
    let determinant = |(at, _): &Gauss| {
        let [u, v, w] = Shape::at(kind, *at).jacobian(xyz);
        dot(u, cross(v, w))
    };
    stiffness_rule(kind).iter().map(determinant).fold(f64::INFINITY, f64::min)
}

/// Shape functions of a face at an integration point, in the order of the face's nodes, and the area it stands for.
pub(super) fn face_points(kind: Kind, xyz: &[[f64; 3]]) -> Vec<([f64; 6], f64)> {
    const SIXTH: f64 = 1.0 / 6.0;
    let rule: &[([f64; 2], f64)] = match kind {
        Kind::Tet4 => &[([1.0 / 3.0, 1.0 / 3.0], 0.5)],
        Kind::Tet10 => {
            &[([SIXTH, SIXTH], SIXTH), ([4.0 * SIXTH, SIXTH], SIXTH), ([SIXTH, 4.0 * SIXTH], SIXTH)]
        }
    };
    rule.iter()
        .map(|([x, y], weight)| {
            let (value, derivative) = triangle(kind, [1.0 - x - y, *x, *y]);
            let mut tangents = [[0.0; 3]; 2];
            for (node, place) in xyz.iter().enumerate() {
                for (along, tangent) in tangents.iter_mut().enumerate() {
                    for axis in 0..3 {
                        tangent[axis] += derivative[node][along] * place[axis];
                    }
                }
            }
            let normal = cross(tangents[0], tangents[1]);
            (value, weight * dot(normal, normal).sqrt())
        })
        .collect()
}

fn triangle(kind: Kind, corner: [f64; 3]) -> ([f64; 6], [[f64; 2]; 6]) {
    let slope = [[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]];
    let (mut value, mut derivative) = ([0.0; 6], [[0.0; 2]; 6]);
    if kind == Kind::Tet4 {
        value[..3].copy_from_slice(&corner);
        derivative[..3].copy_from_slice(&slope);
        return (value, derivative);
    }
    for node in 0..3 {
        value[node] = corner[node] * (2.0 * corner[node] - 1.0);
        derivative[node] = slope[node].map(|slope| slope * (4.0 * corner[node] - 1.0));
        let (a, b) = (node, (node + 1) % 3);
        value[3 + node] = 4.0 * corner[a] * corner[b];
        derivative[3 + node] =
            [0, 1].map(|along| 4.0 * (slope[a][along] * corner[b] + corner[a] * slope[b][along]));
    }
    (value, derivative)
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
