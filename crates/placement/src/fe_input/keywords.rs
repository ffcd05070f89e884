//! Known keywords of FE input files, the order in which their cards are read, and the reasons for rejecting other
//! keywords. A card is a line with a keyword such as `*NODE`, together with the data lines below it.

use std::path::Path;

use super::card::{Card, INCLUDED, plain};
use super::reader::Reader;
use super::{Fault, Faults, FeInput, assembly, load, material, mesh};

/// Stage in which a card is read. All cards that it may refer to are in earlier stages. Cards of one stage are read in
/// the order of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Stage {
    Nodes,
    Elements,
    Sets,
    Surfaces,
    Materials,
    Sections,
    Boundary,
    Step,
    /// Cards for other programs, which have no effect here. They are allowed at any place of the file.
    Anywhere,
}

/// Stages of the cards that are read when the mesh is complete.
const STAGES_WITH_MESH: [Stage; 6] =
    [Stage::Surfaces, Stage::Materials, Stage::Sections, Stage::Boundary, Stage::Step, Stage::Anywhere];

/// Keyword, stage, allowed parameters (separated by blanks), and the function that reads the card.
type Keyword = (&'static str, Stage, &'static str, Read);
type Read = fn(&mut Reader, &Card) -> Result<(), Fault>;

const KEYWORDS: [Keyword; 35] = [
    ("BOUNDARY", Stage::Boundary, "OP", load::boundary),
    ("NODE", Stage::Nodes, "NSET", mesh::nodes),
    ("ELEMENT", Stage::Elements, "TYPE ELSET", mesh::elements),
    ("NSET", Stage::Sets, "NSET GENERATE INTERNAL UNSORTED", mesh::set),
    ("ELSET", Stage::Sets, "ELSET GENERATE INTERNAL UNSORTED", mesh::set),
    ("SURFACE", Stage::Surfaces, "TYPE INTERNAL", mesh::surface),
    ("MATERIAL", Stage::Materials, "", material::material),
    ("ELASTIC", Stage::Materials, "TYPE", material::property),
    ("EXPANSION", Stage::Materials, "TYPE ZERO", material::property),
    ("CONDUCTIVITY", Stage::Materials, "TYPE", material::property),
    ("SPECIFIC HEAT", Stage::Materials, "", material::property),
    ("DENSITY", Stage::Materials, "", material::property),
    ("SOLID SECTION", Stage::Sections, "ELSET MATERIAL", material::section),
    ("INITIAL CONDITIONS", Stage::Sections, "TYPE", load::initial),
    // Physical constants affect only radiation, which is rejected.
    ("PHYSICAL CONSTANTS", Stage::Materials, CONSTANTS, |_, _| Ok(())),
    ("HEAT TRANSFER", Stage::Step, HEAT_TRANSFER, load::heat_transfer),
    ("COUPLED TEMPERATURE-DISPLACEMENT", Stage::Step, HEAT_TRANSFER, load::heat_transfer),
    ("UNCOUPLED TEMPERATURE-DISPLACEMENT", Stage::Step, HEAT_TRANSFER, load::heat_transfer),
    ("FILM", Stage::Step, "OP", load::films),
    ("DFLUX", Stage::Step, "OP", load::fluxes),
    // Abaqus/CAE writes the loads of surfaces with these keywords.
    ("SFILM", Stage::Step, "OP", load::films),
    ("DSFLUX", Stage::Step, "OP", load::fluxes),
    ("CFLUX", Stage::Step, "OP", load::nodal),
    ("NODE PRINT", Stage::Step, PRINTED, load::printed),
    ("NODE FILE", Stage::Step, PRINTED, load::printed),
    ("NODE OUTPUT", Stage::Step, PRINTED, load::printed),
    ("EL PRINT", Stage::Step, PRINTED, load::printed),
    ("EL FILE", Stage::Step, PRINTED, load::printed),
    ("ELEMENT OUTPUT", Stage::Step, PRINTED, load::printed),
    ("OUTPUT", Stage::Step, PRINTED, load::printed),
    ("CONTACT FILE", Stage::Step, PRINTED, load::printed),
    ("ENERGY OUTPUT", Stage::Step, PRINTED, load::printed),
    // The equations are linear: parameters of the iteration have no effect.
    ("CONTROLS", Stage::Anywhere, "PARAMETERS RESET ANALYSIS FIELD TYPE", |_, _| Ok(())),
    ("PREPRINT", Stage::Anywhere, "ECHO MODEL HISTORY CONTACT", |_, _| Ok(())),
    ("RESTART", Stage::Anywhere, "READ WRITE FREQUENCY OVERLAY NUMBERINTERVAL STEP INC", load::restart),
];

