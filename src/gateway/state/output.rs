//! State of an output as the gateway knows it: the register value, and whether it was verified.

use std::ops::{Index, IndexMut};
use std::sync::Arc;
use std::time::Duration;

use super::device_health::DeviceHealth;
use super::dirty_vec::DirtyVec;
use super::units::{cz_factor, is_near};
use crate::fieldbus::seen::Seen;
use crate::observe::events::HandshakeFault;
use isotherm_core::compensation::AxisState;
use isotherm_core::display::{Display, Intent, KnownCz};
use isotherm_core::output::Awaited;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{Handshake, Output, OutputId, Profile, Writes};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(in crate::gateway) enum RegisterHealth {
    /// The register has not been read or written in this run, so its value is not known.
    #[default]
    Unknown,
    /// The register value is known, and is the value that the gateway expects.
    Verified,
    /// The last write failed, or the value read back was different.
    Unverified,
    Interlocked,
    /// The operator must assess the register value, for example because another client wrote it.
    Foreign,
}

/// State of one output, for the axes and for the display.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::gateway) struct OutputState {
    pub(in crate::gateway) standing: RegisterHealth,
    /// Last verified Cz (compensation value) in the register. For a slope, this is the effect of the slope at the
    /// axis's largest distance from the reference position. For a corrected position, this is the Cz that the
    /// position includes. For a reference position, the number has no meaning, and `Some` means that the register
    /// value is known.
    pub(in crate::gateway) cz: Option<Micron>,
    /// Last known register value, in the unit of the output; `None` if no value is known yet.
    pub(in crate::gateway) value: Option<f64>,
    /// Parts of the register value: operator offset (entered by the operator) and gateway share (added by the gateway),
    /// in the unit of the output. `None` if the register is not shared.
    pub(in crate::gateway) shares: Option<(f64, f64)>,
    pub(in crate::gateway) verified_at: Option<Moment>,
    /// Value that the control reports as applied, in the unit of the output, and the time of the request that read it.
    pub(in crate::gateway) applied: Option<(f64, Moment)>,
    /// Time after which an unanswered write can no longer arrive at the register. `None` if no write is unanswered.
    pub(in crate::gateway) waits_until: Option<Moment>,
    /// Whether the next change of the register must wait until `waits_until`.
    pub(in crate::gateway) is_waiting: bool,
    /// Whether the device has acknowledged the last write, but the register is never read back. The register value is
    /// then only assumed.
    pub(in crate::gateway) is_only_acknowledged: bool,
    pub(in crate::gateway) writes: u64,
    /// Number of failed requests since the last verified write.
    pub(in crate::gateway) failures: u64,
    /// Last failed request; `None` before the first one.
    pub(in crate::gateway) cause: Option<Seen>,
    pub(in crate::gateway) handshake: HandshakeStatus,
}

/// States of all outputs of the profile.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct Outputs {
    profile: Arc<Profile>,
    states: DirtyVec<OutputState>,
    /// Outputs of each axis, in the order of the profile.
    of_axis: Arc<Vec<Vec<OutputId>>>,
}

/// Status of the handshake by which the control accepts the values of an output set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) struct HandshakeStatus {
    pub(in crate::gateway) waits: Option<Awaited>,
    /// Failure of the last handshake. `None` after a successful handshake.
    pub(in crate::gateway) failed: Option<HandshakeFault>,
    /// Whether the strobe signal is set, or may be set.
    pub(in crate::gateway) strobe_up: bool,
    /// Whether the control word that is written with the strobe signal may report that every axis is armed.
    pub(in crate::gateway) says_enabled: bool,
    /// Whether the control has not accepted the register value yet.
    pub(in crate::gateway) is_untaken: bool,
}

impl Outputs {
    pub(in crate::gateway) fn new(profile: &Arc<Profile>) -> Outputs {
        let mut of_axis = vec![Vec::new(); profile.axes.len()];
        for (place, output) in profile.outputs.iter().enumerate() {
            of_axis[output.axis.0].push(OutputId(place));
        }
        Outputs {
            profile: profile.clone(),
            states: DirtyVec::new(vec![OutputState::default(); profile.outputs.len()]),
            of_axis: Arc::new(of_axis),
        }
    }

    /// Returns the indices of the outputs of an axis.
    pub(in crate::gateway) fn ids(&self, axis: usize) -> &[OutputId] {
        &self.of_axis[axis]
    }

    pub(in crate::gateway) fn of_axis(&self, axis: usize) -> impl Iterator<Item = (&Output, &OutputState)> {
        self.of_axis[axis].iter().map(|id| (self.profile.output(*id), &self.states[id.0]))
    }

    /// Returns the state of an axis for the display.
    pub(in crate::gateway) fn display(
        &self,
        axis: usize,
        (state, intent): (AxisState, Intent),
        (device_health, dry_run): (&DeviceHealth, bool),
    ) -> Display {
        Display::of(state, intent, self.held(axis, device_health, dry_run))
    }

