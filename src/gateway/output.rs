//! What the gateway knows of one output: whether what it wrote is what stands there.

use std::ops::{Index, IndexMut};
use std::sync::Arc;
use std::time::Duration;

use super::contact::Contact;
use super::noted::Noted;
use super::units::{cz_factor, is_near};
use crate::fieldbus::error::Fault;
use crate::observe::events::HandshakeFault;
use isotherm_core::compensation::AxisState;
use isotherm_core::display::{Display, Held, Intent};
use isotherm_core::output::Awaited;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::{Handshake, Output, OutputId, Profile, Writes};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(super) enum Standing {
    /// Its register has not been read since the connection was made.
    #[default]
    Unknown,
    /// What stands in the register is known, and is ours.
    Verified,
    /// The last write failed, or was not what was read back.
    Unverified,
    Interlocked,
    /// Somebody else wrote to it.
    Foreign,
}

/// One output, as the axes and the people see it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OutputState {
    pub(super) standing: Standing,
    /// Cz in the register as last verified; of a slope what it comes to at the axis's reach, for a corrected position the
    /// Cz that went into it. Of a reference position it says only that the register is known.
    pub(super) cz: Option<Micron>,
    /// The value in the register, in the output's unit.
    pub(super) value: Option<f64>,
    /// The operator's part of that and ours, where the register is shared.
    pub(super) shares: Option<(f64, f64)>,
    pub(super) verified_at: Option<Moment>,
    /// What the control says it applies, in the output's unit, and when it was asked.
    pub(super) applied: Option<(f64, Moment)>,
    /// When nothing of ours can arrive any more that was not answered.
    pub(super) waits_until: Option<Moment>,
    /// A change waits for that.
    pub(super) is_waiting: bool,
    /// It was only acknowledged, and is not read.
    pub(super) is_only_acknowledged: bool,
    pub(super) writes: u64,
    /// Failures since the last verified write.
    pub(super) failures: u64,
    pub(super) cause: Option<Fault>,
    pub(super) handshake: HandshakeStatus,
}

#[derive(Clone, Debug)]
pub(super) struct Outputs {
    profile: Arc<Profile>,
    states: Noted<OutputState>,
    /// By axis, in the profile's order.
    of_axis: Arc<Vec<Vec<OutputId>>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct HandshakeStatus {
    pub(super) waits: Option<Awaited>,
    /// What the last one failed at, until one succeeds.
    pub(super) failed: Option<HandshakeFault>,
    /// The strobe is up, or may be.
    pub(super) strobe_up: bool,
    /// The control word beside it may say that every axis is armed.
    pub(super) says_enabled: bool,
    /// What stands there was not taken yet.
    pub(super) is_untaken: bool,
}

impl Outputs {
    pub(super) fn new(profile: &Arc<Profile>) -> Outputs {
        let mut of_axis = vec![Vec::new(); profile.axes.len()];
        for (place, output) in profile.outputs.iter().enumerate() {
            of_axis[output.axis.0].push(OutputId(place));
        }
        Outputs {
            profile: profile.clone(),
            states: Noted::new(vec![OutputState::default(); profile.outputs.len()]),
            of_axis: Arc::new(of_axis),
        }
    }

    /// Those of an axis, each with its place in the profile.
    pub(super) fn ids(&self, axis: usize) -> &[OutputId] {
        &self.of_axis[axis]
    }

    pub(super) fn of_axis(&self, axis: usize) -> impl Iterator<Item = (&Output, &OutputState)> {
        self.of_axis[axis].iter().map(|id| (self.profile.output(*id), &self.states[id.0]))
    }

    /// State of an axis as people see it.
    pub(super) fn display(
        &self,
        axis: usize,
        (state, intent): (AxisState, Intent),
        (contact, dry_run): (&Contact, bool),
    ) -> Display {
        Display::of(state, intent, self.held(axis, contact, dry_run))
    }

    /// Cz of an axis in the control, as far as the gateway knows it.
    fn held(&self, axis: usize, contact: &Contact, dry_run: bool) -> Held {
        if dry_run {
            return Held::Unknown;
        }
        let mut held = Held::Unknown;
        for (output, state) in self.of_axis(axis).filter(|(output, _)| output.writes.is_cz()) {
            let Some(cz) = state.cz else { continue };
            if contact.devices[output.device.0].does_not_answer() {
                return Held::Unreachable;
            }
            let is_zero = state.is_near(&self.profile, output, cz, Micron::ZERO);
            held = if is_zero && held != Held::Other { Held::Zero } else { Held::Other };
        }
        held
    }

    pub(super) fn states(&self) -> &[OutputState] {
        self.states.as_slice()
    }

    /// One whose state may have changed since it was last asked for.
    pub(super) fn next_changed(&mut self) -> Option<OutputId> {
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
    /// What is to be said of it on the page; empty where nothing is.
    pub(super) fn message(self, handshake: Option<&Handshake>) -> String {
        let Some(Handshake { strobe, acknowledge, .. }) = handshake else { return String::new() };
        match (self.failed, self.waits) {
            (Some(failed), _) => failed.message().to_owned(),
            (None, Some(Awaited::Acknowledge)) => format!("waits for the acknowledge ({acknowledge})"),
            (None, Some(Awaited::Clear | Awaited::Release)) => {
                format!("waits for the acknowledge to drop ({acknowledge})")
            }
            (None, None) if self.strobe_up => format!("the strobe may be up ({strobe})"),
            (None, None) => String::new(),
        }
    }
}

impl OutputState {
    /// How long a change still waits for what may arrive late, at most.
    pub(super) fn waits(&self, now: Moment) -> Option<Duration> {
        self.waits_until.filter(|_| self.is_waiting).map(|until| until.since(now))
    }

    /// What else is to be known of its value, for the page.
    pub(super) fn note(&self, now: Moment) -> String {
        match self.waits(now) {
            Some(span) => format!("waiting for a late write, {} s", span.as_secs()),
            None if self.is_only_acknowledged && self.verified_at.is_some() => {
                "acknowledged, not read back".to_owned()
            }
            None => String::new(),
        }
    }

    /// Returns whether this verified Cz is the wanted one, to half a count of the register.
    pub(super) fn is_near(&self, profile: &Profile, output: &Output, cz: Micron, wanted: Micron) -> bool {
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

    /// What stands in the register is not certain any more.
    pub(super) fn doubt(&mut self) {
        if self.standing != Standing::Unknown {
            self.standing = Standing::Unverified;
        }
    }
}

impl Standing {
    /// The word for it on the page and in the metrics.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Standing::Unknown => "unknown",
            Standing::Verified => "verified",
            Standing::Unverified => "unverified",
            Standing::Interlocked => "interlocked",
            Standing::Foreign => "foreign",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Standing;
    use crate::observe::status::OutputStatus;

    #[test]
    fn an_output_that_is_off_or_stands_somehow_is_in_one_of_the_states_that_are_counted() {
        use Standing::{Foreign, Interlocked, Unknown, Unverified, Verified};
        let standing = [Unknown, Verified, Unverified, Interlocked, Foreign].map(Standing::name);
        assert_eq!(OutputStatus::STATES[0], "off");
        assert_eq!(OutputStatus::STATES[1..], standing);
    }
}
