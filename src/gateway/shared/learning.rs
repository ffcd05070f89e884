//! Candidates (proposed learned models) of the axes, and their adoption. The functions run while the shared state is
//! locked.

use super::state::GatewayState;
use crate::gateway::state::learning::{Consequence, back, day};
use crate::observe::events::{Adoption, Event};
use isotherm_core::candidate::{Gain, Offer};
use isotherm_core::compensation::{Change, Preferred, Unfit};
use isotherm_core::explained::Explained;
use isotherm_profile::Profile;

/// Hint if a requested model does not fit the profile.
const LEARN_AGAIN: &str = "run `isotherm learn` again";

impl GatewayState {
    /// Processes a new candidate (proposed model) of an axis that `isotherm learn` has written. If the profile allows
    /// it, the gateway adopts a better candidate at the next datum (new zero point of Cz).
    pub(in crate::gateway) fn take_candidate(&mut self, axis: usize, offer: Option<Offer>) {
        let profile = self.given.profile.clone();
        let Some(preference) = self.compensation.preference(axis) else { return };
        let (gain, consequence) = self.learning[axis].take((&profile, axis), offer, preference);
        let auto = matches!(consequence, Consequence::Adopt(_));
        // A change was checked when it was made from the candidate. Otherwise the axis keeps its model.
        let _ = match consequence {
            Consequence::None => Ok(()),
            Consequence::Withdraw => self.prefer(axis, None),
            Consequence::Adopt(change) => self.prefer(axis, Some(change)),
        };
        let offer = self.learning[axis].offer.clone();
        if let (Some(gain), Some(offer)) = (gain, offer) {
            let Gain { since, days, touches, in_use, candidate } = gain;
            self.events.push(Event::Adoption(Adoption::Better {
                axis: profile.axes[axis].settings.name.clone(),
                model: offer.name.clone(),
                since: day(since),
                days,
                touches,
                in_use,
                candidate,
                auto,
            }));
        }
    }

    /// Adopts the candidate of an axis, because an operator has confirmed the adoption. Returns a sentence
    /// for the operator.
    ///
    /// # Errors
    /// Returns why the candidate is not adopted.
    pub(in crate::gateway) fn adopt(&mut self, axis: usize) -> Result<String, Explained> {
        let profile = self.given.profile.clone();
        let preference = self.compensation.preference(axis).ok_or_else(|| not_learning(&profile, axis))?;
        let change = self.learning[axis].adopt((&profile, axis), preference)?;
        self.changed(axis, change)
    }

    /// Returns to the model that the axis used before, or withdraws a change of the model that is not carried out
    /// yet. Returns a sentence for the operator.
    ///
    /// # Errors
    /// Returns why the axis has no previous model.
    pub(in crate::gateway) fn adopt_back(&mut self, axis: usize) -> Result<String, Explained> {
        let profile = self.given.profile.clone();
        let preference = self.compensation.preference(axis).ok_or_else(|| not_learning(&profile, axis))?;
        if preference.waiting().is_some() {
            self.compensation.withdraw(axis);
            self.requested(axis, None);
            return Ok(format!("{}: the axis keeps its model", profile.axes[axis].settings.name));
        }
        let change = back((&profile, axis), preference)?;
        self.changed(axis, change)
    }

    fn changed(&mut self, axis: usize, change: Change) -> Result<String, Explained> {
        let name = self.given.profile.axes[axis].settings.name.clone();
        let to = match &change.to {
            Preferred::Profile => "the model of the profile".to_owned(),
            Preferred::Learned(model) => format!("model {}", model.name),
        };
        self.prefer(axis, Some(change))?;
        Ok(format!("{name}: the axis follows {to} from the next step in which Cz does not move"))
    }

    /// Requests a change of the preferred model, and records the request in the log. `None` withdraws a request that
    /// is not carried out yet.
    fn prefer(&mut self, axis: usize, change: Option<Change>) -> Result<(), Explained> {
        let rejected = |unfit: Unfit| Explained::new(unfit.to_string(), LEARN_AGAIN);
        self.compensation.prefer(axis, change.clone()).map_err(rejected)?;
        self.requested(axis, change.as_ref());
        Ok(())
    }

    /// Records a requested change of the preferred model in the log. `None` records that the request was withdrawn.
    fn requested(&mut self, axis: usize, change: Option<&Change>) {
        self.storage.preferred(axis, change);
        self.storage.remember_soon();
        self.next_due = self.compensation.next_due();
    }

    /// Reports each axis whose preferred model has changed in this step. Returns whether an axis was reported.
    pub(super) fn report_preferred(&mut self, profile: &Profile) -> bool {
        let mut any = false;
        for (axis, own) in profile.axes.iter().enumerate() {
            let Some(preference) = self.compensation.preference(axis) else { continue };
            let model = preference.preferred().name();
            if self.learning[axis].preferred.as_deref() == model {
                continue;
            }
            any = true;
            let model = model.map(str::to_owned);
            let before = std::mem::replace(&mut self.learning[axis].preferred, model.clone());
            let axis = own.settings.name.clone();
            self.events.push(Event::Adoption(Adoption::Adopted { axis, model, before }));
        }
        any
    }
}

fn not_learning(profile: &Profile, axis: usize) -> Explained {
    let name = &profile.axes[axis].settings.name;
    Explained::new(
        format!("axis {name} does not learn a model"),
        format!("write learn = \"daily\" under [axis.{name}.probe], and restart the gateway"),
    )
}
