//! Mesh: nodes, tetrahedra, named sets, and the outer surface.

use std::collections::{BTreeMap, HashMap};
use std::fmt;

/// Names of the directions, in the order of their numbers: 0 x, 1 y, 2 z.
pub const AXES: [&str; 3] = ["x", "y", "z"];

/// Number of a node in the FE input file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(pub u32);

impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Kind of a tetrahedron, by its number of nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Linear tetrahedron with four corners (`C3D4`).
    Tet4,
    /// Quadratic tetrahedron with four corners and the midpoints of the six edges (`C3D10`).
    Tet10,
}

impl Kind {
    /// Returns the number of nodes of one element.
    #[must_use]
    pub const fn nodes(self) -> usize {
        match self {
            Self::Tet4 => 4,
            Self::Tet10 => 10,
        }
    }

    /// Returns the name of the element type in an FE input file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tet4 => "C3D4",
            Self::Tet10 => "C3D10",
        }
    }

    /// Returns the positions of the nodes of a face in the element's node list: corners, then midpoints of the edges.
    /// `side` is 0 to 3, in an FE input file F1 to F4.
    #[must_use]
    pub fn face(self, side: usize) -> &'static [usize] {
        match self {
            Self::Tet4 => &FACES[side][..3],
            Self::Tet10 => &FACES[side],
        }
    }
}

/// For each face of a tetrahedron, the positions of its nodes in the element's node list. The numbering is that of
/// Abaqus and CalculiX, clockwise as seen from outside.
const FACES: [[usize; 6]; 4] =
    [[0, 1, 2, 4, 5, 6], [0, 3, 1, 7, 8, 4], [1, 3, 2, 8, 9, 5], [2, 3, 0, 9, 7, 6]];

/// Tetrahedral element of a mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    /// Number of the element in the FE input file.
    pub id: u32,
    /// Linear or quadratic tetrahedron.
    pub kind: Kind,
    /// Indices of the nodes in [`Mesh::nodes`]: four corners, then the midpoints of the edges 12, 23, 31, 14, 24, 34.
    pub nodes: Vec<usize>,
}

/// Triangular face of an element, given by the element and the side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Face {
    /// Index of the element in [`Mesh::elements`].
    pub element: usize,
    /// Side, 0 to 3; in an FE input file F1 to F4.
    pub side: usize,
}

/// Finite-element mesh of a body of tetrahedra, with its named sets.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Numbers of the nodes in the FE input file, ascending. All other data refer to a node by its index in this list.
    pub nodes: Vec<NodeId>,
    /// Coordinates of each node in mm.
    pub xyz: Vec<[f64; 3]>,
    /// Elements of the mesh. All are tetrahedra.
    pub elements: Vec<Element>,
    /// Node sets by name in capitals: indices of the nodes in the order of the file, without duplicates.
    pub node_sets: BTreeMap<String, Vec<usize>>,
    /// Element sets by name in capitals: indices of the elements, ascending, without duplicates.
    pub element_sets: BTreeMap<String, Vec<usize>>,
}

impl Mesh {
    /// Returns the index of the node with this number; `None` if there is no such node.
    #[must_use]
    pub fn place(&self, node: NodeId) -> Option<usize> {
        self.nodes.binary_search(&node).ok()
    }

    /// Returns the coordinates of all nodes of an element, mm.
    #[must_use]
    pub fn corners(&self, element: &Element) -> Vec<[f64; 3]> {
        element.nodes.iter().map(|node| self.xyz[*node]).collect()
    }

    /// Returns for each node whether it belongs to an element.
    #[must_use]
    pub fn used(&self) -> Vec<bool> {
        let mut used = vec![false; self.nodes.len()];
        self.elements.iter().flat_map(|element| &element.nodes).for_each(|node| used[*node] = true);
        used
    }

    /// Returns the nodes of a face, as indices in [`Mesh::nodes`].
    pub fn face_nodes(&self, face: Face) -> impl Iterator<Item = usize> {
        let element = &self.elements[face.element];
        element.kind.face(face.side).iter().map(|place| element.nodes[*place])
    }

    /// Returns the faces that belong to one element only, in the order of the elements.
    #[must_use]
    pub fn outer_faces(&self) -> Vec<Face> {
        let mut seen: HashMap<[usize; 3], (Face, usize)> = HashMap::with_capacity(self.elements.len() * 3);
        for (place, element) in self.elements.iter().enumerate() {
            for side in 0..4 {
                let face = Face { element: place, side };
                seen.entry(self.face_key(element, side)).or_insert((face, 0)).1 += 1;
            }
        }
        let mut outer: Vec<Face> =
            seen.into_values().filter(|(_, times)| *times == 1).map(|(face, _)| face).collect();
        outer.sort_unstable();
        outer
    }

    /// Returns a key that is the same for both elements that share this face: its corner nodes, ascending.
    #[must_use]
    pub fn face_key(&self, element: &Element, side: usize) -> [usize; 3] {
        let mut key = [0, 1, 2].map(|corner| element.nodes[FACES[side][corner]]);
        key.sort_unstable();
        key
    }

    /// Returns the nodes of the outer faces, ascending. Only at these nodes can a sensor be mounted.
    #[must_use]
    pub fn skin(&self) -> Vec<usize> {
        let mut on = vec![false; self.nodes.len()];
        self.outer_faces()
            .into_iter()
            .flat_map(|face| self.face_nodes(face))
            .for_each(|node| on[node] = true);
        (0..on.len()).filter(|node| on[*node]).collect()
    }
}

/// Parses a direction (x, y or z) with a position or length, for example `z=450`. Returns the number of the direction,
/// and the value; `None` if the text is invalid.
pub(super) fn axis_and_value(text: &str) -> Option<(usize, f64)> {
    let (axis, value) = text.split_once('=')?;
    let axis = AXES.iter().position(|known| known.eq_ignore_ascii_case(axis.trim()))?;
    Some((axis, value.trim().parse().ok().filter(|value: &f64| value.is_finite())?))
}

/// Returns the smallest and the largest of the values. If there are no values, returns infinite bounds.
pub(super) fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// Divides the items into connected components; each pair connects two items. Returns for each item the lowest index in
/// its component.
pub(super) fn parts(things: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Vec<usize> {
    fn first(of: &mut [usize], mut thing: usize) -> usize {
        while of[thing] != thing {
            of[thing] = of[of[thing]];
            thing = of[thing];
        }
        thing
    }
    let mut of: Vec<usize> = (0..things).collect();
    for (one, other) in pairs {
        let (one, other) = (first(&mut of, one), first(&mut of, other));
        of[one.max(other)] = one.min(other);
    }
    (0..things).map(|thing| first(&mut of, thing)).collect()
}

/// Converts a count to floating point.
pub(super) fn count(things: usize) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "nodes of a mesh")]
    let count = things as f64;
    count
}

#[cfg(test)]
mod tests;
