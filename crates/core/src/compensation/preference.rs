//! Preferred model of an axis: its first model in the profile, or a model that was learned from touches while the gateway
//! ran. A touch is the result of one probing.
//!
//! An axis that learns has one more model, the slot. The slot has a term for each input of a learned model,
//! so that its lags follow the temperatures from the start. The gains of the slot are zero, and its value is
//! not used, until a learned model is adopted. Then the slot gets the gains of the learned model and becomes
//! the preferred model. The models of the profile become its fallbacks.
//!
//! ```text
//! preferred: the profile's first model ──(adopt)──► slot with gains A ──(adopt)──► slot with gains B
//!                      ▲                                   │    ▲                          │
//!                      └──────────────(back)───────────────┘    └──────────(back)──────────┘
//! ```
//!
//! | change | takes effect |
//! |---|---|
//! | [`When::Now`] | in the first step in which Cz can be kept |
//! | [`When::AtDatum`] | in the step in which a datum (zero point of Cz) of the axis is complete, if Cz can be kept |
//!
//! A datum is a capture of the references of the preferred model or of the slot, such as a machine start. On
//! an axis with the datum "zero", only a zero command captures a datum.
//!
//! Cz stays the same at a change: the correction of the new model becomes the offset that keeps Cz. With the
//! datum "zero", the zero point of the new model becomes the value that keeps Cz. A change waits while the
//! offset would exceed the limit of the probe. It also waits while the present or the new model has no value
//! or is outside its envelope. It waits too while a stand-in replaces a sensor. If Cz is zero because the
//! present model is worse than no compensation, Cz stays zero at the change.
//!
//! A saved preference belongs to the models of the profile. If these models change, the preference is discarded.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::model::{Input, Kind, Linear, Model};
use super::settings::LearnedSlot;
use crate::quantity::MicronPerCelsius;

/// Preferred model of an axis: a model of the profile, or the learned model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preferred {
    /// First model of the profile whose signals are all good.
    #[default]
    Profile,
    /// Learned model. The models of the profile are its fallbacks.
    Learned(LearnedModel),
}

/// Model that was learned from touches: Cz is the sum of its terms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnedModel {
    /// Name of the model, formed from the day of the last run that it was learned from, and from its terms.
    pub name: String,
    /// Terms. An input of the slot without a term has the gain zero.
    pub terms: Vec<LearnedTerm>,
}

/// Term of a learned model: an input (signal, lag, squared or not) and its gain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnedTerm {
    /// Index of the signal in the profile's list of signals.
    pub signal: usize,
    /// Time constant of the input's lag; `None` without a lag.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lag: Option<Duration>,
    /// Whether the input is the square of the signal.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub squared: bool,
    /// Gain in µm per unit of the input.
    pub gain: f64,
}

/// Time at which a change of the preferred model takes effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum When {
    /// In the first step in which Cz can be kept.
    Now,
    /// In the step in which a datum (zero point of Cz) of the axis is complete.
    AtDatum,
}

/// Requested change of the preferred model, with the time at which it takes effect.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Model that is preferred after the change.
    pub to: Preferred,
    /// Time at which the change takes effect: at once, or at the next datum.
    pub when: When,
    /// Fingerprint (hash) of the profile's models to which the change belongs.
    pub own: String,
}

/// Reason why a change of the preferred model is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unfit {
    /// The axis does not learn a model, so it has no learned model to prefer.
    NoSlot,
    /// The models of the profile have changed, so that the change does not belong to them.
    OtherProfile,
    /// A term has an input that the slot does not have, or a gain that is not finite.
    UnknownInput,
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Unfit::NoSlot => "the axis does not learn a model",
            Unfit::OtherProfile => "the models of the axis in the profile have changed",
            Unfit::UnknownInput => "the model has an input that the axis does not have",
        })
    }
}

/// Preferred model of an axis, the model that was preferred before, and a change that waits.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Preference {
    /// Fingerprint (hash) of the profile's models to which the preference belongs.
    own: String,
    preferred: Preferred,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    before: Option<Preferred>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    waiting: Option<Change>,
    /// Name of the learned model whose adoption an operator withdrew last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    withdrawn: Option<String>,
}

impl Preferred {
    /// Returns the name of the learned model; `None` for the models of the profile.
    pub fn name(&self) -> Option<&str> {
        match self {
            Preferred::Profile => None,
            Preferred::Learned(model) => Some(&model.name),
        }
    }

