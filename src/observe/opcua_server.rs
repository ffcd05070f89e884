//! OPC UA server of the gateway: axes, signals, outputs, alarms and events as nodes, read only.
//!
//! ```text
//! clients ─► gate (limits) ─► library (loopback) ─► nodes ◄─ updates ◄─ status of the gateway
//! ```
//!
//! A separate thread serves the clients. It reads the status that the web page shows. Neither a bus line nor
//! a web page waits for this thread. While no client is connected, the thread does not read the status. The
//! thread has the normal priority. A thread with a lower priority could be interrupted for a long time while
//! it holds the lock of the status.
//!
//! # Layout
//! - `catalogue`, `tree`: the fields of the status, and the nodes made of them.
//! - `sampler`, `convert`, `units`: values, qualities, times and units of the nodes.
//! - `nodes`, `measured`: the address space of the library, and the only method.
//! - `users`, `pki`, `files`: who may log in. `refusals`, `reports`: reports about refused clients and logins.
//! - `gate`, `screen`, `door`: limits on connections and on messages, which no client can bypass.
//! - `setup`, `updates`, `event_feed`, `run`: start of the library, and its updates.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::sync::{oneshot, watch};

use super::status::GatewayApi;
use isotherm_profile::OpcUaServer;
use run::Runner;

mod catalogue;
mod convert;
mod door;
mod event_feed;
#[cfg(test)]
mod example;
mod files;
mod gate;
mod measured;
mod nodes;
mod pki;
mod refusals;
mod reports;
mod run;
mod sampler;
mod screen;
mod setup;
mod tree;
mod units;
mod updates;
mod users;

pub use files::{Login, OwnCertificate, Secret, ServerFiles};

/// Maximum number of threads of this server that resolve host names.
const LOOKUPS: usize = 1;
/// Maximum time for which the end of the gateway waits for the server.
const LAST: Duration = Duration::from_secs(1);

/// Running thread that serves OPC UA clients.
#[derive(Debug)]
pub struct Serving {
    stop: watch::Sender<bool>,
    ended: oneshot::Receiver<()>,
    /// Handle of the thread. Nothing joins the thread, because [`Serving::finish`] limits the wait for it.
    _thread: JoinHandle<()>,
}

/// Environment of the server: state directory, name of the computer, and limit on connections.
#[derive(Clone, Debug)]
pub struct ServerPlace {
    /// State directory of the gateway.
    pub state: PathBuf,
    /// Name of this computer.
    pub hostname: String,
    /// Maximum number of simultaneous connections.
    pub connections: usize,
}

impl Serving {
    /// Starts the thread that serves the clients of a machine.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(
        (machine, settings): (&str, &OpcUaServer),
        files: ServerFiles,
        source: &Arc<dyn GatewayApi>,
        place: ServerPlace,
    ) -> std::io::Result<Serving> {
        let ServerPlace { state, hostname, connections } = place;
        let runner = Runner {
            machine: machine.to_owned(),
            settings: settings.clone(),
            files,
            source: source.clone(),
            directory: kept_in(&state, machine),
            hostname,
            connections,
        };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(LOOKUPS)
            .build()?;
        let (stop, stopped) = watch::channel(false);
        let (over, ended) = oneshot::channel();
        let thread = std::thread::Builder::new().name("opcua".to_owned()).spawn(move || {
            runtime.block_on(runner.run(stopped));
            // A name lookup that has not ended must not delay the end.
            runtime.shutdown_background();
            // The receiver may be gone already.
            let _ = over.send(());
        })?;
        Ok(Serving { stop, ended, _thread: thread })
    }

    /// Closes the connections of all clients. Returns after a second at the latest.
    pub async fn finish(self) {
        self.stop.send_replace(true);
        // The thread has ended, or takes too long.
        let _ = tokio::time::timeout(LAST, self.ended).await;
    }
}

/// Returns the directory of the certificates of a machine's server.
pub fn kept_in(state: &Path, machine: &str) -> PathBuf {
    state.join(format!("{machine}-opcua"))
}
