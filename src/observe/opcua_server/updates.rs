//! Updates of the nodes: values that have changed, new events, and reports about refused clients.

use std::sync::Arc;
use std::time::Duration;

use ::opcua::nodes::{BaseEventType, Event, NodeType};
use ::opcua::server::ServerHandle;
use ::opcua::types::{AttributeId, NodeId};

use super::convert::{data_value, date_time, subscribed};
use super::event_feed::EventFeed;
use super::nodes::{Manager, node};
use super::pki::Pki;
use super::refusals::Refusals;
use super::reports::{Reports, is_due};
use super::sampler::Sampler;
use super::tree::{MACHINE, Tree};
use crate::clock::{BootClock, Clock};
use crate::observe::status::{GatewayApi, Status};

/// Updater of the nodes of one start of the library.
pub(super) struct Updates {
    source: Arc<dyn GatewayApi>,
    clock: Clock,
    tree: Arc<Tree>,
    /// Node identifiers of the variables, in the order of the tree.
    ids: Vec<NodeId>,
    /// Node identifier of the machine, which is the source of its events.
    machine: NodeId,
    sampler: Sampler,
    feed: EventFeed,
    manager: Arc<Manager>,
    handle: ServerHandle,
    pki: Pki,
    refusals: Arc<Refusals>,
    reports: Reports,
    /// Time of the last [`Updates::refresh`], as time since the start of the computer; `None` before the first refresh.
    refreshed: Option<Duration>,
}

/// Parts of the server that [`Updates`] needs: nodes, handle, certificates, and refused clients.
pub(super) struct Library {
    pub(super) manager: Arc<Manager>,
    pub(super) handle: ServerHandle,
    pub(super) pki: Pki,
    pub(super) refusals: Arc<Refusals>,
}

impl Updates {
    /// Creates the updater, and sets the nodes to the values of this status.
    pub(super) fn begin(
        source: Arc<dyn GatewayApi>,
        (tree, status): (Arc<Tree>, Status),
        library: Library,
    ) -> Updates {
        let Library { manager, handle, pki, refusals } = library;
        let clock = Clock::wall();
        let index = manager.inner().index();
        let ids = tree.variables.iter().map(|variable| node(index, &variable.id)).collect();
        let feed = EventFeed::after(&status, clock.time_of_day());
        let mut updates = Updates {
            source,
            clock,
            tree,
            ids,
            machine: node(index, MACHINE),
            sampler: Sampler::default(),
            feed,
            manager,
            handle,
            pki,
            refusals,
            reports: Reports::default(),
            refreshed: None,
        };
        updates.set_values(status);
        updates
    }

    /// Returns the handle of the server of the library.
    pub(super) fn handle(&self) -> &ServerHandle {
        &self.handle
    }

    /// Returns the refused clients and logins that are not reported yet.
    pub(super) fn refusals(&self) -> &Arc<Refusals> {
        &self.refusals
    }

    /// Takes a sample of the status, sets the nodes that have changed, and sends new events.
    pub(super) fn refresh(&mut self) {
        self.refreshed = Some(BootClock::default().passed());
        let status = self.source.status();
        self.send_events(&status);
        self.set_values(status);
    }

    /// Refreshes the nodes for the first client that connects, unless their last refresh is more recent than `every`.
    /// Clients that connect repeatedly must not cause more frequent copies of the status.
    pub(super) fn refresh_for_first(&mut self, every: Duration) {
        if is_due(&mut self.refreshed, every, BootClock::default().passed()) {
            self.refresh();
        }
    }

    /// Reports the clients and logins that were refused since the last report.
    pub(super) fn report(&mut self) {
        for certificate in self.refusals.take_clients() {
            self.pki.reject(&certificate);
        }
        let rejected = self.pki.rejected();
        self.reports.report(BootClock::default().passed(), (rejected, &self.refusals), &self.source);
    }

    fn set_values(&mut self, status: Status) {
        let changed = self.sampler.refresh(&self.tree.variables, status);
        let now = date_time(self.clock.time_of_day());
        let mut space = self.manager.address_space().write();
        let mut notifier = self.handle.subscriptions().data_notifier();
        for place in changed {
            let (Some(sample), Some(id)) = (self.sampler.sample(place), self.ids.get(place)) else {
                continue;
            };
            let value = data_value(sample, now);
            if let Some(mut items) = notifier.notify_for(id, AttributeId::Value) {
                items.data_value(subscribed(value.clone()));
            }
            if let Some(NodeType::Variable(variable)) = space.find_mut(id) {
                variable.set_data_value(value);
            }
        }
    }

    fn send_events(&mut self, status: &Status) {
        let new = self.feed.take_new(status);
        let event = |new| self.feed.event(new, &self.machine, &status.machine);
        let events: Vec<BaseEventType> = new.into_iter().map(event).collect();
        let events = events.iter().map(|event| (event as &dyn Event, &self.machine));
        self.handle.subscriptions().notify_events(events);
    }
}
