//! Detects a new result of a probing cycle, and the Cz that acted during its measurement.
//!
//! A cycle of the CNC writes its result (the measured error) to one register. It then announces the result in another
//! register, the trigger. The trigger is a flag or a counter. A change of the trigger to a value other than zero
//! shows a new probing. The result of this probing is the first error that is read after the trigger, because an
//! error from before belongs to an earlier probing. Without a trigger, each change of the error shows a new probing.
//! Two equal results in a row then count as one probing.
//!
//! The first value of a trigger, and the first value after a failed read, do not show a new probing. The probing may
//! be an earlier one, and the Cz (compensation value) that acted then is not known.

use isotherm_core::compensation::{Measured, Probed, Refused};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{ProbeInput, Profile};

use super::arming::Arming;
use super::output::{Outputs, RegisterHealth};
use super::signal_table::SignalTable;

/// Probing (measurement of the remaining error) of one axis, and results that the next step of the axis will use.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct Probing {
    seen: Option<f64>,
    /// Probing whose trigger has changed, but whose result has not been read yet.
    begun: Option<StartedProbe>,
    /// Result with which the next step of the axis corrects its model.
    pub(in crate::gateway) measured: Option<Measured>,
    /// Whether the next step of the axis discards all corrections from earlier probings.
    pub(in crate::gateway) forget: bool,
}

/// Probing whose trigger has changed: the time, and the Cz that acted in the machine at this time.
#[derive(Clone, Copy, Debug)]
struct StartedProbe {
    at: Moment,
    acting: Option<Micron>,
}

/// Reason why the result of a probing cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum MissReason {
    NoResult,
    /// The Cz that acted in the machine during the measurement is not known.
    Acting,
}

impl MissReason {
    pub(in crate::gateway) fn message(self) -> &'static str {
        match self {
            MissReason::NoResult => "the result of the probing could not be read",
            MissReason::Acting => "it is not certain which Cz acted in the machine",
        }
    }
}

impl Probing {
    /// Checks whether a new result can be read. Returns `None` if there is no new result. An error is the
    /// reason why a new result cannot be used. `acting`: Cz that acts in the machine now.
    pub(in crate::gateway) fn check(
        &mut self,
        profile: &Profile,
        input: &ProbeInput,
        board: &SignalTable,
        now: Moment,
        acting: Option<Micron>,
    ) -> Option<Result<Measured, MissReason>> {
        let watched = input.trigger.unwrap_or(input.signal);
        let value = board.value(watched, now);
        let before = std::mem::replace(&mut self.seen, value);
        if let (Some(before), Some(value)) = (before, value)
            && before.to_bits() != value.to_bits()
            && (input.trigger.is_none() || value.abs() > 0.0)
        {
            self.begun = Some(StartedProbe { at: board.taken(watched), acting });
        }
        let StartedProbe { at, acting } = self.begun?;
        let result = board.value(input.signal, now).filter(|_| board.taken(input.signal) >= at);
        let found = match result.and_then(|error| Micron::new(error * input.micron)) {
            Some(error) => acting.map(|_| Measured { error, acting }).ok_or(MissReason::Acting),
            None if now.since(at) > profile.signal(input.signal).max_age => Err(MissReason::NoResult),
            None => return None,
        };
        self.begun = None;
        Some(found)
    }
}

/// Returns the Cz (compensation value) that acts in the machine: the Cz in the first output that writes Cz or
/// a position plus Cz. Zero if the axis has no such output. `None` if the Cz is not known.
pub(in crate::gateway) fn acting(axis: usize, outputs: &Outputs, arming: &Arming) -> Option<Micron> {
    let written =
        outputs.of_axis(axis).find(|(output, _)| output.writes.is_cz() || !output.writes.is_scheduled());
    let Some((output, state)) = written else { return Some(Micron::ZERO) };
    match state.standing {
        // If no position is written, the value that the readout shows is not known.
        _ if !output.writes.is_scheduled() && !arming.is_armed() => None,
        RegisterHealth::Verified | RegisterHealth::Interlocked | RegisterHealth::Foreign => state.cz,
        RegisterHealth::Unknown | RegisterHealth::Unverified => None,
    }
}

/// Returns cause and hint for the result of a probing that the axis has rejected.
pub(in crate::gateway) fn why_refused(
    profile: &Profile,
    axis: usize,
    refused: Refused,
    probed: &Probed,
) -> Explained {
    match refused {
        Refused::NoModel if profile.axes[axis].learning.is_some() => Explained::new(
            "no model can be used now, and the error is only stored for learning",
            "adopt a learned model when one is proposed, or see the alarms of the signals of the axis",
        ),
        Refused::NoModel => Explained::new(
            "no model of the axis can be used now",
            "see the alarms of the signals of the axis",
        ),
        Refused::Tripped => Explained::new(
            "the model requested more than the error level and is not used",
            "arm the axis again when the cause is found",
        ),
        Refused::Outside => Explained::new(
            "the inputs are outside the range on which the model was identified",
            "if such conditions are usual, identify the model again with data that include them",
        ),
        Refused::Implausible => {
            let settings = &profile.axes[axis].settings;
            let most = settings.probe.map_or(Micron::ZERO, |probe| probe.max_error);
            let more = format!("more than the {most} that axis.{}.probe.max_error allows", settings.name);
            Explained::new(format!("{}, {more}", wrong_by(probed)), "measure again")
        }
        Refused::Doubted(most) => Explained::new(
            format!("{}, more than the {most} that is plausible now", wrong_by(probed)),
            "measure again: the gateway waits for a second probing that agrees",
        ),
    }
}

fn wrong_by(probed: &Probed) -> String {
    format!("the model would be wrong by {}", probed.residual.unwrap_or_default().abs())
}

#[cfg(test)]
mod tests;
