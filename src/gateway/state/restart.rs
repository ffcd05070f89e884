//! Restarts of a control. A restart is detected when the boot counter of the control has changed, or when the machine
//! was switched on again.
//!
//! After a restart, the registers may hold any value. The gateway counts the restarts for each output. After
//! a restart, the line task reads the register again. The axis stays armed, and continues from the value that
//! was read.

use std::sync::Arc;

use crate::observe::events::Event;
use isotherm_core::continuity::Break;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::{BusId, DeviceId, Output, OutputId, Profile};

use super::continuity::Devices;
use super::signal_table::SignalTable;

/// Number of restarts of the control of each output, and the signals that show a restart.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct Restarts {
    profile: Arc<Profile>,
    /// Number of restarts of the control for each output.
    counts: Vec<u64>,
    /// Boot counters that are read on each bus line, with the last good reading of each counter.
    counters: Vec<Vec<(SignalId, Option<f64>)>>,
    /// Last good reading of the signal `machine.on`; `None` before the first good reading.
    was_on: Option<bool>,
}

impl Restarts {
    pub(in crate::gateway) fn new(profile: &Arc<Profile>) -> Restarts {
        let mut counters: Vec<Vec<(SignalId, Option<f64>)>> = vec![Vec::new(); profile.buses.len()];
        for id in profile.outputs.iter().filter_map(|output| output.boot_counter) {
            let on_line = &mut counters[profile.device(profile.signal(id).device).bus.0];
            if !on_line.iter().any(|(known, _)| *known == id) {
                on_line.push((id, None));
            }
        }
        let counts = vec![0; profile.outputs.len()];
        Restarts { profile: profile.clone(), counts, counters, was_on: None }
    }

    /// Returns the number of restarts of this output's control since the start of the gateway.
    pub(in crate::gateway) fn of(&self, id: OutputId) -> u64 {
        self.counts[id.0]
    }

    /// Counts a restart for each output of a device, because the device itself has reported the restart.
    pub(in crate::gateway) fn device_restarted(&mut self, device: DeviceId) {
        self.count(|output| output.device == device);
    }

    fn count(&mut self, concerns: impl Fn(&Output) -> bool) {
        for (output, count) in self.profile.outputs.iter().zip(&mut self.counts) {
            *count += u64::from(concerns(output));
        }
    }

    /// Checks whether the latest readings of this bus line show a restart of a control. A restart breaks the
    /// continuity of the control's devices. Returns true if a control may have been restarted.
    pub(in crate::gateway) fn check(
        &mut self,
        board: &SignalTable,
        line: BusId,
        now: Moment,
        (devices, events): (&mut Devices, &mut Vec<Event>),
    ) -> bool {
        // The control may have been switched off with the machine.
        let is_on = self.profile.machine.on.and_then(|id| board.value(id, now)).map(|level| level >= 0.5);
        let was_on = is_on.and_then(|is_on| self.was_on.replace(is_on));
        let mut any = was_on == Some(false) && is_on == Some(true);
        if any {
            self.count(|_| true);
            for output in &self.profile.outputs {
                devices.breaks(output.device, Break::MachineOn, now);
            }
        }
        for place in 0..self.counters[line.0].len() {
            // The first reading shows no restart, and a bad reading is ignored.
            let (id, last) = &mut self.counters[line.0][place];
            let (id, Some(to)) = (*id, board.value(*id, now)) else { continue };
            let Some(from) = last.replace(to).filter(|from| (from - to).abs() > 0.0) else { continue };
            self.count(|output| output.boot_counter == Some(id));
            let device = self.profile.signal(id).device;
            devices.breaks(device, Break::Restarted, now);
            // The control may have another device entry for its outputs.
            let concerned = self.profile.outputs.iter().filter(|output| output.boot_counter == Some(id));
            for output in concerned.filter(|output| output.device != device) {
                devices.breaks(output.device, Break::Restarted, now);
            }
            let device = self.profile.device(device).name.clone();
            events.push(Event::CncBooted { device, from, to });
            any = true;
        }
        any
    }
}
