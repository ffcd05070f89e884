//! Input of a model or an envelope: a signal, the reference of its rise, and its lag.

use std::time::Duration;

use super::{Inputs, Lag, Term, TimeConstant, Unusable};
use crate::compensation::Snapshot;
use crate::compensation::reference::{CapturedReference, Machine, Reference};
use crate::compensation::substitution::{SubstituteSource, Substitution};
use crate::quantity::{Celsius, MicronPerMillimetreCelsius, Moment};
use crate::reading::SignalId;

/// Signal minus its reference, with or without a lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// Signal: a temperature. For a matrix, a network or an envelope it may also be a position or a speed.
    pub signal: SignalId,
    /// Reference of the rise. With the number 0, the rise is the value itself.
    pub reference: Reference,
    /// Time constant C of the first-order lag, above zero. `None` if the rise acts at once, as always in an envelope.
    pub lag: Option<TimeConstant>,
    /// The input is the square of the value minus the square of the reference. The lag applies to the squares.
    pub squared: bool,
}

/// Inputs of a model that may lag, in the order of its lags.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rises<'a> {
    /// Terms of the sum.
    pub terms: &'a [Term],
    /// Terms of the slope.
    pub slope: &'a [Term<MicronPerMillimetreCelsius>],
    /// Inputs that are not terms.
    pub inputs: &'a [Input],
}

impl<'a> Rises<'a> {
    pub(super) fn into_iter(self) -> impl Iterator<Item = &'a Input> {
        let terms = self.terms.iter().map(|term| &term.input);
        terms.chain(self.slope.iter().map(|term| &term.input)).chain(self.inputs)
    }
}

impl Input {
    /// Creates an input of the value itself minus its reference.
    pub fn of(signal: SignalId, reference: Reference, lag: Option<Duration>) -> Input {
        Input { signal, reference, lag: lag.map(TimeConstant::of), squared: false }
    }

    /// Returns the time constant of its lag; `None` without a lag.
    pub fn time_constant(&self) -> Option<Duration> {
        self.lag.map(TimeConstant::span)
    }

    /// Returns the value, and the reference that is subtracted from it.
    ///
    /// # Errors
    /// Returns that the signal cannot be used, that its reference has not been captured, or that its square is not
    /// finite.
    #[allow(
        clippy::inline_always,
        reason = "called for each lag of each step, and dear to hand over in memory"
    )]
    #[inline(always)]
    pub(in crate::compensation) fn level(
        &self,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) -> Result<(f64, CapturedReference), Unusable> {
        let (value, reference) = match snapshot.instead_of(self.signal) {
            Some(substitution) => self.level_of(substitution, machine).ok_or(Unusable::from(substitution))?,
            None => {
                let value = snapshot.reading(self.signal).ok_or(Unusable::Signal(self.signal))?;
                (value, machine.captured(self.reference, self.signal).ok_or_else(|| self.misses(machine))?)
            }
        };
        if self.squared { squared(value, reference) } else { Ok((value, reference)) }
    }

    /// Returns the value and reference from a substitute; `None` if the substitute has no value.
    fn level_of(&self, substitution: &Substitution, machine: &Machine) -> Option<(f64, CapturedReference)> {
        let SubstituteSource::Predictors { value, rise } = substitution.source else { return None };
        let captured = machine.captured(self.reference, self.signal);
        match self.reference {
            // A predicted rise needs no captured reference. The square of a value does.
            Reference::Start => {
                let unread = CapturedReference { value: Celsius::ZERO, at: Moment::default() };
                let start = if self.squared { captured? } else { captured.unwrap_or(unread) };
                Some((start.value.get() + rise, start))
            }
            // A zero that was captured since then is unknown.
            Reference::Zero => {
                let is_known = |zero: &CapturedReference| {
                    zero.at <= substitution.since && !machine.is_zeroed_again(self.signal)
                };
                Some((value?, captured.filter(is_known)?))
            }
            Reference::Fixed(_) => Some((value?, captured?)),
        }
    }

    /// Returns why there is no reference: it waits for the machine, or for its sensor.
    fn misses(&self, machine: &Machine) -> Unusable {
        if machine.is_withheld(self.reference, self.signal) {
            return Unusable::Unproven(self.signal);
        }
        Unusable::Reference(self.signal)
    }

    /// Returns the rise now, lagged if the input has a lag.
    ///
    /// # Errors
    /// Returns that the signal cannot be used, that its reference has not been captured, or that the rise is not
    /// finite.
    #[inline]
    pub fn rise(&self, inputs: &Inputs<'_>, lag: &Lag) -> Result<Celsius, Unusable> {
        lag.risen(&inputs.snapshot).map_or_else(|| self.compute_rise(inputs, lag), Ok)
    }

    #[inline(never)]
    fn compute_rise(&self, inputs: &Inputs<'_>, lag: &Lag) -> Result<Celsius, Unusable> {
        let (value, reference) = self.level(&inputs.snapshot, inputs.machine)?;
        let rise = match self.lag {
            Some(_) => lag.rise(self, inputs),
            None => Celsius::new(value - reference.value.get()),
        };
        rise.ok_or(Unusable::NotANumber)
    }
}

fn squared(value: f64, reference: CapturedReference) -> Result<(f64, CapturedReference), Unusable> {
    let square = |value: f64| Celsius::new(value * value).ok_or(Unusable::NotANumber);
    let from = square(reference.value.get())?;
    Ok((square(value)?.get(), CapturedReference { value: from, ..reference }))
}
