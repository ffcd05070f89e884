//! Materials, sections and initial temperatures.

use std::collections::BTreeMap;

use super::Fault;
use super::card::{Card, Line};
use super::raw::{Material, Raw, Target};

pub(super) const YOUNG: &str = "Young's modulus";
pub(super) const POISSON: &str = "Poisson's ratio";
pub(super) const EXPANSION: &str = "expansion";
pub(super) const CONDUCTIVITY: &str = "conductivity";
pub(super) const SPECIFIC_HEAT: &str = "specific heat";
pub(super) const DENSITY: &str = "density";

/// What a value must lie between to be in the unit that is named.
fn bounds(name: &str) -> (f64, f64, &'static str) {
    match name {
        // Lead to diamond.
        YOUNG => (1e1, 2e6, "MPa (cast iron has about 110000)"),
        EXPANSION => (-1e-3, 1e-3, "1/K (cast iron has about 1.1e-5)"),
        CONDUCTIVITY => (1e-3, 1e5, "mW/(mm·K) (cast iron has about 50)"),
        SPECIFIC_HEAT => (1e7, 1e11, "mJ/(t·K) (cast iron has about 5e8)"),
        DENSITY => (1e-12, 1e-7, "t/mm³ (cast iron has about 7.2e-9)"),
        _ => (f64::MIN, f64::MAX, ""),
    }
}

pub(super) fn material(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let name = card.value("NAME").filter(|name| !name.is_empty());
    let name = name.ok_or_else(|| card.fault("names no material: write NAME="))?;
    if let Some(known) = raw.materials.iter().find(|known| known.name == name) {
        return Err(card.fault(format!("{name} is defined already in line {}", known.at.line)));
    }
    raw.materials.push(Material { name, at: card.at.clone(), properties: BTreeMap::new(), spoiled: false });
    Ok(())
}

pub(super) fn property(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let values = values(card);
    let material = raw.materials.last_mut().ok_or_else(|| card.fault("belongs under a *MATERIAL"))?;
    material.spoiled |= values.is_err();
    for (name, value) in values? {
        if material.properties.insert(name, value).is_some() {
            material.spoiled = true;
            return Err(card.fault(format!("{} has this already", material.name)));
        }
    }
    Ok(())
}

const CONSTANT: &str =
    "a material that changes with temperature is not read: give the value at working temperature";

/// The values of a card of one property, by their names.
fn values(card: &Card) -> Result<Vec<(&'static str, f64)>, Fault> {
    if let Some(kind) = card.value("TYPE").filter(|kind| kind != "ISO" && kind != "ISOTROPIC") {
        return Err(card.fault(format!("TYPE={kind}: materials are the same in all directions (TYPE=ISO)")));
    }
    let names: &[&'static str] = match card.key.as_str() {
        "ELASTIC" => &[YOUNG, POISSON],
        "EXPANSION" => &[EXPANSION],
        "CONDUCTIVITY" => &[CONDUCTIVITY],
        "SPECIFICHEAT" => &[SPECIFIC_HEAT],
        _ => &[DENSITY],
    };
    let [line] = &card.lines[..] else {
        return Err(card.fault(if card.lines.is_empty() { "has no value" } else { CONSTANT }));
    };
    if line.len() == names.len() + 1 {
        return Err(line.fault(format!(
            "{} values where {} belong ({}): a decimal comma makes two values of one (write 1.5, not 1,5), and a \
             temperature does not belong here, since {CONSTANT}",
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
            "the {name} is {value:e}, which cannot be in {unit}: the file is read in mm, N, s, t and K"
        )));
    }
    if name == POISSON && !(value > -1.0 && value < 0.5) {
        return Err(line.fault(format!("Poisson's ratio is {value}; it lies between -1 and 0.5")));
    }
    Ok(value)
}

pub(super) fn section(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let (Some(set), Some(material)) = (card.value("ELSET"), card.value("MATERIAL")) else {
        return Err(card.fault("needs ELSET= and MATERIAL="));
    };
    // PrePoMax writes a thickness of nothing under a solid section.
    let thickness = card
        .lines
        .iter()
        .find(|line| line.values().any(|text| !text.trim_matches(['1', '.', ' ']).is_empty()));
    if let Some(line) = thickness {
        return Err(line.fault("a solid has no thickness: take this line out"));
    }
    raw.sections.push((set, material, card.at.clone()));
    Ok(())
}

pub(super) fn initial(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    if card.value("TYPE").as_deref() != Some("TEMPERATURE") {
        return Err(card.fault("only TYPE=TEMPERATURE is read"));
    }
    let initial = card.each(&mut raw.faults, |line| {
        line.exactly(&["node or set", "temperature"])?;
        Ok((Target::of(line.text(0)), line.number(1, "temperature")?, line.at.clone()))
    });
    raw.initial.extend(initial);
    Ok(())
}
