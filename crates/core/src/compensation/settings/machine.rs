//! Settings of the machine, independent of its axes and their models.

use std::time::Duration;

use crate::reading::SignalId;

/// Settings of the machine: running time and captured references.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MachineSettings {
    /// Signal whose rising edge is the machine start. Without it, the first good reading is the machine start.
    pub on: Option<SignalId>,
    /// Signal whose rising edge captures the "zero" references.
    pub zero: Option<SignalId>,
    /// Time over which a captured reference is the mean; zero takes the first good reading.
    pub settle: Duration,
    /// Number of signals of the machine, and so the length of every snapshot.
    pub signals: usize,
}
