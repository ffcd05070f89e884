//! Conversion of an Abaqus file with a part and its instance to the cards of a file without parts. A card is a line
//! with a keyword such as `*NODE`, together with the data lines below it. A part contains a mesh; an instance puts the
//! part at a position in the assembly.
//!
//! Only one instance is supported, because parts of a mesh can be joined only at common nodes. A name that
//! the part defines does not change, unless the assembly defines the same name. In that case, the name of the
//! part becomes `INSTANCE.NAME`.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use super::card::{Card, Location};
use super::position::{Position, Turn};
use super::{Fault, Faults};
use crate::element::{dot, minus};

/// Block (section) of the file to which a card belongs.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Block {
    /// Outside of all blocks.
    Model,
    /// Between `*PART` and `*END PART`; contains the name of the part.
    Part(String),
    Assembly,
    /// Between `*INSTANCE` and `*END INSTANCE`. The cards belong to the last element of `Blocks::instances`.
    Instance,
}

struct Instance {
    name: String,
    part: String,
    at: Location,
    position: Position,
    /// Cards between `*INSTANCE` and `*END INSTANCE`.
    cards: Vec<Card>,
}

/// Cards of the file, grouped by the blocks to which they belong.
#[derive(Default)]
struct Blocks {
    parts: BTreeMap<String, Vec<Card>>,
    instances: Vec<Instance>,
    /// Cards outside of the parts and instances.
    others: Vec<Card>,
}

const BLOCKS: [&str; 6] = ["PART", "ENDPART", "ASSEMBLY", "ENDASSEMBLY", "INSTANCE", "ENDINSTANCE"];

/// Converts the cards of a file with parts to those of a file without parts. Cards of other files are returned
/// unchanged. Returns `None` after an error, which is in `faults`.
pub(super) fn without_parts(cards: Vec<Card>, faults: &mut Faults) -> Option<Vec<Card>> {
    let Some(first) = cards.iter().find(|card| BLOCKS.contains(&card.key.as_str())) else {
        return Some(cards);
    };
    let first = first.at.clone();
    let before = faults.len();
    let Blocks { mut parts, mut instances, others } = blocks(cards, faults);
    if let Some(second) = instances.get(1) {
        faults.push(second.at.fault(format!(
            "{} is a second instance, but one is supported. Only joints by common nodes are read: merge the \
             instances into one part with one mesh (Abaqus/CAE: Merge/Cut Instances)",
            second.name
        )));
    }
    let instance = instances.pop();
    if instance.is_none() && faults.len() == before {
        faults.push(first.fault(
            "no instance of a part is in the file: write *ASSEMBLY, *INSTANCE, NAME=…, PART=…, *END INSTANCE, \
             *END ASSEMBLY below the part",
        ));
    }
    let instance = instance.filter(|_| faults.len() == before)?;
    let mut own = parts.remove(&instance.part).unwrap_or_default();
    if own.is_empty() && instance.cards.is_empty() {
        let known = parts.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
        let known = if known.is_empty() { "there is none".to_owned() } else { format!("there are {known}") };
        faults.push(instance.at.fault(format!("part {} is not defined ({known})", instance.part)));
        return None;
    }
    own.extend(instance.cards);
    let position = Rc::new(instance.position);
    own.iter_mut().for_each(|card| card.position = Some(Rc::clone(&position)));
    let cards = with_common_names(own, others, &instance.name, faults);
    (faults.len() == before).then_some(cards)
}

/// Divides the cards into blocks. If a card begins or ends a block incorrectly, adds an error and stops.
fn blocks(cards: Vec<Card>, faults: &mut Faults) -> Blocks {
    let mut blocks = Blocks::default();
    let mut open = Block::Model;
    let mut begun: Option<Location> = None;
    for card in cards {
        if BLOCKS.contains(&card.key.as_str()) {
            match next(&card, &open, &mut blocks, faults) {
                Ok(block) => open = block,
                // The blocks that follow would only repeat the error.
                Err(fault) => {
                    faults.push(fault);
                    return blocks;
                }
            }
            begun = (open != Block::Model).then(|| card.at.clone());
            continue;
        }
        match &open {
            Block::Part(name) => blocks.parts.entry(name.clone()).or_default().push(card),
            Block::Instance => {
                if let Some(instance) = blocks.instances.last_mut() {
                    instance.cards.push(card);
                }
            }
            Block::Assembly if ["NODE", "ELEMENT"].contains(&card.key.as_str()) => faults.push(card.fault(
                "nodes and elements of the assembly, such as reference points, are not read: take them out of \
                 the file",
            )),
            Block::Assembly | Block::Model => blocks.others.push(card),
        }
    }
    faults.extend(
        begun.map(|at| at.fault("the file ends inside *PART or *ASSEMBLY: its *END card is missing")),
    );
    blocks
}

