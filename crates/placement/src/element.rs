//! Contribution of one tetrahedron to the equations of a finite-element mesh: shape functions, their gradients and the
//! integration points.
//!
//! The integration rules are those of CalculiX. A `C3D10` has four points in its volume and three on each
//! face. A `C3D4` has one point in its volume and one on each face. CalculiX and isotherm therefore solve the
//! same discrete problem, and their results agree to the last printed digit, not only within the accuracy of
//! the mesh.

use crate::mesh::{Kind, Mesh};

/// Shape functions and their derivatives with respect to the `D` reference coordinates of a tetrahedron or triangle, at
/// one point.
struct Shape<const D: usize> {
    value: [f64; 10],
    derivative: [[f64; D]; 10],
}

/// Integration point of an element, with the shape functions at this point.
pub(super) struct Point {
    /// Volume that the point represents, mm³: weight times the determinant of the Jacobian.
    pub(super) volume: f64,
    /// Values of the shape functions.
    pub(super) value: [f64; 10],
    /// Gradients of the shape functions, 1/mm.
    pub(super) gradient: [[f64; 3]; 10],
}

/// Integration rule: points in the reference tetrahedron or triangle, with their weights. The sum of the weights is the
/// volume or area of this reference shape.
type Rule<const D: usize> = &'static [([f64; D], f64)];

const NEAR: f64 = 0.138_196_601_125_010_5;
const FAR: f64 = 0.585_410_196_624_968_5;
const SIXTH: f64 = 1.0 / 6.0;

/// Returns the integration rule for the volume of an element. One point is exact for linear functions, and four points
/// are exact for quadratic functions. For the heat capacity, both rules are only approximate. CalculiX uses the same
/// rules, and the total stored heat is exact.
const fn volume_rule(kind: Kind) -> Rule<3> {
    match kind {
        Kind::Tet4 => &[([0.25; 3], SIXTH)],
        Kind::Tet10 => &[
            ([NEAR, NEAR, NEAR], 1.0 / 24.0),
            ([FAR, NEAR, NEAR], 1.0 / 24.0),
            ([NEAR, FAR, NEAR], 1.0 / 24.0),
            ([NEAR, NEAR, FAR], 1.0 / 24.0),
        ],
    }
}

const fn face_rule(kind: Kind) -> Rule<2> {
    match kind {
        Kind::Tet4 => &[([1.0 / 3.0; 2], 0.5)],
        Kind::Tet10 => &[([SIXTH; 2], SIXTH), ([4.0 * SIXTH, SIXTH], SIXTH), ([SIXTH, 4.0 * SIXTH], SIXTH)],
    }
}

/// Corners of the edges whose midpoints are the nodes 5 to 10. The first three edges are also the edges of a triangle.
pub(super) const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];

impl<const D: usize> Shape<D> {
    fn at(kind: Kind, place: [f64; D]) -> Self {
        let first = place.iter().fold(1.0, |rest, at| rest - at);
        let corner = |node: usize| if node == 0 { first } else { place[node - 1] };
        let slope = |node: usize| -> [f64; D] {
            std::array::from_fn(|along| match node {
                0 => -1.0,
                _ if node == along + 1 => 1.0,
                _ => 0.0,
            })
        };
        let (mut value, mut derivative) = ([0.0; 10], [[0.0; D]; 10]);
        for node in 0..=D {
            let at = corner(node);
            let (own, steep) = match kind {
                Kind::Tet4 => (at, 1.0),
                Kind::Tet10 => (at * (2.0 * at - 1.0), 4.0 * at - 1.0),
            };
            value[node] = own;
            derivative[node] = slope(node).map(|slope| slope * steep);
        }
        let edges = if kind == Kind::Tet10 { &EDGES[..D * (D + 1) / 2] } else { &[] };
        for (node, [a, b]) in (D + 1..).zip(edges) {
            value[node] = 4.0 * corner(*a) * corner(*b);
            let (slope_a, slope_b) = (slope(*a), slope(*b));
            derivative[node] = std::array::from_fn(|along| {
                4.0 * (slope_a[along] * corner(*b) + corner(*a) * slope_b[along])
            });
        }
        Self { value, derivative }
    }

