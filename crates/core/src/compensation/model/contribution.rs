//! Contributions of the signals to the Cz of a model. They show which sensor moves an axis.

use std::time::Duration;

use super::{Inputs, Lag, Model};
use crate::compensation::Snapshot;
use crate::compensation::reference::{Machine, Reference};
use crate::quantity::{Micron, Moment};
use crate::reading::{Reading, SignalId};

/// Time after which every lag has settled.
const SETTLED: Duration = Duration::from_hours(100 * 7 * 24);

/// Contribution of one signal to the Cz of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contribution {
    /// Signal.
    pub signal: SignalId,
    /// Change of Cz between the reference of the signal and its present value.
    pub cz: Micron,
}

impl Model {
    /// Returns the contributions of the signals, the largest first. A contribution is the change of Cz if only this
    /// signal changes from its reference to its present value. All lags have then settled. A formula has no references:
    /// its signals count from their values at machine start, or from zero. Returns an empty list if the model has no
    /// value. Signals without a reference are left out.
    pub fn contributions(&self, snapshot: &Snapshot<'_>, machine: &Machine) -> Vec<Contribution> {
        let (now, readings) = (snapshot.now, snapshot.readings);
        let Some(whole) = self.settled(now, readings, machine) else { return Vec::new() };
        let contribution = |(signal, neutral): (SignalId, f64)| {
            let mut readings = readings.to_vec();
            *readings.get_mut(signal.0)? = Reading::good(neutral, now);
            let cz = Micron::new(whole - self.settled(now, &readings, machine)?)?;
            Some(Contribution { signal, cz })
        };
        let mut all: Vec<Contribution> =
            self.neutral_values(machine).into_iter().filter_map(contribution).collect();
        all.sort_by(|one, other| other.cz.abs().get().total_cmp(&one.cz.abs().get()));
        all
    }

    /// Returns the signals that contribute, each once, with the value at which it contributes nothing.
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

    /// Returns the Cz of the model for constant readings, after all lags have settled. `None` if it has no value.
    fn settled(&self, now: Moment, readings: &[Reading], machine: &Machine) -> Option<f64> {
        let later = now.after(SETTLED);
        let lags = self.rises().map(|input| {
            let mut lag = Lag::default();
            for at in [now, later] {
                lag.follow(input, &Snapshot::new(at, readings), machine);
            }
            lag
        });
        let lags: Vec<Lag> = lags.collect();
        // A formula has no lag. Its time since machine start is the present one.
        let is_late = self.rises().any(|input| input.lag.is_some());
        let snapshot = Snapshot::new(if is_late { later } else { now }, readings);
        let inputs = Inputs { snapshot, machine, lags: &lags, splits_slope: false };
        self.outputs(&inputs).ok().map(|outputs| outputs.cz.get())
    }
}

#[cfg(test)]
mod tests;