/// Reads the position of an instance from the data lines of `*INSTANCE`. The first line is the translation, and the
/// second line the rotation. Both lines may be missing.
fn position(card: &Card) -> Result<Position, Fault> {
    let mut position = Position { shift: [0.0; 3], turn: None };
    if let Some(line) = card.lines.first() {
        if line.len() > 3 {
            line.exactly(&["translation along x", "along y", "along z"])?;
        }
        position.shift = line.coordinates(0)?;
    }
    if let Some(line) = card.lines.get(1) {
        line.exactly(&["x of a point", "y", "z", "x of a second point", "y", "z", "angle in degrees"])?;
        let (origin, end) = (line.coordinates(0)?, line.coordinates(3)?);
        let along = minus(end, origin);
        let length = dot(along, along).sqrt();
        if length <= 0.0 {
            return Err(
                line.fault("the two points of the axis of rotation are the same: write two different points")
            );
        }
        let axis = along.map(|part| part / length);
        let angle = line.number(6, "angle in degrees")?.to_radians();
        position.turn = Some(Turn { origin, axis, angle });
    }
    if let Some(line) = card.lines.get(2) {
        return Err(line.fault("an instance has one line for its translation and one for its rotation"));
    }
    Ok(position)
}

/// Returns the block that is open after this card, which begins or ends a block such as `*PART`.
fn next(card: &Card, open: &Block, blocks: &mut Blocks, faults: &mut Faults) -> Result<Block, Fault> {
    let named = |parameter: &str| {
        let name = card.value(parameter).filter(|name| !name.is_empty());
        name.ok_or_else(|| card.fault(format!("{parameter}= is missing: write it with a name")))
    };
    match (card.key.as_str(), open) {
        ("PART", Block::Model) => {
            card.only("", faults);
            let name = named("NAME")?;
            if blocks.parts.insert(name.clone(), Vec::new()).is_some() {
                return Err(
                    card.fault(format!("part {name} is defined already: remove one of the two definitions"))
                );
            }
            Ok(Block::Part(name))
        }
        ("ASSEMBLY", Block::Model) => {
            card.only("", faults);
            Ok(Block::Assembly)
        }
        ("INSTANCE", Block::Assembly) => {
            card.only("PART", faults);
            let (name, part) = (named("NAME")?, named("PART")?);
            // Otherwise the number 1.5 could be the node 5 of an instance 1.
            if !name.starts_with(char::is_alphabetic) {
                return Err(card.fault(format!("the name {name} does not begin with a letter: rename it")));
            }
            let (at, position) = (card.at.clone(), position(card)?);
            blocks.instances.push(Instance { name, part, at, position, cards: Vec::new() });
            Ok(Block::Instance)
        }
        ("ENDPART", Block::Part(_)) | ("ENDASSEMBLY", Block::Assembly) => Ok(Block::Model),
        ("ENDINSTANCE", Block::Instance) => Ok(Block::Assembly),
        (_, open) => Err(card.fault(format!(
            "the card is not allowed {}. Close each *PART, *ASSEMBLY and *INSTANCE with its *END card, and \
             write *INSTANCE only inside *ASSEMBLY",
            match open {
                Block::Model => "outside of *PART and *ASSEMBLY",
                Block::Part(_) => "inside a part",
                Block::Assembly => "inside the assembly",
                Block::Instance => "inside an instance",
            }
        ))),
    }
}

/// Joins the cards of the instance with the cards outside of it. A name that both define gets the prefix `INSTANCE.` in
/// the cards of the part. References to these names are changed accordingly.
fn with_common_names(
    mut own: Vec<Card>,
    mut others: Vec<Card>,
    instance: &str,
    faults: &mut Faults,
) -> Vec<Card> {
    let (of_part, of_model) = (names(&own), names(&others));
    let is_in_both = |name: &str| of_part.contains(name) && of_model.contains(name);
    // Name of the part, as it is called in the converted cards.
    let renamed = |text: &str| {
        let name = text.to_uppercase();
        is_in_both(&name).then(|| format!("{instance}.{name}"))
    };
    for card in &mut own {
        let key = card.key.clone();
        card.rename_parameters(&["NSET", "ELSET"], renamed);
        if key == "SURFACE" {
            card.rename_parameters(&["NAME"], renamed);
        }
        if ["NSET", "ELSET", "SURFACE"].contains(&key.as_str()) {
            card.rename_values(renamed);
        }
    }
    let prefix = format!("{instance}.");
    let resolved = |text: &str| {
        let text = text.to_uppercase();
        let name = text.strip_prefix(&prefix)?;
        Some(renamed(name).unwrap_or_else(|| name.to_owned()))
    };
    for card in &mut others {
        match card.take("INSTANCE") {
            Some(of) if of == instance => card.rename_values(renamed),
            Some(of) => {
                faults.push(
                    card.fault(format!("instance {of} is not defined (the only instance is {instance})")),
                );
            }
            None => {}
        }
        // The name that a set card defines has no prefix.
        card.rename_parameters(&["NSET", "ELSET"], resolved);
        card.rename_values(resolved);
    }
    own.append(&mut others);
    own
}

/// Returns the names of the sets and surfaces that the cards define, in capitals.
fn names(cards: &[Card]) -> BTreeSet<String> {
    let defined = |card: &Card| match card.key.as_str() {
        "NODE" | "NSET" => card.value("NSET"),
        "ELEMENT" | "ELSET" => card.value("ELSET"),
        "SURFACE" => card.value("NAME"),
        _ => None,
    };
    cards.iter().filter_map(defined).collect()
}
