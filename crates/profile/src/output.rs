//! What is written: one register, or several side by side, of a device.

use std::time::Duration;

use crate::{AxisId, DeviceId, Display, SetId, Writes};
use isotherm_core::codec::{Address, Encoding, Object, Register};
use isotherm_core::compensation::model::Condition;
use isotherm_core::reading::SignalId;

/// One value that is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// Its name in the profile.
    pub name: String,
    /// Whose Cz.
    pub axis: AxisId,
    /// Where it goes.
    pub device: DeviceId,
    /// Its first register, its object, its place in a frame.
    pub address: Address,
    /// How the value becomes registers.
    pub encoding: Encoding,
    /// What is written.
    pub writes: Writes,
    /// How a write is believed.
    pub verify: Verify,
    /// Written again though unchanged.
    pub refresh: Option<Duration>,
    /// Interlock: otherwise held.
    pub when: Option<Condition>,
    /// What it is written with: a set of its own where it has a handshake of its own.
    pub set: Option<SetId>,
    /// The signal that changes at every start of the CNC.
    pub boot_counter: Option<SignalId>,
    /// Whose register it is.
    pub share: Share,
    /// Where the control says what it applies.
    pub applied: Option<Applied>,
    /// What a display shows beside the value, and instead of it.
    pub display: Display,
}

/// Whose register an output writes to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// Ours.
    Whole,
    /// An operator's, of which we own a share; how much, a ledger says.
    Ledger,
}

/// How a write is believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verify {
    /// The register is read again.
    ReadBack,
    /// The answer repeats address and value.
    Echo,
    /// This object is read, of the same type as what was written.
    ReadBackAt(Object),
    /// Not at all: a display shows it, and nobody acts on it.
    Shown,
}

/// What the control applies of an offset, where it says so in a register beside the one that is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    /// Where.
    pub address: Register,
    /// How the value lies there, in the output's unit.
    pub encoding: Encoding,
    /// It may be so far from what was written, in the output's unit.
    pub tolerance: f64,
    /// The control may take so long to apply a change.
    pub settle: Duration,
}

impl Share {
    /// A change needs so many counts at least: the sum of a shared register is never zero, which a restarted CNC shows.
    pub const fn counts_of_a_step(self) -> u32 {
        match self {
            Share::Whole => 1,
            Share::Ledger => 2,
        }
    }
}

impl Verify {
    /// What was written is read back.
    pub const fn reads(self) -> bool {
        matches!(self, Verify::ReadBack | Verify::ReadBackAt(_))
    }
}

impl Output {
    /// An offset that is written by itself, not with a set.
    pub fn is_single_offset(&self) -> bool {
        let is_offset = self.writes.is_scheduled();
        is_offset && self.set.is_none()
    }

    /// These words by the registers that they stand in; none where it is not in registers.
    pub fn cells(&self, words: &[u16]) -> impl Iterator<Item = (u16, u16)> {
        let first = self.address.register().map(|register| register.offset..);
        first.into_iter().flatten().zip(words.iter().copied())
    }

    /// Where what stands there is read: where it is written, unless another place is said.
    pub fn reads_at(&self) -> Address {
        match self.verify {
            Verify::ReadBackAt(object) => Address::Object(object),
            _ => self.address.clone(),
        }
    }
}
