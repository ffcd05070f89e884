//! Materials of a finite-element mesh, and the thermal loads of one load case. A load case is one thermal situation of
//! the structure: initial temperatures, heat flows, and a time range.

use crate::mesh::{Face, Mesh};

/// Linear isotropic material whose properties do not depend on temperature.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name in the FE input file, in capitals.
    pub name: String,
    /// Young's modulus, MPa.
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Coefficient of linear thermal expansion, 1/K.
    pub expansion: f64,
    /// Thermal conductivity, mW/(mm·K).
    pub conductivity: f64,
    /// Density times specific heat, mJ/(mm³·K). Only a transient case requires it.
    pub capacity: Option<f64>,
}

/// Materials, and their assignment to the elements.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Materials {
    /// Materials that the elements use. Each material occurs once.
    pub list: Vec<Material>,
    /// Index of the material of each element in `list`.
    pub of_element: Vec<usize>,
}

impl Materials {
    /// Assigns one material to all elements.
    #[must_use]
    pub fn uniform(material: Material, mesh: &Mesh) -> Self {
        Self { list: vec![material], of_element: vec![0; mesh.elements.len()] }
    }

    /// Returns the material of an element.
    #[must_use]
    pub fn of(&self, element: usize) -> &Material {
        &self.list[self.of_element[element]]
    }
}

/// Time range of a load case: a steady state, or a period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Case {
    /// Steady state: temperatures that no longer change.
    Steady,
    /// Transient case over a period, in equal steps of the implicit Euler method. The last step may be shorter.
    Transient {
        /// Length of a time step, s.
        step: f64,
        /// Length of the whole period, s.
        period: f64,
    },
}

/// Heat exchange (convection) between a face of an element and a fluid such as air or coolant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Film {
    /// Face through which the heat flows.
    pub face: Face,
    /// Temperature of the fluid, °C.
    pub sink: f64,
    /// Film coefficient (heat transfer coefficient), mW/(mm²·K).
    pub coefficient: f64,
}

/// Heat flow into an element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flux {
    /// Heat flow through a face: the face, and the flow in mW/mm².
    Face(Face, f64),
    /// Heat source in the volume of an element: index of the element, and the power in mW/mm³.
    Volume(usize, f64),
}

/// One load case: initial temperatures, heat flows, prescribed temperatures, and time range.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadCase {
    /// Time range of the case: steady, or transient.
    pub case: Case,
    /// Initial temperature of each node, °C. Temperature rises are relative to this temperature.
    pub initial: Vec<f64>,
    /// Heat exchange of faces with fluids.
    pub films: Vec<Film>,
    /// Heat flows through faces and in volumes.
    pub fluxes: Vec<Flux>,
    /// Heat flows into nodes: index of the node, and the flow in mW.
    pub nodal: Vec<(usize, f64)>,
    /// Nodes with a prescribed temperature: index of the node, and °C. Each node occurs once.
    pub held: Vec<(usize, f64)>,
}

/// Callback that reports progress. Its arguments are the name of the current work, the number of finished items, and
/// the total number of items.
pub type Progress<'a> = &'a dyn Fn(&str, usize, usize);

/// Callback that does not report progress.
pub const SILENT: Progress<'static> = &|_, _, _| {};
