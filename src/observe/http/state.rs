//! State that the handlers of all requests share.

use std::sync::{Arc, OnceLock};

use axum::http::HeaderMap;
use isotherm_profile::Language;
use tokio::sync::Semaphore;

use super::access::Access;
use super::live::Live;
use super::peer::Peer;
use crate::observe::requester::{Requester, ServiceTimes};
use crate::observe::status::GatewayApi;

#[derive(Clone)]
pub(super) struct HttpState {
    pub(super) source: Arc<dyn GatewayApi>,
    pub(super) access: Arc<Access>,
    pub(super) live: Live,
    pub(super) attendance: ServiceTimes,
    /// Permits for requests that read the history.
    pub(super) readers: Arc<Semaphore>,
    /// Permit for a request that reads the events.
    pub(super) events: Arc<Semaphore>,
    /// Texts of the sign-in page. They are read for the first answer to a client that may not read the status.
    pub(super) login: Arc<OnceLock<LoginTexts>>,
}

/// Texts of the profile that the sign-in page needs.
pub(super) struct LoginTexts {
    pub(super) language: Option<Language>,
    /// Displayed name of the machine.
    pub(super) machine: String,
}

impl HttpState {
    pub(super) fn requester(&self, peer: &Peer, headers: &HeaderMap) -> Arc<Requester> {
        Arc::new(peer.requester(headers).until(self.attendance.until()))
    }
}
