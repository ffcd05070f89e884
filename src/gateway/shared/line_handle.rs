//! Access of the task of a bus line to the shared state of the gateway.

use std::ops::Deref;
use std::sync::Arc;
use std::time::Duration;

use super::shared_state::Shared;
use super::state::GatewayState;
use super::{releasing, signing};
use crate::fieldbus::error::Fault;
use crate::fieldbus::line::{Attribution, RequestObserver};
use crate::fieldbus::seen::Seen;
use crate::fieldbus::wire::Request;
use crate::gateway::state::signal_table::MANY;
use crate::observe::events::Event;
use isotherm_core::continuity::Break;
use isotherm_core::explained::Explained;
use isotherm_core::output::Beat;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Arm, BusId, DeviceId, OnStop, OutputId, Signal};

/// Minimum time between two checks whether the computer's clock was set. A check is made after a step of the axes.
const DAY_EVERY: Duration = Duration::from_millis(100);

/// Access of the task of one bus line to the shared state of the gateway.
#[derive(Clone)]
pub(in crate::gateway) struct LineHandle {
    shared: Arc<Shared>,
    bus: BusId,
}

/// Gives the line task access to the profile, the clock and the lock of the shared state.
impl Deref for LineHandle {
    type Target = Shared;

    fn deref(&self) -> &Shared {
        &self.shared
    }
}

impl LineHandle {
    pub(in crate::gateway) fn new(shared: Arc<Shared>, bus: BusId) -> LineHandle {
        LineHandle { shared, bus }
    }

    /// Steps (calculates) each axis that is due, and wakes the other bus lines whose outputs may need a write. A line
    /// task calls this function after it has read inputs. Returns the time at which the next axis is due.
    pub(in crate::gateway) fn advance(&self, now: Moment) -> Option<Moment> {
        let mut core = self.core();
        let stepped = core.advance(now);
        if stepped {
            signing::follow(&mut core, now);
            releasing::follow(&mut core);
        }
        let due = core.next_due;
        let looks_at_day = stepped && now >= core.day_due;
        if looks_at_day {
            core.day_due = now.after(DAY_EVERY);
        }
        drop(core);
        // Only time stamps depend on the time of day.
        if looks_at_day && let Some(correction) = self.clock.check_time_of_day() {
            self.report(&Event::ClockSet(correction));
        }
        if stepped {
            self.wake_followers(self.bus);
        }
        due
    }

    /// Processes new results of the probing cycles that are read on this line.
    pub(in crate::gateway) fn take_probings(&self, now: Moment) {
        let axes = &self.dependents.probed_on[self.bus.0];
        if axes.is_empty() {
            return;
        }
        let mut core = self.core();
        let received = axes.iter().filter(|axis| core.take_probing(**axis, now)).count();
        drop(core);
        if received > 0 {
            self.wake_others(self.bus);
        }
    }

    /// Checks whether the latest readings of this line show a restart of the control, before outputs are written.
    /// After a restart, wakes the tasks of all lines.
    pub(in crate::gateway) fn check_for_restarts(&self, now: Moment) {
        if !self.dependents.shows_restarts[self.bus.0] {
            return;
        }
        let mut core = self.core();
        let GatewayState { restarts, board, devices, events, .. } = &mut *core;
        let any = restarts.check(board, self.bus, now, (devices, events));
        drop(core);
        if any {
            self.wake();
        }
    }

    /// Reports that a changed value was not sent, because the line task reached the output after the time
    /// `not_after`. After this time, the readings from which the value was calculated are too old.
    pub(in crate::gateway) fn order_lapsed(&self, id: OutputId, not_after: Moment) {
        // The default moment means that no earlier decision may be used, so nothing is late.
        if not_after == Moment::default() {
            return;
        }
        let output = self.profile.output(id);
        let bus = self.profile.device(output.device).bus;
        let late = self.clock.now().since(not_after);
        self.overrun(bus, 1, late, || format!("a change of output {}", output.name));
    }

