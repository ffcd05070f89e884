//! Task that receives the frames of a CAN line, handles them, and keeps the interface open.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::health::{Health, HealthChange};
use super::nodes::{Nodes, Reaction};
use super::routes::Routes;
use super::{Can, PendingNodeReports, images};
use crate::clock::{Sleeper, SocketGate, StallDetector};
use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use crate::fieldbus::explain::explain_on;
use crate::fieldbus::kinds::can::canopen::master::NodeEvent;
use crate::fieldbus::kinds::can::{Interface, Link, ReceivedFrame, Socket};
use crate::fieldbus::trace::Tap;
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::shared::state::GatewayState;
use crate::observe::events::Event;
use isotherm_core::codec::Frame;
use isotherm_core::continuity::Break;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::duration_text;
use isotherm_profile::{BusId, DeviceId};

/// Interval of the checks whether a missing or stopped interface is back. The interval is wall-clock time even in a
/// simulation, because the interface is real.
const LOOK_AGAIN: Duration = Duration::from_millis(200);
/// Delay before the listener tries again to send a frame for which the send queue was full.
const SEND_AGAIN: Duration = Duration::from_millis(5);
/// Interval at which the listener reads the counters of full send queues and lost frames.
const MEASURE_EVERY: Duration = Duration::from_secs(1);
/// Maximum number of frames that wait for space in the send queue of the interface: one for each possible node.
const MOST_UNSENT: usize = 128;
/// Delay until the next action if no action is scheduled. It is longer than any other delay.
const LONG: Duration = Duration::from_secs(3600);

const DOWN: Fault = Fault::Link(LinkFault::Can(CanFault::Down));
const FULL: Fault = Fault::Link(LinkFault::Can(CanFault::Full));

/// Listener of one CAN line: receives its frames, sends the frames of the CANopen master, and keeps the interface
/// open.
pub(in crate::gateway) struct CanListener {
    shared: LineHandle,
    bus: BusId,
    can: Arc<Can>,
    sleeper: Sleeper,
    routes: Routes,
    nodes: Nodes,
    health: Health,
    unsent: VecDeque<Frame>,
    socket: Option<(Arc<Socket>, Option<SocketGate>)>,
    /// Whether the network interface is up, so that it can send and receive frames.
    is_up: bool,
    tap: Tap,
    /// Time of the next read of the socket's counters (full send queues, lost frames).
    measure_at: Moment,
    stall_detector: StallDetector,
}

impl CanListener {
    /// Creates the listener of a line, and the state that it shares with the line. Opens the interface, if the
    /// interface exists. Returns `None` if the line is not a CAN line.
    pub(in crate::gateway) fn of(
        shared: &LineHandle,
        bus: BusId,
        tap: &Tap,
    ) -> Option<(Arc<Can>, CanListener)> {
        let profile = &shared.profile;
        let settings = profile.bus(bus);
        if !settings.transport.is_can() {
            return None;
        }
        let now = shared.clock.now();
        let (routes, nodes) = (Routes::new(profile, bus), Nodes::new(profile, bus, now));
        let wanted = routes.wanted().chain(nodes.wanted()).collect();
        let link = Arc::new(Link::new(&settings.address, wanted, images(profile, bus)));
        let sleeper = shared.clock.join();
        let can = Arc::new(Can {
            link,
            wakeup: sleeper.wakeup(),
            handed: Mutex::new(PendingNodeReports::default()),
        });
        let mut listener = CanListener {
            shared: shared.clone(),
            bus,
            can: can.clone(),
            sleeper,
            routes,
            nodes,
            health: Health::default(),
            unsent: VecDeque::new(),
            socket: None,
            is_up: false,
            tap: tap.clone(),
            measure_at: now,
            stall_detector: StallDetector::begin(now, shared.profile.shortest_age()),
        };
        listener.try_interface();
        Some((can, listener))
    }

    pub(in crate::gateway) async fn listen(mut self: Box<Self>) {
        let mut due = self.sample();
        loop {
            self.wait(due).await;
            let gate = self.socket.as_mut().and_then(|(_, gate)| gate.take());
            let taking = gate.as_ref().map(SocketGate::taking);
            due = self.sample();
            drop(taking);
            if let (Some((_, kept)), Some(gate)) = (&mut self.socket, gate) {
                kept.get_or_insert(gate);
            }
            // A bus that is never silent must not prevent the line task from working.
            tokio::task::coop::consume_budget().await;
        }
    }

