//! Settings of the machine, whatever its axes and their models are.

use std::time::Duration;

use crate::reading::SignalId;

/// What concerns every axis of the machine: the time since machine start and captured references.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MachineSettings {
    /// The signal whose rising edge starts the machine's time; without one, the first good reading does.
    pub on: Option<SignalId>,
    /// The signal whose rising edge captures the references given as "zero".
    pub zero: Option<SignalId>,
    /// A captured reference is the mean over this long; zero takes the first good reading.
    pub settle: Duration,
    /// How many signals the machine has: the length of every snapshot.
    pub signals: usize,
}