    /// Counts `count` late cycles of a bus line. `late` is the largest delay, and `what` returns a text about the
    /// late action. Reports the late cycles, unless such a report was made recently.
    pub(in crate::gateway) fn overrun(
        &self,
        bus: BusId,
        count: u64,
        late: Duration,
        what: impl FnOnce() -> String,
    ) {
        let now = self.clock.now();
        let mut core = self.core();
        if core.device_health.overrun(bus, (count, late), now) {
            let bus = self.profile.bus(bus).name.clone();
            core.events.push(Event::Overrun { bus, what: what(), late });
        }
    }

    /// Returns the state of the heartbeat for the next request. Heartbeats begin when an axis is armed for the first
    /// time. With `arm = "auto"`, they already begin with the first valid reading. They end when the process ends.
    pub(in crate::gateway) fn beat(&self, now: Moment) -> Beat {
        let (core, arm) = (self.core(), self.profile.arm);
        if self.dry_run || !(core.was_armed || (arm == Arm::Auto && core.has_read)) {
            return Beat::Silent;
        }
        drop(core);
        if self.head_lives(now) { Beat::Counts } else { Beat::Stands }
    }

    /// Returns whether the axes were stepped (calculated) in time. If `false`, the count of the heartbeat no
    /// longer increases, even if the bus lines work. While another program takes over, the axes need no
    /// steps, and the result is `true`.
    fn head_lives(&self, now: Moment) -> bool {
        let (every, core) = (self.dependents.shortest_period, self.core());
        core.phase.stop() == Some(OnStop::Hold)
            || every.is_none_or(|every| now.since(core.stepped_at) <= every * 2)
    }
}

/// Counts the result of each request on this line, and reports when failures begin and end.
impl RequestObserver for LineHandle {
    fn note(
        &self,
        device: DeviceId,
        request: Request<'_>,
        outcome: Result<(), Fault>,
        refusals: (u32, Fault),
    ) {
        let (now, mut core) = (self.clock.now(), self.core());
        count(&mut core, (device, request), outcome, refusals, now);
    }

    fn note_delivery(&self, device: DeviceId, request: Request<'_>, refusals: (u32, Fault), at: Moment) {
        let mut core = self.core();
        count(&mut core, (device, request), Ok(()), refusals, at);
        core.devices.delivers(device, at);
    }

    fn breaks(&self, device: Option<DeviceId>, cause: Break) {
        let (now, mut core) = (self.clock.now(), self.core());
        match device {
            Some(device) => core.devices.breaks(device, cause, now),
            None => {
                let here = self.profile.devices_on(self.bus);
                here.for_each(|(device, _)| core.devices.breaks(device, cause, now));
            }
        }
    }

    /// Returns whether the device has passed its checks. Always `true` in a dry run. A dry run writes nothing, so it
    /// reads the outputs even if the checks do not pass.
    fn is_verified(&self, device: DeviceId) -> bool {
        let (now, mut core) = (self.clock.now(), self.core());
        core.devices.notice_silence(device, now);
        self.dry_run || core.devices.is_confirmed(device)
    }

    fn gives_up_pipeline(&self, fault: Fault) {
        let bus = self.profile.bus(self.bus).name.clone();
        self.core().events.push(Event::PipelineGivenUp { bus, fault: fault.to_string() });
    }

    fn waits_for_gateway(&self, own: Duration) {
        let bus = self.profile.bus(self.bus);
        let (bus, timeout) = (bus.name.clone(), bus.timeout);
        self.core().events.push(Event::GatewayTimeout { bus, own, timeout });
    }

