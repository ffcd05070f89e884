//! Client of a request. The client is at the other end of the connection, or behind a trusted proxy at that end.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::forwarded::{Forwarded, Scheme, UnusableReport};
use crate::observe::requester::{Channel, Connection, Requester};
use isotherm_profile::IpNetwork;

/// Header with which the web page marks its own requests. Commands of other programs do not have this header.
const WAY: &str = "isotherm-way";

/// Address of the client, and the connection of its request. The connection shows whether the client still waits.
#[derive(Clone)]
pub(super) struct Peer {
    address: SocketAddr,
    connection: Arc<Connection>,
    arrival: Arrival,
}

/// How a request has reached this server.
#[derive(Clone)]
enum Arrival {
    /// Directly from the client, or from a proxy that is not trusted.
    Direct,
    /// Through a trusted proxy, which reports the client.
    Proxied(Arc<Forwarded>),
}

/// Reads the report of a trusted proxy about a request. The access check and the handlers run after this function, and
/// use the client that the proxy reports.
pub(super) async fn behind_proxies(
    State(trusted): State<Arc<[IpNetwork]>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    mut request: Request,
    next: Next,
) -> Response {
    match peer.reported(request.headers(), &trusted) {
        Ok(peer) => {
            request.extensions_mut().insert(ConnectInfo(peer));
            next.run(request).await
        }
        Err(unusable) => {
            let text = match unusable {
                UnusableReport::Differs => {
                    "The headers Forwarded and X-Forwarded-… of this request differ. Let the proxy remove the \
                     one that it does not set.\n"
                }
                UnusableReport::OpenQuote => {
                    "A quote in the header Forwarded of this request is not closed. Let the proxy replace this \
                     header.\n"
                }
            };
            (StatusCode::BAD_REQUEST, text).into_response()
        }
    }
}

impl Peer {
    pub(super) fn new(address: SocketAddr, connection: Arc<Connection>) -> Peer {
        Peer { address, connection, arrival: Arrival::Direct }
    }

    /// Returns the peer of a request with these headers. If the connection comes from a trusted proxy, the peer is the
    /// client that the proxy reports.
    fn reported(self, headers: &HeaderMap, trusted: &[IpNetwork]) -> Result<Peer, UnusableReport> {
        let proxy = self.address.ip();
        if !trusted.iter().any(|network| network.contains(proxy)) {
            return Ok(self);
        }
        let report = Forwarded::read(headers, proxy, trusted)?;
        Ok(Peer { arrival: Arrival::Proxied(Arc::new(report)), ..self })
    }

    fn report(&self) -> Option<&Forwarded> {
        match &self.arrival {
            Arrival::Direct => None,
            Arrival::Proxied(report) => Some(report),
        }
    }

    pub(super) fn ip(&self) -> IpAddr {
        self.report().map_or(self.address.ip(), |report| report.client)
    }

    /// Returns whether the request came through a trusted proxy. The client of such a request counts as a
    /// client on another computer.
    pub(super) fn is_proxied(&self) -> bool {
        self.report().is_some()
    }

    /// Returns the scheme of the page's address in the browser. `own` is the scheme of this server.
    pub(super) fn scheme(&self, own: Scheme) -> Scheme {
        self.report().and_then(|report| report.scheme).unwrap_or(own)
    }

    /// Returns host and port of the page's address in the browser; `None` if the request does not name them.
    pub(super) fn host<'a>(&'a self, headers: &'a HeaderMap) -> Option<&'a str> {
        let reported = self.report().and_then(|report| report.host.as_deref());
        reported.or_else(|| headers.get(header::HOST)?.to_str().ok())
    }

    /// Returns the path of the page on the proxy, without a slash at its end. The path is empty if there is no proxy.
    pub(super) fn prefix(&self) -> &str {
        self.report().map_or("", |report| report.prefix.as_str())
    }

    pub(super) fn requester(&self, headers: &HeaderMap) -> Requester {
        let is_page = headers.get(WAY).is_some_and(|way| way == "page");
        let way = if is_page { Channel::Page } else { Channel::Api };
        Requester::new(way, self.ip().to_canonical().to_string()).at(&self.connection)
    }
}
