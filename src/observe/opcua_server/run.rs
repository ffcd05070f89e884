//! Main loop of the server: it opens the port, starts the library behind the gate, and updates the nodes.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

use super::door::Door;
use super::files::ServerFiles;
use super::gate::{self, Clients};
use super::measured::Measured;
use super::nodes::{Manager, NodesBuilder};
use super::pki::Pki;
use super::refusals::Refusals;
use super::reports::LOOK_EVERY;
use super::screen::Rules;
use super::setup::Setup;
use super::tree::Tree;
use super::updates::{Library, Updates};
use super::users::Users;
use crate::observe::events::{Event, OpcUaServerEvent};
use crate::observe::http::Limits;
use crate::observe::http::connection_limiter::ConnectionLimiter;
use crate::observe::status::GatewayApi;
use isotherm_core::explained::Cause;
use isotherm_profile::safe_file::without_numbers;
use isotherm_profile::{OpcUaServer, host_and_port};

/// Number of consecutive failures with a new cause after which the new cause is reported.
const CHANGED_AFTER: u32 = 2;
/// Wait after a failure before the server is started again.
const AGAIN: Duration = Duration::from_secs(10);
/// Interval of the checks whether the library has started.
const STARTING: Duration = Duration::from_millis(5);
/// Maximum time for the library to close its connections when the server ends.
const LAST: Duration = Duration::from_millis(500);

/// Server of one machine, before it is started.
pub(super) struct Runner {
    pub(super) machine: String,
    pub(super) settings: OpcUaServer,
    pub(super) files: ServerFiles,
    pub(super) source: Arc<dyn GatewayApi>,
    /// Path of the directory with the certificates.
    pub(super) directory: PathBuf,
    /// Name of this computer. Clients see it in the server address if the server listens on every address.
    pub(super) hostname: String,
    /// Maximum number of simultaneous connections.
    pub(super) connections: usize,
}

/// State of the server's port in the last report: nothing was reported, or the port is closed.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Reported {
    Nothing,
    Closed,
}

impl Runner {
    /// Serves clients until `stopped` is set. After each failure, the server starts again ten seconds later.
    pub(super) async fn run(self, mut stopped: watch::Receiver<bool>) {
        let (mut cause, mut reported) = (None, Reported::Nothing);
        loop {
            let Err(why) = self.serve(&mut stopped, &mut reported).await else { return };
            if Cause::is_news(&mut cause, why.clone(), CHANGED_AFTER) || reported == Reported::Nothing {
                self.report(OpcUaServerEvent::Closed { listen: self.settings.listen.clone(), why });
                reported = Reported::Closed;
            }
            tokio::select! {
                () = tokio::time::sleep(AGAIN) => {}
                () = ends(&mut stopped) => return,
            }
        }
    }

    fn report(&self, event: OpcUaServerEvent) {
        self.source.report(&Event::OpcUaServer(event));
    }

    /// Serves clients until `stopped` is set.
    ///
    /// # Errors
    /// The server cannot be started, or has failed; the error is a sentence.
    async fn serve(
        &self,
        stopped: &mut watch::Receiver<bool>,
        reported: &mut Reported,
    ) -> Result<(), String> {
        let system = |error: std::io::Error| without_numbers(&error.to_string()).to_string();
        let listener = TcpListener::bind(&self.settings.listen).await.map_err(system)?;
        let address = listener.local_addr().map_err(system)?;
        let inside = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await.map_err(system)?;
        let door = Arc::new(Door::of(&inside).map_err(system)?);
        let (server, mut updates) = self.library(address)?;
        let handle = updates.handle().clone();
        let mut server = tokio::spawn(server.run_with(inside));
        let port = &handle.info().port;
        // The library shows its own port. Clients must get the one of the gate.
        while port.load(Ordering::Relaxed) == 0 && !server.is_finished() {
            tokio::time::sleep(STARTING).await;
        }
        port.store(address.port(), Ordering::Relaxed);
        if std::mem::replace(reported, Reported::Nothing) == Reported::Closed {
            self.report(OpcUaServerEvent::Open { listen: self.settings.listen.clone() });
        }
        tracing::info!("OPC UA clients are served at opc.tcp://{}:{}", self.host(address), address.port());
        let clients = Arc::new(Clients::default());
        let limiter = Arc::new(ConnectionLimiter::new(Limits::of(self.connections)));
        let library = (door, Arc::new(Rules::of(self.settings.security, &self.files.trusted)));
        let refusals = updates.refusals().clone();
        let mut gate = pin!(gate::serve(listener, library, limiter, clients.clone(), refusals));
        let mut ticks = interval(self.settings.every);
        // Refused certificates fill the disk meanwhile, however seldom the nodes are updated.
        let mut looks = interval(LOOK_EVERY);
        for each in [&mut ticks, &mut looks] {
            each.set_missed_tick_behavior(MissedTickBehavior::Skip);
        }
        loop {
            tokio::select! {
                () = &mut gate => {}
                ended = &mut server => {
                    let why = ended.unwrap_or_else(|error| Err(error.to_string()));
                    return Err(format!("the server has ended: {}", why.err().unwrap_or_default()));
                }
                () = clients.first.notified() => updates.refresh_for_first(self.settings.every),
                _ = ticks.tick() => {
                    // Without a client, nobody sees the values.
                    if clients.count() > 0 {
                        updates.refresh();
                    }
                }
                _ = looks.tick() => updates.report(),
                () = ends(stopped) => break,
            }
        }
        handle.cancel();
        let _ = tokio::time::timeout(LAST, server).await;
        Ok(())
    }

    /// Makes the server object of the library, and the updater of its nodes.
    fn library(&self, address: SocketAddr) -> Result<(::opcua::server::Server, Updates), String> {
        let pki = Pki::make(&self.directory, &self.files).map_err(|error| {
            format!("{} cannot be written: {}", self.directory.display(), without_numbers(&error.to_string()))
        })?;
        let status = self.source.status();
        let tree = Arc::new(Tree::of(&status));
        let refusals = Arc::new(Refusals::default());
        let users = Arc::new(Users::new(&self.files.users, refusals.clone()));
        let measured = users.take_measured().then(|| Measured { source: self.source.clone() });
        let host = self.host(address);
        let setup = Setup {
            machine: &self.machine,
            files: &self.files,
            security: self.settings.security,
            anonymous: self.settings.anonymous,
            every: self.settings.every,
            shown: (host.as_str(), address.port()),
            connections: self.connections,
            directory: pki.directory().to_owned(),
            key: pki.key(),
        };
        let (server, handle) = setup.server(NodesBuilder { tree: tree.clone(), measured }, users)?;
        let manager = handle.node_managers().get_of_type::<Manager>();
        let manager = manager.ok_or("the OPC UA library does not return its nodes")?;
        let library = Library { manager, handle, pki, refusals };
        Ok((server, Updates::begin(self.source.clone(), (tree, status), library)))
    }

    /// Returns the host in the addresses that clients see. It is the host of `listen`, or the name of this computer
    /// if the server listens on every address.
    fn host(&self, address: SocketAddr) -> String {
        let host = host_and_port(&self.settings.listen).map_or("", |(host, _)| host);
        if address.ip().is_unspecified() { self.hostname.clone() } else { host.to_owned() }
    }
}

async fn ends(stopped: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone, which ends the server as well.
    let _ = stopped.wait_for(|stopped| *stopped).await;
}
