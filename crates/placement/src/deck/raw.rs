//! The deck in numbers and names, card by card, before any name is looked up.

use super::Fault;
use super::card::{Card, INCLUDED, Place};
use super::load::{self, Load};
use super::model::{self, Members};
use super::refused;
use super::solid::{self, Solid};
use crate::mesh::Kind;

/// One node, element or set, as it is named where it is used.
#[derive(Debug, Clone)]
pub(super) enum Target {
    Id(u32),
    Set(String),
}

impl Target {
    /// A number is an id, anything else the name of a set.
    pub(super) fn of(text: &str) -> Self {
        text.parse().map_or_else(|_| Self::Set(text.to_uppercase()), Self::Id)
    }
}

/// Whether one is inside a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    Before,
    Inside,
    After,
}

#[derive(Debug, Default)]
pub(super) struct Raw {
    pub(super) nodes: Vec<(u32, [f64; 3], Place)>,
    /// A line of a node is wrong: those who name it are not to blame.
    pub(super) spoiled_nodes: bool,
    pub(super) elements: Vec<(u32, Kind, Vec<u32>, Place)>,
    /// Lines and surfaces of the geometry, which carry names and nothing else.
    pub(super) outlines: Vec<(u32, Vec<u32>, Place)>,
    pub(super) node_sets: Vec<Members>,
    pub(super) element_sets: Vec<Members>,
    /// Name, element or set, side from 0.
    pub(super) surfaces: Vec<(String, Target, usize, Place)>,
    pub(super) solids: Vec<Solid>,
    /// Element set, material.
    pub(super) sections: Vec<(String, String, Place)>,
    /// Node set or node, °C.
    pub(super) initial: Vec<(Target, f64, Place)>,
    pub(super) boundaries: Vec<load::Boundary>,
    pub(super) load: Option<Load>,
    /// Sets whose nodes or elements are to be printed.
    pub(super) printed: Vec<(String, bool, Place)>,
}

impl Raw {
    pub(super) fn of(cards: &[Card], faults: &mut Vec<Fault>) -> Self {
        let mut raw = Self::default();
        let mut step = Step::Before;
        let mut began: Option<&Place> = None;
        for card in cards {
            match card.key.as_str() {
                "STEP" if step == Step::Before => {
                    card.only(&["INC", "AMPLITUDE"], faults);
                    (step, began) = (Step::Inside, Some(&card.place));
                }
                "STEP" => {
                    let message = "a second step: a deck is one load case, write one deck for each";
                    faults.push(card.place.fault(message));
                    return raw;
                }
                "ENDSTEP" if step == Step::Inside => step = Step::After,
                "ENDSTEP" => faults.push(card.place.fault("there is no step to end")),
                _ => raw.card(card, step, faults),
            }
        }
        match (step, began) {
            (Step::Before, _) => faults.extend(cards.last().map(|card| {
                card.place
                    .fault("the deck ends without a step: write *STEP, *HEAT TRANSFER, loads, *END STEP")
            })),
            (Step::Inside, Some(place)) => {
                faults.push(place.fault("the step is not ended: *END STEP is missing"))
            }
            _ => {}
        }
        raw
    }

    fn card(&mut self, card: &Card, step: Step, faults: &mut Vec<Fault>) {
        let before = |faults: &mut Vec<Fault>| {
            if step != Step::Before {
                faults.push(card.place.fault("belongs before *STEP"));
            }
        };
        let inside = |faults: &mut Vec<Fault>| {
            if step != Step::Inside {
                faults.push(card.place.fault("belongs between *STEP and *END STEP"));
            }
        };
        let known = match card.key.as_str() {
            "HEADING" | INCLUDED => true,
            key if model::KEYS.contains(&key) => {
                before(faults);
                model::card(self, card, faults);
                true
            }
            key if solid::KEYS.contains(&key) => {
                before(faults);
                solid::card(self, card, faults);
                true
            }
            "BOUNDARY" if step != Step::After => {
                load::boundary(self, card, faults);
                true
            }
            key if load::KEYS.contains(&key) => {
                inside(faults);
                load::card(self, card, faults);
                true
            }
            _ => false,
        };
        if !known {
            faults.push(card.place.fault(refused::why(card)));
        }
    }
}
