//! Finds held-out runs whose values go far beyond the values of all other runs. A model that was identified from the
//! other runs does not predict such a run well. The rise of a sensor is its reading minus its reference value.

use crate::bank::Bank;
use crate::campaign::Campaign;
use crate::statistics::least_and_most;

/// Limit of the ratio of two spans (maximum minus minimum): the span of all other runs together, divided by the span of
/// one run. Below this limit, that run goes far beyond the others.
const ALIKE: f64 = 1.0 / 3.0;
/// Minimum spans (maximum minus minimum) of the error in µm, of temperatures in °C, and of speeds in rpm. Smaller spans
/// are ignored.
const MOVES_UM: f64 = 0.5;
const MOVES_C: f64 = 0.5;
const MOVES_RPM: f64 = 100.0;
/// Maximum number of quantities that the message about one run names.
const MOST_NAMED: usize = 4;

/// Smallest and largest value of a quantity in a run.
type Span = (f64, f64);

/// Quantity whose spans are compared between runs: the error, the rise of a sensor, or a speed. Each span includes
/// zero.
struct Quantity<'a> {
    name: &'a str,
    unit: &'a str,
    /// Minimum span. If the span of the quantity in a run is smaller, the quantity is ignored in that run.
    moves: f64,
    /// Smallest and largest value of the quantity in each run.
    spans: Vec<Span>,
}

impl Quantity<'_> {
    /// Returns a text that compares the span of a run with the span of all other runs. `None` if the run does not go
    /// far beyond them.
    fn beyond(&self, run: usize) -> Option<String> {
        let Quantity { name, unit, moves, spans } = self;
        let others = spans.iter().enumerate().filter(|(other, _)| *other != run);
        let others = width(others.map(|(_, span)| *span).fold((0.0, 0.0), joined));
        let own = width(*spans.get(run)?);
        let is_beyond = own > *moves && others < ALIKE * own;
        is_beyond.then(|| {
            format!(
                "{name} spans {own:.1} {unit} in this run and {others:.1} {unit} in all other runs together"
            )
        })
    }
}

/// Returns a message for each run whose values go far beyond those of all other runs. Empty if there is only one run.
pub(crate) fn alike(campaign: &Campaign<'_>, bank: &Bank) -> Vec<String> {
    if bank.runs.len() < 2 {
        return Vec::new();
    }
    let quantities = quantities(campaign, bank);
    let mut found = Vec::new();
    for (place, run) in bank.runs.iter().enumerate() {
        let beyond = quantities.iter().filter_map(|quantity| quantity.beyond(place));
        let beyond: Vec<String> = beyond.take(MOST_NAMED).collect();
        if !beyond.is_empty() {
            found.push(format!(
                "the other runs cover only a small part of the values in {}: {}. A model that was identified \
                 from similar days does not predict a different day well. Record days that differ as much as \
                 the days on which the machine is used",
                run.name,
                beyond.join(", ")
            ));
        }
    }
    found
}

/// Returns the quantities to compare: the error, then each input.
fn quantities<'a>(campaign: &'a Campaign<'_>, bank: &Bank) -> Vec<Quantity<'a>> {
    let errors = bank.runs.iter().map(|run| least_and_most(run.target.iter()).unwrap_or_default());
    let mut found =
        vec![Quantity { name: "the error", unit: "µm", moves: MOVES_UM, spans: errors.collect() }];
    for (place, input) in campaign.inputs.iter().enumerate() {
        let name = input.name.as_str();
        if input.is_speed() {
            let runs = campaign.dataset.runs.iter();
            let spans = runs.map(|run| least_and_most(&run.values[input.column]).unwrap_or_default());
            found.push(Quantity { name, unit: "rpm", moves: MOVES_RPM, spans: spans.collect() });
        } else if let Some(column) = bank.plain(place) {
            let rises = bank.runs.iter().map(|run| run.rises.column(column));
            let spans = rises.map(|rises| least_and_most(rises.iter()).unwrap_or_default());
            found.push(Quantity { name, unit: "°C", moves: MOVES_C, spans: spans.collect() });
        }
    }
    found
}

fn joined(one: Span, other: Span) -> Span {
    (one.0.min(other.0), one.1.max(other.1))
}

fn width((least, most): Span) -> f64 {
    most.max(0.0) - least.min(0.0)
}
