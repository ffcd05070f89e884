//! Reader functions of the cards of a load case: initial temperatures, prescribed temperatures, and the step.
//! The step contains heat transfer, films, fluxes, and print requests. A card is a line with a keyword such
//! as `*NODE`, together with the data lines below it.

use std::path::Path;

use super::card::{Card, Line, quoted};
use super::mesh::side;
use super::reader::Reader;
use super::temperature::{self, Scale};
use super::{Fault, SurfaceNames};
use crate::body::{Case, Film, Flux, LoadCase};

/// Reads the card of the step. A coupled step (temperatures and displacements) is read as heat transfer, because
/// isotherm computes the displacements from the temperatures.
pub(super) fn heat_transfer(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    if reader.case.is_some() {
        return Err(card.fault("the step has this card already: remove one of the two cards"));
    }
    if card.value("END").is_some_and(|end| end == "SS") {
        return Err(card.fault(
            "END=SS: the end of the period would depend on the solver; write STEADY STATE, or leave END out",
        ));
    }
    let case = if card.has("STEADYSTATE") { Ok(Case::Steady) } else { transient(card) };
    // After an error in this line, the loads that follow must not be reported as misplaced.
    reader.case = Some(*case.as_ref().unwrap_or(&Case::Steady));
    if let Some(solver) = card.value("SOLVER").filter(|solver| solver != "SPOOLES") {
        return Err(card.fault(format!(
            "SOLVER={solver}: the file cannot choose the solver, because this solver is not available \
             everywhere: leave SOLVER out"
        )));
    }
    case.map(drop)
}

/// Maximum number of time steps in a load case. A larger number would require too much computing time.
const MOST_STEPS: f64 = 100_000.0;

fn transient(card: &Card) -> Result<Case, Fault> {
    let [line] = &card.lines[..] else {
        return Err(
            card.fault("a transient step needs one line: step in s, period in s (or write STEADY STATE)")
        );
    };
    let names = ["step in s", "period in s", "shortest step", "longest step"];
    line.exactly(if line.len() == 4 { &names } else { &names[..2] })?;
    let (step, period) = (line.number(0, names[0])?, line.number(1, names[1])?);
    if line.len() == 4 && line.number(2, names[2])? > line.number(3, names[3])? {
        return Err(line.fault("the shortest step is longer than the longest: exchange the two values"));
    }
    if !(step > 0.0 && period >= step) {
        return Err(line.fault(format!(
            "a step of {step} s is not possible in a period of {period} s: write a step above 0, and at most \
             the period"
        )));
    }
    if period / step > MOST_STEPS {
        return Err(line.fault(format!("more than {MOST_STEPS} steps: use a longer step")));
    }
    Ok(Case::Transient { step, period })
}

/// Reads every data line of a load card with the function `read`. Fails if no `*HEAT TRANSFER` precedes the card.
fn loads(
    reader: &mut Reader,
    card: &Card,
    read: impl FnMut(&mut Reader, &Line) -> Result<(), Fault>,
) -> Result<(), Fault> {
    if reader.case.is_none() {
        return Err(card.fault("the card must be after *HEAT TRANSFER"));
    }
    reader.each(card, read);
    Ok(())
}

/// Returns the side in the second value of the line, counted from 0: `F2` gives 1. Returns `None` if this
/// value is only the letter, because the first value then names a surface.
fn side_or_surface(line: &Line, letter: &str) -> Result<Option<usize>, Fault> {
    if line.text(1).eq_ignore_ascii_case(letter) { Ok(None) } else { side(line, letter).map(Some) }
}

pub(super) fn films(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    loads(reader, card, |reader, line| {
        line.exactly(&["element or set", "side", "sink temperature", "film coefficient"])?;
        let side = side_or_surface(line, "F")?;
        let sink = temperature::of_load(reader.scale, line, 2, "sink temperature")?;
        let coefficient = line.number(3, "film coefficient")?;
        if coefficient <= 0.0 {
            let message = format!("the film coefficient is {coefficient}; it must be above 0");
            return Err(line.fault(message));
        }
        for face in reader.faces(line, side, "F") {
            let id = reader.mesh.elements[face.element].id;
            let what = || format!("side F{} of element {id} has a film", face.side + 1);
            reader.once(line, (0, face.element, face.side), what);
            reader.names.films.push(line.text(0).to_lowercase());
            reader.films.push(Film { face, sink, coefficient });
        }
        Ok(())
    })
}

