//! Which signals a frame brings.

use std::collections::HashMap;

use super::CanListener;
use crate::gateway::core::Core;
use isotherm_core::codec::{Address, CanId, CanMatch, Field, Frame};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::{Reason, SignalId};
use isotherm_profile::{BusId, DeviceId, Profile, Writes};

/// By identifier; those that several identifiers match, in a list.
#[derive(Debug, Default)]
pub(super) struct Routes {
    exact: HashMap<CanId, Vec<Route>>,
    wide: Vec<Route>,
}

/// One signal.
#[derive(Debug)]
struct Route {
    device: DeviceId,
    signal: SignalId,
    field: Field,
    /// The lines that have something to do as soon as it has come.
    wakes: Vec<BusId>,
}

impl Routes {
    pub(super) fn new(profile: &Profile, bus: BusId) -> Routes {
        let mut routes = Routes::default();
        for (place, signal) in profile.signals.iter().enumerate() {
            let device = profile.device(signal.device);
            let Address::Frame(field) = &signal.address else { continue };
            if device.bus != bus {
                continue;
            }
            let id = SignalId(place);
            let route =
                Route { device: signal.device, signal: id, field: field.clone(), wakes: wakes(profile, id) };
            if field.frames.is_exact() {
                routes.exact.entry(field.frames.id).or_default().push(route);
            } else {
                routes.wide.push(route);
            }
        }
        routes
    }

    /// The frames that are wanted, each once.
    pub(super) fn wanted(&self) -> impl Iterator<Item = CanMatch> {
        let exact = self.exact.keys().copied().map(CanMatch::exactly);
        let mut wide: Vec<CanMatch> = self.wide.iter().map(|route| route.field.frames).collect();
        wide.sort_unstable();
        wide.dedup();
        exact.chain(wide)
    }

    /// The signals that come by frames of a device.
    pub(super) fn of_device(&self, device: DeviceId) -> impl Iterator<Item = SignalId> {
        self.all().filter(move |route| route.device == device).map(|route| route.signal)
    }

    /// All signals that come by frames.
    pub(super) fn signals(&self) -> impl Iterator<Item = SignalId> {
        self.all().map(|route| route.signal)
    }

    fn all(&self) -> impl Iterator<Item = &Route> {
        self.exact.values().flatten().chain(&self.wide)
    }
}

/// The line that corrects a position; all lines where a probing waits for it.
fn wakes(profile: &Profile, id: SignalId) -> Vec<BusId> {
    let is_corrected = |writes| matches!(writes, Writes::Corrected { position } if position == id);
    let outputs = profile.outputs.iter().filter(|output| is_corrected(output.writes));
    let mut wakes: Vec<BusId> = outputs.map(|output| profile.device(output.device).bus).collect();
    let mut probed = profile.axes.iter().filter_map(|axis| axis.probe_input);
    if probed.any(|input| input.signal == id || input.trigger == Some(id)) {
        wakes.extend((0..profile.buses.len()).map(BusId));
    }
    wakes.sort_unstable();
    wakes.dedup();
    wakes
}

impl CanListener {
    /// Puts what a frame brings onto the board. A node that is lost, or is not set as it should be, brings nothing.
    pub(super) fn route(&mut self, frame: &Frame, now: Moment) {
        let exact = self.routes.exact.get(&frame.id()).into_iter().flatten();
        let wide = self.routes.wide.iter().filter(|route| route.field.frames.takes(frame.id()));
        let mut core = None;
        let mut shown = None;
        for route in exact.chain(wide) {
            if shown.replace(route.device) != Some(route.device) {
                self.tap.heard((route.device, self.shared.profile.device(route.device).unit), frame);
            }
            let core = core.get_or_insert_with(|| self.shared.core());
            self.nodes.heard(route.device, now);
            let Some(words) = route.field.read(frame.data()) else { continue };
            let encoding = &self.shared.profile.signal(route.signal).encoding;
            let value = words.and_then(|words| encoding.decode(words.words()));
            let value = match value {
                _ if self.nodes.is_lost(route.device) => Err(Reason::Timeout),
                Ok(_) if !core.commissioning.is_fit(route.device) => Err(Reason::NotAsExpected),
                value => value,
            };
            // Before it has been looked at, nothing is known of what it says, not even that it is wrong.
            if !core.commissioning.is_unknown(route.device) {
                core.board.store(&self.shared.profile, route.signal, value, now);
            }
            let Core { contact, events, .. } = &mut **core;
            contact.answers(&self.shared.profile, route.device, self.shared.clock.now(), events);
        }
        drop(core);
        let exact = self.routes.exact.get(&frame.id()).into_iter().flatten();
        let wide = self.routes.wide.iter().filter(|route| route.field.frames.takes(frame.id()));
        exact.chain(wide).flat_map(|route| &route.wakes).for_each(|bus| self.shared.wake_line(*bus));
    }
}
