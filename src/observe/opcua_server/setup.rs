//! Configuration of the library: endpoints, users, limits and directories.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use ::opcua::crypto::SecurityPolicy;
use ::opcua::server::node_manager::memory::InMemoryNodeManagerBuilder;
use ::opcua::server::{ANONYMOUS_USER_TOKEN_ID, Limits, Server, ServerBuilder, ServerEndpoint, ServerHandle};
use ::opcua::types::{BuildInfo, MessageSecurityMode, UAString};

use super::files::ServerFiles;
use super::nodes::NodesBuilder;
use super::pki::{KeyInMemory, OWN};
use super::users::{Users, tokens};
use isotherm_profile::{AnonymousClients, Security};

/// Security policies, the strongest first. None of them uses SHA-1.
pub(super) const POLICIES: [SecurityPolicy; 3] =
    [SecurityPolicy::Aes256Sha256RsaPss, SecurityPolicy::Aes128Sha256RsaOaep, SecurityPolicy::Basic256Sha256];
/// Maximum number of nodes in one call, and of entries in an array that a client sends.
const MOST_NODES: usize = 10_000;
/// Maximum number of nodes that are read in one call. The library stores all values until it sends them, and a value
/// may be an array of texts.
const MOST_READ: usize = 2_000;
/// Number of nodes that one subscription may always contain, even if the machine has few nodes.
const FEW_NODES: usize = 1_000;
/// Maximum number of subscriptions of one login.
const MOST_SUBSCRIPTIONS: usize = 4;
/// Maximum number of values or events of one node that wait for the next message to a client. Longer queues would need
/// much memory, because each node has its own queue.
const MOST_QUEUED: usize = 10;
/// Maximum number of chunks of a message, each of 64 kB.
const MOST_CHUNKS: usize = 32;
/// Maximum size of a chunk in bytes. The server reports this size to clients when they connect.
pub(super) const CHUNK: usize = 65_535;
/// Publishing interval, in milliseconds, that clients may always request, even if the nodes are updated less often.
const LONGEST_PUBLISHING_MS: f64 = 1000.0;
/// Path of every endpoint in the address of the server.
const PATH: &str = "/";

/// Configuration for one start of the library.
pub(super) struct Setup<'s> {
    pub(super) machine: &'s str,
    pub(super) files: &'s ServerFiles,
    pub(super) security: Security,
    pub(super) anonymous: AnonymousClients,
    pub(super) every: Duration,
    /// Host and port in the addresses that clients see.
    pub(super) shown: (&'s str, u16),
    /// Maximum number of simultaneous connections.
    pub(super) connections: usize,
    pub(super) directory: PathBuf,
    pub(super) key: Option<&'s KeyInMemory>,
}

impl Setup<'_> {
    /// Makes the server object of the library.
    ///
    /// # Errors
    /// The library rejects the configuration. The error is a sentence.
    pub(super) fn server(
        self,
        nodes: NodesBuilder,
        users: Arc<Users>,
    ) -> Result<(Server, ServerHandle), String> {
        let (host, port) = self.shown;
        let variables = nodes.tree.variables.len();
        let mut server = ServerBuilder::new()
            .application_name(format!("isotherm {}", self.machine))
            .application_uri(self.files.application.clone())
            .product_uri("urn:isotherm")
            .build_info(build_info())
            .host(host)
            .port(port)
            .discovery_urls(vec![format!("opc.tcp://{host}:{port}{PATH}")])
            .pki_dir(self.directory.clone())
            .trust_client_certs(false)
            .diagnostics_enabled(false)
            .with_authenticator(users)
            .with_node_manager(InMemoryNodeManagerBuilder::new(nodes));
        if let Some(key) = self.key {
            server = server.certificate_path(OWN).private_key_path(key.path());
        }
        for (name, token) in tokens(&self.files.users) {
            server = server.add_user_token(name, token);
        }
        for (name, endpoint) in self.endpoints() {
            server = server.add_endpoint(name, endpoint);
        }
        self.limit(server.limits_mut(), variables);
        server.build()
    }

    /// Returns the endpoints by name: one endpoint for each allowed policy and mode.
    fn endpoints(&self) -> Vec<(String, ServerEndpoint)> {
        let mut users: Vec<String> = self.files.users.iter().map(|user| user.name.clone()).collect();
        if self.anonymous == AnonymousClients::Allowed {
            users.push(ANONYMOUS_USER_TOKEN_ID.to_owned());
        }
        let (policies, modes): (&[SecurityPolicy], &[MessageSecurityMode]) = match self.security {
            Security::None => (&[SecurityPolicy::None], &[MessageSecurityMode::None]),
            Security::Sign => (&POLICIES, &[MessageSecurityMode::Sign, MessageSecurityMode::SignAndEncrypt]),
            Security::SignAndEncrypt => (&POLICIES, &[MessageSecurityMode::SignAndEncrypt]),
        };
        let pairs = policies.iter().flat_map(|policy| modes.iter().map(move |mode| (*policy, *mode)));
        pairs
            .map(|(policy, mode)| {
                let endpoint = ServerEndpoint::new(PATH, policy, mode, &users);
                (format!("{policy} {mode:?}"), endpoint)
            })
            .collect()
    }

    fn limit(&self, limits: &mut Limits, variables: usize) {
        limits.max_array_length = MOST_NODES;
        limits.max_chunk_count = MOST_CHUNKS;
        limits.max_message_size = MOST_CHUNKS * CHUNK;
        limits.receive_buffer_size = CHUNK;
        // A client that was cut off keeps its login for a minute, and logs in again meanwhile.
        limits.max_sessions = 2 * self.connections;
        let every_ms = 1000.0 * self.every.as_secs_f64();
        let subscriptions = &mut limits.subscriptions;
        subscriptions.min_sampling_interval_ms = every_ms;
        // These messages also show the client that the server is alive.
        subscriptions.min_publishing_interval_ms = every_ms.min(LONGEST_PUBLISHING_MS);
        // Each monitored item needs memory, so the limit depends on the number of variables.
        subscriptions.max_monitored_items_per_sub = (2 * variables).clamp(FEW_NODES, MOST_NODES);
        subscriptions.max_subscriptions_per_session = MOST_SUBSCRIPTIONS;
        subscriptions.max_monitored_item_queue_size = MOST_QUEUED;
        limits.operational.max_nodes_per_read = MOST_READ;
        limits.operational.max_monitored_items_per_call = MOST_NODES;
        limits.operational.max_nodes_per_translate_browse_paths_to_node_ids = MOST_NODES;
    }
}

fn build_info() -> BuildInfo {
    BuildInfo {
        product_uri: UAString::from("urn:isotherm"),
        manufacturer_name: UAString::from("isotherm"),
        product_name: UAString::from("isotherm"),
        software_version: UAString::from(env!("CARGO_PKG_VERSION")),
        ..BuildInfo::default()
    }
}
