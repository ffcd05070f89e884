//! The cards in their order, each given to those who read it: a card has its place before, inside or after the step.

use super::Fault;
use super::card::{Card, INCLUDED, Place};
use super::raw::Raw;
use super::{load, model, refused, solid};

/// Whether one is inside a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Before,
    Inside,
    After,
}

/// What the cards say, in numbers and names.
pub(super) fn raw(cards: &[Card], faults: &mut Vec<Fault>) -> Raw {
    let mut raw = Raw::default();
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
            _ => one(&mut raw, card, step, faults),
        }
    }
    match (step, began) {
        (Step::Before, _) => faults.extend(cards.last().map(|card| {
            card.place.fault("the deck ends without a step: write *STEP, *HEAT TRANSFER, loads, *END STEP")
        })),
        (Step::Inside, Some(place)) => {
            faults.push(place.fault("the step is not ended: *END STEP is missing"))
        }
        _ => {}
    }
    raw
}

fn one(raw: &mut Raw, card: &Card, step: Step, faults: &mut Vec<Fault>) {
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
            model::card(raw, card, faults);
            true
        }
        key if solid::KEYS.contains(&key) => {
            before(faults);
            solid::card(raw, card, faults);
            true
        }
        "BOUNDARY" if step != Step::After => {
            load::boundary(raw, card, faults);
            true
        }
        key if load::KEYS.contains(&key) => {
            inside(faults);
            load::card(raw, card, faults);
            true
        }
        _ => false,
    };
    if !known {
        faults.push(card.place.fault(refused::why(card)));
    }
}
