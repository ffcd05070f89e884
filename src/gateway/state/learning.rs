//! Learned model of an axis: the candidate (proposed model), and the resulting change of the preferred model. The
//! code uses no lock and no disk.

use std::sync::Arc;
use std::time::Duration;

use crate::observe::status::{CandidateStatus, LearnedStatus};
use isotherm_core::candidate::{Gain, Occasion, Offer, OfferedTerm, Policy, Step};
use isotherm_core::compensation::{Change, LearnedModel, LearnedTerm, Preference, Preferred, When};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::Profile;

/// Hint for a candidate that does not fit the profile.
const LEARN_AGAIN: &str = "run `isotherm learn` again";

/// Candidate (proposed model) of one axis, and the last reports about the candidate.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct AxisLearning {
    /// Last candidate that `isotherm learn` has written; `None` if no candidate exists.
    pub(in crate::gateway) offer: Option<Arc<Offer>>,
    /// Name of the preferred learned model in the last report; `None` if the model of the profile is preferred.
    pub(in crate::gateway) preferred: Option<String>,
    /// Name of the candidate that was last reported as better.
    reported: Option<String>,
}

/// Consequence of a new candidate (proposed model) for the preferred model of its axis.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::gateway) enum Consequence {
    /// The preferred model does not change.
    None,
    /// The adoption of an earlier candidate, which is not carried out yet, is withdrawn.
    Withdraw,
    /// The candidate is adopted at the next datum (new zero point of Cz).
    Adopt(Change),
}

impl AxisLearning {
    /// Creates the learning state of an axis at the start of a run.
    pub(in crate::gateway) fn begin(preference: Option<&Preference>) -> AxisLearning {
        let preferred = preference.and_then(|preference| preference.preferred().name());
        AxisLearning { preferred: preferred.map(str::to_owned), ..AxisLearning::default() }
    }

    /// Returns the learned model and the candidate for the status.
    pub(in crate::gateway) fn status(&self, preference: &Preference, policy: Policy) -> LearnedStatus {
        let named = |preferred: &Preferred| preferred.name().unwrap_or_default().to_owned();
        let candidate = self.offer.as_ref().map(|offer| {
            let gain = offer.judgement.gain();
            let is_another = preference.preferred().name() != Some(offer.name.as_str());
            CandidateStatus {
                model: offer.name.clone(),
                runs: offer.runs,
                since: gain.map(|gain| day(gain.since)),
                days: gain.map_or(0, |gain| gain.days),
                touches: gain.map_or(0, |gain| gain.touches),
                in_use_um: gain.map(|gain| gain.in_use.get()),
                candidate_um: gain.map(|gain| gain.candidate.get()),
                better: is_another && is_current(offer, preference) && offer.judgement.is_better(),
            }
        });
        LearnedStatus {
            adopted: preference.preferred().name().map(str::to_owned),
            before: preference.before().map(named),
            waiting: preference.waiting().map(|change| named(&change.to)),
            auto: self.policy(policy, preference) == Policy::Auto,
            candidate,
        }
    }

    /// Takes a new candidate (proposed model). Returns its gain (improvement) if the gain must be reported, and the
    /// consequence for the preferred model.
    pub(in crate::gateway) fn take(
        &mut self,
        (profile, axis): (&Profile, usize),
        offer: Option<Offer>,
        preference: &Preference,
    ) -> (Option<Gain>, Consequence) {
        self.offer = offer.map(Arc::new);
        let policy = profile.axes[axis].learning.as_ref().map(|learning| learning.adopt).unwrap_or_default();
        // The gateway requests a change at a datum, and a person one at once. The profile may have had `auto` before.
        let waiting = preference.waiting().map(|change| change.when);
        let nothing = if waiting == Some(When::AtDatum) { Consequence::Withdraw } else { Consequence::None };
        let Some(offer) = &self.offer else { return (None, nothing) };
        if !is_current(offer, preference) || preference.preferred().name() == Some(offer.name.as_str()) {
            return (None, nothing);
        }
        let policy = self.policy(policy, preference);
        let (gain, consequence) = match offer.judgement.decide(policy, Occasion::default()) {
            Step::Keep => return (None, nothing),
            Step::Propose(gain) => (gain, nothing),
            // The request of a person is not replaced.
            Step::WaitForDatum(gain) | Step::Adopt(gain) if waiting == Some(When::Now) => (gain, nothing),
            Step::WaitForDatum(gain) | Step::Adopt(gain) => match change(profile, axis, offer, When::AtDatum)
            {
                Ok(change) => (gain, Consequence::Adopt(change)),
                Err(_) => return (None, nothing),
            },
        };
        let is_news = self.reported.replace(offer.name.clone()).as_ref() != Some(&offer.name);
        (is_news.then_some(gain), consequence)
    }

