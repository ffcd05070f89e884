//! Order of an axis's models, and changes of the preferred model. At such a change, the Cz of the axis stays
//! the same. The preferred model is a model of the profile, or the learned model. The slot is the model of
//! the axis that receives learned gains. The envelope of a model is the region of inputs on which the model
//! was identified.

use super::Axis;
use super::model_choice::ModelChoice;
use crate::compensation::model::Coverage;
use crate::compensation::preference::{Change, Preference, Preferred, Unfit};
use crate::compensation::probe::Learned;
use crate::compensation::reference::Machine;
use crate::compensation::settings::{Datum, ProbeSettings};
use crate::compensation::{Permit, Snapshot};

/// Values that keep Cz the same when another model becomes the preferred model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct KeptCz {
    /// Offset that becomes the correction of the new model, µm.
    offset: f64,
    /// Change of Cz by the datum (zero point of Cz) of the new model, µm. Zero unless the axis has the datum "zero".
    raised: f64,
}

impl Axis {
    /// Returns the indices of the models in the order of preference. The learned model is left out unless it is
    /// preferred.
    pub(super) fn ranked(&self) -> impl Iterator<Item = usize> + use<> {
        let slot = self.settings.learned.as_ref().map(|slot| slot.model);
        let first = slot.filter(|_| self.preference.is_learned());
        let own = (0..self.settings.models.len()).filter(move |place| Some(*place) != slot);
        first.into_iter().chain(own)
    }

    /// Returns the index of the preferred model; `None` if the axis has no model.
    pub(super) fn preferred(&self) -> Option<usize> {
        self.ranked().next()
    }

    /// Returns whether the axis may use this model: a model of the profile, or the learned model if it is preferred.
    pub(super) fn is_ranked(&self, place: usize) -> bool {
        !self.is_slot(place) || self.preference.is_learned()
    }

    /// Returns whether this is the slot: the model of the axis whose gains are learned.
    pub(super) fn is_slot(&self, place: usize) -> bool {
        self.settings.learned.as_ref().is_some_and(|slot| slot.model == place)
    }

    /// Requests a change of the preferred model. The request replaces a change that waits to take effect.
    /// `None` cancels the waiting change.
    ///
    /// # Errors
    /// Returns why the change is rejected.
    pub(in crate::compensation) fn prefer(&mut self, change: Option<Change>) -> Result<(), Unfit> {
        let slot = self.settings.learned.as_ref().ok_or(Unfit::NoSlot)?;
        if let Some(change) = &change {
            if change.own != slot.own {
                return Err(Unfit::OtherProfile);
            }
            if let Preferred::Learned(model) = &change.to {
                let slot = self.settings.models.get(slot.model).ok_or(Unfit::NoSlot)?;
                model.gains_in(slot)?;
            }
        }
        self.preference.set_waiting(change);
        self.due = None;
        Ok(())
    }

    /// Withdraws the waiting change of the preferred model at an operator's request.
    pub(in crate::compensation) fn withdraw(&mut self) {
        self.preference.withdraw();
        self.due = None;
    }

    /// Restores the preferred model of an earlier run. If the models of the profile have changed since then, the models
    /// of the profile are preferred.
    pub(super) fn recall_preference(&mut self, kept: Option<&Preference>) {
        let Some(slot) = &self.settings.learned else { return };
        let Some(kept) = kept.filter(|kept| kept.own() == slot.own) else { return };
        let place = slot.model;
        if let Some(learned) = kept.preferred().learned() {
            let Some(model) = self.settings.models.get_mut(place) else { return };
            let Ok(gains) = learned.gains_in(model) else { return };
            model.exchange_gains(&gains);
            if let Some(correction) = self.probe.models.get_mut(place) {
                *correction = Learned::new(model, self.settings.probe.as_ref());
            }
        }
        self.preference = kept.clone();
    }

