//! Handover from a gateway to the program that replaces it in the same process. A handover contains the checked
//! profile and the armed axes. The new program continues to compensate these axes. The module [`memfd`] describes how
//! a handover is transported.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::gateway::shared::state::GatewayState;
use crate::gateway::state::arming::ArmRequest;
use crate::observe::requester::{Channel, Requester};
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::AxisId;

mod memfd;
mod memory;
mod profile;

pub use memfd::{Arrival, Prepared, digest_path};
pub use profile::{KeptProfile, answer_of_check, memory_for_profile};

/// State that a gateway passes to the program that replaces it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Handover {
    /// Requester of the replacement, as a phrase in a sentence, for example "by user anna".
    pub by: String,
    /// Names of the armed axes, with the last Cz (compensation value) of each axis.
    pub armed: BTreeMap<String, Micron>,
    /// Names of the axes that were switched off, with the reason. Only an operator may arm them again.
    pub off: BTreeMap<String, String>,
}

impl Handover {
    pub(in crate::gateway) fn of(core: &GatewayState, by: String) -> Handover {
        let mut handover = Handover { by, ..Handover::default() };
        let axes = core.given.profile.axes.iter().zip(core.arming.as_slice());
        for (place, (axis, arming)) in axes.enumerate() {
            let name = axis.settings.name.clone();
            if arming.is_armed() && !arming.is_tripped() {
                let of_position = core.outputs.of_axis(place);
                let verified_cz = of_position.filter(|(output, _)| output.writes.position().is_some());
                let verified_cz = verified_cz.filter_map(|(_, state)| state.cz).next();
                let decided = core.compensation.decision(place).map(|decision| decision.cz);
                handover.armed.insert(name, verified_cz.or(decided).unwrap_or_default());
            } else if arming.is_tripped() || arming.is_latched() && !core.places.is_why(&name, &arming.why) {
                // An axis that is off because of a former register is left out: the next start checks that register
                // again.
                handover.off.insert(name, arming.why.cause.clone());
            }
        }
        handover
    }

    /// Applies the handover to a new gateway. Each armed axis gets a request to arm, which waits for missing
    /// conditions like a request of an operator. Each axis that was switched off remains off.
    pub(in crate::gateway) fn go_on(&self, core: &mut GatewayState, now: Moment) {
        let profile = core.given.profile.clone();
        for (place, axis) in profile.axes.iter().enumerate() {
            let name = &axis.settings.name;
            if let Some(why) = self.off.get(name) {
                core.disarm(AxisId(place), why.as_str());
            } else if let Some(from) = self.armed.get(name).filter(|_| axis.has_model()) {
                let by = Arc::new(Requester::new(
                    Channel::Restart,
                    format!("armed before; restarted {}", self.by),
                ));
                let until = now.after(profile.arm_timeout);
                let reported = (String::new(), now);
                core.arming[place].asked = Some(ArmRequest { by, until, reported, from: Some(*from) });
            }
        }
    }
}
