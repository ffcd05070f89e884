//! What is written: one register, or several side by side, of a device.

use std::time::Duration;

use super::{AxisId, DeviceId, Display, SetId, Writes};
use crate::codec::{Address, Encoding};
use crate::compensation::model::Condition;
use crate::reading::SignalId;

/// One value that is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// Its name in the profile.
    pub name: String,
    /// Whose Cz.
    pub axis: AxisId,
    /// Where it goes.
    pub device: DeviceId,
    /// Its first register.
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
    /// The object at this address is read, of the same type as what was written.
    ReadBackAt(Address),
    /// Not at all: a display shows it, and nobody acts on it.
    Shown,
}

impl Verify {
    /// What was written is read back.
    pub const fn reads(self) -> bool {
        matches!(self, Verify::ReadBack | Verify::ReadBackAt(_))
    }

    /// Where that is, if it is another place than it was written to.
    pub const fn reads_at(self) -> Option<Address> {
        match self {
            Verify::ReadBackAt(address) => Some(address),
            _ => None,
        }
    }
}
