//! Configuration and start of the OPC UA library (async-opcua) for a virtual server.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use ::opcua::crypto::SecurityPolicy;
use ::opcua::server::node_manager::memory::{CoreNodeManagerBuilder, InMemoryNodeManagerBuilder};
use ::opcua::server::{
    ANONYMOUS_USER_TOKEN_ID, Server, ServerBuilder, ServerEndpoint, ServerHandle, ServerUserToken,
};
use ::opcua::types::MessageSecurityMode;
use tokio::net::{TcpListener, TcpStream};

use super::line::NodeLine;
use super::manager::NodesBuilder;
use super::nodes::APPLICATION;
use isotherm_profile::{Bus, User};

/// Interval of the checks whether the library has started.
const STARTING: Duration = Duration::from_millis(5);
/// Directory that cannot exist, so that the library reads and stores no certificate.
const NO_DIRECTORY: &str = "/dev/null/certificates";

/// Address of a server as clients know it, and the user that may log in with a password.
#[derive(Clone)]
pub(in crate::virtual_machine) struct Endpoint {
    host: String,
    port: u16,
    path: String,
    /// Name and password of the user; `None` if no user logs in with a password.
    user: Option<(String, String)>,
}

/// Running server of the library. Dropping it ends the server with all its sessions.
pub(super) struct Library {
    endpoint: Endpoint,
    /// Loopback address at which the library listens.
    address: SocketAddr,
    handle: ServerHandle,
    /// Number of starts of the device when the library was started.
    boots: u16,
}

impl Endpoint {
    /// Returns the endpoint of a bus at this host and port, with the path of its URL. A user with a certificate is left
    /// out, because the server has no security.
    pub(in crate::virtual_machine) fn new(bus: &Bus, host: &str, port: u16) -> Endpoint {
        let user = match bus.opcua.as_deref().map(|line| &line.user) {
            Some(User::Named { name, password }) => {
                let text = String::from_utf8_lossy(&password.bytes);
                Some((name.clone(), text.trim_end_matches(['\r', '\n']).to_owned()))
            }
            _ => None,
        };
        let (_, path) = Endpoint::parts(&bus.address);
        Endpoint { host: host.to_owned(), port, path: path.to_owned(), user }
    }

    /// Splits the URL of a server into host with port, and path.
    pub(in crate::virtual_machine) fn parts(url: &str) -> (&str, &str) {
        let rest = url.strip_prefix("opc.tcp://").unwrap_or(url);
        rest.find('/').map_or((rest, ""), |at| rest.split_at(at))
    }

    /// Returns the URL of the server.
    pub(in crate::virtual_machine) fn url(&self) -> String {
        format!("opc.tcp://{}:{}{}", self.host, self.port, self.path)
    }

    /// Makes the server of the library.
    ///
    /// # Errors
    /// The library rejects the configuration; the error is a sentence.
    fn server(&self, line: &Arc<NodeLine>) -> Result<(Server, ServerHandle), String> {
        let path = if self.path.is_empty() { "/" } else { self.path.as_str() };
        let mut users = vec![ANONYMOUS_USER_TOKEN_ID.to_owned()];
        // Without the diagnostics of the library, namespace 1 has the nodes of the profile too.
        let mut server = ServerBuilder::new()
            .without_node_managers()
            .with_node_manager(InMemoryNodeManagerBuilder::new(CoreNodeManagerBuilder))
            .with_node_manager(InMemoryNodeManagerBuilder::new(NodesBuilder { line: line.clone() }))
            .application_name("isotherm virtual")
            .application_uri(APPLICATION)
            .product_uri("urn:isotherm")
            .host(self.host.as_str())
            .port(self.port)
            .discovery_urls(vec![self.url()])
            .pki_dir(NO_DIRECTORY)
            .trust_client_certs(false)
            .diagnostics_enabled(false);
        if let Some((name, password)) = &self.user {
            users.push(name.clone());
            server = server.add_user_token(name.clone(), ServerUserToken::user_pass(name, password));
        }
        let endpoint = ServerEndpoint::new(path, SecurityPolicy::None, MessageSecurityMode::None, &users);
        server.add_endpoint("none", endpoint).build()
    }
}

impl Library {
    /// Starts the library, and waits until it listens.
    ///
    /// # Errors
    /// The library rejects the configuration, or cannot listen.
    pub(super) async fn start(endpoint: &Endpoint, line: &Arc<NodeLine>) -> io::Result<Library> {
        let inside = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await?;
        let (address, boots) = (inside.local_addr()?, line.boots());
        let (server, handle) = endpoint.server(line).map_err(io::Error::other)?;
        let server = tokio::spawn(server.run_with(inside));
        let port = &handle.info().port;
        while port.load(Ordering::Relaxed) == 0 && !server.is_finished() {
            tokio::time::sleep(STARTING).await;
        }
        // The library shows its own port. Clients must get that of the endpoint.
        port.store(endpoint.port, Ordering::Relaxed);
        Ok(Library { endpoint: endpoint.clone(), address, handle, boots })
    }

    /// Opens a connection, and returns it with the number of starts of the device. If the device was started again, the
    /// library is started again first, so that all earlier sessions are gone.
    ///
    /// # Errors
    /// The library cannot be started, or does not listen.
    pub(super) async fn connect(&mut self, line: &Arc<NodeLine>) -> io::Result<(TcpStream, u16)> {
        if self.boots != line.boots() {
            let started = Library::start(&self.endpoint, line).await?;
            *self = started;
        }
        let stream = TcpStream::connect(self.address).await?;
        stream.set_nodelay(true)?;
        Ok((stream, self.boots))
    }
}

impl Drop for Library {
    fn drop(&mut self) {
        self.handle.cancel();
    }
}
