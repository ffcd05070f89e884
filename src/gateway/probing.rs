//! When a probing cycle has left a new result, and which Cz acted while it measured.
//!
//! A cycle of the CNC writes its result into one register and then says so in another: a flag it raises, or a counter.
//! A change of the trigger to anything but zero is a probing; the result is what is read of the error from then on, so
//! that a result read just before its trigger is never taken for the new one. Without a trigger each change of the error
//! is a probing, and two equal results in a row are one.
//!
//! The first look at a trigger, and the first after it could not be read, only shows where it stands: a probing whose
//! moment is not known cannot be held against the Cz that acted then.

use isotherm_core::compensation::{Measured, Probed, Refused};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{ProbeInput, Profile};

use super::arming::Arming;
use super::board::Board;
use super::output::{Outputs, Standing};

/// The probing of one axis, and what waits to be handed to its step.
#[derive(Clone, Debug, Default)]
pub(super) struct Probing {
    seen: Option<f64>,
    /// A probing whose result has not been read yet.
    begun: Option<Begun>,
    /// To be learned at the next step.
    pub(super) measured: Option<Measured>,
    /// Everything learned is to be taken back at the next step.
    pub(super) forget: bool,
}

#[derive(Clone, Copy, Debug)]
struct Begun {
    at: Moment,
    acting: Option<Micron>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Missed {
    NoResult,
    /// What acted while it measured is not known.
    Acting,
}

impl Missed {
    pub(super) fn message(self) -> &'static str {
        match self {
            Missed::NoResult => "its result could not be read",
            Missed::Acting => "it is not certain which Cz stood in the machine",
        }
    }
}

impl Probing {
    /// Looks for a new result. `acting` is what stands in the machine now.
    pub(super) fn look(
        &mut self,
        profile: &Profile,
        input: &ProbeInput,
        board: &Board,
        now: Moment,
        acting: Option<Micron>,
    ) -> Option<Result<Measured, Missed>> {
        let watched = input.trigger.unwrap_or(input.signal);
        let value = board.value(watched, now);
        let before = std::mem::replace(&mut self.seen, value);
        if let (Some(before), Some(value)) = (before, value)
            && before.to_bits() != value.to_bits()
            && (input.trigger.is_none() || value.abs() > 0.0)
        {
            self.begun = Some(Begun { at: board.taken(watched), acting });
        }
        let Begun { at, acting } = self.begun?;
        let result = board.value(input.signal, now).filter(|_| board.taken(input.signal) >= at);
        let found = match result.and_then(|error| Micron::new(error * input.micron)) {
            Some(error) => acting.map(|_| Measured { error, acting }).ok_or(Missed::Acting),
            None if now.since(at) > profile.signal(input.signal).max_age => Err(Missed::NoResult),
            None => return None,
        };
        self.begun = None;
        Some(found)
    }
}

/// The Cz that stands in the machine: what its first output holds, as verified. Nothing acts where no output writes it.
pub(super) fn acting(axis: usize, outputs: &Outputs, arming: &Arming) -> Option<Micron> {
    let written =
        outputs.of_axis(axis).find(|(output, _)| output.writes.is_cz() || !output.writes.is_scheduled());
    let Some((output, state)) = written else { return Some(Micron::ZERO) };
    match state.standing {
        // Where nothing is written into a position, it is not known what the readout makes of that.
        _ if !output.writes.is_scheduled() && !arming.armed => None,
        Standing::Verified | Standing::Interlocked | Standing::Foreign => state.cz,
        Standing::Unknown | Standing::Unverified => None,
    }
}

/// Why nothing was learned.
pub(super) fn why_refused(profile: &Profile, axis: usize, refused: Refused, probed: &Probed) -> Explained {
    match refused {
        Refused::NoModel => {
            Explained::new("no model of the axis can be used now", "look at the alarms of its signals")
        }
        Refused::Tripped => Explained::new(
            "its model asked for more than the error level and is not used",
            "arm the axis again when the cause is found",
        ),
        Refused::Outside => Explained::new(
            "the inputs lie outside what its model was identified on",
            "if such days are usual, identify the model with them",
        ),
        Refused::Implausible => {
            let settings = &profile.axes[axis].settings;
            let most = settings.probe.map_or(Micron::ZERO, |probe| probe.max_error);
            let more = format!("more than the {most} of axis.{}.probe.max_error", settings.name);
            Explained::new(format!("{}, {more}", wrong_by(probed)), "measure again")
        }
        Refused::Doubted(most) => Explained::new(
            format!("{}, more than the {most} that it can have come to", wrong_by(probed)),
            "measure again: it waits for a second probing that agrees",
        ),
    }
}

fn wrong_by(probed: &Probed) -> String {
    format!("the model would be wrong by {}", probed.residual.unwrap_or_default().abs())
}

#[cfg(test)]
mod tests;
