//! OPC UA client, with the library async-opcua: binary protocol over TCP, on sockets of the gateway.
//!
//! ```text
//! dial ─► endpoints ─► trusted? ─► secure channel ─► session (resumed or new) ─► limits, namespaces
//! wire ─► one Read or Write call at a time
//!         one Publish request per subscription waits at the server, and is renewed when values are requested
//! ```
//!
//! - The session of the library is not used, because it reconnects, sends keep-alive messages and repeats requests by
//!   itself. [`DeviceLine`] does this for every kind of line. Without a request of the line, the gateway sends nothing.
//! - A lost connection leaves its session at the server. The next connection resumes that session, so that a server
//!   with few sessions does not run out of them.
//! - A certificate is trusted if it is identical to one in the directory that the profile names, and is valid now. The
//!   gateway checks neither the authority that signed the certificate nor the names in it. The server may send the
//!   certificates of its authorities too (`chain.rs`).
//! - A call that is too large for the server is halved (`call_size.rs`).
//! - After a rejected login, the gateway does not connect for five minutes, and leaves no session at the server.
//! - The index of a namespace that the profile names by its URI is read each time a connection is opened. The URI of a
//!   namespace that the profile names by index is stored ([`super::namespaces`]). If the server does not have the
//!   namespace of a node, the gateway does not request the node, and treats it as missing.
//! - The library discards an answer with an unknown request number, so such an answer is never mistaken for the answer
//!   to another request.
//!
//! [`DeviceLine`]: crate::fieldbus::line::DeviceLine

use std::sync::Arc;
use std::time::Duration;

use ::opcua::client::{AsyncSecureChannel, IdentityToken};
use ::opcua::crypto::{PrivateKey, X509};
use ::opcua::types::{EndpointDescription, Error};
use tokio::net::TcpStream;

use super::fault::OpcUaFault;
use super::namespaces::NamespaceTable;
use crate::fieldbus::connection::{Connection, Dial};
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::kinds::target::host_of_url;
use crate::fieldbus::tcp::connected;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::Boxed;
use call_size::CallSizes;
use channel::{Link, Socket};
use files::Files;
use isotherm_profile::{Bus, Security};
use session::{Limits, Login, Session};
use status::{Purpose, call_fault, dial_fault, opening_fault};
use wire::OpcUa;

pub mod browse;
mod call_size;
pub mod certificate;
mod chain;
mod channel;
mod chunks;
mod endpoint;
mod files;
mod namespaces;
pub mod offer;
mod panic_guard;
mod publishing;
pub(super) mod scan;
pub(super) mod server_files;
mod session;
mod status;
mod subscription;
mod value;
mod wire;

pub(super) use files::wrong;

/// Time that opening a session may take in addition to the timeout of an answer: signatures and checks of certificates
/// take longer.
const OPENING: Duration = Duration::from_secs(5);
/// Pause after the server has rejected the user or the gateway's certificate. Many servers lock a user after a few
/// rejected logins, and record each rejected certificate.
const AFTER_REJECTION: Duration = Duration::from_mins(5);

/// Opener of sessions with one OPC UA server.
pub(super) struct OpcUaDial {
    /// URL of the server, for example `opc.tcp://192.168.0.12:4840`.
    url: String,
    /// Host and port, taken from the URL, for the TCP connection.
    address: String,
    security: Security,
    timeout: Duration,
    /// Certificates, keys and user that the profile names; `None` if one of the files is unusable, as [`wrong`]
    /// reports.
    files: Option<Files>,
    /// Channel, endpoint and session of the last connection. The next connection resumes this session.
    known: Option<ServerState>,
    /// Maximum number of nodes in one call of each service, as learned from refusals of the server.
    sizes: CallSizes,
    /// Whether the server no longer had the session of the previous connection when the present one was opened.
    is_forgotten: bool,
    /// Table of the namespaces that the profile names by index, which the bus line and the gateway share.
    namespaces: NamespaceTable,
}

/// Data of a server that are kept between connections: channel, endpoint and session.
struct ServerState {
    channel: Arc<AsyncSecureChannel>,
    endpoint: EndpointDescription,
    session: Session,
}

impl OpcUaDial {
    /// Returns a connection opener (dial) for the server of this bus; `None` for any other type of bus.
    pub(super) fn new(bus: &Bus) -> Option<OpcUaDial> {
        let line = bus.opcua.as_deref()?;
        let address = host_of_url(&bus.address).to_owned();
        let (url, timeout) = (bus.address.clone(), bus.timeout);
        let files = Files::read(line).ok();
        Some(OpcUaDial {
            url,
            address,
            security: line.security,
            timeout,
            files,
            known: None,
            sizes: CallSizes::default(),
            is_forgotten: false,
            namespaces: NamespaceTable::default(),
        })
    }

    async fn open(&mut self) -> Result<Connection, Fault> {
        let Some(files) = &self.files else { return Err(fault(OpcUaFault::OurFiles)) };
        files.own_is_valid().map_err(fault)?;
        let (mut taken_up, had_session) = (None, self.known.is_some());
        if self.known.as_ref().is_some_and(|known| known.session.is_alive()) {
            let socket = connected(&self.address, self.timeout).await?;
            // If a later step fails, the endpoint or its certificate may have changed: query them again.
            if let Some(known) = self.known.take() {
                taken_up = self.take_up(files, known, socket).await?;
            }
        }
        self.is_forgotten = had_session && taken_up.is_none();
        let (mut link, known) = match taken_up {
            Some(taken_up) => taken_up,
            None => self.begin(files).await?,
        };
        let limits = self.prepare(&mut link, &known.session).await?;
        let wire = OpcUa::new(link, known.session.clone(), limits);
        self.known = Some(known);
        Ok(Connection::Other(Box::new(wire)))
    }

