//! Settings of the machine that do not depend on its axes and their models.

use std::time::Duration;

use crate::reading::SignalId;

/// Settings of the machine: detection of its start, and capture of references.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MachineSettings {
    /// Signal whose rising edge is the machine start. Without it, the first good reading is the machine start.
    pub on: Option<SignalId>,
    /// Signal whose rising edge captures the "zero" references.
    pub zero: Option<SignalId>,
    /// Time over which the readings are averaged for a captured reference. With zero, the first good reading is the
    /// reference.
    pub settle: Duration,
    /// Number of signals of the machine, which is also the number of readings of every snapshot.
    pub signals: usize,
}
