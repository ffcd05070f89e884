//! Who is at the other end of a connection.

use std::net::{IpAddr, SocketAddr};
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use axum::extract::connect_info::Connected;
use axum::http::HeaderMap;
use axum::serve::IncomingStream;
use tokio::net::TcpListener;

use crate::observe::asker::{Asker, Way};

/// What our own page says of itself, so that its buttons and other programs are told apart.
const WAY: &str = "isotherm-way";

/// His address, and the connection by which he is known to be there.
#[derive(Clone, Debug)]
pub(super) struct Peer {
    address: SocketAddr,
    connection: Option<Arc<OwnedFd>>,
}

impl Connected<IncomingStream<'_, TcpListener>> for Peer {
    fn connect_info(stream: IncomingStream<'_, TcpListener>) -> Peer {
        let connection = stream.io().as_fd().try_clone_to_owned().ok().map(Arc::new);
        Peer { address: *stream.remote_addr(), connection }
    }
}

impl Peer {
    pub(super) fn ip(&self) -> IpAddr {
        self.address.ip()
    }

    pub(super) fn asker(&self, headers: &HeaderMap) -> Asker {
        let is_page = headers.get(WAY).is_some_and(|way| way == "page");
        let way = if is_page { Way::Page } else { Way::Api };
        let asker = Asker::new(way, self.ip().to_canonical().to_string());
        match &self.connection {
            Some(connection) => asker.at(connection.clone()),
            None => asker,
        }
    }
}
