//! Reader functions of the cards that define materials and assign them to elements. A card is a line with a
//! keyword such as `*NODE`, together with the data lines below it.

use std::collections::BTreeMap;

use super::Fault;
use super::card::{Card, Line, Location};
use super::reader::Reader;
use crate::body::{Case, Material, Materials};

/// Material that is being read, with the properties of the cards so far.
pub(super) struct Draft {
    name: String,
    at: Location,
    /// Values by the names of the properties, for example [`YOUNG`].
    properties: BTreeMap<&'static str, f64>,
    /// Whether a card of the material is wrong. Missing properties of this material are then not reported in addition.
    is_spoiled: bool,
}

const YOUNG: &str = "Young's modulus";
const POISSON: &str = "Poisson's ratio";
const EXPANSION: &str = "expansion";
const CONDUCTIVITY: &str = "conductivity";
const SPECIFIC_HEAT: &str = "specific heat";
const DENSITY: &str = "density";

/// Returns the range of plausible values of a property, and its unit with an example.
fn bounds(name: &str) -> (f64, f64, &'static str) {
    match name {
        // From lead to diamond.
        YOUNG => (1e1, 2e6, "MPa (cast iron has about 110000)"),
        EXPANSION => (-1e-3, 1e-3, "1/K (cast iron has about 1.1e-5)"),
        CONDUCTIVITY => (1e-3, 1e5, "mW/(mm·K) (cast iron has about 50)"),
        SPECIFIC_HEAT => (1e7, 1e11, "mJ/(t·K) (cast iron has about 5e8)"),
        DENSITY => (1e-12, 1e-7, "t/mm³ (cast iron has about 7.2e-9)"),
        _ => (f64::MIN, f64::MAX, ""),
    }
}

pub(super) fn material(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    let name = card.value("NAME").filter(|name| !name.is_empty());
    let name = name.ok_or_else(|| card.fault("the card names no material: write NAME="))?;
    if let Some(known) = reader.materials.iter().find(|known| known.name == name) {
        return Err(card.fault(format!(
            "{name} is defined already in line {}: remove one of the two definitions",
            known.at.line
        )));
    }
    let (at, properties) = (card.at.clone(), BTreeMap::new());
    reader.materials.push(Draft { name, at, properties, is_spoiled: false });
    Ok(())
}

pub(super) fn property(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    let values = values(card);
    let material =
        reader.materials.last_mut().ok_or_else(|| card.fault("the card must be after a *MATERIAL"))?;
    material.is_spoiled |= values.is_err();
    for (name, value) in values? {
        if material.properties.insert(name, value).is_some() {
            material.is_spoiled = true;
            return Err(
                card.fault(format!("{} has this card already: remove one of the two cards", material.name))
            );
        }
    }
    Ok(())
}

const CONSTANT: &str = "material values that depend on the temperature are not supported: write the value at the \
                        working temperature";

/// Returns the values of a property card with the names of their properties.
fn values(card: &Card) -> Result<Vec<(&'static str, f64)>, Fault> {
    if let Some(kind) = card.value("TYPE").filter(|kind| kind != "ISO" && kind != "ISOTROPIC") {
        return Err(card.fault(format!(
            "TYPE={kind}: only materials with the same properties in all directions are supported (TYPE=ISO)"
        )));
    }
    let names: &[&'static str] = match card.key.as_str() {
        "ELASTIC" => &[YOUNG, POISSON],
        "EXPANSION" => &[EXPANSION],
        "CONDUCTIVITY" => &[CONDUCTIVITY],
        "SPECIFICHEAT" => &[SPECIFIC_HEAT],
        _ => &[DENSITY],
    };
    let [line] = &card.lines[..] else {
        return Err(card.fault(if card.lines.is_empty() {
            "the card has no value: write it in the next line"
        } else {
            CONSTANT
        }));
    };
    if line.len() == names.len() + 1 {
        return Err(line.fault(format!(
            "the card has {} values, but {} are required ({}): a decimal comma divides a number into two \
             values (write 1.5, not 1,5). A temperature is not allowed here: {CONSTANT}",
            line.len(),
            names.len(),
            names.join(", ")
        )));
    }
    line.exactly(names)?;
    names.iter().enumerate().map(|(place, name)| Ok((*name, value(line, place, name)?))).collect()
}

fn value(line: &Line, place: usize, name: &str) -> Result<f64, Fault> {
    let value = line.number(place, name)?;
    let (least, most, unit) = bounds(name);
    if !(least..=most).contains(&value) {
        return Err(line.fault(format!(
            "the {name} is {value:e}, which is not plausible in {unit}: the units of the file must be mm, N, s, t and K"
        )));
    }
    if name == POISSON && !(value > -1.0 && value < 0.5) {
        return Err(line.fault(format!("Poisson's ratio is {value}; it must be between -1 and 0.5")));
    }
    Ok(value)
}

pub(super) fn section(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    let (Some(set), Some(material)) = (card.value("ELSET"), card.value("MATERIAL")) else {
        return Err(card.fault("the card needs ELSET= and MATERIAL="));
    };
    // PrePoMax writes a thickness of 1 under a solid section.
    let is_thick = |line: &&Line| line.values().any(|text| !text.trim_matches(['1', '.', ' ']).is_empty());
    if let Some(line) = card.lines.iter().find(is_thick) {
        return Err(line.fault("a solid has no thickness: remove this line"));
    }
    let number = reader.materials.iter().position(|known| known.name == material);
    let number = number.ok_or_else(|| {
        card.fault(format!("material {material} is not defined: write *MATERIAL, NAME={material} above"))
    })?;
    for element in reader.elements(&set, &card.at) {
        if reader.of_element[element].replace(number).is_some_and(|other| other != number) {
            let id = reader.mesh.elements[element].id;
            reader.faults.push(card.fault(format!(
                "element {id} has another material already: take the element out of one of the sets"
            )));
        }
    }
    Ok(())
}

/// Returns the materials; `None` if an element has no material. Adds an error for each missing material and property.
pub(super) fn finish(reader: &mut Reader) -> Option<Materials> {
    let missing = reader.of_element.iter().filter(|material| material.is_none()).count();
    let is_reported = reader.faults.described.iter().any(|fault| fault.card == "*SOLID SECTION");
    if let Some(first) = reader.of_element.iter().position(Option::is_none).filter(|_| !is_reported) {
        let id = reader.mesh.elements[first].id;
        let message = format!(
            "{missing} elements have no material, the first is {id}: write *SOLID SECTION, ELSET=…, MATERIAL=…"
        );
        let at = reader.element_at[first].clone();
        reader.missed(&at, message);
    }
    let transient = reader.case.is_some_and(|case| case != Case::Steady);
    let mut list = Vec::new();
    for (number, draft) in reader.materials.iter().enumerate() {
        let property = |name: &str| draft.properties.get(name).copied();
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
        if !lacks.is_empty() && !draft.is_spoiled && reader.of_element.contains(&Some(number)) {
            let message = format!("{} has no {}", draft.name, lacks.join(", no "));
            reader.faults.push(draft.at.fault(message));
        }
        list.push(Material {
            name: draft.name.clone(),
            young: property(YOUNG).unwrap_or_default(),
            poisson: property(POISSON).unwrap_or_default(),
            expansion,
            conductivity: property(CONDUCTIVITY).unwrap_or_default(),
            capacity: stores,
        });
    }
    Some(Materials { list, of_element: reader.of_element.iter().copied().collect::<Option<_>>()? })
}
