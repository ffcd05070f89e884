//! Materials, sections and initial temperatures.

use super::Fault;
use super::card::Card;
use super::fields::Fields;
use super::raw::{Raw, Solid, Target};

pub(super) const KEYS: [&str; 9] = [
    "MATERIAL",
    "ELASTIC",
    "EXPANSION",
    "CONDUCTIVITY",
    "SPECIFICHEAT",
    "DENSITY",
    "SOLIDSECTION",
    "INITIALCONDITIONS",
    "PHYSICALCONSTANTS",
];

pub(super) fn card(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) {
    let done = match card.key.as_str() {
        "MATERIAL" => material(raw, card, faults),
        "SOLIDSECTION" => section(raw, card, faults),
        "INITIALCONDITIONS" => initial(raw, card, faults),
        "PHYSICALCONSTANTS" => {
            // They only matter to radiation, which is refused.
            card.only(&["ABSOLUTEZERO", "STEFANBOLTZMANN", "NEWTONGRAVITY"], faults);
            Ok(())
        }
        _ => property(raw, card, faults).inspect_err(|_| {
            raw.solids.last_mut().into_iter().for_each(|solid| solid.spoiled = true);
        }),
    };
    faults.extend(done.err());
}

fn material(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) -> Result<(), Fault> {
    card.only(&["NAME"], faults);
    let name = card.value("NAME").filter(|name| !name.is_empty());
    let name = name.ok_or_else(|| card.place.fault("names no material: write NAME="))?;
    if let Some(known) = raw.solids.iter().find(|known| known.name == name) {
        return Err(card.place.fault(format!("{name} is defined already in line {}", known.place.line)));
    }
    raw.solids.push(Solid {
        name,
        place: card.place.clone(),
        elastic: None,
        expansion: None,
        conductivity: None,
        specific_heat: None,
        density: None,
        spoiled: false,
    });
    Ok(())
}

fn property(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) -> Result<(), Fault> {
    let known: &[&str] = match card.key.as_str() {
        "ELASTIC" => &["TYPE"],
        "EXPANSION" => &["TYPE", "ZERO"],
        "CONDUCTIVITY" => &["TYPE"],
        _ => &[],
    };
    card.only(known, faults);
    if let Some(kind) = card.value("TYPE").filter(|kind| kind != "ISO" && kind != "ISOTROPIC") {
        return Err(card
            .place
            .fault(format!("TYPE={kind}: materials are the same in all directions (TYPE=ISO)")));
    }
    let solid = raw.solids.last_mut().ok_or_else(|| card.place.fault("belongs under a *MATERIAL"))?;
    let [line] = &card.lines[..] else {
        let message = if card.lines.is_empty() { "has no value" } else { CONSTANT };
        return Err(card.place.fault(message));
    };
    let fields = Fields::of(line);
    let double = match card.key.as_str() {
        "ELASTIC" => {
            constant(&fields, &["Young's modulus", "Poisson's ratio"])?;
            let young = fields.number(0, "Young's modulus")?;
            let poisson = fields.number(1, "Poisson's ratio")?;
            // Lead to diamond, in MPa.
            within(&fields, young, 1e1, 2e6, "Young's modulus", "MPa (cast iron has about 110000)")?;
            if !(poisson > -1.0 && poisson < 0.5) {
                return Err(fields.fault(format!("Poisson's ratio is {poisson}; it lies between -1 and 0.5")));
            }
            solid.elastic.replace((young, poisson)).is_some()
        }
        key => {
            let (slot, name, least, most, unit) = match key {
                "EXPANSION" => {
                    (&mut solid.expansion, "expansion", -1e-3, 1e-3, "1/K (cast iron has about 1.1e-5)")
                }
                "CONDUCTIVITY" => {
                    (&mut solid.conductivity, "conductivity", 1e-3, 1e5, "mW/(mm·K) (cast iron has about 50)")
                }
                "SPECIFICHEAT" => (
                    &mut solid.specific_heat,
                    "specific heat",
                    1e7,
                    1e11,
                    "mJ/(t·K) (cast iron has about 5e8)",
                ),
                _ => (&mut solid.density, "density", 1e-12, 1e-7, "t/mm³ (cast iron has about 7.2e-9)"),
            };
            constant(&fields, &[name])?;
            let value = fields.number(0, name)?;
            within(&fields, value, least, most, name, unit)?;
            slot.replace(value).is_some()
        }
    };
    if double {
        return Err(card.place.fault(format!("{} has this already", solid.name)));
    }
    Ok(())
}

const CONSTANT: &str =
    "a material that changes with temperature is not read: give the value at working temperature";

fn constant(fields: &Fields<'_>, names: &[&str]) -> Result<(), Fault> {
    if fields.len() == names.len() + 1 {
        return Err(fields.fault(format!(
            "{} values where {} belong ({}): a decimal comma makes two values of one (write 1.5, not 1,5), and a \
             temperature does not belong here, since {CONSTANT}",
            fields.len(),
            names.len(),
            names.join(", ")
        )));
    }
    fields.exactly(names)
}

fn within(
    fields: &Fields<'_>,
    value: f64,
    least: f64,
    most: f64,
    name: &str,
    unit: &str,
) -> Result<(), Fault> {
    if value >= least && value <= most {
        return Ok(());
    }
    Err(fields.fault(format!(
        "the {name} is {value:e}, which cannot be in {unit}: the deck is read in mm, N, s, t and K"
    )))
}

fn section(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) -> Result<(), Fault> {
    card.only(&["ELSET", "MATERIAL"], faults);
    let (Some(set), Some(material)) = (card.value("ELSET"), card.value("MATERIAL")) else {
        return Err(card.place.fault("needs ELSET= and MATERIAL="));
    };
    // PrePoMax writes a thickness of nothing under a solid section.
    if let Some(line) =
        card.lines.iter().find(|line| !line.text.trim_matches([',', ' ', '1', '.']).is_empty())
    {
        return Err(line.place.fault("a solid has no thickness: take this line out"));
    }
    raw.sections.push((set, material, card.place.clone()));
    Ok(())
}

fn initial(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) -> Result<(), Fault> {
    card.only(&["TYPE"], faults);
    if card.value("TYPE").as_deref() != Some("TEMPERATURE") {
        return Err(card.place.fault("only TYPE=TEMPERATURE is read"));
    }
    for line in &card.lines {
        let fields = Fields::of(line);
        fields.exactly(&["node or set", "temperature"])?;
        let temperature = fields.number(1, "temperature")?;
        raw.initial.push((Target::of(fields.text(0)), temperature, line.place.clone()));
    }
    Ok(())
}
