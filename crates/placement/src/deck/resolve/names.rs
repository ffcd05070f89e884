//! Nodes and elements by number or by the name of their set.

use std::collections::{BTreeMap, HashMap};

use super::super::Fault;
use super::super::card::Place;
use super::super::raw::Target;
use crate::mesh::{Face, Mesh, NodeId};

/// Where names are looked up.
pub(super) struct Names<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) elements: &'a HashMap<u32, usize>,
    /// Outer faces by the name of their surface.
    pub(super) surfaces: &'a BTreeMap<String, Vec<Face>>,
}

impl Names<'_> {
    pub(super) fn nodes(&self, target: &Target, place: &Place, faults: &mut Vec<Fault>) -> Vec<usize> {
        let found = match target {
            Target::Id(id) => self.mesh.place(NodeId(*id)).map(|at| vec![at]),
            Target::Set(name) => self.mesh.node_sets.get(name).cloned(),
        };
        found.unwrap_or_else(|| {
            faults.push(place.fault(unknown(target, "node", &self.mesh.node_sets)));
            Vec::new()
        })
    }

    pub(super) fn elements(&self, target: &Target, place: &Place, faults: &mut Vec<Fault>) -> Vec<usize> {
        let found = match target {
            Target::Id(id) => self.elements.get(id).map(|at| vec![*at]),
            Target::Set(name) => self.mesh.element_sets.get(name).cloned(),
        };
        found.unwrap_or_else(|| {
            faults.push(place.fault(unknown(target, "element", &self.mesh.element_sets)));
            Vec::new()
        })
    }

    pub(super) fn surface(&self, target: &Target, place: &Place, faults: &mut Vec<Fault>) -> Vec<Face> {
        let found = match target {
            Target::Id(_) => None,
            Target::Set(name) => self.surfaces.get(name),
        };
        found.cloned().unwrap_or_else(|| {
            faults.push(place.fault(unknown(target, "surface", self.surfaces)));
            Vec::new()
        })
    }
}

fn unknown<T>(target: &Target, what: &str, sets: &BTreeMap<String, T>) -> String {
    let name = match target {
        Target::Id(id) => return format!("{what} {id} is not defined"),
        Target::Set(name) => name,
    };
    let known: Vec<&str> = sets.keys().map(String::as_str).collect();
    let known =
        if known.is_empty() { "there is none".to_owned() } else { format!("there are {}", known.join(", ")) };
    format!("{what} set {name} is not defined ({known})")
}