    /// Returns the learned model; `None` for the models of the profile.
    pub fn learned(&self) -> Option<&LearnedModel> {
        match self {
            Preferred::Profile => None,
            Preferred::Learned(model) => Some(model),
        }
    }
}

impl Preference {
    /// Creates the preference of an axis that learns: the models of the profile.
    pub(super) fn new(slot: Option<&LearnedSlot>) -> Preference {
        Preference { own: slot.map(|slot| slot.own.clone()).unwrap_or_default(), ..Preference::default() }
    }

    /// Returns the preferred model.
    pub fn preferred(&self) -> &Preferred {
        &self.preferred
    }

    /// Returns the model that was preferred before the last change; `None` if the preferred model has never changed.
    pub fn before(&self) -> Option<&Preferred> {
        self.before.as_ref()
    }

    /// Returns the requested change that waits to take effect; `None` if no change waits.
    pub fn waiting(&self) -> Option<&Change> {
        self.waiting.as_ref()
    }

    /// Returns whether this learned model was preferred before the last change, or its adoption was withdrawn by an
    /// operator.
    pub fn is_taken_back(&self, name: &str) -> bool {
        let left = self.before().and_then(Preferred::name);
        [left, self.withdrawn.as_deref()].contains(&Some(name))
    }

    /// Returns the fingerprint (hash) of the profile's models to which the preference belongs.
    pub fn own(&self) -> &str {
        &self.own
    }

    pub(super) fn is_learned(&self) -> bool {
        matches!(self.preferred, Preferred::Learned(_))
    }

    /// Returns whether the preference must be saved: a learned model is preferred, the preferred model has changed
    /// before, or a change waits or was withdrawn.
    pub(super) fn is_worth_saving(&self) -> bool {
        self.is_learned() || self.before.is_some() || self.waiting.is_some() || self.withdrawn.is_some()
    }

    /// Replaces the change that waits. With `None`, no change waits any more.
    pub(super) fn set_waiting(&mut self, change: Option<Change>) {
        self.waiting = change;
    }

    /// Discards the change that waits, and records the learned model to which it would have led.
    pub(super) fn withdraw(&mut self) {
        let name = self.waiting.take().and_then(|change| change.to.name().map(str::to_owned));
        self.withdrawn = name.or(self.withdrawn.take());
    }

    /// Removes and returns the waiting change if it may take effect in this step; else returns `None`. `at_datum`:
    /// whether a datum (zero point of Cz) of the axis has just been captured.
    pub(super) fn take_due(&mut self, at_datum: bool) -> Option<Change> {
        self.waiting.take_if(|change| at_datum || change.when == When::Now)
    }

    /// Records that a change has taken effect, so that `to` is now the preferred model. The former preferred model is
    /// stored.
    pub(super) fn changed(&mut self, to: Preferred) {
        self.before = Some(std::mem::replace(&mut self.preferred, to));
    }
}

impl LearnedModel {
    /// Returns the gain of each term of the slot.
    ///
    /// # Errors
    /// The slot lacks an input of the model, or a gain is not finite.
    pub(super) fn gains_in(&self, slot: &Model) -> Result<Vec<f64>, Unfit> {
        let mut gains = vec![0.0; slot.correctable().len()];
        for term in &self.terms {
            let is_it = |input: &Input| {
                (input.signal.0, input.time_constant(), input.squared)
                    == (term.signal, term.lag, term.squared)
            };
            let place = slot.correctable().iter().position(|own| is_it(&own.input));
            let place = place.filter(|_| term.gain.is_finite()).ok_or(Unfit::UnknownInput)?;
            gains[place] += term.gain;
        }
        Ok(gains)
    }
}

impl Model {
    /// Replaces the gains of a linear model. Returns the former gains. Nothing changes if the model is not linear.
    pub(super) fn exchange_gains(&mut self, gains: &[f64]) -> Vec<f64> {
        let Kind::Linear(Linear { terms, .. }) = &mut self.kind else { return Vec::new() };
        let former = terms.iter().map(|term| term.gain.get()).collect();
        let finite = gains.iter().map(|gain| MicronPerCelsius::new(*gain).unwrap_or_default());
        terms.iter_mut().zip(finite).for_each(|(term, gain)| term.gain = gain);
        former
    }
}
