//! Held-out runs that go far beyond all the others: these are alike, and a model of them says little of such a run.

use crate::bank::{Bank, Traced};
use crate::campaign::Campaign;
use crate::statistics::least_and_most;

/// The other runs are alike beside a run, if what they span together is a smaller share of its own span.
const ALIKE: f64 = 1.0 / 3.0;
/// Spans that are smaller say nothing: °C, and µm of the error.
const MOVES_C: f64 = 0.5;
const MOVES_UM: f64 = 0.5;
/// Most quantities that are named of a run.
const MOST_NAMED: usize = 4;

/// A quantity of a run: least and most of the error and of the rise of each sensor. A run begins at 0.
type Span = (f64, f64);

/// A sentence for each run beside which the others are alike. None where there are no others.
pub(crate) fn alike(campaign: &Campaign<'_>, bank: &Bank) -> Vec<String> {
    let sensors: Vec<(usize, usize)> = campaign
        .sensors()
        .into_iter()
        .filter_map(|sensor| Some((sensor, bank.plain(sensor)?)))
        .collect();
    let spans: Vec<Vec<Span>> = bank.runs.iter().map(|run| spans(run, &sensors)).collect();
    if spans.len() < 2 {
        return Vec::new();
    }
    let named = |place: usize, own: f64, others: f64| match place.checked_sub(1) {
        None => format!("the error spans {own:.1} µm there and {others:.1} µm in all of them"),
        Some(sensor) => {
            let name = &campaign.inputs[sensors[sensor].0].name;
            format!("{name} spans {own:.1} °C there and {others:.1} °C in all of them")
        }
    };
    let of_run = |(run, own): (usize, &Vec<Span>)| {
        let beyond = own.iter().enumerate().filter_map(|(place, own)| {
            let others = spans.iter().enumerate().filter(|(other, _)| *other != run);
            let others = others.map(|(_, spans)| spans[place]).fold((0.0, 0.0), joined);
            let (own, others) = (width(*own), width(others));
            let moves = if place == 0 { MOVES_UM } else { MOVES_C };
            (own > moves && others < ALIKE * own).then(|| named(place, own, others))
        });
        let beyond: Vec<String> = beyond.take(MOST_NAMED).collect();
        let name = &bank.runs[run].name;
        (!beyond.is_empty()).then(|| {
            format!(
                "the other runs are alike beside {name}: {}. A model of days that are alike says little of a day that is not: let \
                 them differ as much as the machine's days do",
                beyond.join(", ")
            )
        })
    };
    spans.iter().enumerate().filter_map(of_run).collect()
}

/// The error first, then each sensor.
fn spans(run: &Traced, sensors: &[(usize, usize)]) -> Vec<Span> {
    let error = least_and_most(run.target.iter());
    let sensors = sensors.iter().map(|(_, column)| least_and_most(run.rises.column(*column).iter()));
    std::iter::once(error).chain(sensors).map(Option::unwrap_or_default).collect()
}

fn joined(one: Span, other: Span) -> Span {
    (one.0.min(other.0), one.1.max(other.1))
}

fn width((least, most): Span) -> f64 {
    most.max(0.0) - least.min(0.0)
}
