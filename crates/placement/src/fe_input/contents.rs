//! Contents of an FE input file: a mesh, its materials, and one load case.

use crate::body::{LoadCase, Materials};
use crate::mesh::Mesh;

/// A mesh, its materials, and one load case.
#[derive(Debug, Clone, PartialEq)]
pub struct FeInput {
    /// Name of the load case: the file name without extension.
    pub name: String,
    /// Mesh with its sets.
    pub mesh: Mesh,
    /// Materials of the elements.
    pub materials: Materials,
    /// Load case: initial temperatures, loads and time range.
    pub load: LoadCase,
    /// Names of the surfaces with films and fluxes.
    pub surfaces: SurfaceNames,
    /// Nodes that `*BOUNDARY` fixes in x, y and z, ascending. The list is often empty, because heat conduction does not
    /// require fixed nodes.
    pub supports: Vec<usize>,
}

/// Names of the surfaces or sets of the loads, in small letters. The name of a single element is its number.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SurfaceNames {
    /// Name of the surface or set of each film, in the order of [`LoadCase::films`].
    pub films: Vec<String>,
    /// Name of the surface or set of each flux, in the order of [`LoadCase::fluxes`].
    pub fluxes: Vec<String>,
}
