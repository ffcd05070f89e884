//! What each element is made of.

use super::super::Fault;
use super::super::raw::{Raw, Target};
use super::names::Names;
use crate::body::{Case, Material, Materials};

pub(super) fn materials(raw: &Raw, names: &Names<'_>, faults: &mut Vec<Fault>) -> Option<Materials> {
    let mut of_element: Vec<Option<usize>> = vec![None; names.mesh.elements.len()];
    let before = faults.len();
    for (set, material, place) in &raw.sections {
        let Some(number) = raw.solids.iter().position(|solid| solid.name == *material) else {
            faults.push(place.fault(format!("material {material} is not defined")));
            continue;
        };
        for element in names.elements(&Target::Set(set.clone()), place, faults) {
            if of_element[element].replace(number).is_some_and(|other| other != number) {
                let id = names.mesh.elements[element].id;
                faults.push(place.fault(format!("element {id} has a material already")));
            }
        }
    }
    let without = of_element.iter().filter(|material| material.is_none()).count();
    if let Some(first) = of_element.iter().position(Option::is_none)
        && faults.len() == before
    {
        faults.push(raw.elements[first].3.fault(format!(
            "{without} elements have no material, the first is {}: write *SOLID SECTION, ELSET=…, MATERIAL=…",
            names.mesh.elements[first].id
        )));
    }
    let transient = raw.load.as_ref().is_some_and(|load| load.case != Case::Steady);
    let mut list = Vec::new();
    for (number, solid) in raw.solids.iter().enumerate() {
        let mut lacks = Vec::new();
        if solid.elastic.is_none() {
            lacks.push("*ELASTIC");
        }
        if solid.expansion.is_none_or(|expansion| expansion.abs() <= 0.0) {
            lacks.push("*EXPANSION");
        }
        if solid.conductivity.is_none() {
            lacks.push("*CONDUCTIVITY");
        }
        let stores = solid.specific_heat.zip(solid.density).map(|(heat, density)| heat * density);
        if transient && stores.is_none() {
            lacks.push("*SPECIFIC HEAT and *DENSITY (a transient step needs both)");
        }
        if !lacks.is_empty() && !solid.spoiled && of_element.contains(&Some(number)) {
            faults.push(solid.place.fault(format!("{} has no {}", solid.name, lacks.join(", no "))));
        }
        let (young, poisson) = solid.elastic.unwrap_or_default();
        list.push(Material {
            name: solid.name.clone(),
            young,
            poisson,
            expansion: solid.expansion.unwrap_or_default(),
            conductivity: solid.conductivity.unwrap_or_default(),
            capacity: stores,
        });
    }
    Some(Materials { list, of_element: of_element.into_iter().collect::<Option<_>>()? })
}
