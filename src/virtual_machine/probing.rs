//! Probing cycle of the virtual machine. It periodically measures the residual error with the active Cz. The signals of
//! the probe in the profile show the result and its trigger. The trigger is a counter that increases by one, or a flag
//! that stays set for a while.

use std::time::Duration;

use isotherm_core::codec::DataType;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::{ProbeInput, Profile, Signal};

/// Time for which a trigger flag stays set after a probing cycle.
const FLAG: Duration = Duration::from_secs(30);
/// Largest value of a trigger counter, which fits every data type of a signal. After this value, the counter continues
/// with one.
const MOST: u32 = 30_000;

/// Probing cycle of one axis: its interval, its signals and its last result.
#[derive(Debug)]
pub(super) struct Cycle {
    pub(super) axis: usize,
    input: ProbeInput,
    every: Duration,
    due: Moment,
    measured: Moment,
    result_um: f64,
    count: u32,
}

impl Cycle {
    /// Returns a cycle for each axis of the profile that has a probe.
    pub(super) fn of(profile: &Profile, every: Duration, begin: Moment) -> Vec<Cycle> {
        let inputs = profile.axes.iter().enumerate();
        let inputs = inputs.filter_map(|(axis, settings)| settings.probe_input.map(|input| (axis, input)));
        let cycle = |(axis, input)| Cycle {
            axis,
            input,
            every,
            due: begin.after(every),
            measured: begin,
            result_um: 0.0,
            count: 0,
        };
        inputs.map(cycle).collect()
    }

    pub(super) fn is_due(&self, now: Moment) -> bool {
        now >= self.due
    }

    pub(super) fn measure(&mut self, left_um: f64, now: Moment) {
        (self.result_um, self.measured) = (left_um, now);
        self.count = self.count % MOST + 1;
        self.due = now.next_tick(self.due, self.every);
    }

    /// Returns the value of this signal; `None` if the signal does not show the result or the trigger of the cycle.
    pub(super) fn shows(&self, id: SignalId, signal: &Signal, now: Moment) -> Option<f64> {
        if id == self.input.signal {
            return Some(self.result_um / self.input.micron);
        }
        let is_on = self.count > 0 && now < self.measured.after(FLAG);
        (Some(id) == self.input.trigger).then(|| match signal.encoding.data_type {
            DataType::Bool => f64::from(u8::from(is_on)),
            _ => f64::from(self.count),
        })
    }
}