const CONSTANTS: &str = "ABSOLUTEZERO STEFANBOLTZMANN NEWTONGRAVITY";
/// Allowed parameters of the cards that begin the calculation, such as `*HEAT TRANSFER`. DELTMX and MXDEM control the
/// time steps of other programs.
const HEAT_TRANSFER: &str = "STEADYSTATE DIRECT SOLVER END DELTMX MXDEM";
/// Allowed parameters of the card `*STEP`. NLGEOM (large deformations) has no effect, because the calculated
/// deformations are small.
const STEP: &str = "INC AMPLITUDE NLGEOM UNSYMM EXTRAPOLATION";
const PRINTED: &str = "NSET ELSET FREQUENCY FREQUENCYF TOTALS GLOBAL OUTPUT TIMEPOINTS NODES 2D 3D FIELD HISTORY VARIABLE OP \
                       NUMBERINTERVAL TIMEINTERVAL DIRECTIONS LASTITERATIONS CONTACTELEMENTS SURFACE";

/// Reads the cards. Returns the content of the files, or all errors, including the errors that `faults`
/// already contains.
pub(super) fn read(path: &Path, cards: Vec<Card>, mut faults: Faults) -> Result<FeInput, Faults> {
    let Some(cards) = assembly::without_parts(cards, &mut faults) else { return Err(faults) };
    let known = known(&cards, &mut faults);
    let before = faults.len();
    let mut reader = Reader::default();
    reader.faults = faults;
    let read = |reader: &mut Reader, stage: Stage| {
        for (_, card, read) in known.iter().filter(|(known, ..)| *known == stage) {
            let done = read(reader, card);
            reader.faults.extend(done.err());
        }
    };
    read(&mut reader, Stage::Nodes);
    reader.sort_nodes();
    read(&mut reader, Stage::Elements);
    if reader.mesh.elements.is_empty() && reader.faults.is_empty() {
        let why = match reader.outlines.is_empty() {
            true => "the file has no elements: does it include its mesh?",
            false => {
                "the file has lines and surfaces, but no tetrahedra: mesh the volume too, with Gmsh by `gmsh -3`"
            }
        };
        reader.faults.push(Fault::of_file(path, why));
    }
    reader.is_spoiled |= reader.faults.len() > before || reader.mesh.elements.is_empty();
    if !reader.is_spoiled {
        reader.remove_free_nodes();
    }
    reader.begin_sets();
    read(&mut reader, Stage::Sets);
    reader.find_surfaces();
    reader.check_mesh();
    for stage in STAGES_WITH_MESH {
        read(&mut reader, stage);
    }
    let materials = material::finish(&mut reader);
    let supports = load::supports(&mut reader);
    let load = load::finish(path, &mut reader);
    let Reader { mesh, faults, .. } = reader;
    match (materials, load) {
        (Some(materials), Some((load, surfaces))) if faults.is_empty() => {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            Ok(FeInput { name, mesh, materials, load, surfaces, supports })
        }
        _ => Err(faults),
    }
}

/// Returns the known cards with their stages and reader functions. Unknown or misplaced cards are added to `faults`.
fn known<'a>(cards: &'a [Card], faults: &mut Faults) -> Vec<(Stage, &'a Card, Read)> {
    let mut known = Vec::new();
    // The card that began the step, and whether the step has ended.
    let (mut began, mut ended) = (None, false);
    for card in cards {
        match card.key.as_str() {
            "HEADING" | INCLUDED => {}
            "STEP" if began.is_none() => {
                card.only(STEP, faults);
                began = Some(card);
            }
            "STEP" => {
                let message =
                    "a second step: an FE input file has one load case; write one file for each load case";
                faults.push(card.fault(message));
                return known;
            }
            "ENDSTEP" if began.is_some() && !ended => ended = true,
            "ENDSTEP" => faults.push(
                card.fault("there is no step to end: write *STEP above, or take this card out of the file"),
            ),
            key => match KEYWORDS.iter().find(|(name, ..)| plain(name) == key) {
                Some((_, stage, parameters, read)) => {
                    let misplaced = match stage {
                        Stage::Boundary => ended.then_some("the card must be before *END STEP"),
                        Stage::Step if began.is_some() && !ended => None,
                        Stage::Step => Some("the card must be between *STEP and *END STEP"),
                        Stage::Anywhere => None,
                        _ => began.map(|_| "the card must be before *STEP"),
                    };
                    faults.extend(misplaced.map(|message| card.fault(message)));
                    card.only(parameters, faults);
                    known.push((*stage, card, *read));
                }
                None if removes_loads(card) => {}
                None => faults.push(card.fault(why_refused(key))),
            },
        }
    }
    let ramp = began.filter(|step| step.value("AMPLITUDE").is_some_and(|how| how == "RAMP"));
    if let Some(step) = ramp.filter(|_| known.iter().any(|(_, card, _)| is_transient(card))) {
        faults.push(step.fault(
            "AMPLITUDE=RAMP: the loads would grow during the step, and only constant loads are supported: remove \
             AMPLITUDE=RAMP if the loads are constant",
        ));
    }
    match (began, cards.last()) {
        (None, Some(last)) => faults
            .push(last.fault("the file ends without a step: write *STEP, *HEAT TRANSFER, loads, *END STEP")),
        (Some(step), _) if !ended => faults.push(step.fault("the step is not ended: *END STEP is missing")),
        _ => {}
    }
    known
}

