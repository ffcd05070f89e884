//! Views of the structure from the six directions of its axes. They show which surface is accessible for a sensor, and
//! are drawn in the report.

use rayon::prelude::*;

use crate::mesh::{Face, Mesh, count, range};

/// Number of pixels of a view along the longest side of the structure.
const FINE: usize = 400;

/// View along one axis, with the nearest surface in each pixel.
#[derive(Clone, Debug)]
pub struct View {
    /// Axis of the view: 0 x, 1 y, 2 z.
    pub axis: usize,
    /// Whether the view is from the positive end of the axis.
    pub from_above: bool,
    /// Axes of the picture: the axis to the right, and the axis upwards.
    pub plane: [usize; 2],
    /// Number of pixels to the right and upwards.
    pub size: [usize; 2],
    low: [f64; 2],
    /// Side of a pixel, mm.
    pub pixel: f64,
    seen: Vec<Option<VisiblePoint>>,
}

/// Point of the surface that is visible in one pixel: a position on a triangle of the mesh surface.
#[derive(Clone, Copy, Debug)]
pub struct VisiblePoint {
    /// Coordinate of the point along the axis of the view, towards the viewer, mm.
    depth: f64,
    /// Corners of one triangle of the surface, as indices of nodes of the mesh.
    pub corners: [usize; 3],
    /// Weight of each corner for interpolation; the sum of the weights is 1.
    pub shares: [f64; 3],
}

impl VisiblePoint {
    /// Returns the value of a nodal quantity at this point. `values` has a value for each node of the mesh.
    #[must_use]
    pub fn of(&self, values: &[f64]) -> f64 {
        self.corners.iter().zip(&self.shares).map(|(corner, share)| share * values[*corner]).sum()
    }

    /// Returns the corner of the triangle that is nearest to this point, as an index of a node.
    #[must_use]
    pub fn nearest(&self) -> usize {
        let nearest = (0..3).max_by(|one, other| self.shares[*one].total_cmp(&self.shares[*other]));
        self.corners[nearest.unwrap_or(0)]
    }
}

impl View {
    /// Creates the view of a mesh along `axis`, from its positive or its negative end.
    #[must_use]
    pub fn new(mesh: &Mesh, axis: usize, from_above: bool) -> View {
        View::of(mesh, &mesh.outer_faces(), axis, from_above)
    }

    fn of(mesh: &Mesh, faces: &[Face], axis: usize, from_above: bool) -> View {
        let plane = match axis {
            0 => [2, 1],
            1 => [0, 2],
            _ => [0, 1],
        };
        let (low, high) = extent(mesh);
        let pixel = ((0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max) / count(FINE)).max(1e-9);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels, at most FINE")]
        let size = plane.map(|axis| ((high[axis] - low[axis]) / pixel) as usize + 1);
        let seen = vec![None; size[0] * size[1]];
        let mut view = View { axis, from_above, plane, size, low: plane.map(|axis| low[axis]), pixel, seen };
        for face in faces {
            let nodes: Vec<usize> = mesh.face_nodes(*face).collect();
            view.draw(mesh, [0, 1, 2].map(|corner| nodes[corner]));
        }
        view
    }

    /// Returns the position of a point in pixels: to the right, and upwards.
    #[must_use]
    pub fn place(&self, xyz: &[f64; 3]) -> [f64; 2] {
        [0, 1].map(|way| (xyz[self.plane[way]] - self.low[way]) / self.pixel)
    }

    /// Returns whether the horizontal axis of the drawing must be mirrored, because the view would otherwise show a
    /// mirror image.
    #[must_use]
    pub fn mirrored(&self) -> bool {
        // Depending on the direction of the view, the three axes form a right-handed or left-handed image.
        (self.axis == 2) != self.from_above
    }

    /// Returns the visible point of a pixel; `None` if the pixel is outside the view or shows no surface.
    #[must_use]
    pub fn at(&self, right: usize, up: usize) -> Option<&VisiblePoint> {
        if right >= self.size[0] || up >= self.size[1] {
            return None;
        }
        self.seen[up * self.size[0] + right].as_ref()
    }

    fn depth(&self, xyz: &[f64; 3]) -> f64 {
        if self.from_above { xyz[self.axis] } else { -xyz[self.axis] }
    }

