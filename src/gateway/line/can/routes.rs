//! Routes: table of the signals in each CAN frame that the gateway receives.

use std::collections::HashMap;

use isotherm_core::codec::{Address, CanId, CanMatch, Field};
use isotherm_core::reading::SignalId;
use isotherm_profile::{BusId, DeviceId, Profile, Writes};

/// Routes by CAN identifier. The map `exact` contains the routes with one identifier. The list `wide` contains the
/// routes that match several identifiers.
#[derive(Debug, Default)]
pub(super) struct Routes {
    exact: HashMap<CanId, Vec<Route>>,
    wide: Vec<Route>,
}

/// Route of one signal: the part of a CAN frame that contains its value, and the bus lines that need the value.
#[derive(Debug)]
pub(super) struct Route {
    pub(super) device: DeviceId,
    pub(super) signal: SignalId,
    pub(super) field: Field,
    /// Bus lines whose tasks must be woken when the signal has been received.
    pub(super) wakes: Vec<BusId>,
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

    /// Returns the routes of the signals in a frame with this identifier.
    pub(super) fn of_frame(&self, id: CanId) -> impl Iterator<Item = &Route> {
        let wide = self.wide.iter().filter(move |route| route.field.frames.takes(id));
        self.exact.get(&id).into_iter().flatten().chain(wide)
    }

    /// Returns the filters for the frames of all routes, without duplicates.
    pub(super) fn wanted(&self) -> impl Iterator<Item = CanMatch> {
        let exact = self.exact.keys().copied().map(CanMatch::exactly);
        let mut wide: Vec<CanMatch> = self.wide.iter().map(|route| route.field.frames).collect();
        wide.sort_unstable();
        wide.dedup();
        exact.chain(wide)
    }

    pub(super) fn of_device(&self, device: DeviceId) -> impl Iterator<Item = SignalId> {
        self.all().filter(move |route| route.device == device).map(|route| route.signal)
    }

    pub(super) fn signals(&self) -> impl Iterator<Item = SignalId> {
        self.all().map(|route| route.signal)
    }

    fn all(&self) -> impl Iterator<Item = &Route> {
        self.exact.values().flatten().chain(&self.wide)
    }
}

/// Returns the bus lines that the gateway wakes when it has received the signal. If a probing cycle needs the signal,
/// the result contains all lines. Otherwise, it contains the lines of the outputs that correct this position signal.
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
