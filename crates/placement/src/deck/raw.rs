//! The deck in numbers and names, as its cards give them, before any name is looked up.

use super::card::Place;
use crate::body::Case;
use crate::mesh::Kind;

/// One node, element or set, as it is named where it is used.
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
    pub(super) nodes: Vec<(u32, [f64; 3], Place)>,
    /// A line of a node is wrong: those who name it are not to blame.
    pub(super) spoiled_nodes: bool,
    pub(super) elements: Vec<(u32, Kind, Vec<u32>, Place)>,
    /// Lines and surfaces of the geometry, which carry names and nothing else.
    pub(super) outlines: Vec<(u32, Vec<u32>, Place)>,
    pub(super) node_sets: Vec<Members>,
    pub(super) element_sets: Vec<Members>,
    /// Name, element or set, side from 0.
    pub(super) surfaces: Vec<(String, Target, usize, Place)>,
    pub(super) solids: Vec<Solid>,
    /// Element set, material.
    pub(super) sections: Vec<(String, String, Place)>,
    /// Node set or node, °C.
    pub(super) initial: Vec<(Target, f64, Place)>,
    pub(super) boundaries: Vec<Boundary>,
    pub(super) load: Option<Load>,
    /// Sets whose nodes or elements are to be printed.
    pub(super) printed: Vec<(String, bool, Place)>,
}

/// What a set is said to hold, in the order of the deck.
#[derive(Debug)]
pub(super) struct Members {
    pub(super) name: String,
    pub(super) members: Vec<Member>,
    pub(super) place: Place,
    /// Whether a card of its own says so: a second one is refused. Sets that `*NODE` and `*ELEMENT` name grow.
    pub(super) own_card: bool,
}

#[derive(Debug)]
pub(super) enum Member {
    One(Target, Place),
    Range { first: u32, last: u32, by: u32, place: Place },
}

/// A material as far as the deck gives it.
#[derive(Debug)]
pub(super) struct Solid {
    pub(super) name: String,
    pub(super) place: Place,
    pub(super) elastic: Option<(f64, f64)>,
    pub(super) expansion: Option<f64>,
    pub(super) conductivity: Option<f64>,
    pub(super) specific_heat: Option<f64>,
    pub(super) density: Option<f64>,
    /// One of its cards is wrong: what it lacks is not said on top.
    pub(super) spoiled: bool,
}

/// What the step holds.
#[derive(Debug)]
pub(super) struct Load {
    pub(super) case: Case,
    /// Where, sink °C, coefficient.
    pub(super) films: Vec<(Where, f64, f64, Place)>,
    /// Where, heat.
    pub(super) fluxes: Vec<(Where, f64, Place)>,
    /// Node or set, heat at each of its nodes.
    pub(super) nodal: Vec<(Target, f64, Place)>,
}

/// Where heat passes.
#[derive(Debug)]
pub(super) enum Where {
    /// Through a side, from 0, of an element or a set of them.
    Side(Target, usize),
    /// Through a named surface.
    Surface(Target),
    /// In the volume of an element or a set of them.
    Volume(Target),
}

impl Where {
    /// What it is called: the set, or the number of the element.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Side(target, _) | Self::Surface(target) | Self::Volume(target) => match target {
                Target::Set(name) => name.to_lowercase(),
                Target::Id(id) => id.to_string(),
            },
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
    pub(super) place: Place,
}
