//! Services of the gateway on a separate thread and runtime: the web page and the command socket.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use tokio::sync::watch;

use super::certificate::Certificate;
use super::descriptors::Shares;
use super::port::{BadToken, Port};
use crate::gateway::{Successor, WireLog, control};
use crate::observe::http::{self, HttpListener, Limits};
use crate::observe::status::GatewayApi;
use isotherm_profile::Web;

/// Open sockets that are not served yet. They are opened before the gateway starts, so that an error is known
/// before the first device is polled.
#[derive(Default)]
pub(super) struct Sockets {
    page: Option<Page>,
    control: Option<(std::os::unix::net::UnixListener, PathBuf)>,
    /// Program that can replace this gateway; `None` if none can.
    pub(super) successor: Option<Successor>,
}

/// Web page that is to be served.
enum Page {
    /// Web page at this port, which is open or will be opened later.
    At(Box<Port>),
    /// Web page whose port is not created yet. The port is created as soon as the tokens and the certificate can be
    /// read.
    Later(Web),
}

/// Running services: web page and command socket. Dropping this value ends them.
pub(super) struct Services {
    stop: Option<watch::Sender<bool>>,
    thread: Option<JoinHandle<()>>,
    control: Option<PathBuf>,
}

impl Sockets {
    /// Opens the port of the web page, and returns the address of the page. If the web page listens on every address,
    /// the address has the name of this computer. Port 0 selects any free port.
    pub(super) fn open_page(&mut self, web: &Web) -> anyhow::Result<String> {
        let mut port = Port::new(web)?;
        port.open().map_err(|error| anyhow::anyhow!("{}", port.closed(&error)))?;
        let url = port.url();
        self.page = Some(Page::At(Box::new(port)));
        Ok(url)
    }

    /// Opens the port of the web page, and returns the address of the page. Returns `None` if another program has the
    /// port, this computer does not have the address yet, or a token cannot be used. Such an error must not stop the
    /// compensation: the gateway tries again while it runs.
    pub(super) fn open_page_now_or_later(&mut self, web: &Web) -> anyhow::Result<Option<String>> {
        let mut port = match Port::new(web) {
            Err(error) if error.is::<BadToken>() => {
                self.open_page_later(web.clone());
                return Ok(None);
            }
            port => port?,
        };
        let opened = port.open();
        if let Err(error) = &opened
            && !Port::may_open_later(error)
        {
            anyhow::bail!("{}", port.closed(error));
        }
        let url = opened.is_ok().then(|| port.url());
        self.page = Some(Page::At(Box::new(port)));
        Ok(url)
    }

    /// Lets the running services open the port of the web page later. Errors of the web page then do not stop the
    /// gateway.
    pub(super) fn open_page_later(&mut self, web: Web) {
        self.page = Some(Page::Later(web));
    }

    /// Opens the gateway's command socket in the state directory.
    pub(super) fn open_control(&mut self, directory: &Path, machine: &str) -> anyhow::Result<()> {
        let path = control::path(directory, machine);
        self.control = Some((control::open(&path)?, path));
        Ok(())
    }

    /// Starts to serve the open sockets. `lines` is the number of bus lines of the gateway, which need file descriptors
    /// too.
    pub(super) fn serve(
        self,
        source: &Arc<dyn GatewayApi>,
        wire_log: WireLog,
        lines: usize,
    ) -> anyhow::Result<Services> {
        let (stop, stopped) = watch::channel(false);
        let source = source.clone();
        let control = self.control.as_ref().map(|(_, path)| path.clone());
        let runtime = super::runtime::start()?;
        let shares = Shares::now(lines);
        let thread = std::thread::Builder::new().name("services".to_owned()).spawn(move || {
            runtime.block_on(self.all(source, wire_log, shares, stopped));
        })?;
        Ok(Services { stop: Some(stop), thread: Some(thread), control })
    }

    async fn all(
        self,
        source: Arc<dyn GatewayApi>,
        wire_log: WireLog,
        shares: Shares,
        stopped: watch::Receiver<bool>,
    ) {
        let control = async {
            let Some((listener, _)) = self.control else { return std::future::pending().await };
            let served =
                control::serve(listener, source.clone(), wire_log, self.successor, shares.commands).await;
            report("the command socket", served);
        };
        let page = async {
            let port = match self.page {
                None => return std::future::pending().await,
                Some(Page::At(port)) => *port,
                Some(Page::Later(web)) => Port::found(&web, source.as_ref()).await,
            };
            report("the page", serve_page(port, &source, shares.page, stopped.clone()).await);
        };
        // A service that fails has been logged. The gateway runs without it.
        let both = async { tokio::join!(control, page) };
        // The web page ends its open streams itself, and reports in them that the gateway stops. This time is for that.
        let end = async {
            until(stopped.clone()).await;
            tokio::time::sleep(std::time::Duration::from_millis(200)).await;
        };
        tokio::select! {
            _ = both => {}
            () = end => {}
        }
    }
}

/// Serves the web page as soon as its port is open.
async fn serve_page(
    port: Port,
    source: &Arc<dyn GatewayApi>,
    connections: usize,
    stopped: watch::Receiver<bool>,
) -> std::io::Result<()> {
    let (listener, admission, certificate) = port.listen(source.as_ref()).await?;
    let shown = certificate.as_ref().map(Certificate::shown);
    let renewing = async {
        match certificate {
            Some(certificate) => certificate.keep().await,
            None => std::future::pending().await,
        }
    };
    let door = HttpListener::from(listener).secured(shown).within(Limits::of(connections));
    tokio::select! {
        served = http::serve(door, source.clone(), admission, until(stopped)) => served,
        () = renewing => Ok(()),
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
            // The next gateway replaces a socket that could not be removed.
            let _ = std::fs::remove_file(path);
        }
    }
}
