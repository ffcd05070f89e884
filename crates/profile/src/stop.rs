//! Maximum duration of a stop of the gateway. Normally this is the duration of the fault actions of the axes. If the
//! registers keep their values, only the exchanges in progress are completed.

use std::time::Duration;

use crate::Profile;
use isotherm_core::quantity::Micron;

/// Time at the end of a stop of the gateway for the last reports and the last writes to disk.
const REST: Duration = Duration::from_secs(2);
/// Time after `REST` for posting the last event messages to the servers of `[[notify]]`.
pub const MESSAGES: Duration = Duration::from_secs(2);
/// Time for sending the last state to the MQTT broker and disconnecting. It runs in parallel to [`MESSAGES`].
pub const BROKER: Duration = Duration::from_secs(4);

/// Returns the maximum duration of the fault actions. `ways` contains for each axis the distances in µm by which Cz
/// (the compensation value) and the slope must move to zero.
pub fn fault_actions(profile: &Profile, ways: impl IntoIterator<Item = [Micron; 2]>) -> Duration {
    let exchange = profile.sets.iter().filter_map(|set| Some(set.handshake.as_ref()?.timeout * 2)).max();
    let settle = profile.outputs.iter().filter_map(|output| Some(output.applied.as_ref()?.settle)).max();
    let exchange = exchange.unwrap_or_default() + settle.unwrap_or_default();
    // A slope returns to zero in parallel to Cz, in steps of the same size.
    let times = profile.axes.iter().zip(ways).flat_map(|(axis, ways)| {
        ways.map(|way| {
            // Each step may have to wait until it is acknowledged and applied.
            let steps = way.abs().get() / axis.settings.guard.step.get() + 2.0;
            axis.settings.time_to_rest(way).saturating_add(exchange.mul_f64(steps))
        })
    });
    times.max().unwrap_or_default().saturating_add(hold(profile))
}

/// Returns the maximum duration of the fault actions, with every axis at its limit.
pub fn longest(profile: &Profile) -> Duration {
    let at_limit = |axis: &crate::Axis| {
        let limit = axis.settings.guard.limit;
        [limit, if axis.settings.intercept_slope.is_some() { limit } else { Micron::ZERO }]
    };
    fault_actions(profile, profile.axes.iter().map(at_limit))
}

/// Returns the maximum duration of a stop without fault actions. The exchanges in progress are completed, and a slow
/// device may still write and read back a last value.
pub fn hold(profile: &Profile) -> Duration {
    let slowest = profile.buses.iter().map(|bus| bus.timeout * 6).max();
    slowest.unwrap_or_default() + REST
}

/// Returns the maximum time at the end of a stop for the MQTT broker and the servers of `[[notify]]`. `None` if the
/// profile has neither.
pub fn told(profile: &Profile) -> Option<Duration> {
    let broker = profile.mqtt.as_ref().map(|_| BROKER);
    broker.max((!profile.notify.is_empty()).then_some(MESSAGES))
}

/// Returns the maximum time for which an unanswered write delays the next step of a register. `None` if no register
/// changes in steps.
pub fn late(profile: &Profile) -> Option<Duration> {
    let stepped = profile.outputs.iter().filter(|output| output.writes.is_scheduled());
    stepped.map(|output| profile.bus(profile.device(output.device).bus).late).max()
}