    /// Returns the columns of the Jacobian: derivatives of the position in space by the reference coordinates.
    fn jacobian(&self, xyz: &[[f64; 3]]) -> [[f64; 3]; D] {
        let mut jacobian = [[0.0; 3]; D];
        for (derivative, place) in self.derivative.iter().zip(xyz) {
            for (column, derivative) in jacobian.iter_mut().zip(derivative) {
                for axis in 0..3 {
                    column[axis] += derivative * place[axis];
                }
            }
        }
        jacobian
    }
}

impl Shape<3> {
    /// Returns the integration point for an element whose nodes are at `xyz`, mm. `weight` is the weight of the point
    /// in the integration rule.
    fn point(&self, weight: f64, xyz: &[[f64; 3]]) -> Point {
        let [u, v, w] = self.jacobian(xyz);
        let reciprocal = [cross(v, w), cross(w, u), cross(u, v)];
        let determinant = dot(u, reciprocal[0]);
        let mut gradient = [[0.0; 3]; 10];
        for (gradient, derivative) in gradient.iter_mut().zip(&self.derivative).take(xyz.len()) {
            for axis in 0..3 {
                let along = (0..3).map(|along| derivative[along] * reciprocal[along][axis]).sum::<f64>();
                gradient[axis] = along / determinant;
            }
        }
        Point { volume: weight * determinant, value: self.value, gradient }
    }
}

/// Calls `visit` for every element, with its index and its integration points.
pub(super) fn for_each_element(mesh: &Mesh, mut visit: impl FnMut(usize, &[Point])) {
    let shapes = [Kind::Tet4, Kind::Tet10].map(|kind| -> Vec<(Shape<3>, f64)> {
        volume_rule(kind).iter().map(|(at, weight)| (Shape::at(kind, *at), *weight)).collect()
    });
    let mut points = Vec::new();
    for (place, element) in mesh.elements.iter().enumerate() {
        let xyz = mesh.corners(element);
        let shapes = &shapes[element.kind as usize];
        points.clear();
        points.extend(shapes.iter().map(|(shape, weight)| shape.point(*weight, &xyz)));
        visit(place, &points);
    }
}

/// Calls `visit` for every integration point of every element, with the index of the element, the point, and the number
/// of nodes.
pub(super) fn for_each_point(mesh: &Mesh, mut visit: impl FnMut(usize, &Point, usize)) {
    for_each_element(mesh, |element, points| {
        let count = mesh.elements[element].nodes.len();
        points.iter().for_each(|point| visit(element, point, count));
    });
}

/// Returns the smallest determinant of the Jacobian at the integration points, mm³. It is not positive if the node
/// numbering is inverted, or if the element is folded.
pub(super) fn worst_determinant(kind: Kind, xyz: &[[f64; 3]]) -> f64 {
    let determinants = volume_rule(kind).iter().map(|(at, _)| {
        let [u, v, w] = Shape::at(kind, *at).jacobian(xyz);
        dot(u, cross(v, w))
    });
    determinants.fold(f64::INFINITY, f64::min)
}

/// Returns the integration points of a face. For each point: the values of the shape functions in the order of the
/// face's nodes, and the area that the point represents, mm².
pub(super) fn face_points(kind: Kind, xyz: &[[f64; 3]]) -> Vec<([f64; 10], f64)> {
    let point = |(at, weight): &([f64; 2], f64)| {
        let shape = Shape::at(kind, *at);
        let [u, v] = shape.jacobian(xyz);
        let normal = cross(u, v);
        (shape.value, weight * dot(normal, normal).sqrt())
    };
    face_rule(kind).iter().map(point).collect()
}

pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| a[axis] - b[axis])
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