    /// Returns whether this point is visible in the view (not hidden by the structure), with a tolerance of two pixels.
    #[must_use]
    pub fn sees(&self, xyz: &[f64; 3]) -> bool {
        let [right, up] = self.place(xyz);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of the drawing")]
        let (right, up) = (right.round().max(0.0) as usize, up.round().max(0.0) as usize);
        let around = [(0, 0), (1, 0), (0, 1), (1, 1)];
        around.iter().any(|(dx, dy)| {
            let seen = self.at(right.saturating_sub(*dx), up.saturating_sub(*dy));
            seen.is_some_and(|seen| self.depth(xyz) > seen.depth - 2.0 * self.pixel)
        })
    }

    fn draw(&mut self, mesh: &Mesh, corners: [usize; 3]) {
        let at = corners.map(|corner| self.place(&mesh.xyz[corner]));
        let depth = corners.map(|corner| self.depth(&mesh.xyz[corner]));
        let double =
            (at[1][0] - at[0][0]) * (at[2][1] - at[0][1]) - (at[2][0] - at[0][0]) * (at[1][1] - at[0][1]);
        if double.abs() < 1e-9 {
            return;
        }
        let ends = |way: usize| {
            let places = at.map(|at| at[way]);
            let low = places.iter().copied().fold(f64::INFINITY, f64::min).floor().max(0.0);
            let high = places.iter().copied().fold(0.0, f64::max).ceil();
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "pixels of the drawing"
            )]
            let ends = (low as usize, (high as usize).min(self.size[way] - 1));
            ends
        };
        let ((left, right), (bottom, top)) = (ends(0), ends(1));
        for y in bottom..=top {
            for x in left..=right {
                let point = [count(x) + 0.5, count(y) + 0.5];
                let share = |one: usize, other: usize| {
                    ((at[other][0] - at[one][0]) * (point[1] - at[one][1])
                        - (point[0] - at[one][0]) * (at[other][1] - at[one][1]))
                        / double
                };
                let shares = [share(1, 2), share(2, 0), share(0, 1)];
                if shares.iter().any(|share| *share < -1e-9) {
                    continue;
                }
                let near: f64 = shares.iter().zip(&depth).map(|(share, depth)| share * depth).sum();
                let seen = &mut self.seen[y * self.size[0] + x];
                if seen.is_none_or(|seen| near > seen.depth) {
                    *seen = Some(VisiblePoint { depth: near, corners, shares });
                }
            }
        }
    }
}

/// Returns the smallest and the largest coordinates of the nodes, mm.
fn extent(mesh: &Mesh) -> ([f64; 3], [f64; 3]) {
    let ends = [0, 1, 2].map(|axis| range(mesh.xyz.iter().map(|xyz| xyz[axis])));
    (ends.map(|(low, _)| low), ends.map(|(_, high)| high))
}

/// Returns for each node whether it is visible from outside along an axis. The side on which the structure is fixed is
/// excluded, because its foot is mounted on the bed.
#[must_use]
pub fn outside(mesh: &Mesh, fixed: &[usize]) -> Vec<bool> {
    let (low, high) = extent(mesh);
    let hidden = |axis: usize, from_above: bool| {
        let end = if from_above { high[axis] } else { low[axis] };
        let near = 0.02 * (high[axis] - low[axis]);
        !fixed.is_empty() && fixed.iter().all(|node| (mesh.xyz[*node][axis] - end).abs() <= near)
    };
    let sides = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
    let sides: Vec<(usize, bool)> = sides.filter(|(axis, from_above)| !hidden(*axis, *from_above)).collect();
    let faces = mesh.outer_faces();
    let view = |(axis, from_above): &(usize, bool)| View::of(mesh, &faces, *axis, *from_above);
    let views: Vec<View> = sides.par_iter().map(view).collect();
    let mut outside = vec![false; mesh.nodes.len()];
    for node in faces.iter().flat_map(|face| mesh.face_nodes(*face)) {
        outside[node] = outside[node] || views.iter().any(|view| view.sees(&mesh.xyz[node]));
    }
    outside
}

#[cfg(test)]
mod tests;