    /// Reports that another master uses the bus line, and marks the readings that may be answers to that
    /// master as doubtful. The report is repeated when the other master gets answers of another form
    /// (function and length).
    fn shares_line(&self, attribute: &dyn Fn(u8, Request<'_>) -> Attribution) {
        let mut ids = Vec::new();
        for (id, device) in self.profile.devices_on(self.bus) {
            for request in self.profile.requests(id) {
                if attribute(device.unit, Request::from(&request.asks)) == Attribution::Ambiguous {
                    for field in &request.fields {
                        if !ids.contains(&field.signal) {
                            ids.push(field.signal);
                        }
                    }
                }
            }
        }
        let bus = self.profile.bus(self.bus);
        let (name, address) = (bus.name.clone(), bus.address.clone());
        let signals: Vec<&Signal> = ids.iter().map(|id| self.profile.signal(*id)).collect();
        let what = another_master(&signals);
        let mut core = self.core();
        ids.into_iter().for_each(|id| core.board.doubt(id));
        core.events.push(Event::BusTrouble { bus: name, address, what });
    }

    fn has_line_alone(&self, frames: u64, within: Duration) {
        let bus = self.profile.bus(self.bus);
        let (bus, address) = (bus.name.clone(), bus.address.clone());
        let what = "messages of another master";
        self.core().events.push(Event::BusWell { bus, address, count: frames, what, within });
    }

    /// Reports the state of a device's OPC UA subscription when the state has changed. Each new connection requests the
    /// subscription again.
    fn subscribes(&self, device: DeviceId, what: String) {
        let mut core = self.core();
        let GatewayState { device_health, events, .. } = &mut *core;
        let reported = &mut device_health.devices[device.0].subscription;
        if *reported != what {
            reported.clone_from(&what);
            let device = self.profile.device(device).name.clone();
            events.push(Event::Subscription { device, what });
        }
    }
}

/// Counts the result of a request to a device, and reports when failures begin and end.
fn count(
    core: &mut GatewayState,
    (device, request): (DeviceId, Request<'_>),
    outcome: Result<(), Fault>,
    refusals: (u32, Fault),
    now: Moment,
) {
    let GatewayState { device_health, devices, events, .. } = core;
    let seen = device_health.record(device, request, outcome);
    let count = &mut device_health.devices[device.0];
    count.requests += 1;
    if let Err(fault) = outcome {
        *count.failures.entry(fault.blame()).or_default() += 1;
    }
    match outcome {
        // The gateway before the device has answered: nothing came from the device.
        Err(fault) if !fault.is_refusal() || (fault.is_of_a_gateway() && request.is_read()) => {
            device_health.fails(device, seen.unwrap_or(Seen::from(fault)), refusals, events);
            devices.misses(device, now);
        }
        // No device answers a frame: a frame that was sent says nothing about the device.
        Ok(()) if !request.is_answered() => {}
        _ => {
            devices.answers(device, now);
            if !device_health.devices[device.0].is_here() {
                device_health.answers(device, now, events);
            }
        }
    }
}

/// Maximum number of signals that a message lists by name. The message also contains the number of further signals.
const NAMED: usize = 8;

/// Returns cause and hint for another master on the bus line. `signals` are the signals for which messages of the
/// other master look like answers.
fn another_master(signals: &[&Signal]) -> Explained {
    let list = |signals: &[&Signal]| {
        let named: Vec<&str> = signals.iter().take(NAMED).map(|signal| signal.name.as_str()).collect();
        let more = signals.len().saturating_sub(NAMED);
        if more == 0 { named.join(", ") } else { format!("{} and {more} more", named.join(", ")) }
    };
    let mut cause =
        "another master is on the line: messages arrived that this gateway did not request".to_owned();
    if !signals.is_empty() {
        let agree = format!(
            "a value is used only if it agrees with the previous value; with `max_rate` and no recent good \
             value, {MANY} consecutive values must agree"
        );
        cause += &format!("; messages of the other master look like answers for {}; {agree}", list(signals));
        let (_, unlimited): (Vec<&Signal>, Vec<&Signal>) =
            signals.iter().copied().partition(|signal| signal.max_rate.is_some());
        if !unlimited.is_empty() {
            let same = "for these signals without `max_rate`, two equal answers of the other master cannot \
                        be detected";
            cause += &format!("; {same}: {}", list(&unlimited));
        }
    }
    Explained::new(
        cause,
        "only one master is allowed on a line: disconnect the other master, or let it read the values on \
         another line",
    )
}
