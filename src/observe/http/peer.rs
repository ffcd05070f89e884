//! Client at the other end of a connection.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use axum::http::HeaderMap;

use crate::observe::requester::{Channel, Connection, Requester};

/// Header by which the web page marks its own requests. Commands of other programs do not have it.
const WAY: &str = "isotherm-way";

/// Address of the client, and its connection, which shows whether the client still waits.
#[derive(Clone)]
pub(super) struct Peer {
    address: SocketAddr,
    connection: Arc<Connection>,
}

impl Peer {
    pub(super) fn new(address: SocketAddr, connection: Arc<Connection>) -> Peer {
        Peer { address, connection }
    }

    pub(super) fn ip(&self) -> IpAddr {
        self.address.ip()
    }

    pub(super) fn requester(&self, headers: &HeaderMap) -> Requester {
        let is_page = headers.get(WAY).is_some_and(|way| way == "page");
        let way = if is_page { Channel::Page } else { Channel::Api };
        Requester::new(way, self.ip().to_canonical().to_string()).at(&self.connection)
    }
}
