//! An OPC UA server, spoken to by the library async-opcua: binary over TCP, on sockets of ours.
//!
//! ```text
//! dial ─► endpoints ─► trusted? ─► secure channel ─► session (the one from before, or a new one) ─► limits, namespaces
//! wire ─► one Read or Write call at a time; nothing is sent that nobody has asked for
//!         but for a Publish request of each subscription, which waits at the server: it is renewed as its values are asked for
//! ```
//!
//! - The library's own session, which reconnects, keeps alive and repeats by itself, is not used: [`DeviceLine`] does that for every
//!   kind of line, and nothing is sent behind its back.
//! - A connection that is lost leaves its session at the server. The next one takes it up again, so that a server with few sessions
//!   does not run out of them.
//! - A certificate is trusted where it is, byte for byte, one of those in the profile's directory, and its time is not over. No
//!   authority is asked, and no name in it is compared.
//! - A namespace that the profile names by its URI has the index that the server gave it when the connection was opened. Of one that
//!   it names by index, the URI is remembered ([`super::namespaces`]). A node whose namespace the server does not have is not sent
//!   to it: it is a node that is not there.
//! - An answer whose number is nobody's is passed over by the library. It is never taken for another's.
//!
//! [`DeviceLine`]: super::line::DeviceLine

use std::sync::Arc;
use std::time::Duration;

use ::opcua::client::{AsyncSecureChannel, IdentityToken};
use ::opcua::crypto::{PrivateKey, X509};
use ::opcua::types::EndpointDescription;
use tokio::net::TcpStream;

use super::connection::{Connection, Dial};
use super::error::{Fault, LinkFault};
use super::namespaces::NamespaceTable;
use super::opcua_fault::OpcUaFault;
use super::tcp::connected;
use super::trace::Tap;
use super::wire::Boxed;
use channel::{Link, Socket};
use files::Files;
use isotherm_profile::{Bus, Security};
use session::Session;
use status::{call_fault, dial_fault};
use wire::OpcUa;

pub mod browse;
pub mod certificate;
mod channel;
mod chunks;
mod contained;
mod endpoint;
mod files;
mod namespaces;
pub mod offer;
mod publishing;
mod session;
mod status;
mod subscription;
mod value;
mod wire;

pub(super) use files::wrong;

/// Signatures, certificates and a server that makes up its mind take longer than an answer.
const OPENING: Duration = Duration::from_secs(5);

/// Opens sessions with one server.
pub(super) struct OpcUaDial {
    /// Its URL.
    url: String,
    /// Host and port of that.
    address: String,
    security: Security,
    timeout: Duration,
    /// `None`: they are of no use, as [`wrong`] says.
    files: Option<Files>,
    /// What is kept beyond a connection: the session, which the next one takes up.
    known: Option<Known>,
    /// The server did not know the session of the connection before.
    is_forgotten: bool,
    /// Where the namespaces are that the profile names by index.
    namespaces: NamespaceTable,
}

/// What is known of a server.
struct Known {
    channel: Arc<AsyncSecureChannel>,
    endpoint: EndpointDescription,
    session: Session,
}

impl OpcUaDial {
    /// To the server of this bus; `None` for any other kind of line.
    pub(super) fn new(bus: &Bus) -> Option<OpcUaDial> {
        let line = bus.opcua.as_ref()?;
        let address = host_and_port(&bus.address).to_owned();
        let (url, timeout) = (bus.address.clone(), bus.timeout);
        let files = Files::read(line).ok();
        Some(OpcUaDial {
            url,
            address,
            security: line.security,
            timeout,
            files,
            known: None,
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
            // Whatever fails from here on, its endpoint may be another by now, and its certificate: they are asked for anew.
            if let Some(known) = self.known.take() {
                taken_up = self.take_up(files, known, socket).await;
            }
        }
        self.is_forgotten = had_session && taken_up.is_none();
        let (mut link, known) = match taken_up {
            Some(taken_up) => taken_up,
            None => self.begin(files).await?,
        };
        let limits = known.session.limits(&mut link).await?;
        let read = known.session.read_namespaces(&mut link, &self.namespaces).await;
        read.map_err(|error| call_fault(&error))?;
        let wire = OpcUa::new(link, known.session.clone(), limits);
        self.known = Some(known);
        Ok(Connection::Other(Box::new(wire)))
    }

    /// The session from before, on this socket; `None` where the server does not have it any more.
    async fn take_up(&self, files: &Files, known: Known, socket: TcpStream) -> Option<(Link, Known)> {
        let own = self.shown(files);
        let socket = Socket::new(&self.url, socket, own);
        let mut link = Link::open(known.channel.clone(), &socket).await.ok()?;
        known.session.take_up(&mut link, &known.endpoint, own, &files.user).await.ok()?;
        Some((link, known))
    }

    /// A new session.
    async fn begin(&self, files: &Files) -> Result<(Link, Known), Fault> {
        let endpoints = offered(&self.url, self.timeout).await?;
        let endpoint =
            endpoint::choose(endpoints, self.security, &files.user).ok_or(fault(OpcUaFault::NoEndpoint))?;
        if self.security != Security::None {
            files.trusts(endpoint.server_certificate.as_ref()).map_err(fault)?;
        }
        let own = self.shown(files);
        let socket = connected(&self.address, self.timeout).await?;
        let socket = Socket::new(&self.url, socket, own);
        let channel = Arc::new(channel::secured(&endpoint));
        let mut link = Link::open(channel.clone(), &socket).await.map_err(|error| dial_fault(&error))?;
        let session = Session::none(files.application.clone(), self.timeout);
        session.begin(&mut link, &endpoint, own, &files.user).await?;
        Ok((link, Known { channel, endpoint, session }))
    }

    /// The certificate that the gateway shows, and its key.
    fn shown<'f>(&self, files: &'f Files) -> Option<&'f (X509, PrivateKey)> {
        files.own.as_ref().filter(|_| self.security != Security::None)
    }
}

/// Host and port in the URL of a server.
fn host_and_port(url: &str) -> &str {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    rest.split('/').next().unwrap_or_default()
}

/// What a server offers, asked on a connection of its own that nothing protects.
async fn offered(url: &str, timeout: Duration) -> Result<Vec<EndpointDescription>, Fault> {
    let socket = connected(host_and_port(url), timeout).await?;
    let socket = Socket::new(url, socket, None);
    let plain = channel::secured(&EndpointDescription::from(url));
    let opening = Link::open(Arc::new(plain), &socket);
    let mut link = opening.await.map_err(|_| fault(OpcUaFault::NoServer))?;
    session::endpoints(&mut link, url, timeout + OPENING).await
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
}

/// Says as whom, without what is secret.
fn user_kind(user: &IdentityToken) -> ::opcua::types::UserTokenType {
    use ::opcua::types::UserTokenType;
    match user {
        IdentityToken::Anonymous => UserTokenType::Anonymous,
        IdentityToken::UserName(..) => UserTokenType::UserName,
        IdentityToken::X509(..) => UserTokenType::Certificate,
        IdentityToken::IssuedToken(_) => UserTokenType::IssuedToken,
    }
}
