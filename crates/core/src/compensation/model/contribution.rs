//! Contributions of the signals to the Cz of a model. The contributions show which sensor moves an axis.

use std::time::Duration;

use super::{Inputs, Lag, Model};
use crate::compensation::Snapshot;
use crate::compensation::reference::{Machine, Reference};
use crate::compensation::substitution::Substitution;
use crate::quantity::Micron;
use crate::reading::{Reading, SignalId};

/// Elapsed time after which every lag counts as settled: the lagged temperature equals the reading.
const SETTLED: Duration = Duration::from_hours(100 * 7 * 24);

/// Contribution of one signal to the Cz of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// Signal that contributes to Cz.
    pub signal: SignalId,
    /// Change of Cz between the reference of the signal and its present value.
    pub cz: Micron,
}

impl Model {
    /// Returns the contributions of the signals, the largest first. The contribution of a signal is the change of Cz if
    /// only this signal changes from its reference to its present value. All lags count as settled. A stand-in counts
    /// as the present value.
    ///
    /// A formula has no references: its signals count from their values at machine start, or from zero. Returns an
    /// empty list if the model has no value. Signals without a reference are left out.
    pub fn contributions(&self, inputs: &Inputs<'_>) -> Vec<Contribution> {
        let Snapshot { now, readings, substitutions, .. } = inputs.snapshot;
        let Some(whole) = self.settled(inputs) else { return Vec::new() };
        let contribution = |(signal, neutral): (SignalId, f64)| {
            let mut readings = readings.to_vec();
            *readings.get_mut(signal.0)? = Reading::good(neutral, now);
            let others = substitutions.iter().filter(|substitution| substitution.signal != signal);
            let others: Vec<Substitution> = others.copied().collect();
            let snapshot = Snapshot { readings: &readings, substitutions: &others, ..inputs.snapshot };
            let cz = Micron::new(whole - self.settled(&Inputs { snapshot, ..*inputs })?)?;
            Some(Contribution { signal, cz })
        };
        let mut all: Vec<Contribution> =
            self.neutral_values(inputs.machine).into_iter().filter_map(contribution).collect();
        all.sort_by(|one, other| other.cz.abs().get().total_cmp(&one.cz.abs().get()));
        all
    }

    /// Returns the signals that contribute, without duplicates. Each signal is returned with the value at
    /// which it contributes nothing to Cz.
    fn neutral_values(&self, machine: &Machine) -> Vec<(SignalId, f64)> {
        let captured =
            |reference, signal| machine.captured(reference, signal).map(|captured| captured.value.get());
        let mut found: Vec<(SignalId, f64)> = self
            .rises()
            .filter_map(|input| Some((input.signal, captured(input.reference, input.signal)?)))
            .collect();
        if self.rises().next().is_none() {
            let start = |signal| (signal, captured(Reference::Start, signal).unwrap_or_default());
            found.extend(self.signals().into_iter().map(start));
        }
        found.sort_by_key(|(signal, _)| *signal);
        found.dedup_by_key(|(signal, _)| *signal);
        found
    }

    /// Returns the Cz of the model for constant readings, after all lags have settled. `None` if the model has no
    /// value.
    fn settled(&self, inputs: &Inputs<'_>) -> Option<f64> {
        let begin = Snapshot { is_followed: false, ..inputs.snapshot };
        let later = Snapshot { now: begin.now.after(SETTLED), ..begin };
        let lags = self.rises().map(|input| {
            let mut lag = Lag::default();
            for snapshot in [begin, later] {
                lag.follow(input, &snapshot, inputs.machine);
            }
            lag
        });
        let lags: Vec<Lag> = lags.collect();
        // A formula has no lag, and uses the present time since machine start.
        let is_late = self.rises().any(|input| input.lag.is_some());
        let snapshot = if is_late { later } else { begin };
        self.outputs(&Inputs { snapshot, lags: &lags, ..*inputs }).ok().map(|outputs| outputs.cz.get())
    }
}

#[cfg(test)]
mod tests;