    /// Carries out the waiting change of the preferred model if it may take effect in this step and Cz can be kept.
    /// Otherwise the change waits. `at_datum`: whether a datum (zero point of Cz) has just been captured.
    pub(super) fn change_preferred(
        &mut self,
        (snapshot, machine): (&Snapshot<'_>, &Machine),
        at_datum: bool,
        permit: Permit,
    ) {
        let Some(place) = self.settings.learned.as_ref().map(|slot| slot.model) else { return };
        let Some(settings) = self.settings.probe else { return };
        let Some(change) = self.preference.take_due(at_datum) else { return };
        let before = self.choose(snapshot, machine).0;
        let gains = match (change.to.learned(), self.settings.models.get(place)) {
            (None, _) => None,
            // After a restart, the slot may lack an input of the learned model that waits.
            (Some(learned), Some(slot)) => match learned.gains_in(slot) {
                Ok(gains) => Some(gains),
                Err(_) => return,
            },
            (Some(_), None) => return,
        };
        // If the profile has no model for the axis, the axis cannot return to such a model.
        let to = match &change.to {
            Preferred::Learned(_) => Some(place),
            Preferred::Profile => (0..self.settings.models.len()).find(|own| *own != place),
        };
        let Some(to) = to else { return };
        let former =
            gains.and_then(|gains| Some(self.settings.models.get_mut(place)?.exchange_gains(&gains)));
        match self.keeping_cz(to, before, (&settings, permit), (snapshot, machine)) {
            Some(kept) => {
                let (from, model) = (before.map_or(to, |before| before.model), &self.settings.models[to]);
                let correction = self.probe.models[from].moved_to(model, &settings, kept.offset);
                // A running capture of the references of the new model continues.
                let renewal = self.probe.models[to].renewal();
                self.probe.models[to] = correction;
                if let Some(complete) = renewal {
                    self.probe.models[to].renew(complete);
                }
                self.zeroing.raise(to, kept.raised);
                self.preference.changed(change.to);
                self.decision.worse = None;
            }
            None => {
                if let (Some(former), Some(slot)) = (former, self.settings.models.get_mut(place)) {
                    slot.exchange_gains(&former);
                }
                self.preference.set_waiting(Some(change));
            }
        }
    }

    /// Returns the values with which another model requests the same Cz as the model in use. `None` if Cz
    /// cannot be kept, for example because a model has no value or is outside its envelope, or because the
    /// offset would exceed the limit of the probe.
    fn keeping_cz(
        &self,
        to: usize,
        before: Option<ModelChoice>,
        (settings, permit): (&ProbeSettings, Permit),
        (snapshot, machine): (&Snapshot<'_>, &Machine),
    ) -> Option<KeptCz> {
        let Some(before) = before else {
            // An axis without a model has requested nothing.
            self.preferred().is_none().then_some(())?;
            if self.settings.datum != Datum::Zero {
                return Some(KeptCz::default());
            }
            // The datum of the slot was captured while its gains were zero.
            let asked = self.asked(to, self.evaluate(to, snapshot, machine).ok()?);
            return Some(KeptCz { offset: 0.0, raised: -asked.cz });
        };
        let evaluated = self.evaluate(to, snapshot, machine).ok()?;
        let is_inside =
            |coverage: Option<Coverage>| coverage.is_none_or(|coverage| coverage.extrapolating.is_none());
        if !is_inside(evaluated.coverage) || !is_inside(before.coverage) {
            return None;
        }
        let wanted = self.cz_to_keep(&before, permit)? - self.asked(to, evaluated).cz;
        if self.settings.datum == Datum::Zero {
            let offset = self.probe.models.get(before.model)?.offset();
            return Some(KeptCz { offset, raised: wanted - offset });
        }
        (wanted.abs() <= settings.limit.get()).then_some(KeptCz { offset: wanted, raised: 0.0 })
    }

    /// Returns the Cz that the new model must request, µm. `None` while the envelope of the model in use
    /// keeps Cz, or a stand-in replaces one of its sensors. Neither applies to the new model.
    fn cz_to_keep(&self, before: &ModelChoice, permit: Permit) -> Option<f64> {
        if self.kept_outside || before.stood_in.is_some() {
            return None;
        }
        let is_left = permit == Permit::Armed
            && self.settings.leaves_what_is_worse()
            && self.probe.worse(before.model).is_some();
        // Cz goes to zero, or is zero, instead of the value that the model in use requests.
        Some(if is_left { self.guard.value().get() } else { before.raw.get() })
    }
}
