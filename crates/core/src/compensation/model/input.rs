//! One input of a model or an envelope: a signal, what its rise is measured from, and how late it acts.

use std::time::Duration;

use super::{Inputs, Lag, Term, TimeConstant, Unusable};
use crate::compensation::Snapshot;
use crate::compensation::instead::{Instead, Says};
use crate::compensation::reference::{Captured, Machine, Reference};
use crate::quantity::{Celsius, MicronPerMillimetreCelsius, Moment};
use crate::reading::SignalId;

/// A signal less its reference, at once or behind a lag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// A temperature; of a matrix, a network or an envelope also a position or a speed.
    pub signal: SignalId,
    /// What the rise is measured from; the number 0 leaves the value itself.
    pub reference: Reference,
    /// Time constant C of the first-order lag, above zero; `None`: the rise acts at once. An envelope's inputs have none.
    pub lag: Option<TimeConstant>,
    /// The square of the value counts, less the square of the reference; what lags is that.
    pub squared: bool,
}

/// What of a model may lag, in the order of its lags.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rises<'a> {
    /// Terms of a sum.
    pub terms: &'a [Term],
    /// Those of the slope.
    pub slope: &'a [Term<MicronPerMillimetreCelsius>],
    /// Inputs that are no terms.
    pub inputs: &'a [Input],
}

impl<'a> Rises<'a> {
    pub(super) fn into_iter(self) -> impl Iterator<Item = &'a Input> {
        let terms = self.terms.iter().map(|term| &term.input);
        terms.chain(self.slope.iter().map(|term| &term.input)).chain(self.inputs)
    }
}

impl Input {
    /// The value itself, less its reference.
    pub fn of(signal: SignalId, reference: Reference, lag: Option<Duration>) -> Input {
        Input { signal, reference, lag: lag.map(TimeConstant::of), squared: false }
    }

    /// The time constant of its lag, where it has one.
    pub fn time_constant(&self) -> Option<Duration> {
        self.lag.map(TimeConstant::span)
    }

    /// The value that counts, and what is subtracted from it.
    ///
    /// # Errors
    /// The signal cannot be used, its reference has not been captured, or its square is no finite number.
    #[allow(
        clippy::inline_always,
        reason = "called for each lag of each step, and dear to hand over in memory"
    )]
    #[inline(always)]
    pub(in crate::compensation) fn level(
        &self,
        snapshot: &Snapshot<'_>,
        machine: &Machine,
    ) -> Result<(f64, Captured), Unusable> {
        let (value, reference) = match snapshot.instead_of(self.signal) {
            Some(instead) => self.level_of(instead, machine).ok_or(Unusable::from(instead))?,
            None => {
                let value = snapshot.reading(self.signal).ok_or(Unusable::Signal(self.signal))?;
                (value, machine.captured(self.reference, self.signal).ok_or_else(|| self.misses(machine))?)
            }
        };
        if self.squared { squared(value, reference) } else { Ok((value, reference)) }
    }

    /// The same of what others say.
    fn level_of(&self, instead: &Instead, machine: &Machine) -> Option<(f64, Captured)> {
        let Says::Others { value, rise } = instead.says else { return None };
        let captured = machine.captured(self.reference, self.signal);
        match self.reference {
            // A rise that others predict needs no captured beginning; the square of a value does.
            Reference::Start => {
                let unread = Captured { value: Celsius::ZERO, at: Moment::default() };
                let start = if self.squared { captured? } else { captured.unwrap_or(unread) };
                Some((start.value.get() + rise, start))
            }
            // A zero that was taken since then is not known.
            Reference::Zero => {
                let is_known =
                    |zero: &Captured| zero.at <= instead.since && !machine.is_zeroed_anew(self.signal);
                Some((value?, captured.filter(is_known)?))
            }
            Reference::Fixed(_) => Some((value?, captured?)),
        }
    }

    /// Why there is no reference: it waits, for the machine or for its sensor.
    fn misses(&self, machine: &Machine) -> Unusable {
        if machine.is_withheld(self.reference, self.signal) {
            return Unusable::Unproven(self.signal);
        }
        Unusable::Reference(self.signal)
    }

    /// The rise now; behind its lag, where it has one.
    ///
    /// # Errors
    /// The signal cannot be used, its reference has not been captured, or the rise is no finite number.
    #[inline]
    pub fn rise(&self, inputs: &Inputs<'_>, lag: &Lag) -> Result<Celsius, Unusable> {
        lag.risen(&inputs.snapshot).map_or_else(|| self.rise_anew(inputs, lag), Ok)
    }

    #[inline(never)]
    fn rise_anew(&self, inputs: &Inputs<'_>, lag: &Lag) -> Result<Celsius, Unusable> {
        let (value, reference) = self.level(&inputs.snapshot, inputs.machine)?;
        let rise = match self.lag {
            Some(_) => lag.rise(self, inputs),
            None => Celsius::new(value - reference.value.get()),
        };
        rise.ok_or(Unusable::NotANumber)
    }
}

fn squared(value: f64, reference: Captured) -> Result<(f64, Captured), Unusable> {
    let square = |value: f64| Celsius::new(value * value).ok_or(Unusable::NotANumber);
    let from = square(reference.value.get())?;
    Ok((square(value)?.get(), Captured { value: from, ..reference }))
}