    /// Returns how far the gateway knows the Cz that the control applies to an axis: zero, another value,
    /// unknown, or unreachable because a device does not answer.
    fn held(&self, axis: usize, device_health: &DeviceHealth, dry_run: bool) -> KnownCz {
        if dry_run {
            return KnownCz::Unknown;
        }
        let mut held = KnownCz::Unknown;
        for (output, state) in self.of_axis(axis).filter(|(output, _)| output.writes.is_cz()) {
            let Some(cz) = state.cz else { continue };
            if device_health.devices[output.device.0].does_not_answer() {
                return KnownCz::Unreachable;
            }
            let is_zero = state.is_near(&self.profile, output, cz, Micron::ZERO);
            held = if is_zero && held != KnownCz::Other { KnownCz::Zero } else { KnownCz::Other };
        }
        held
    }

    pub(in crate::gateway) fn states(&self) -> &[OutputState] {
        self.states.as_slice()
    }

    /// Returns the next output whose state may have changed and was not returned yet; `None` if no such output
    /// remains.
    pub(in crate::gateway) fn next_changed(&mut self) -> Option<OutputId> {
        self.states.next_changed().map(OutputId)
    }
}

impl Index<usize> for Outputs {
    type Output = OutputState;

    fn index(&self, place: usize) -> &OutputState {
        &self.states[place]
    }
}

impl IndexMut<usize> for Outputs {
    fn index_mut(&mut self, place: usize) -> &mut OutputState {
        &mut self.states[place]
    }
}

impl HandshakeStatus {
    /// Returns a text about the handshake for the web page; empty if there is nothing to report.
    pub(in crate::gateway) fn message(self, handshake: Option<&Handshake>) -> String {
        let Some(Handshake { strobe, acknowledge, .. }) = handshake else { return String::new() };
        match (self.failed, self.waits) {
            (Some(failed), _) => failed.message().to_owned(),
            (None, Some(Awaited::Acknowledge)) => format!("waits for the acknowledge signal ({acknowledge})"),
            (None, Some(Awaited::Clear | Awaited::Release)) => {
                format!("waits for the acknowledge signal to drop ({acknowledge})")
            }
            (None, None) if self.strobe_up => format!("the strobe signal may be up ({strobe})"),
            (None, None) => String::new(),
        }
    }
}

impl OutputState {
    /// Returns the longest remaining time for which a change of the register must wait for an unanswered write.
    /// `None` if no change waits.
    pub(in crate::gateway) fn waits(&self, now: Moment) -> Option<Duration> {
        self.waits_until.filter(|_| self.is_waiting).map(|until| until.since(now))
    }

    /// Returns a note about the register value for the web page. The note is empty if there is nothing to report.
    pub(in crate::gateway) fn note(&self, now: Moment) -> String {
        match self.waits(now) {
            Some(span) => format!("waiting for a late write, {} s", span.as_secs()),
            None if self.is_only_acknowledged && self.verified_at.is_some() => {
                "acknowledged, not read back".to_owned()
            }
            None => String::new(),
        }
    }

    /// Returns whether the verified Cz `cz` equals `wanted`, to half a count of the register.
    pub(in crate::gateway) fn is_near(
        &self,
        profile: &Profile,
        output: &Output,
        cz: Micron,
        wanted: Micron,
    ) -> bool {
        let settings = &profile.axis(output.axis).settings;
        let grain = match (output.writes, settings.intercept_slope) {
            (Writes::Slope, Some(apart)) => apart.count.unwrap_or(Micron::ZERO),
            // A floating-point register is written in thousandths of a step.
            _ => settings
                .guard
                .count
                .or_else(|| Micron::new(settings.guard.step.get() * 1e-3))
                .unwrap_or_default(),
        };
        let base = self.shares.map(|(base, _)| base / cz_factor(profile, output));
        is_near(cz, wanted, grain.get(), base.unwrap_or_default())
    }

    /// Marks the register value as uncertain, for example after a failed write.
    pub(in crate::gateway) fn doubt(&mut self) {
        if self.standing != RegisterHealth::Unknown {
            self.standing = RegisterHealth::Unverified;
        }
    }
}

impl RegisterHealth {
    /// Returns the name of the state, as the web page and the metrics show it.
    pub(in crate::gateway) const fn name(self) -> &'static str {
        match self {
            RegisterHealth::Unknown => "unknown",
            RegisterHealth::Verified => "verified",
            RegisterHealth::Unverified => "unverified",
            RegisterHealth::Interlocked => "interlocked",
            RegisterHealth::Foreign => "foreign",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::RegisterHealth;
    use crate::observe::status::OutputStatus;

    #[test]
    fn an_output_that_is_off_or_stands_somehow_is_in_one_of_the_states_that_are_counted() {
        use RegisterHealth::{Foreign, Interlocked, Unknown, Unverified, Verified};
        let standing = [Unknown, Verified, Unverified, Interlocked, Foreign].map(RegisterHealth::name);
        assert_eq!(OutputStatus::STATES[0], "off");
        assert_eq!(OutputStatus::STATES[1..], standing);
    }
}
