//! Each card to its reader: which cards there are, where each belongs, and what is said of all others.

use super::Fault;
use super::card::{Card, INCLUDED, plain};
use super::raw::Raw;
use super::{load, material, model};

/// Where in the file a card belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Belongs {
    BeforeStep,
    InStep,
    BeforeEnd,
}
use Belongs::{BeforeEnd, BeforeStep, InStep};

/// Keyword, where it belongs, the parameters it may have, and its reader.
type Keyword = (&'static str, Belongs, &'static [&'static str], Reader);
type Reader = fn(&mut Raw, &Card) -> Result<(), Fault>;

const KEYWORDS: [Keyword; 27] = [
    ("BOUNDARY", BeforeEnd, &["OP"], load::boundary),
    ("NODE", BeforeStep, &["NSET"], model::nodes),
    ("ELEMENT", BeforeStep, &["TYPE", "ELSET"], model::elements),
    ("NSET", BeforeStep, &["NSET", "GENERATE"], model::node_set),
    ("ELSET", BeforeStep, &["ELSET", "GENERATE"], model::element_set),
    ("SURFACE", BeforeStep, &["NAME", "TYPE"], model::surface),
    ("MATERIAL", BeforeStep, &["NAME"], material::material),
    ("ELASTIC", BeforeStep, &["TYPE"], material::property),
    ("EXPANSION", BeforeStep, &["TYPE", "ZERO"], material::property),
    ("CONDUCTIVITY", BeforeStep, &["TYPE"], material::property),
    ("SPECIFIC HEAT", BeforeStep, &[], material::property),
    ("DENSITY", BeforeStep, &[], material::property),
    ("SOLID SECTION", BeforeStep, &["ELSET", "MATERIAL"], material::section),
    ("INITIAL CONDITIONS", BeforeStep, &["TYPE"], material::initial),
    // They only matter to radiation, which is refused.
    ("PHYSICAL CONSTANTS", BeforeStep, &["ABSOLUTEZERO", "STEFANBOLTZMANN", "NEWTONGRAVITY"], |_, _| Ok(())),
    ("HEAT TRANSFER", InStep, &["STEADYSTATE", "DIRECT", "SOLVER"], load::heat_transfer),
    ("FILM", InStep, &["OP"], load::films),
    ("DFLUX", InStep, &["OP"], load::fluxes),
    ("CFLUX", InStep, &["OP"], load::nodal),
    ("NODE PRINT", InStep, PRINTED, load::printed),
    ("NODE FILE", InStep, PRINTED, load::printed),
    ("NODE OUTPUT", InStep, PRINTED, load::printed),
    ("EL PRINT", InStep, PRINTED, load::printed),
    ("EL FILE", InStep, PRINTED, load::printed),
    ("ELEMENT OUTPUT", InStep, PRINTED, load::printed),
    ("OUTPUT", InStep, PRINTED, load::printed),
    ("CONTACT FILE", InStep, PRINTED, load::printed),
];

const PRINTED: &[&str] = &[
    "NSET",
    "ELSET",
    "FREQUENCY",
    "FREQUENCYF",
    "TOTALS",
    "GLOBAL",
    "OUTPUT",
    "TIMEPOINTS",
    "NODES",
    "2D",
    "3D",
];

/// What the cards say, in numbers and names.
pub(super) fn parse(cards: &[Card], faults: Vec<Fault>) -> Raw {
    let mut raw = Raw { faults, ..Raw::default() };
    // The card that began the step; whether it has ended.
    let (mut began, mut ended) = (None, false);
    for card in cards {
        let inside = began.is_some() && !ended;
        match card.key.as_str() {
            "HEADING" | INCLUDED => {}
            "STEP" if began.is_none() => {
                card.only(&["INC", "AMPLITUDE"], &mut raw.faults);
                began = Some(card);
            }
            "STEP" => {
                let message = "a second step: an FE input file is one load case, write one file for each";
                raw.faults.push(card.fault(message));
                return raw;
            }
            "ENDSTEP" if inside => ended = true,
            "ENDSTEP" => raw.faults.push(card.fault("there is no step to end")),
            key => match KEYWORDS.iter().find(|(name, ..)| plain(name) == key) {
                Some((_, belongs, parameters, read)) => {
                    let misplaced = match belongs {
                        BeforeStep if began.is_some() => Some("belongs before *STEP"),
                        InStep if !inside => Some("belongs between *STEP and *END STEP"),
                        BeforeEnd if ended => Some("belongs before *END STEP"),
                        _ => None,
                    };
                    raw.faults.extend(misplaced.map(|message| card.fault(message)));
                    card.only(parameters, &mut raw.faults);
                    let read = read(&mut raw, card);
                    raw.faults.extend(read.err());
                }
                None => raw.faults.push(card.fault(why_refused(key))),
            },
        }
    }
    match began {
        None => raw.faults.extend(cards.last().map(|card| {
            card.fault("the file ends without a step: write *STEP, *HEAT TRANSFER, loads, *END STEP")
        })),
        Some(step) if !ended => {
            raw.faults.push(step.fault("the step is not ended: *END STEP is missing"));
        }
        _ => {}
    }
    raw
}

/// Cards that are known and refused, with what to do instead.
const REFUSED: [(&[&str], &str); 14] = [
    (
        &["RADIATE"],
        "radiation is not linear; put it into the film coefficient: *FILM with 4·ε·σ·T³ more, about 0.005 mW/(mm²·K) \
         at room temperature",
    ),
    (
        &["STATIC"],
        "only heat-transfer steps are read: one file for each load case with *HEAT TRANSFER; displacements follow from \
         its temperatures",
    ),
    (
        &["TEMPERATURE"],
        "temperatures are computed, not given: write what warms the structure (*FILM, *DFLUX, *CFLUX, or *BOUNDARY with \
         direction 11)",
    ),
    (
        &["COUPLEDTEMPERATURE-DISPLACEMENT", "UNCOUPLEDTEMPERATURE-DISPLACEMENT"],
        "write *HEAT TRANSFER: displacements follow from its temperatures",
    ),
    (&["CLOAD"], "forces do not warm anything: take them out of the file"),
    (&["DLOAD"], "pressures do not warm anything: take them out of the file"),
    (&["AMPLITUDE"], "loads are constant over the step"),
    (
        &[
            "EQUATION",
            "MPC",
            "TIE",
            "RIGIDBODY",
            "COUPLING",
            "CONTACTPAIR",
            "SURFACEINTERACTION",
            "GAPCONDUCTANCE",
        ],
        "only joints by common nodes are read: make one mesh of the parts",
    ),
    (
        &["SHELLSECTION", "BEAMSECTION", "MEMBRANESECTION"],
        "only solids are read: mesh the structure with C3D4 or C3D10",
    ),
    (&["ORIENTATION"], "materials are the same in all directions"),
    (&["TRANSFORM"], "coordinates and directions are those of the mesh"),
    (
        &["PLASTIC", "CREEP", "HYPERELASTIC"],
        "materials are linear: for warming by some kelvin that is what they are",
    ),
    (&["CONTROLS"], "the equations are linear: there is nothing to control"),
    (&["RESTART"], "each file is computed from its beginning"),
];

fn why_refused(key: &str) -> String {
    if let Some((_, why)) = REFUSED.iter().find(|(keys, _)| keys.contains(&key)) {
        return format!("is not read: {why}");
    }
    let known = ["HEADING", "INCLUDE", "STEP", "END STEP"].into_iter();
    let known = known.chain(KEYWORDS.map(|(name, ..)| name));
    let distances = known.map(|name| (strsim::damerau_levenshtein(&plain(name), key), name));
    match distances.min_by_key(|(distance, _)| *distance) {
        Some((0..=2, near)) => format!("no such card; did you mean *{near}?"),
        _ => "this card is not understood, and none is passed over: take it out if it does not bear on the temperatures"
            .to_owned(),
    }
}