    async fn wait(&mut self, due: Moment) {
        self.stall_detector.away_for(due.since(self.stall_detector.last()));
        let socket = self.socket.as_ref().map(|(socket, _)| socket.clone());
        match socket.filter(|_| self.is_up) {
            Some(socket) => {
                tokio::select! {
                    () = socket.ready() => {}
                    _ = self.sleeper.sleep_until(due) => {}
                }
            }
            None => {
                let ages_away = self.sleeper.now().after(LONG);
                tokio::select! {
                    () = tokio::time::sleep(LOOK_AGAIN) => {}
                    _ = self.sleeper.sleep_until(ages_away) => {}
                }
            }
        }
    }

    /// Processes all received frames, and carries out all actions that are due. Returns the time at which the caller
    /// must call this function again.
    fn sample(&mut self) -> Moment {
        // A frame to be sent may be the first to find the interface down. Receiving reports nothing in that case.
        if let Some(fault) = self.can.link.fault().filter(|_| self.is_up) {
            self.lose_interface(fault);
        }
        if !self.is_up {
            self.try_interface();
        }
        let clock = &self.shared.clock;
        let gap = self.stall_detector.sample(clock.now()).filter(|_| !clock.is_virtual());
        if let Some(since) = gap {
            // The frames in the socket arrived while the task did not run. Their age is unknown.
            let fault = self.discard();
            self.shared.stalled_at(since);
            if let Some(fault) = fault.filter(|_| self.is_up) {
                self.lose_interface(fault);
            }
        }
        if self.is_up {
            self.receive();
        }
        let now = self.shared.clock.now();
        if self.is_up {
            let set_up = std::mem::take(&mut self.can.handed().set_up);
            let reactions = self.nodes.tick(set_up, now);
            self.react(reactions);
        }
        if now >= self.measure_at {
            self.measure_at = now.after(MEASURE_EVERY);
            let changes = self.health.tick(self.can.link.full(), self.can.link.lost(), now);
            self.report_health(changes);
        }
        let resend = (!self.unsent.is_empty()).then(|| now.after(SEND_AGAIN));
        let due = [self.nodes.due(), Some(self.measure_at), resend];
        due.into_iter().flatten().min().unwrap_or(now.after(LONG))
    }

    fn receive(&mut self) {
        while let Some((socket, _)) = &self.socket {
            match socket.receive_now() {
                Ok(Some(ReceivedFrame::Frame(frame))) => self.take(&frame),
                Ok(Some(ReceivedFrame::Error(trouble))) => {
                    let changes = self.health.trouble(&trouble, self.shared.clock.now());
                    self.report_health(changes);
                }
                Ok(None) => return,
                Err(fault) if self.is_outdated(fault) => {}
                Err(fault) => return self.lose_interface(fault),
            }
        }
    }

    /// Discards all received frames. Returns the fault that the socket has reported during the call. `None` if the
    /// socket has reported no fault, or if the interface is up again.
    fn discard(&self) -> Option<Fault> {
        let (socket, _) = self.socket.as_ref()?;
        let mut fault = None;
        loop {
            match socket.receive_now() {
                Ok(Some(_)) => {}
                // The socket reports an interface that is down a single time.
                Err(DOWN) if fault.is_none() => fault = Some(DOWN),
                Ok(None) => break,
                Err(other) => return Some(other),
            }
        }
        fault.filter(|fault| !self.is_outdated(*fault))
    }

    /// Returns whether the socket reports that the interface is down, although it is up again.
    fn is_outdated(&self, fault: Fault) -> bool {
        fault == DOWN && !self.can.link.is_down()
    }

    fn take(&mut self, frame: &Frame) {
        let now = self.shared.clock.now();
        if self.nodes.is_sdo(frame.id()) {
            self.can.link.passed(frame);
        }
        if let Some(device) = self.nodes.speaker(frame) {
            let reactions = self.nodes.take(frame, now);
            self.react(reactions);
            self.answers(device);
            self.tap.heard((device, self.shared.profile.device(device).unit), frame);
        }
        self.route(frame, now);
    }

    /// Sends the waiting frames, until the queue is full again.
    fn send(&mut self) {
        while let (Some(frame), Some((socket, _))) = (self.unsent.front(), &self.socket) {
            match socket.send_now(frame) {
                Err(FULL) => return,
                Err(fault) if fault.is_of_the_line() => return self.lose_interface(fault),
                _ => drop(self.unsent.pop_front()),
            }
        }
    }

