//! How long a stop takes at most: the fault actions of the axes, or what is under way where the registers keep what they hold.

use std::time::Duration;

use crate::Profile;
use isotherm_core::quantity::Micron;

/// What is said and kept at the end.
const REST: Duration = Duration::from_secs(2);
/// How long the last messages to servers are waited for after all of that.
pub const MESSAGES: Duration = Duration::from_secs(2);
/// How long the broker is waited for meanwhile: to take the last state, and to let go.
pub const BROKER: Duration = Duration::from_secs(4);

/// How long the fault actions take at most, where each axis has so far to go: with its Cz, and with its slope.
pub fn fault_actions(profile: &Profile, ways: impl IntoIterator<Item = [Micron; 2]>) -> Duration {
    let exchange = profile.sets.iter().filter_map(|set| Some(set.handshake.as_ref()?.timeout * 2)).max();
    let settle = profile.outputs.iter().filter_map(|output| Some(output.applied.as_ref()?.settle)).max();
    let exchange = exchange.unwrap_or_default() + settle.unwrap_or_default();
    // A slope goes to zero beside Cz, in steps of the same size.
    let times = profile.axes.iter().zip(ways).flat_map(|(axis, ways)| {
        ways.map(|way| {
            // Each step may have to wait for its acknowledge, and to be applied.
            let steps = way.abs().get() / axis.settings.guard.step.get() + 2.0;
            axis.settings.time_to_rest(way).saturating_add(exchange.mul_f64(steps))
        })
    });
    times.max().unwrap_or_default().saturating_add(hold(profile))
}

/// The same with every axis at its limit.
pub fn longest(profile: &Profile) -> Duration {
    let at_limit = |axis: &crate::Axis| {
        let limit = axis.settings.guard.limit;
        [limit, if axis.settings.intercept_slope.is_some() { limit } else { Micron::ZERO }]
    };
    fault_actions(profile, profile.axes.iter().map(at_limit))
}

/// How long what is under way takes at most: a last value is still to be written and read back, by a device that may be slow.
pub fn hold(profile: &Profile) -> Duration {
    let slowest = profile.buses.iter().map(|bus| bus.timeout * 6).max();
    slowest.unwrap_or_default() + REST
}

/// How long whoever is told of the machine is waited for after all of that; `None` where nobody is told.
pub fn told(profile: &Profile) -> Option<Duration> {
    let broker = profile.mqtt.as_ref().map(|_| BROKER);
    broker.max((!profile.notify.is_empty()).then_some(MESSAGES))
}

/// How long a write that was not answered may keep the next step of a register waiting, of those that are changed in steps.
pub fn late(profile: &Profile) -> Option<Duration> {
    let stepped = profile.outputs.iter().filter(|output| output.writes.is_scheduled());
    stepped.map(|output| profile.bus(profile.device(output.device).bus).late).max()
}
