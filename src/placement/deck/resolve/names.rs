//! Nodes and elements by number or by the name of their set.

use std::collections::{BTreeMap, HashMap};

use super::super::Fault;
use super::super::card::Place;
use super::super::raw::Target;
use crate::placement::mesh::{Mesh, NodeId};

/// Where names are looked up.
pub(super) struct Names<'a> {
    pub(super) mesh: &'a Mesh,
    pub(super) elements: &'a HashMap<u32, usize>,
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
}

fn unknown(target: &Target, what: &str, sets: &BTreeMap<String, Vec<usize>>) -> String {
    let name = match target {
        Target::Id(id) => return format!("{what} {id} is not defined"),
        Target::Set(name) => name,
    };
    let known: Vec<&str> = sets.keys().map(String::as_str).collect();
    let known =
        if known.is_empty() { "there is none".to_owned() } else { format!("there are {}", known.join(", ")) };
    format!("{what} set {name} is not defined ({known})")
}
