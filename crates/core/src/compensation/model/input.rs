//! Input of a model or an envelope: a signal, the reference that is subtracted from it, and its lag.

use std::time::Duration;

use super::{Lag, Term, TimeConstant, Unusable};
use crate::compensation::Snapshot;
use crate::compensation::reference::{CapturedReference, Machine, Reference};
use crate::compensation::substitution::{SubstituteSource, Substitution};
use crate::quantity::{Celsius, MicronPerMillimetreCelsius, Moment};
use crate::reading::SignalId;

/// Input of a model or an envelope: a signal minus its reference, with or without a lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// Signal of the input: a temperature. For a matrix, a network or an envelope it may also be a position or a speed.
    pub signal: SignalId,
    /// Reference that is subtracted from the signal. The difference is called the rise. With the fixed reference 0, the
    /// rise is the signal's value.
    pub reference: Reference,
    /// Time constant C of the first-order lag, above zero. `None` if the input has no lag. Inputs of an envelope never
    /// have a lag.
    pub lag: Option<TimeConstant>,
    /// Whether the input is the square of the value minus the square of the reference. The lag then applies to the
    /// squares.
    pub squared: bool,
}

/// Inputs of a model at one moment: readings, state of the machine, and lags.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// Readings of all signals, from which the model takes its inputs.
    pub snapshot: Snapshot<'a>,
    /// State of the machine: time since its start, and references.
    pub machine: &'a Machine,
    /// Lag of each input of [`Model::rises`](super::Model::rises), in the same order.
    pub lags: &'a [Lag],
    /// Whether the control receives Cz and slope separately, and itself multiplies the slope by the distance.
    pub splits_slope: bool,
}

/// Inputs of a model that may lag, in the order of their lags: terms of the sum, terms of the slope, other inputs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rises<'a> {
    /// Terms of the sum of a linear model.
    pub terms: &'a [Term],
    /// Terms of the slope of a linear model.
    pub slope: &'a [Term<MicronPerMillimetreCelsius>],
    /// Other inputs, which are not terms of a sum.
    pub inputs: &'a [Input],
}

impl<'a> Rises<'a> {
    pub(super) fn into_iter(self) -> impl Iterator<Item = &'a Input> {
        let terms = self.terms.iter().map(|term| &term.input);
        terms.chain(self.slope.iter().map(|term| &term.input)).chain(self.inputs)
    }
}

impl Input {
    /// Creates an input: the signal's value, not squared, minus its reference.
    pub fn of(signal: SignalId, reference: Reference, lag: Option<Duration>) -> Input {
        Input { signal, reference, lag: lag.map(TimeConstant::of), squared: false }
    }

    /// Returns the time constant of the input's lag; `None` without a lag.
    pub fn time_constant(&self) -> Option<Duration> {
        self.lag.map(TimeConstant::span)
    }

    /// Returns the present value of the signal, and the reference that is subtracted from it. For a squared input, both
    /// are squares.
    ///
    /// # Errors
    /// Returns that the signal cannot be used, that its reference has not been captured, or that its square is not
    /// finite.
    #[allow(
        clippy::inline_always,
        reason = "called for each lag in each step; a return through memory would be slow"
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

    /// Returns the value and the reference of a signal whose reading this substitute replaces. `None` if the substitute
    /// lacks the value or the reference.
    fn level_of(&self, substitution: &Substitution, machine: &Machine) -> Option<(f64, CapturedReference)> {
        let SubstituteSource::Predictors { value, rise } = substitution.source else { return None };
        let captured = machine.captured(self.reference, self.signal);
        match self.reference {
            // A predicted rise is used without a captured reference. The square of a value requires the reference.
            Reference::Start => {
                let unread = CapturedReference { value: Celsius::ZERO, at: Moment::default() };
                let start = if self.squared { captured? } else { captured.unwrap_or(unread) };
                Some((start.value.get() + rise, start))
            }
            // A "zero" reference is only valid if it was captured while the sensor still worked.
            Reference::Zero => {
                let is_known = |zero: &CapturedReference| {
                    zero.at <= substitution.since && !machine.is_zeroed_again(self.signal)
                };
                Some((value?, captured.filter(is_known)?))
            }
            Reference::Fixed(_) => Some((value?, captured?)),
        }
    }

    /// Returns why the input has no reference: the capture is not complete, or the sensor is rejected.
    fn misses(&self, machine: &Machine) -> Unusable {
        if machine.is_withheld(self.reference, self.signal) {
            return Unusable::Unproven(self.signal);
        }
        Unusable::Reference(self.signal)
    }

    /// Returns the present rise of the input: its value minus its reference, lagged if the input has a lag.
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