pub(super) fn fluxes(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    loads(reader, card, |reader, line| {
        line.exactly(&["element or set", "side or BF", "heat"])?;
        let fluxes: Vec<(usize, usize, Flux)> = if line.text(1).eq_ignore_ascii_case("BF") {
            let heat = line.number(2, "heat")?;
            let elements = reader.elements(line.text(0), &line.at).into_iter();
            elements.map(|element| (element, 4, Flux::Volume(element, heat))).collect()
        } else {
            let (side, heat) = (side_or_surface(line, "S")?, line.number(2, "heat")?);
            let faces = reader.faces(line, side, "S").into_iter();
            faces.map(|face| (face.element, face.side, Flux::Face(face, heat))).collect()
        };
        for (element, side, flux) in fluxes {
            let id = reader.mesh.elements[element].id;
            reader.once(line, (1, element, side), || format!("element {id} has this flux"));
            reader.names.fluxes.push(line.text(0).to_lowercase());
            reader.fluxes.push(flux);
        }
        Ok(())
    })
}

pub(super) fn nodal(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    loads(reader, card, |reader, line| {
        line.exactly(&["node or set", "direction 11", "heat"])?;
        if line.text(1) != "11" {
            return Err(line.fault(format!(
                "`{}` is not a direction in which heat enters at a node: write 11",
                quoted(line.text(1))
            )));
        }
        let heat = line.number(2, "heat")?;
        for node in reader.nodes(line.text(0), &line.at) {
            let id = reader.mesh.nodes[node];
            reader.once(line, (2, node, 0), || format!("node {id} has a flux"));
            reader.nodal.push((node, heat));
        }
        Ok(())
    })
}

/// Effect of one data line of `*BOUNDARY`.
enum Held {
    /// Fixed directions: 1 to 3 are x, y and z. 4 to 6 are rotations, which have no effect on a solid.
    Directions(std::ops::RangeInclusive<usize>),
    /// Prescribed temperature, °C.
    Temperature(f64),
}

/// Parses directions and value of a line of `*BOUNDARY`. The Abaqus names `ENCASTRE` and `PINNED` fix x, y
/// and z. The directions 4 to 6 are rotations, which have no effect on a solid.
fn held(line: &Line, scale: Option<Scale>) -> Result<Held, Fault> {
    if line.len() == 2 && ["ENCASTRE", "PINNED"].contains(&line.text(1).to_uppercase().as_str()) {
        return Ok(Held::Directions(1..=3));
    }
    if line.len() == 2 && line.text(1).to_uppercase().ends_with("SYMM") {
        return Err(line.fault(format!(
            "{} fixes the nodes in some directions only: fix them in the directions 1 to 3, or mesh the whole \
             structure",
            quoted(line.text(1))
        )));
    }
    if !(2..=4).contains(&line.len()) {
        line.exactly(&["node or set", "first direction", "last direction", "value"])?;
    }
    let first = line.id(line.text(1), "first direction")?;
    let last = if line.text(2).is_empty() { first } else { line.id(line.text(2), "last direction")? };
    if (first, last) == (11, 11) {
        if line.len() < 4 {
            return Err(line.fault("the temperature is missing: write it as the fourth value"));
        }
        return temperature::of_load(scale, line, 3, "given temperature").map(Held::Temperature);
    }
    let directions = first as usize..=last as usize;
    if directions.is_empty() || last > 6 {
        let message = format!(
            "directions {first} to {last}: write 1 to 3 to fix the structure, or 11 for a given temperature"
        );
        return Err(line.fault(message));
    }
    if line.len() == 4 && line.number(3, "value")?.abs() > 0.0 {
        return Err(line.fault("only supports without displacement are supported: the value must be 0"));
    }
    Ok(Held::Directions(directions))
}

/// Reads the fixed nodes and prescribed temperatures of `*BOUNDARY`. The card may be before the step or in the step.
pub(super) fn boundary(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    let is_new = card.value("OP").is_some_and(|op| op == "NEW");
    match &reader.kept_boundary {
        Some(first) if is_new => {
            return Err(card.fault(format!(
                "OP=NEW removes the supports and temperatures of the *BOUNDARY in line {}: take that card out of \
                 the file, or leave OP=NEW out",
                first.line
            )));
        }
        None if !is_new => reader.kept_boundary = Some(card.at.clone()),
        _ => {}
    }
    reader.each(card, |reader, line| {
        let held = held(line, reader.scale)?;
        for node in reader.nodes(line.text(0), &line.at) {
            match &held {
                Held::Temperature(value) => {
                    let other = reader.held.insert(node, *value);
                    if other.is_some_and(|other| other.to_bits() != value.to_bits()) {
                        let id = reader.mesh.nodes[node];
                        reader.faults.push(line.fault(format!(
                            "node {id} has another given temperature already: give it one temperature"
                        )));
                    }
                }
                Held::Directions(directions) => {
                    let fixed = directions.clone().filter(|direction| *direction <= 3);
                    let support = reader.supports.entry(node).or_insert(([false; 3], line.at.clone()));
                    fixed.for_each(|direction| support.0[direction - 1] = true);
                }
            }
        }
        Ok(())
    });
    Ok(())
}

