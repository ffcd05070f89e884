//! Restarts of a control: its boot counter has changed, or the machine was switched on again.
//!
//! Either way the registers may hold anything now. Each output counts the restarts that concern it; its writer reads the
//! register anew, and the axis, armed as before, goes on from what stands there.

use crate::observe::events::Event;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::{BusId, DeviceId, OutputId, Profile};

use super::board::Board;

/// Those that each output has seen, and what shows them.
#[derive(Clone, Debug, Default)]
pub(super) struct Restarts {
    counts: Vec<u64>,
    /// By line: the last good reading of each boot counter that is read there.
    counters: Vec<Vec<(SignalId, Option<f64>)>>,
    /// The last good reading of the machine's `on` signal.
    was_on: Option<bool>,
}

impl Restarts {
    pub(super) fn new(profile: &Profile) -> Restarts {
        let mut counters: Vec<Vec<(SignalId, Option<f64>)>> = vec![Vec::new(); profile.buses.len()];
        for id in profile.outputs.iter().filter_map(|output| output.boot_counter) {
            let on_line = &mut counters[profile.device(profile.signal(id).device).bus.0];
            if !on_line.iter().any(|(known, _)| *known == id) {
                on_line.push((id, None));
            }
        }
        Restarts { counts: vec![0; profile.outputs.len()], counters, was_on: None }
    }

    /// How many concern this output so far.
    pub(super) fn of(&self, id: OutputId) -> u64 {
        self.counts.get(id.0).copied().unwrap_or_default()
    }

    /// A device was restarted, as it said itself.
    pub(super) fn device_restarted(&mut self, profile: &Profile, device: DeviceId) {
        for (output, count) in profile.outputs.iter().zip(&mut self.counts) {
            *count += u64::from(output.device == device);
        }
    }

    /// Takes in the machine's `on` signal; whether it was off and is on. The control may have been off with it.
    fn switched_on(&mut self, is_on: Option<bool>) -> bool {
        let Some(is_on) = is_on else { return false };
        let rises = self.was_on.replace(is_on) == Some(false) && is_on;
        self.counts.iter_mut().for_each(|count| *count += u64::from(rises));
        rises
    }

    /// Takes in a boot counter; what it was before, where it has changed. Its first reading is no restart, and one that
    /// cannot be believed is no reading.
    fn counted(
        &mut self,
        (line, place): (BusId, usize),
        value: Option<f64>,
        profile: &Profile,
    ) -> Option<(SignalId, f64, f64)> {
        let (id, last) = self.counters.get_mut(line.0)?.get_mut(place)?;
        let (id, value) = (*id, value?);
        let from = last.replace(value).filter(|last| (last - value).abs() > 0.0)?;
        for (output, count) in profile.outputs.iter().zip(&mut self.counts) {
            *count += u64::from(output.boot_counter == Some(id));
        }
        Some((id, from, value))
    }

    /// Looks at what has just been read on this line. Whether a control may have been restarted.
    pub(super) fn look(
        &mut self,
        profile: &Profile,
        board: &Board,
        line: BusId,
        now: Moment,
        events: &mut Vec<Event>,
    ) -> bool {
        let is_on = profile.machine.on.and_then(|id| board.value(profile, id, now));
        let mut any = self.switched_on(is_on.map(|level| level >= 0.5));
        for place in 0..self.counters[line.0].len() {
            let value = board.value(profile, self.counters[line.0][place].0, now);
            if let Some((id, from, to)) = self.counted((line, place), value, profile) {
                let device = profile.device(profile.signal(id).device).name.clone();
                events.push(Event::CncBooted { device, from, to });
                any = true;
            }
        }
        any
    }
}
