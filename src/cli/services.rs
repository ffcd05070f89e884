//! What runs beside the loop, on a thread and a runtime of its own: the page and the command socket.

use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use anyhow::Context;
use tokio::sync::watch;

use crate::fieldbus::explain;
use crate::gateway::{WireLog, control};
use crate::observe::http;
use crate::observe::status::Source;
use isotherm_profile::{Web, regular};

/// Sockets that are open and not yet served: whatever is wrong with them is known before the loop starts.
#[derive(Debug, Default)]
pub(super) struct Sockets {
    page: Option<(TcpListener, Option<String>)>,
    control: Option<(std::os::unix::net::UnixListener, PathBuf)>,
}

/// The running services; dropping them ends them.
pub(super) struct Services {
    stop: Option<watch::Sender<bool>>,
    thread: Option<JoinHandle<()>>,
    control: Option<PathBuf>,
}

impl Sockets {
    /// Opens the page's port. Port 0 takes any free one.
    pub(super) fn open_page(&mut self, web: &Web) -> anyhow::Result<SocketAddr> {
        let token = match &web.token_file {
            Some(path) => {
                let token = regular::read_text(path)
                    .with_context(|| format!("the token file {} cannot be read", path.display()))?;
                let token = token.trim().to_owned();
                anyhow::ensure!(!token.is_empty(), "the token file {} is empty", path.display());
                Some(token)
            }
            None => None,
        };
        let addresses: Vec<SocketAddr> = web
            .listen
            .to_socket_addrs()
            .with_context(|| format!("`{}` is no address to listen on; write 127.0.0.1:8080", web.listen))?
            .collect();
        anyhow::ensure!(
            token.is_some() || addresses.iter().all(|address| address.ip().is_loopback()),
            "the page may listen on {} only with web.token_file in the profile; without one, on loopback",
            web.listen
        );
        let listener = TcpListener::bind(addresses.as_slice()).map_err(|error| {
            let why = explain::system(&error);
            anyhow::anyhow!("the page cannot listen on {} (another address: --listen): {why}", web.listen)
        })?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        self.page = Some((listener, token));
        Ok(address)
    }

    /// Opens the command socket.
    pub(super) fn open_control(&mut self, directory: &Path, machine: &str) -> anyhow::Result<()> {
        let path = control::path(directory, machine);
        self.control = Some((control::open(&path)?, path));
        Ok(())
    }

    /// Serves what has been opened.
    pub(super) fn serve(self, source: &Arc<dyn Source>, wire_log: WireLog) -> anyhow::Result<Services> {
        let (stop, stopped) = watch::channel(false);
        let source = source.clone();
        let control = self.control.as_ref().map(|(_, path)| path.clone());
        let runtime = super::runtime()?;
        let thread = std::thread::Builder::new().name("services".to_owned()).spawn(move || {
            runtime.block_on(self.all(source, wire_log, stopped));
        })?;
        Ok(Services { stop: Some(stop), thread: Some(thread), control })
    }

    async fn all(self, source: Arc<dyn Source>, wire_log: WireLog, stopped: watch::Receiver<bool>) {
        let control = async {
            match self.control {
                Some((listener, _)) => {
                    report("the command socket", control::serve(listener, source.clone(), wire_log).await)
                }
                None => std::future::pending().await,
            }
        };
        let page = async {
            let Some((listener, token)) = self.page else { return std::future::pending().await };
            let served = match tokio::net::TcpListener::from_std(listener) {
                Ok(listener) => http::serve(listener, source.clone(), token, until(stopped.clone())).await,
                Err(error) => Err(error),
            };
            report("the page", served);
        };
        // A service that fails has said so; the loop goes on without it.
        let both = async { tokio::join!(control, page) };
        tokio::select! {
            _ = both => {}
            () = until(stopped.clone()) => {
                // The page ends its open streams by itself; this is how long it may take.
                tokio::time::sleep(std::time::Duration::from_millis(200)).await;
            }
        }
    }
}

async fn until(mut stopped: watch::Receiver<bool>) {
    // An error means that the sender is gone, which ends the services as well.
    let _ = stopped.wait_for(|stopped| *stopped).await;
}

fn report(what: &str, ended: std::io::Result<()>) {
    if let Err(error) = ended {
        tracing::error!("{what} ended: {error}");
    }
}

impl Drop for Services {
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            let _ = stop.send(true);
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        if let Some(path) = self.control.take() {
            // One that is left behind is replaced by the next gateway.
            let _ = std::fs::remove_file(path);
        }
    }
}
