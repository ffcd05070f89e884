//! The probing cycle of the virtual machine: at its period it measures the true error that is left with the Cz that
//! stands in the machine, and leaves the result where the profile's probe looks for it, with its trigger: a counter that
//! goes on by one, or a flag that stands for a while.

use std::time::Duration;

use isotherm_core::codec::DataType;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::{ProbeInput, Profile, Signal};

/// How long a flag stands after a probing.
const FLAG: Duration = Duration::from_secs(30);
/// A counter begins anew after this many: it fits every type.
const MOST: u32 = 30_000;

/// The cycle of one axis.
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
    /// One for each axis of the profile that has a probe.
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

    /// What this signal shows, if the cycle is what it shows.
    pub(super) fn shows(&self, id: SignalId, signal: &Signal, now: Moment) -> Option<f64> {
        if id == self.input.signal {
            return Some(self.result_um / self.input.micron);
        }
        let stands = self.count > 0 && now < self.measured.after(FLAG);
        (Some(id) == self.input.trigger).then(|| match signal.encoding.data_type {
            DataType::Bool => f64::from(u8::from(stands)),
            _ => f64::from(self.count),
        })
    }
}
