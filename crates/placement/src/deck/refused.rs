//! Cards that are known and refused, with what to do instead; and cards nobody knows.

use super::card::Card;
use super::{load, model, solid};

const REFUSED: [(&str, &str); 26] = [
    (
        "RADIATE",
        "radiation is not linear; put it into the film coefficient: *FILM with 4·ε·σ·T³ more, about 0.005 mW/(mm²·K) \
         at room temperature",
    ),
    (
        "STATIC",
        "only heat-transfer steps are read: one deck for each load case with *HEAT TRANSFER; displacements follow from \
         its temperatures",
    ),
    (
        "TEMPERATURE",
        "temperatures are computed, not given: write what warms the structure (*FILM, *DFLUX, *CFLUX, or *BOUNDARY with \
         direction 11)",
    ),
    ("COUPLEDTEMPERATURE-DISPLACEMENT", "write *HEAT TRANSFER: displacements follow from its temperatures"),
    ("UNCOUPLEDTEMPERATURE-DISPLACEMENT", "write *HEAT TRANSFER: displacements follow from its temperatures"),
    ("CLOAD", "forces do not warm anything: take them out of the deck"),
    ("DLOAD", "pressures do not warm anything: take them out of the deck"),
    ("AMPLITUDE", "loads are constant over the step"),
    ("EQUATION", "only joints by common nodes are read: make one mesh of the parts"),
    ("MPC", "only joints by common nodes are read: make one mesh of the parts"),
    ("TIE", "only joints by common nodes are read: make one mesh of the parts"),
    ("RIGIDBODY", "only joints by common nodes are read: make one mesh of the parts"),
    ("COUPLING", "only joints by common nodes are read: make one mesh of the parts"),
    ("CONTACTPAIR", "only joints by common nodes are read: make one mesh of the parts"),
    ("SURFACEINTERACTION", "only joints by common nodes are read: make one mesh of the parts"),
    ("GAPCONDUCTANCE", "only joints by common nodes are read: make one mesh of the parts"),
    ("SHELLSECTION", "only solids are read: mesh the structure with C3D4 or C3D10"),
    ("BEAMSECTION", "only solids are read: mesh the structure with C3D4 or C3D10"),
    ("MEMBRANESECTION", "only solids are read: mesh the structure with C3D4 or C3D10"),
    ("ORIENTATION", "materials are the same in all directions"),
    ("TRANSFORM", "coordinates and directions are those of the mesh"),
    ("PLASTIC", "materials are linear: for warming by some kelvin that is what they are"),
    ("CREEP", "materials are linear: for warming by some kelvin that is what they are"),
    ("HYPERELASTIC", "materials are linear: for warming by some kelvin that is what they are"),
    ("CONTROLS", "the equations are linear: there is nothing to control"),
    ("RESTART", "each deck is computed from its beginning"),
];

/// Why a card is not read.
pub(super) fn why(card: &Card) -> String {
    if let Some((_, why)) = REFUSED.iter().find(|(key, _)| *key == card.key) {
        return format!("is not read: {why}");
    }
    let known = || {
        let own = ["HEADING", "INCLUDE", "STEP", "ENDSTEP", "BOUNDARY"];
        own.into_iter().chain(model::KEYS).chain(solid::KEYS).chain(load::KEYS)
    };
    let distance = |key: &&str| strsim::damerau_levenshtein(key, &card.key);
    match known().min_by_key(distance).filter(|key| distance(key) <= 2) {
        Some(near) => format!("no such card; did you mean *{}?", spoken(near)),
        None => {
            "this card is not understood, and none is passed over: take it out if it does not bear on the \
                 temperatures"
                .to_owned()
        }
    }
}

/// A key as it is written.
fn spoken(key: &str) -> &str {
    match key {
        "ENDSTEP" => "END STEP",
        "HEATTRANSFER" => "HEAT TRANSFER",
        "SPECIFICHEAT" => "SPECIFIC HEAT",
        "SOLIDSECTION" => "SOLID SECTION",
        "INITIALCONDITIONS" => "INITIAL CONDITIONS",
        "PHYSICALCONSTANTS" => "PHYSICAL CONSTANTS",
        "NODEPRINT" => "NODE PRINT",
        "NODEFILE" => "NODE FILE",
        "NODEOUTPUT" => "NODE OUTPUT",
        "ELPRINT" => "EL PRINT",
        "ELFILE" => "EL FILE",
        "ELEMENTOUTPUT" => "ELEMENT OUTPUT",
        key => key,
    }
}