    /// Returns the policy for the adoption of the candidate. If an operator has replaced this candidate by
    /// the previous model, or withdrawn its adoption, only an operator may adopt the candidate again.
    pub(in crate::gateway) fn policy(&self, policy: Policy, preference: &Preference) -> Policy {
        match &self.offer {
            Some(offer) if preference.is_taken_back(&offer.name) => Policy::Propose,
            _ => policy,
        }
    }

    /// Returns the change by which an operator adopts the candidate.
    ///
    /// # Errors
    /// Returns why the candidate is not adopted.
    pub(in crate::gateway) fn adopt(
        &self,
        (profile, axis): (&Profile, usize),
        preference: &Preference,
    ) -> Result<Change, Explained> {
        let Some(offer) = &self.offer else {
            return Err(Explained::new(
                "no candidate has been learned yet",
                "the gateway learns once a day from the touches (probe measurements) of the axis; to learn now, run \
                 `isotherm learn`",
            ));
        };
        if preference.preferred().name() == Some(offer.name.as_str()) {
            return Err(format!("the axis follows model {} already", offer.name).into());
        }
        if !is_current(offer, preference) {
            return Err(Explained::new(
                "the candidate was compared with another model than the one in use",
                LEARN_AGAIN,
            ));
        }
        let policy = profile.axes[axis].learning.as_ref().map(|learning| learning.adopt).unwrap_or_default();
        match offer.judgement.decide(policy, Occasion { confirmed: true, at_datum: false }) {
            Step::Adopt(_) => change(profile, axis, offer, When::Now),
            Step::Keep | Step::Propose(_) | Step::WaitForDatum(_) => Err(not_better(offer)),
        }
    }
}

/// Returns the date of a time of the computer's clock, as text (2026-01-31).
pub(in crate::gateway) fn day(at: Moment) -> String {
    let mut text = Vec::new();
    time::write(&mut text, at);
    String::from_utf8_lossy(&text).chars().take_while(|c| *c != 'T').collect()
}

/// Returns whether the candidate was compared with the model that is in use now. The models of the profile may have
/// changed after the comparison.
fn is_current(offer: &Offer, preference: &Preference) -> bool {
    offer.own == preference.own() && offer.compared_with.as_deref() == preference.preferred().name()
}

/// Returns why a candidate is not adopted: the candidate is not better than the model in use, or the models
/// were not compared yet.
fn not_better(offer: &Offer) -> Explained {
    let cause = match offer.judgement.gain() {
        None => "the candidate has not been compared with the model in use yet".to_owned(),
        Some(gain) => format!(
            "the candidate is not better: it would have left a residual error of {:.1} µm instead of \
             {:.1} µm",
            gain.candidate.get(),
            gain.in_use.get()
        ),
    };
    Explained::new(cause, "probe the axis on more days; the candidate is compared again on each day")
}

/// Returns the change that makes the axis use its previous model again.
///
/// # Errors
/// The axis has no previous model. The error contains the reason.
pub(in crate::gateway) fn back(
    (profile, axis): (&Profile, usize),
    preference: &Preference,
) -> Result<Change, Explained> {
    let before = preference.before().ok_or("no other model was in use before")?;
    let has_own = !profile.axes[axis].settings.own_models().is_empty();
    if *before == Preferred::Profile && !has_own {
        return Err("the profile has no model for this axis".into());
    }
    Ok(Change { to: before.clone(), when: When::Now, own: preference.own().to_owned() })
}

/// Returns the change of the preferred model that adopts a candidate.
///
/// # Errors
/// The profile lacks a signal of the candidate.
pub(crate) fn change(profile: &Profile, axis: usize, offer: &Offer, when: When) -> Result<Change, Explained> {
    let term = |term: &OfferedTerm| -> Result<LearnedTerm, Explained> {
        let signal = profile.signals.iter().position(|signal| signal.name == term.signal);
        let lag = Duration::try_from_secs_f64(term.lag_s).ok();
        let (signal, lag) = signal.zip(lag).ok_or_else(|| {
            Explained::new(
                format!("the candidate needs signal {}, which is not in the profile", term.signal),
                LEARN_AGAIN,
            )
        })?;
        let lag = (!lag.is_zero()).then_some(lag);
        Ok(LearnedTerm { signal, lag, squared: term.squared, gain: term.gain })
    };
    let terms = offer.terms.iter().map(term).collect::<Result<Vec<LearnedTerm>, Explained>>()?;
    let own = profile.axes[axis].settings.learned.as_ref().map(|slot| slot.own.clone()).unwrap_or_default();
    let to = Preferred::Learned(LearnedModel { name: offer.name.clone(), terms });
    Ok(Change { to, when, own })
}
