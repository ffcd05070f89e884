//! The listening side of a CAN line: one task takes every frame as it comes, and puts what it brings onto the board.
//!
//! ```text
//! frames ─► routes ─► board, and the wakeup of the line that corrects a position
//!        ├► nodes   heartbeats, boot-ups, emergencies, silence: told, started again, their readings condemned
//!        ├► answers of SDO ─► the line, which asks and writes as on any other line
//!        └► health  error frames, a full queue, lost frames: told when it begins and when it is over
//! ```
//!
//! The interface may be missing, go down and be taken away at any time; it is taken up again by itself.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::line_handle::LineHandle;
use crate::clock::{Inlet, Looks, Sleeper, Wakeup};
use crate::fieldbus::can::{CanDial, Heard, Link, Socket};
use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use crate::fieldbus::trace::Tap;
use isotherm_core::codec::Frame;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bus, BusId, DeviceId};

mod health;
mod interface;
mod links;
mod nodes;
mod routes;
mod told;

use health::Health;
use nodes::Nodes;
use routes::Routes;

/// How often an interface that is missing or down is looked at. The wall's time: it is a real one.
const LOOK_AGAIN: Duration = Duration::from_millis(200);
/// How soon a frame that found the queue full is sent again.
const SEND_AGAIN: Duration = Duration::from_millis(5);
/// How often the counts of full queues and lost frames are looked at.
const MEASURE_EVERY: Duration = Duration::from_secs(1);
/// Frames that wait for room in the queue: one for each node there can be.
const MOST_UNSENT: usize = 128;
/// Longer than anything that is waited for.
const LONG: Duration = Duration::from_secs(3600);

/// What the line and its listener share.
pub(super) struct Can {
    pub(super) link: Arc<Link>,
    /// The listener's.
    wakeup: Wakeup,
    handed: Mutex<Handed>,
}

/// What one has for the other.
#[derive(Debug, Default)]
struct Handed {
    /// Devices whose setup list has been written.
    set_up: Vec<DeviceId>,
    /// What need not rest any longer: a device, or the whole line.
    revived: Vec<Option<DeviceId>>,
}

/// The task that listens.
pub(super) struct CanListener {
    shared: LineHandle,
    bus: BusId,
    can: Arc<Can>,
    sleeper: Sleeper,
    routes: Routes,
    nodes: Nodes,
    health: Health,
    unsent: VecDeque<Frame>,
    socket: Option<(Arc<Socket>, Option<Inlet>)>,
    /// The interface carries frames.
    is_up: bool,
    tap: Tap,
    /// When the counts of the socket are looked at again.
    measure_at: Moment,
    looks: Looks,
}

impl Can {
    /// What opens the line of this bus.
    pub(super) fn dial(&self, bus: &Bus) -> CanDial {
        CanDial::new(self.link.clone(), bus.timeout)
    }

    /// The setup list of a device has been written.
    pub(super) fn is_set_up(&self, device: DeviceId) {
        self.handed().set_up.push(device);
        self.wakeup.wake();
    }

    /// What need not rest any longer, since this was last asked for.
    pub(super) fn revived(&self) -> Vec<Option<DeviceId>> {
        std::mem::take(&mut self.handed().revived)
    }

    fn handed(&self) -> MutexGuard<'_, Handed> {
        self.handed.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl CanListener {
    /// Listens for ever.
    pub(super) async fn listen(mut self) {
        let mut due = self.look();
        loop {
            self.wait(due).await;
            let inlet = self.socket.as_mut().and_then(|(_, inlet)| inlet.take());
            let taking = inlet.as_ref().map(Inlet::taking);
            due = self.look();
            drop(taking);
            if let (Some((_, kept)), Some(inlet)) = (&mut self.socket, inlet) {
                kept.get_or_insert(inlet);
            }
            // A bus that never falls silent must not keep the line from its turn.
            tokio::task::coop::consume_budget().await;
        }
    }

    /// Until a frame comes, or it is time for something.
    async fn wait(&mut self, due: Moment) {
        self.looks.away_for(due.since(self.looks.last()));
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

    /// Takes all there is and does all that is due; when there is something to do again.
    fn look(&mut self) -> Moment {
        if !self.is_up {
            self.try_interface();
        }
        let clock = &self.shared.clock;
        let gap = self.looks.look(clock.now()).filter(|_| !clock.is_virtual());
        if let Some(since) = gap {
            // What waits here came while nobody listened: how long ago, nobody knows.
            self.discard();
            self.shared.stood_still(since);
        }
        self.hear();
        let now = self.shared.clock.now();
        if self.is_up {
            let set_up = std::mem::take(&mut self.can.handed().set_up);
            let mut follows = self.nodes.tick(set_up, now);
            self.act(&mut follows);
        }
        if now >= self.measure_at {
            self.measure_at = now.after(MEASURE_EVERY);
            let changes = self.health.tick(self.can.link.full(), self.can.link.lost(), now);
            self.tell_health(changes);
        }
        let resend = (!self.unsent.is_empty()).then(|| now.after(SEND_AGAIN));
        let due = [self.nodes.due(), Some(self.measure_at), resend];
        due.into_iter().flatten().min().unwrap_or(now.after(LONG))
    }

    fn hear(&mut self) {
        while let Some((socket, _)) = &self.socket {
            match socket.hear_now() {
                Ok(Some(Heard::Frame(frame))) => self.take(&frame),
                Ok(Some(Heard::Trouble(trouble))) => {
                    let changes = self.health.trouble(&trouble, self.shared.clock.now());
                    self.tell_health(changes);
                }
                Ok(None) => return,
                Err(DOWN) if !self.can.link.is_down() => {}
                Err(fault) => return self.lose_interface(fault),
            }
        }
    }

    fn discard(&mut self) {
        while let Some((socket, _)) = &self.socket
            && matches!(socket.hear_now(), Ok(Some(_)))
        {}
    }

    fn take(&mut self, frame: &Frame) {
        let now = self.shared.clock.now();
        if self.nodes.answers(frame.id()) {
            self.can.link.answered(frame);
        }
        if let Some(device) = self.nodes.speaker(frame) {
            let mut follows = self.nodes.take(frame, now);
            self.act(&mut follows);
            self.is_spoken_to_by(device);
            self.tap.heard((device, self.shared.profile.device(device).unit), frame);
        }
        self.route(frame, now);
    }

    /// Sends what waits, until the queue is full again.
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
        // One that waits already serves for both: SYNC is not caught up with.
        if self.unsent.len() < MOST_UNSENT && !self.unsent.contains(&frame) {
            self.unsent.push_back(frame);
        }
    }
}

const DOWN: Fault = Fault::Link(LinkFault::Can(CanFault::Down));
const FULL: Fault = Fault::Link(LinkFault::Can(CanFault::Full));
