//! State that the handlers of all requests share.

use std::sync::{Arc, OnceLock};

use axum::http::HeaderMap;
use tokio::sync::Semaphore;

use super::access::Access;
use super::live::Live;
use super::peer::Peer;
use crate::observe::page::MachineTexts;
use crate::observe::requester::{Requester, ServiceTimes};
use crate::observe::status::GatewayApi;

#[derive(Clone)]
pub(super) struct HttpState {
    pub(super) source: Arc<dyn GatewayApi>,
    pub(super) access: Arc<Access>,
    pub(super) live: Live,
    pub(super) attendance: ServiceTimes,
    /// Permits for requests that read the decision logs.
    pub(super) readers: Arc<Semaphore>,
    /// Permit for a request that reads the events.
    pub(super) events: Arc<Semaphore>,
    /// Texts of the web page. They are read when the first page is made.
    pub(super) texts: Arc<OnceLock<MachineTexts>>,
}

impl HttpState {
    /// Returns the texts of the web page. A status is made only for the first call: for a large machine this takes
    /// long, and a client without access must not cause much work.
    pub(super) fn texts(&self) -> &MachineTexts {
        self.texts.get_or_init(|| MachineTexts::of(self.source.status()))
    }

    pub(super) fn requester(&self, peer: &Peer, headers: &HeaderMap) -> Arc<Requester> {
        Arc::new(peer.requester(headers).until(self.attendance.until()))
    }
}