    /// Reads the limits and the namespaces of the server in a new or resumed session. If that fails, closes the
    /// session, because no later connection resumes it.
    async fn prepare(&self, link: &mut Link, session: &Session) -> Result<Limits, Fault> {
        let limits = session.limits(link).await;
        let read = match limits {
            Ok(limits) => session.read_namespaces(link, &self.namespaces).await.map(|()| limits),
            Err(error) => Err(error),
        };
        if read.is_err() {
            session.give_up(link).await;
        }
        read.map_err(|error| call_fault(&error))
    }

    /// Resumes the previous session on this socket; returns `None` if that fails.
    ///
    /// # Errors
    /// The server rejects the user. The server would also reject the user in a new session, and count another failed
    /// login.
    async fn take_up(
        &self,
        files: &Files,
        known: ServerState,
        socket: TcpStream,
    ) -> Result<Option<(Link, ServerState)>, Fault> {
        let own = self.shown(files);
        let socket = Socket::new(&self.url, socket, own, &known.endpoint);
        let Ok(mut link) = Link::open(known.channel.clone(), &socket).await else { return Ok(None) };
        let login = Login { endpoint: &known.endpoint, own, user: &files.user };
        let resumed = known.session.take_up(&mut link, login).await.map_err(|error| dial_fault(&error));
        let rejected = fault(OpcUaFault::UserRefused);
        match resumed {
            Ok(()) => Ok(Some((link, known))),
            Err(why) if why == rejected => {
                known.session.give_up(&mut link).await;
                Err(rejected)
            }
            Err(_) => Ok(None),
        }
    }

    /// Chooses an endpoint of the server, opens a secure channel to this endpoint, and begins a new session.
    async fn begin(&self, files: &Files) -> Result<(Link, ServerState), Fault> {
        let endpoints = offered(&self.url, self.timeout).await?;
        let endpoint =
            endpoint::choose(endpoints, self.security, &files.user).ok_or(fault(OpcUaFault::NoEndpoint))?;
        if self.security != Security::None {
            files.trusts(endpoint.server_certificate.as_ref()).map_err(fault)?;
        }
        let endpoint = chain::without_chain(endpoint);
        let own = self.shown(files);
        let socket = connected(&self.address, self.timeout).await?;
        let socket = Socket::new(&self.url, socket, own, &endpoint);
        let channel = Arc::new(channel::secured(&endpoint));
        let not_opened = |error: Error| opening_fault(Purpose::Session, socket.reply(), &error);
        let mut link = Link::open(channel.clone(), &socket).await.map_err(not_opened)?;
        let session = Session::none(files.application.clone(), self.timeout, self.sizes.clone());
        session.begin(&mut link, Login { endpoint: &endpoint, own, user: &files.user }).await?;
        Ok((link, ServerState { channel, endpoint, session }))
    }

    /// Returns the certificate that the gateway sends, with its key; `None` if the line uses no security.
    fn shown<'f>(&self, files: &'f Files) -> Option<&'f (X509, PrivateKey)> {
        files.own.as_ref().filter(|_| self.security != Security::None)
    }
}

/// Queries the endpoints of a server, on a separate connection without security.
async fn offered(url: &str, timeout: Duration) -> Result<Vec<EndpointDescription>, Fault> {
    let socket = connected(host_of_url(url), timeout).await?;
    let socket = Socket::plain(url, socket);
    let plain = channel::secured(&EndpointDescription::from(url));
    let opening = Link::open(Arc::new(plain), &socket);
    let not_opened = |error: Error| opening_fault(Purpose::List, socket.reply(), &error);
    let mut link = opening.await.map_err(not_opened)?;
    let found = session::endpoints(&mut link, url, timeout + OPENING).await;
    // The server may have a single channel, which the session needs.
    link.close().await;
    found
}

fn fault(why: OpcUaFault) -> Fault {
    Fault::Link(LinkFault::OpcUa(why))
}

impl Dial for OpcUaDial {
    fn dial<'a>(&'a mut self, _: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(self.open())
    }

    fn resumes(&self) -> bool {
        !self.is_forgotten
    }

    fn namespaces(&self) -> Option<NamespaceTable> {
        Some(self.namespaces.clone())
    }

    fn takes(&self) -> Duration {
        OPENING
    }

    fn pause_after(&self, fault: Fault) -> Duration {
        match fault {
            Fault::Link(LinkFault::OpcUa(OpcUaFault::UserRefused | OpcUaFault::OursRefused)) => {
                AFTER_REJECTION
            }
            _ => Duration::ZERO,
        }
    }
}

/// Returns the kind of identity with which the gateway logs in: anonymous, password, certificate or issued token.
fn user_kind(user: &IdentityToken) -> ::opcua::types::UserTokenType {
    use ::opcua::types::UserTokenType;
    match user {
        IdentityToken::Anonymous => UserTokenType::Anonymous,
        IdentityToken::UserName(..) => UserTokenType::UserName,
        IdentityToken::X509(..) => UserTokenType::Certificate,
        IdentityToken::IssuedToken(_) => UserTokenType::IssuedToken,
    }
}
