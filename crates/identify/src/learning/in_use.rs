//! Model in use of an axis, as a sum of terms. A candidate (a newly learned model) is compared with this
//! model.

use crate::fleet::FleetModel;
use crate::method::PriorTerm;
use isotherm_core::compensation::model::{Expected, Kind, Linear, Term};
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::compensation::{LearnedModel, LearnedTerm};
use isotherm_profile::{Profile, sha256};

/// Model in use of an axis: its terms, and its expected error.
#[derive(Clone, Debug, PartialEq)]
pub struct InUse {
    pub(super) terms: Vec<PriorTerm>,
    pub(super) expected: Option<Expected>,
}

impl InUse {
    /// Returns the first model of an axis in the profile. For an axis without a model, the result has no terms.
    ///
    /// # Errors
    /// The model is not a sum of terms.
    pub fn of(profile: &Profile, axis: &str) -> Result<InUse, String> {
        let Some(model) = settings(profile, axis).and_then(|own| own.own_models().first()) else {
            return Ok(InUse { terms: Vec::new(), expected: None });
        };
        let Kind::Linear(Linear { terms, slope: None, .. }) = &model.kind else {
            return Err(format!(
                "model {} of axis {axis} is not a sum of terms, or has a slope: no candidate can be compared \
                 with this model",
                model.name
            ));
        };
        let term = |term: &Term| {
            let signal = profile.signals.get(term.input.signal.0)?;
            Some(PriorTerm {
                signal: signal.name.clone(),
                lag: term.input.time_constant(),
                squared: term.input.squared,
                gain: term.gain.get(),
            })
        };
        Ok(InUse { terms: terms.iter().filter_map(term).collect(), expected: model.expected })
    }

    /// Returns the model in use after `candidate` has replaced this model. The expected error of this model is kept.
    #[must_use]
    pub fn replaced_by(&self, candidate: &FleetModel) -> InUse {
        InUse { terms: candidate.prior(), expected: self.expected }
    }

    /// Returns the learned model that an axis has adopted. The expected error is taken from the first model of the axis
    /// in the profile.
    pub fn adopted(profile: &Profile, axis: &str, model: &LearnedModel) -> InUse {
        let term = |term: &LearnedTerm| {
            let signal = profile.signals.get(term.signal)?.name.clone();
            Some(PriorTerm { signal, lag: term.lag, squared: term.squared, gain: term.gain })
        };
        let own = settings(profile, axis).and_then(|own| own.own_models().first());
        InUse {
            terms: model.terms.iter().filter_map(term).collect(),
            expected: own.and_then(|model| model.expected),
        }
    }

    /// Returns a text (hash) that identifies the model. Terms with the gain zero do not change the hash.
    pub(super) fn fingerprint(&self) -> String {
        fingerprint(&self.terms)
    }
}

/// Returns a text (hash) that identifies a model by its terms. Terms with the gain zero do not change the hash.
pub(super) fn fingerprint(terms: &[PriorTerm]) -> String {
    let effective: Vec<&PriorTerm> = terms.iter().filter(|term| term.gain.abs() > 0.0).collect();
    sha256(format!("{effective:?}").as_bytes())
}

/// Returns the settings of the axis with this name; `None` if the profile does not have this axis.
pub(super) fn settings<'a>(profile: &'a Profile, axis: &str) -> Option<&'a AxisSettings> {
    profile.axes.iter().map(|axis| &axis.settings).find(|own| own.name == axis)
}
