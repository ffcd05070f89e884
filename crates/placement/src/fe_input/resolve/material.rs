//! What each element is made of.

use super::super::material::{CONDUCTIVITY, DENSITY, EXPANSION, POISSON, SPECIFIC_HEAT, YOUNG};
use super::super::raw::Target;
use super::Resolver;
use crate::body::{Case, Material, Materials};

pub(super) fn materials(resolver: &mut Resolver<'_>) -> Option<Materials> {
    let raw = resolver.raw;
    let mut of_element: Vec<Option<usize>> = vec![None; resolver.mesh.elements.len()];
    let before = resolver.faults.len();
    for (set, material, at) in &raw.sections {
        let Some(number) = raw.materials.iter().position(|known| known.name == *material) else {
            resolver.faults.push(at.fault(format!("material {material} is not defined")));
            continue;
        };
        for element in resolver.elements(&Target::Set(set.clone()), at) {
            if of_element[element].replace(number).is_some_and(|other| other != number) {
                let id = resolver.mesh.elements[element].id;
                resolver.faults.push(at.fault(format!("element {id} has a material already")));
            }
        }
    }
    let without = of_element.iter().filter(|material| material.is_none()).count();
    if let Some(first) = of_element.iter().position(Option::is_none)
        && resolver.faults.len() == before
    {
        resolver.faults.push(raw.elements[first].3.fault(format!(
            "{without} elements have no material, the first is {}: write *SOLID SECTION, ELSET=…, MATERIAL=…",
            resolver.mesh.elements[first].id
        )));
    }
    let transient = raw.load.as_ref().is_some_and(|load| load.case != Case::Steady);
    let mut list = Vec::new();
    for (number, material) in raw.materials.iter().enumerate() {
        let property = |name: &str| material.properties.get(name).copied();
        let stores = property(SPECIFIC_HEAT).zip(property(DENSITY)).map(|(heat, density)| heat * density);
        let expansion = property(EXPANSION).unwrap_or_default();
        let needed = [
            (property(YOUNG).is_some(), "*ELASTIC"),
            (expansion.abs() > 0.0, "*EXPANSION"),
            (property(CONDUCTIVITY).is_some(), "*CONDUCTIVITY"),
            (!transient || stores.is_some(), "*SPECIFIC HEAT and *DENSITY (a transient step needs both)"),
        ];
        let lacks: Vec<&str> =
            needed.iter().filter(|(is_there, _)| !is_there).map(|(_, card)| *card).collect();
        if !lacks.is_empty() && !material.spoiled && of_element.contains(&Some(number)) {
            let message = format!("{} has no {}", material.name, lacks.join(", no "));
            resolver.faults.push(material.at.fault(message));
        }
        list.push(Material {
            name: material.name.clone(),
            young: property(YOUNG).unwrap_or_default(),
            poisson: property(POISSON).unwrap_or_default(),
            expansion,
            conductivity: property(CONDUCTIVITY).unwrap_or_default(),
            capacity: stores,
        });
    }
    Some(Materials { list, of_element: of_element.into_iter().collect::<Option<_>>()? })
}