    fn queue(&mut self, frame: Frame) {
        // One waiting frame is enough: a missed SYNC is not sent later.
        if self.unsent.len() < MOST_UNSENT && !self.unsent.contains(&frame) {
            self.unsent.push_back(frame);
        }
    }

    /// Opens the interface, or detects that the interface is up again. In both cases, the supervision of the
    /// nodes restarts, and the devices are checked again.
    fn try_interface(&mut self) {
        let socket = match self.can.link.open() {
            Ok(socket) => socket,
            Err(fault) => return self.is_without(fault),
        };
        let is_new = self.socket.as_ref().is_none_or(|(known, _)| !Arc::ptr_eq(known, &socket));
        if is_new {
            // If the process has no file descriptor left, virtual time works without the gate.
            let gate = self.shared.clock.gate(socket.as_ref()).ok();
            self.socket = Some((socket, gate));
        }
        self.is_up = true;
        let now = self.shared.clock.now();
        self.nodes.restart(now);
        let mut core = self.shared.core();
        let GatewayState { device_health, devices, events, .. } = &mut *core;
        device_health.buses[self.bus.0].connected = true;
        device_health.link_is_up(self.bus, events);
        for device in self.nodes.devices() {
            devices.breaks(device, Break::InterfaceDown, now);
        }
        drop(core);
        self.can.revive(None);
        self.shared.wake_line(self.bus);
    }

    /// Handles a failed call to the socket: the interface is down or was removed. Frames that are still in the socket
    /// are discarded, because a later read would treat these old frames as signs of life.
    fn lose_interface(&mut self, fault: Fault) {
        self.can.link.failed(fault);
        self.is_up = false;
        self.unsent.clear();
        // The socket reports a removed interface a single time. Without this report the dead socket would stay open.
        if let Some(later) = self.discard() {
            self.can.link.failed(later);
        }
        self.is_without(fault);
    }

    /// Handles a missing interface. Reports the loss once. The devices on the line get this fault as the cause of
    /// their bad readings.
    fn is_without(&mut self, fault: Fault) {
        if self.can.link.socket().is_none() {
            self.socket = None;
        }
        let mut core = self.shared.core();
        let GatewayState { device_health, board, events, .. } = &mut *core;
        let count = &mut device_health.buses[self.bus.0];
        count.connected = false;
        let attempts = count.down.as_ref().map_or(0, |down| down.attempts) + 1;
        device_health.link_is_down(self.bus, attempts, fault, events);
        for device in self.nodes.devices() {
            let lost = device_health.devices[device.0].lost.get_or_insert_default();
            lost.fault = explain_on(self.shared.profile.bus(self.bus).transport, fault);
            lost.answers_since = None;
        }
        for signal in self.routes.signals() {
            board.fail(signal, Reason::LinkDown);
        }
    }

    fn report_health(&self, changes: Vec<HealthChange>) {
        for change in changes {
            let settings = self.shared.profile.bus(self.bus);
            let (bus, address) = (settings.name.clone(), settings.address.clone());
            self.shared.report(&match change {
                HealthChange::Worse { mut what, is_off } => {
                    if is_off && Interface::query(&address).is_ok_and(|found| found.stays_off()) {
                        let hint = format!(
                            "`ip link set {address} type can restart-ms 100` makes the interface restart by \
                             itself"
                        );
                        what = Explained::new(format!("{}; the interface stays off", what.cause), hint);
                    }
                    Event::BusTrouble { bus, address, what }
                }
                HealthChange::Over { count, what, within } => {
                    Event::BusWell { bus, address, count, what, within }
                }
            });
        }
    }

    /// Records that the gateway has received a frame of a device.
    fn answers(&self, device: DeviceId) {
        let mut core = self.shared.core();
        let now = self.shared.clock.now();
        let GatewayState { device_health, devices, events, .. } = &mut *core;
        devices.answers(device, now);
        device_health.answers(device, now, events);
    }

    /// Carries out the reactions to a received frame or to an elapsed timeout, for example sends a frame or reports a
    /// lost node.
    fn react(&mut self, reactions: Vec<Reaction>) {
        for reaction in reactions {
            match reaction {
                Reaction::Send(frame) => self.queue(frame),
                Reaction::Node(device, event) => self.happened(device, event),
                Reaction::Silent(device, patience, was_heard) => {
                    let patience = duration_text(patience);
                    let what = if was_heard { "no more frames received" } else { "no frame received yet" };
                    self.lost(device, format!("{what}, for {patience}"));
                }
                Reaction::Emergency(device, emergency) => {
                    let own = self.shared.profile.device(device);
                    let means = own.can.as_ref().map_or(String::new(), |can| can.emergency(emergency.code));
                    let (device, what) = (own.name.clone(), format!("{means} ({emergency})"));
                    self.shared.report(&Event::Emergency { device, what: what.into() });
                }
                Reaction::EmergencyOver(device, count) => {
                    let device = self.shared.profile.device(device).name.clone();
                    self.shared.report(&Event::EmergencyOver { device, count });
                }
            }
        }
        self.send();
    }

