//! The step: heat transfer, films, fluxes, held temperatures, and what is to be printed.

use super::Fault;
use super::card::{Card, Line};
use super::model::side;
use super::raw::{Boundary, Load, Part, Raw, Region, Target};
use crate::body::Case;

pub(super) fn heat_transfer(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    if raw.load.is_some() {
        return Err(card.fault("the step has this already"));
    }
    let case = if card.has("STEADYSTATE") { Ok(Case::Steady) } else { transient(card) };
    // A wrong line must not make every load after it look misplaced.
    let (films, fluxes, nodal) = (Vec::new(), Vec::new(), Vec::new());
    raw.load = Some(Load { case: *case.as_ref().unwrap_or(&Case::Steady), films, fluxes, nodal });
    if let Some(solver) = card.value("SOLVER").filter(|solver| solver != "SPOOLES") {
        return Err(card.fault(format!(
            "SOLVER={solver}: which solver is taken is not for the file to say, and not everyone has this one: leave \
             SOLVER out"
        )));
    }
    case.map(drop)
}

/// More steps than these nobody waits for.
const MOST_STEPS: f64 = 100_000.0;

fn transient(card: &Card) -> Result<Case, Fault> {
    let [line] = &card.lines[..] else {
        return Err(
            card.fault("a transient step needs one line: step in s, period in s (or say STEADY STATE)")
        );
    };
    let names = ["step in s", "period in s", "shortest step", "longest step"];
    line.exactly(if line.len() == 4 { &names } else { &names[..2] })?;
    let (step, period) = (line.number(0, names[0])?, line.number(1, names[1])?);
    if line.len() == 4 && line.number(2, names[2])? > line.number(3, names[3])? {
        return Err(line.fault("the shortest step is longer than the longest"));
    }
    if !(step > 0.0 && period >= step) {
        return Err(line.fault(format!("a step of {step} s does not lead through a period of {period} s")));
    }
    if period / step > MOST_STEPS {
        return Err(line.fault(format!("more than {MOST_STEPS} steps: take a longer one")));
    }
    Ok(Case::Transient { step, period })
}

/// What the step holds so far.
fn load<'a>(load: &'a mut Option<Load>, card: &Card) -> Result<&'a mut Load, Fault> {
    load.as_mut().ok_or_else(|| card.fault("belongs after *HEAT TRANSFER"))
}

/// A side of elements, or a named surface, where only the letter stands.
fn region(line: &Line, letter: &str) -> Result<Region, Fault> {
    let is_surface = line.text(1).eq_ignore_ascii_case(letter);
    let part = if is_surface { Part::Surface } else { Part::Side(side(line, 1, letter)?) };
    Ok(Region { target: Target::of(line.text(0)), part })
}

pub(super) fn films(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let films = card.each(&mut raw.faults, |line| {
        line.exactly(&["element or set", "side", "sink temperature", "film coefficient"])?;
        let region = region(line, "F")?;
        let sink = line.number(2, "sink temperature")?;
        let coefficient = line.number(3, "film coefficient")?;
        if coefficient <= 0.0 {
            return Err(line.fault(format!("the film coefficient is {coefficient}; it is more than nothing")));
        }
        Ok((region, sink, coefficient, line.at.clone()))
    });
    load(&mut raw.load, card)?.films.extend(films);
    Ok(())
}

pub(super) fn fluxes(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let fluxes = card.each(&mut raw.faults, |line| {
        line.exactly(&["element or set", "side or BF", "heat"])?;
        let region = if line.text(1).eq_ignore_ascii_case("BF") {
            Region { target: Target::of(line.text(0)), part: Part::Volume }
        } else {
            region(line, "S")?
        };
        Ok((region, line.number(2, "heat")?, line.at.clone()))
    });
    load(&mut raw.load, card)?.fluxes.extend(fluxes);
    Ok(())
}

pub(super) fn nodal(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let nodal = card.each(&mut raw.faults, |line| {
        line.exactly(&["node or set", "direction 11", "heat"])?;
        if line.text(1) != "11" {
            return Err(line.fault(format!("`{}`: heat enters at a node in direction 11", line.text(1))));
        }
        Ok((Target::of(line.text(0)), line.number(2, "heat")?, line.at.clone()))
    });
    load(&mut raw.load, card)?.nodal.extend(nodal);
    Ok(())
}

/// `*BOUNDARY`, before the step or in it.
pub(super) fn boundary(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    let boundaries = card.each(&mut raw.faults, bound);
    raw.boundaries.extend(boundaries);
    Ok(())
}

fn bound(line: &Line) -> Result<Boundary, Fault> {
    if !(2..=4).contains(&line.len()) {
        line.exactly(&["node or set", "first direction", "last direction", "value"])?;
    }
    let first = line.id(line.text(1), "first direction")?;
    let last = if line.text(2).is_empty() { first } else { line.id(line.text(2), "last direction")? };
    let value = if line.len() == 4 { line.number(3, "value")? } else { 0.0 };
    let heat = (first, last) == (11, 11);
    let structural = first <= last && last <= 3;
    if !heat && !structural {
        let message = format!("directions {first} to {last}: 1 to 3 hold the structure, 11 its temperature");
        return Err(line.fault(message));
    }
    if heat && line.len() < 4 {
        return Err(line.fault("the temperature is missing"));
    }
    if !heat && value.abs() > 0.0 {
        return Err(line.fault("a structure is held where it stands: the value is 0"));
    }
    Ok(Boundary { target: Target::of(line.text(0)), first, last, value, at: line.at.clone() })
}

/// What other programs are to print; only the sets it names are looked at.
pub(super) fn printed(raw: &mut Raw, card: &Card) -> Result<(), Fault> {
    raw.printed.extend(card.value("NSET").map(|name| (name, true, card.at.clone())));
    raw.printed.extend(card.value("ELSET").map(|name| (name, false, card.at.clone())));
    Ok(())
}
