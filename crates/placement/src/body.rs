//! What a mesh is made of, and how one load case warms it.

use crate::mesh::{Face, Mesh};

/// A linear, isotropic material that does not change with temperature.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Its name in the FE input file, in capitals.
    pub name: String,
    /// Young's modulus, MPa.
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Linear thermal expansion, 1/K.
    pub expansion: f64,
    /// Heat conduction, mW/(mm·K).
    pub conductivity: f64,
    /// Density times specific heat, mJ/(mm³·K); only a transient case needs it.
    pub capacity: Option<f64>,
}

/// Materials, and which of them each element is made of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Materials {
    /// The materials.
    pub list: Vec<Material>,
    /// For each element its place in `list`.
    pub of_element: Vec<usize>,
}

impl Materials {
    /// One material throughout.
    #[must_use]
    pub fn uniform(material: Material, mesh: &Mesh) -> Self {
        Self { list: vec![material], of_element: vec![0; mesh.elements.len()] }
    }

    /// The material of an element.
    #[must_use]
    pub fn of(&self, element: usize) -> &Material {
        &self.list[self.of_element[element]]
    }
}

/// How far the heat is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Case {
    /// Until nothing changes any more.
    Steady,
    /// For a time, in equal steps, each computed backwards (implicit Euler). The last step may be shorter.
    Transient {
        /// s
        step: f64,
        /// s
        period: f64,
    },
}

/// Heat exchange of a face with what flows past it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Film {
    /// Where.
    pub face: Face,
    /// Temperature of what flows, °C.
    pub sink: f64,
    /// mW/(mm²·K)
    pub coefficient: f64,
}

/// Heat that enters an element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flux {
    /// Through a face, mW/mm².
    Face(Face, f64),
    /// In the volume of the element, mW/mm³.
    Volume(usize, f64),
}

/// One load case: what warms the body, from where it starts, how long.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadCase {
    /// Steady or for a time.
    pub case: Case,
    /// Temperature of each node at the start, °C; rises are counted from here.
    pub initial: Vec<f64>,
    /// Films.
    pub films: Vec<Film>,
    /// Fluxes through faces and in volumes.
    pub fluxes: Vec<Flux>,
    /// Heat that enters at a node, mW.
    pub nodal: Vec<(usize, f64)>,
    /// Nodes whose temperature is held, °C, each once.
    pub held: Vec<(usize, f64)>,
}

/// Hears what is being computed, how much of it is done, and of how much.
pub type Progress<'a> = &'a dyn Fn(&str, usize, usize);

/// Nobody listens.
pub const SILENT: Progress<'static> = &|_, _, _| {};