/// Checks `*RESTART`: the card may request that files are written, but not that a file is read.
pub(super) fn restart(_: &mut Reader, card: &Card) -> Result<(), Fault> {
    if card.has("READ") {
        return Err(card.fault(
            "each load case is computed from its beginning: take the card out of the file, and write the initial \
             temperatures",
        ));
    }
    Ok(())
}

/// Reads print requests for other programs. Only the names of their sets are checked.
pub(super) fn printed(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    if let Some(name) = card.value("NSET").filter(|name| !reader.is_without_elements(name)) {
        reader.nodes(&name, &card.at);
    }
    if let Some(name) = card.value("ELSET") {
        reader.elements(&name, &card.at);
    }
    Ok(())
}

pub(super) fn initial(reader: &mut Reader, card: &Card) -> Result<(), Fault> {
    if card.value("TYPE").as_deref() != Some("TEMPERATURE") {
        return Err(card.fault(
            "only TYPE=TEMPERATURE is read: write TYPE=TEMPERATURE, or take the card out of the file",
        ));
    }
    reader.each(card, |reader, line| {
        line.exactly(&["node or set", "temperature"])?;
        let temperature = temperature::initial(&mut reader.scale, line, 1)?;
        if reader.is_without_elements(line.text(0)) {
            return Ok(());
        }
        for node in reader.nodes(line.text(0), &line.at) {
            let other = reader.initial[node].replace(temperature);
            if other.is_some_and(|other| other.to_bits() != temperature.to_bits()) {
                let id = reader.mesh.nodes[node];
                reader.faults.push(line.fault(format!(
                    "node {id} has another initial temperature already: give it one temperature"
                )));
            }
        }
        Ok(())
    });
    Ok(())
}

/// Returns the nodes that are fixed. Adds an error if a node is not fixed in all three directions.
pub(super) fn supports(reader: &mut Reader) -> Vec<usize> {
    // Rotations only: the line fixes nothing.
    reader.supports.retain(|_, (directions, _)| directions.contains(&true));
    let partly = reader.supports.iter().find(|(_, (directions, _))| directions.contains(&false));
    if let Some((node, (_, at))) = partly {
        let id = reader.mesh.nodes[*node];
        reader.faults.push(
            at.fault(format!("node {id} is fixed in some directions only: fix it in the directions 1 to 3")),
        );
    }
    reader.supports.keys().copied().collect()
}

/// Returns the load case with the names of its surfaces. If the step has no `*HEAT TRANSFER`, or a node has no initial
/// temperature, adds an error and returns `None`.
pub(super) fn finish(path: &Path, reader: &mut Reader) -> Option<(LoadCase, SurfaceNames)> {
    // A wrong line of the card has been reported; its missing values are not reported in addition.
    let is_reported = reader.faults.described.iter().any(|fault| fault.card == "*INITIAL CONDITIONS");
    let without = reader.initial.iter().position(Option::is_none);
    if let Some(node) = without.filter(|_| !is_reported && !reader.is_spoiled) {
        let id = reader.mesh.nodes[node];
        let message = format!(
            "node {id} has no initial temperature: write *INITIAL CONDITIONS, TYPE=TEMPERATURE for all nodes before \
             *STEP"
        );
        reader.faults.push(Fault::of_file(path, message));
    }
    if reader.case.is_none() && reader.faults.is_empty() {
        let message = "the step has no *HEAT TRANSFER: write this card, and after it the loads that warm the \
                       structure";
        reader.faults.push(Fault::of_file(path, message));
    }
    let load = LoadCase {
        case: reader.case?,
        initial: reader.initial.iter().copied().collect::<Option<_>>()?,
        films: std::mem::take(&mut reader.films),
        fluxes: std::mem::take(&mut reader.fluxes),
        nodal: std::mem::take(&mut reader.nodal),
        held: std::mem::take(&mut reader.held).into_iter().collect(),
    };
    Some((load, std::mem::take(&mut reader.names)))
}
