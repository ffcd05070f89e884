//! The step: heat transfer, films, fluxes, held temperatures, and what is to be printed.

use super::Fault;
use super::card::{Card, Place};
use super::fields::Fields;
use super::model::side_or_surface;
use super::raw::{Boundary, Load, Raw, Target, Where};
use crate::body::Case;

pub(super) const KEYS: [&str; 12] = [
    "HEATTRANSFER",
    "FILM",
    "DFLUX",
    "CFLUX",
    "NODEPRINT",
    "NODEFILE",
    "NODEOUTPUT",
    "ELPRINT",
    "ELFILE",
    "ELEMENTOUTPUT",
    "OUTPUT",
    "CONTACTFILE",
];

pub(super) fn card(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) {
    let done = match card.key.as_str() {
        "HEATTRANSFER" => heat_transfer(raw, card, faults),
        "FILM" => each(raw, card, faults, film),
        "DFLUX" => each(raw, card, faults, flux),
        "CFLUX" => each(raw, card, faults, nodal),
        _ => printed(raw, card, faults),
    };
    faults.extend(done.err());
}

fn heat_transfer(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) -> Result<(), Fault> {
    card.only(&["STEADYSTATE", "DIRECT", "SOLVER"], faults);
    if raw.load.is_some() {
        return Err(card.place.fault("the step has this already"));
    }
    let case = if card.has("STEADYSTATE") { Ok(Case::Steady) } else { transient(card) };
    // A wrong line must not make every load after it look misplaced.
    raw.load = Some(Load {
        case: case.clone().unwrap_or(Case::Steady),
        films: Vec::new(),
        fluxes: Vec::new(),
        nodal: Vec::new(),
    });
    if let Some(solver) = card.value("SOLVER").filter(|solver| solver != "SPOOLES") {
        return Err(card.place.fault(format!(
            "SOLVER={solver}: which solver is taken is not for the deck to say, and not everyone has this one: leave \
             SOLVER out"
        )));
    }
    case.map(drop)
}

/// More steps than these nobody waits for.
const MOST_STEPS: f64 = 100_000.0;

fn transient(card: &Card) -> Result<Case, Fault> {
    let [line] = &card.lines[..] else {
        return Err(card
            .place
            .fault("a transient step needs one line: step in s, period in s (or say STEADY STATE)"));
    };
    let fields = Fields::of(line);
    let names = ["step in s", "period in s", "shortest step", "longest step"];
    fields.exactly(if fields.len() == 4 { &names } else { &names[..2] })?;
    let (step, period) = (fields.number(0, names[0])?, fields.number(1, names[1])?);
    if fields.len() == 4 && fields.number(2, names[2])? > fields.number(3, names[3])? {
        return Err(fields.fault("the shortest step is longer than the longest"));
    }
    if !(step > 0.0 && period >= step) {
        return Err(fields.fault(format!("a step of {step} s does not lead through a period of {period} s")));
    }
    if period / step > MOST_STEPS {
        return Err(fields.fault(format!("more than {MOST_STEPS} steps: take a longer one")));
    }
    Ok(Case::Transient { step, period })
}

fn each(
    raw: &mut Raw,
    card: &Card,
    faults: &mut Vec<Fault>,
    one: fn(&mut Load, &Fields<'_>, Place) -> Result<(), Fault>,
) -> Result<(), Fault> {
    card.only(&["OP"], faults);
    let load = raw.load.as_mut().ok_or_else(|| card.place.fault("belongs after *HEAT TRANSFER"))?;
    for line in &card.lines {
        faults.extend(one(load, &Fields::of(line), line.place.clone()).err());
    }
    Ok(())
}

/// Through which faces heat passes: a side, or a named surface.
fn faces(fields: &Fields<'_>, letter: &str) -> Result<Where, Fault> {
    let target = Target::of(fields.text(0));
    Ok(match side_or_surface(fields, 1, letter)? {
        Some(side) => Where::Side(target, side),
        None => Where::Surface(target),
    })
}

fn film(load: &mut Load, fields: &Fields<'_>, place: Place) -> Result<(), Fault> {
    fields.exactly(&["element or set", "side", "sink temperature", "film coefficient"])?;
    let at = faces(fields, "F")?;
    let (sink, coefficient) = (fields.number(2, "sink temperature")?, fields.number(3, "film coefficient")?);
    if coefficient <= 0.0 {
        return Err(fields.fault(format!("the film coefficient is {coefficient}; it is more than nothing")));
    }
    load.films.push((at, sink, coefficient, place));
    Ok(())
}

fn flux(load: &mut Load, fields: &Fields<'_>, place: Place) -> Result<(), Fault> {
    fields.exactly(&["element or set", "side or BF", "heat"])?;
    let in_volume = fields.text(1).eq_ignore_ascii_case("BF");
    let at = if in_volume { Where::Volume(Target::of(fields.text(0))) } else { faces(fields, "S")? };
    load.fluxes.push((at, fields.number(2, "heat")?, place));
    Ok(())
}

fn nodal(load: &mut Load, fields: &Fields<'_>, place: Place) -> Result<(), Fault> {
    fields.exactly(&["node or set", "direction 11", "heat"])?;
    if fields.text(1) != "11" {
        return Err(fields.fault(format!("`{}`: heat enters at a node in direction 11", fields.text(1))));
    }
    load.nodal.push((Target::of(fields.text(0)), fields.number(2, "heat")?, place));
    Ok(())
}

/// `*BOUNDARY`, before the step or in it.
pub(super) fn boundary(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) {
    card.only(&["OP"], faults);
    for line in &card.lines {
        match bound(&Fields::of(line), line.place.clone()) {
            Ok(bound) => raw.boundaries.push(bound),
            Err(fault) => faults.push(fault),
        }
    }
}

fn bound(fields: &Fields<'_>, place: Place) -> Result<Boundary, Fault> {
    if !(2..=4).contains(&fields.len()) {
        fields.exactly(&["node or set", "first direction", "last direction", "value"])?;
    }
    let first = fields.whole(1, "first direction")?;
    let last = if fields.text(2).is_empty() { first } else { fields.whole(2, "last direction")? };
    let value = if fields.len() == 4 { fields.number(3, "value")? } else { 0.0 };
    let heat = (first, last) == (11, 11);
    let structural = first <= last && last <= 3;
    if !heat && !structural {
        return Err(fields
            .fault(format!("directions {first} to {last}: 1 to 3 hold the structure, 11 its temperature")));
    }
    if heat && fields.len() < 4 {
        return Err(fields.fault("the temperature is missing"));
    }
    if !heat && value.abs() > 0.0 {
        return Err(fields.fault("a structure is held where it stands: the value is 0"));
    }
    Ok(Boundary { target: Target::of(fields.text(0)), first, last, value, place })
}

/// What other programs are to print; only the sets it names are looked at.
fn printed(raw: &mut Raw, card: &Card, faults: &mut Vec<Fault>) -> Result<(), Fault> {
    let known = [
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
    card.only(&known, faults);
    raw.printed.extend(card.value("NSET").map(|name| (name, true, card.place.clone())));
    raw.printed.extend(card.value("ELSET").map(|name| (name, false, card.place.clone())));
    Ok(())
}
