//! The FE input file in numbers and names, as its cards give them, before any name is looked up.

use std::collections::BTreeMap;

use super::Fault;
use super::card::Location;
use crate::body::Case;
use crate::mesh::Kind;

/// One node or element, or a set of them, as it is named where it is used.
#[derive(Debug, Clone)]
pub(super) enum Target {
    Id(u32),
    Set(String),
}

impl Target {
    /// A number is an id, anything else the name of a set.
    pub(super) fn of(text: &str) -> Self {
        text.parse().map_or_else(|_| Self::Set(text.to_uppercase()), Self::Id)
    }
}

#[derive(Debug, Default)]
pub(super) struct Raw {
    pub(super) nodes: Vec<(u32, [f64; 3], Location)>,
    /// A line of a node is wrong: those who name it are not to blame.
    pub(super) spoiled_nodes: bool,
    pub(super) elements: Vec<(u32, Kind, Vec<u32>, Location)>,
    /// Lines and surfaces of the geometry, which carry names and nothing else.
    pub(super) outlines: Vec<(u32, Vec<u32>, Location)>,
    pub(super) node_sets: Vec<Members>,
    pub(super) element_sets: Vec<Members>,
    /// Name, element or set, side from 0.
    pub(super) surfaces: Vec<(String, Target, usize, Location)>,
    pub(super) materials: Vec<Material>,
    /// Element set, material.
    pub(super) sections: Vec<(String, String, Location)>,
    /// Node set or node, °C.
    pub(super) initial: Vec<(Target, f64, Location)>,
    pub(super) boundaries: Vec<Boundary>,
    pub(super) load: Option<Load>,
    /// Sets whose nodes (true) or elements are to be printed.
    pub(super) printed: Vec<(String, bool, Location)>,
    /// What is wrong so far.
    pub(super) faults: Vec<Fault>,
}

/// What a set is said to hold, in the order of the file.
#[derive(Debug)]
pub(super) struct Members {
    pub(super) name: String,
    pub(super) members: Vec<(Member, Location)>,
    pub(super) at: Location,
    /// Whether a card of its own says so: a second one is refused. Sets that `*NODE` and `*ELEMENT` name grow.
    pub(super) own_card: bool,
}

#[derive(Debug)]
pub(super) enum Member {
    /// The first, the last and the step.
    Ids(u32, u32, u32),
    /// A set above.
    Set(String),
}

impl From<Target> for Member {
    fn from(target: Target) -> Member {
        match target {
            Target::Id(id) => Member::Ids(id, id, 1),
            Target::Set(name) => Member::Set(name),
        }
    }
}

/// A material as far as the file gives it.
#[derive(Debug)]
pub(super) struct Material {
    pub(super) name: String,
    pub(super) at: Location,
    /// By the names of [`super::material`].
    pub(super) properties: BTreeMap<&'static str, f64>,
    /// One of its cards is wrong: what it lacks is not said on top.
    pub(super) spoiled: bool,
}

/// What the step holds.
#[derive(Debug)]
pub(super) struct Load {
    pub(super) case: Case,
    /// Where, sink °C, coefficient.
    pub(super) films: Vec<(Region, f64, f64, Location)>,
    /// Where, heat.
    pub(super) fluxes: Vec<(Region, f64, Location)>,
    /// Node or set, heat at each of its nodes.
    pub(super) nodal: Vec<(Target, f64, Location)>,
}

/// Where heat passes: what of an element or a set of them.
#[derive(Debug)]
pub(super) struct Region {
    pub(super) target: Target,
    pub(super) part: Part,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    /// This side of each element, from 0.
    Side(usize),
    /// The faces that the target names: it is a surface.
    Surface,
    /// Its volume.
    Volume,
}

impl Region {
    /// The set in small letters, or the number of the element.
    pub(super) fn name(&self) -> String {
        match &self.target {
            Target::Set(name) => name.to_lowercase(),
            Target::Id(id) => id.to_string(),
        }
    }
}

/// Node or set, first and last direction, value.
#[derive(Debug)]
pub(super) struct Boundary {
    pub(super) target: Target,
    pub(super) first: u32,
    pub(super) last: u32,
    pub(super) value: f64,
    pub(super) at: Location,
}