    fn happened(&mut self, device: DeviceId, event: NodeEvent) {
        let what = event.to_string();
        match event {
            NodeEvent::BootedUp { again } => self.restart_node(device, again),
            NodeEvent::FellBack => self.restart_node(device, true),
            NodeEvent::Lost { .. } => return self.lost(device, what),
            NodeEvent::Back { .. } => {
                self.can.revive(Some(device));
                self.answers(device);
                self.shared.wake_line(self.bus);
            }
            // `follow` of the nodes makes a separate reaction of each emergency.
            NodeEvent::Stopped | NodeEvent::Emergency(_) => {}
        }
        if matches!(event, NodeEvent::BootedUp { again: true } | NodeEvent::FellBack | NodeEvent::Stopped) {
            let own = self.shared.profile.device(device);
            self.shared.report(&Event::NodeReset { device: own.name.clone(), node: own.unit, what });
        }
    }

    fn lost(&self, device: DeviceId, what: String) {
        self.condemn(device, Reason::Timeout);
        let mut core = self.shared.core();
        let GatewayState { device_health, devices, events, .. } = &mut *core;
        let hint =
            "check power and cable of the node, and compare its node number and bitrate with the profile";
        device_health.is_silent(device, Explained::new(what, hint), events);
        devices.breaks(device, Break::Silence, self.shared.clock.now());
    }

    /// Handles the start of a node. Sets up and checks the node as at its first start. After a restart, the gateway
    /// rejects the readings from before, and reads the registers of the node again.
    fn restart_node(&mut self, device: DeviceId, was_there: bool) {
        if was_there {
            self.condemn(device, Reason::NotAsExpected);
        }
        let mut core = self.shared.core();
        core.devices.breaks(device, Break::Restarted, self.shared.clock.now());
        if was_there {
            core.restarts.device_restarted(device);
        }
        drop(core);
        self.can.revive(Some(device));
        self.shared.wake_line(self.bus);
    }

    fn condemn(&self, device: DeviceId, reason: Reason) {
        let now = self.shared.clock.now();
        let mut core = self.shared.core();
        let breaks = core.devices.of(device).breaks_without_checks();
        for signal in self.routes.of_device(device) {
            core.board.store(signal, Err(reason), now, breaks);
            core.board.fail(signal, reason);
        }
    }

    /// Stores the values of a frame in the table of signals. The values are not good if the node is lost or has wrong
    /// settings.
    fn route(&mut self, frame: &Frame, now: Moment) {
        let mut core = None;
        let mut shown = None;
        for route in self.routes.of_frame(frame.id()) {
            if shown.replace(route.device) != Some(route.device) {
                self.tap.heard((route.device, self.shared.profile.device(route.device).unit), frame);
            }
            let core = core.get_or_insert_with(|| self.shared.core());
            self.nodes.heard(route.device, now);
            let Some(read) = route.field.read(frame.data()) else { continue };
            let encoding = &self.shared.profile.signal(route.signal).encoding;
            let decoded = read.and_then(|read| encoding.decode(read.registers()));
            let value = match decoded {
                _ if self.nodes.is_lost(route.device) => Err(Reason::Timeout),
                Ok(_) if !core.devices.is_confirmed(route.device) => Err(Reason::NotAsExpected),
                value => value,
            };
            // Nothing is known of the values of an unchecked device, not even that they are wrong.
            if !core.devices.is_unconfirmed(route.device) {
                let breaks = core.devices.of(route.device).breaks_without_checks();
                core.board.store(route.signal, value, now, breaks);
            }
            let GatewayState { device_health, devices, events, .. } = &mut **core;
            match decoded {
                Ok(_) => devices.delivers(route.device, now),
                Err(_) => devices.answers(route.device, now),
            }
            device_health.answers(route.device, self.shared.clock.now(), events);
        }
        drop(core);
        let wakes = self.routes.of_frame(frame.id()).flat_map(|route| &route.wakes);
        wakes.for_each(|bus| self.shared.wake_line(*bus));
    }
}