/// Returns whether the card begins a calculation over time (transient). In a steady state, the growth of the loads
/// during the step has no effect.
fn is_transient(card: &Card) -> bool {
    let begins = ["HEATTRANSFER", "COUPLEDTEMPERATURE-DISPLACEMENT", "UNCOUPLEDTEMPERATURE-DISPLACEMENT"];
    begins.contains(&card.key.as_str()) && !card.has("STEADYSTATE")
}

/// Returns whether the card only removes the loads of an earlier step. Such a card has no effect, because a file has
/// one step only. PrePoMax writes such cards.
fn removes_loads(card: &Card) -> bool {
    let is_load = ["CLOAD", "DLOAD", "DSLOAD", "RADIATE", "SRADIATE"].contains(&card.key.as_str());
    is_load && card.lines.is_empty() && card.value("OP").is_some_and(|op| op == "NEW")
}

/// Keywords of cards that are known but rejected, each with the reason and a remedy.
const REFUSED: [(&str, &str); 12] = [
    (
        "RADIATE",
        "radiation is not linear; write *FILM with a film coefficient that is greater by 4·ε·σ·T³ (about 0.005 \
         mW/(mm²·K) at room temperature)",
    ),
    (
        "STATIC",
        "only heat-transfer steps are read: write one file for each load case, with *HEAT TRANSFER; \
         displacements are computed from the temperatures",
    ),
    (
        "TEMPERATURE",
        "temperatures are computed, not given: write what warms the structure (*FILM, *DFLUX, *CFLUX, or *BOUNDARY with \
         direction 11)",
    ),
    ("CLOAD", "forces do not warm anything: take them out of the file"),
    ("DLOAD DSLOAD", "pressures do not warm anything: take them out of the file"),
    (
        "AMPLITUDE",
        "only loads that are constant during the step are supported: take the card out of the file",
    ),
    (
        "SRADIATE",
        "radiation is not linear; write *SFILM with a film coefficient that is greater by 4·ε·σ·T³ (about 0.005 \
         mW/(mm²·K) at room temperature)",
    ),
    (
        "EQUATION MPC TIE RIGIDBODY COUPLING CONTACTPAIR SURFACEINTERACTION GAPCONDUCTANCE",
        "only joints by common nodes are read: make one mesh of the parts",
    ),
    (
        "SHELLSECTION BEAMSECTION MEMBRANESECTION",
        "only solids are read: mesh the structure with C3D4 or C3D10",
    ),
    (
        "ORIENTATION",
        "only materials with the same properties in all directions are supported: take the card out of the \
         file",
    ),
    (
        "TRANSFORM",
        "only the coordinate system of the mesh is supported: take the card out of the file, and give \
         directions in the coordinates of the mesh",
    ),
    (
        "PLASTIC CREEP HYPERELASTIC",
        "only linear materials are supported, which is accurate for temperature rises of some kelvin: take \
         the card out of the file",
    ),
];

fn why_refused(key: &str) -> String {
    if let Some((_, why)) = REFUSED.iter().find(|(keys, _)| keys.split(' ').any(|known| known == key)) {
        return format!("this card is not supported: {why}");
    }
    let known = ["HEADING", "INCLUDE", "STEP", "END STEP"].into_iter();
    let known = known.chain(KEYWORDS.map(|(name, ..)| name));
    let known = known.filter(|name| plain(name).len().abs_diff(key.len()) <= 2);
    let distances = known.map(|name| (strsim::damerau_levenshtein(&plain(name), key), name));
    match distances.min_by_key(|(distance, _)| *distance) {
        Some((0..=2, near)) => format!("no such card; did you mean *{near}?"),
        _ => "this card is not supported: remove it if it does not affect the temperatures".to_owned(),
    }
}
