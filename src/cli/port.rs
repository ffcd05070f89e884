//! Port of the web page: it is opened when the gateway starts, or as soon as it is free.

use std::io::{Error, ErrorKind};
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::time::Duration;

use anyhow::Context;

use super::certificate::Certificate;
use crate::cli::print::say;
use crate::fieldbus::explain;
use crate::observe::events::{Event, PagePort};
use crate::observe::http::Admission;
use crate::observe::status::GatewayApi;
use isotherm_core::explained::{Cause, Explained};
use isotherm_profile::{PLAIN, Web, host_and_port};

/// Number of successive failed attempts with the same new cause, after which the gateway reports this cause.
const CHANGED_AFTER: u32 = 2;
/// Interval between attempts to open the port.
const AGAIN: Duration = Duration::from_secs(10);

/// Listening address of the web page, with its rules for clients and its certificate.
#[derive(Debug)]
pub(super) struct Port {
    listen: String,
    addresses: Vec<SocketAddr>,
    admission: Admission,
    certificate: Option<Certificate>,
    opened: Result<TcpListener, String>,
}

/// Error: a token of the web page cannot be used. It can be corrected while the gateway runs.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(super) struct BadToken(String);

/// Open web page: its listener, its rules for clients, and its certificate.
type Opened = (tokio::net::TcpListener, Admission, Option<Certificate>);

impl Port {
    /// Reads the certificate and the tokens of the web page. The port is not opened yet.
    ///
    /// # Errors
    /// The settings or the certificate are wrong. A wrong token is the error [`BadToken`].
    pub(super) fn new(web: &Web) -> anyhow::Result<Port> {
        let place = host_and_port(&web.listen);
        if let Some(help) = place.err().and_then(|why| why.help(8080, str::to_owned)) {
            anyhow::bail!("`{}` is not an address to listen on; {help}", web.listen);
        }
        let addresses: Vec<SocketAddr> = web
            .listen
            .to_socket_addrs()
            .with_context(|| {
                format!("`{}` is not an address to listen on; write 127.0.0.1:8080", web.listen)
            })?
            .collect();
        let is_local = addresses.iter().all(|address| address.ip().is_loopback());
        anyhow::ensure!(
            web.has_token() || is_local,
            "the web page may listen on {} only with web.token_file in the profile; without this key, only \
             on loopback",
            web.listen
        );
        anyhow::ensure!(
            web.tls.is_some() || web.plain || is_local,
            "the web page would listen on {} in plain text: {PLAIN}",
            web.listen
        );
        let certificate = web.tls.as_ref().map(Certificate::open).transpose()?;
        let admission = Admission::of(web).map_err(BadToken)?;
        let opened = Err("not opened yet".to_owned());
        Ok(Port { listen: web.listen.clone(), addresses, admission, certificate, opened })
    }

    /// Waits until the tokens and the certificate of the web page can be read. Returns the port, which is already open
    /// if that was possible.
    pub(super) async fn found(web: &Web, source: &dyn GatewayApi) -> Port {
        let mut reported = None;
        loop {
            let settings = web.clone();
            // A name server may not answer. Commands are answered meanwhile.
            let read = tokio::task::spawn_blocking(move || Port::new(&settings)).await;
            match read.map_err(anyhow::Error::from).flatten() {
                Ok(mut port) => {
                    if port.open().is_ok() {
                        port.announce(reported.map(|_| source));
                    }
                    return port;
                }
                Err(why) => {
                    let (listen, why) = (web.listen.clone(), format!("{why:#}"));
                    if Cause::is_news(&mut reported, why.clone(), CHANGED_AFTER) {
                        source.report(&Event::Page(PagePort::NotServed { listen, why }));
                    }
                }
            }
            tokio::time::sleep(AGAIN).await;
        }
    }

    /// Prints the address of the web page. If an earlier event reported that the web page is closed, `source` gets an
    /// event that it is open.
    fn announce(&self, source: Option<&dyn GatewayApi>) {
        // A closed stdout must not stop the machine.
        let _ = say!("page {}", self.url());
        if let Some(source) = source {
            source.report(&Event::Page(PagePort::Open { listen: self.listen.clone() }));
        }
    }

    pub(super) fn open(&mut self) -> std::io::Result<()> {
        let bound = TcpListener::bind(self.addresses.as_slice()).and_then(|listener| {
            listener.set_nonblocking(true)?;
            Ok(listener)
        });
        match bound {
            Ok(listener) => {
                self.opened = Ok(listener);
                Ok(())
            }
            Err(error) => {
                self.opened = Err(self.why(&error).to_string());
                Err(error)
            }
        }
    }

    /// Returns whether the port may open later after this error. The program that has the port may end, or the network
    /// of the address may come up.
    pub(super) fn may_open_later(error: &Error) -> bool {
        matches!(error.kind(), ErrorKind::AddrInUse | ErrorKind::AddrNotAvailable)
    }

    /// Returns the message about a port that cannot be opened.
    pub(super) fn closed(&self, error: &Error) -> String {
        let why = self.why(error);
        format!("the web page cannot listen on {} (another address: --listen): {why}", self.listen)
    }

    /// Returns cause and remedy of an error of the port.
    fn why(&self, error: &Error) -> Explained {
        let is_low = self.addresses.iter().any(|address| (1..1024).contains(&address.port()));
        match error.kind() {
            ErrorKind::PermissionDenied if is_low => Explained::new(
                "ports below 1024 need root",
                "choose another port, such as 8080, or put a proxy in front of the web page",
            ),
            _ => explain::explain_system(error),
        }
    }

    /// Returns the address of the web page for a browser.
    pub(super) fn url(&self) -> String {
        let scheme = if self.certificate.is_some() { "https" } else { "http" };
        let address = self.opened.as_ref().ok().and_then(|listener| listener.local_addr().ok());
        match address {
            Some(address) => format!("{scheme}://{}", to_open(address, &hostname())),
            None => format!("{scheme}://{}", self.listen),
        }
    }

    /// Waits until the port is open, and returns its listener.
    pub(super) async fn listen(mut self, source: &dyn GatewayApi) -> std::io::Result<Opened> {
        let mut reported = None;
        while let Err(why) = &self.opened {
            if Cause::is_news(&mut reported, why.clone(), CHANGED_AFTER) {
                let closed = PagePort::Closed { listen: self.listen.clone(), why: why.clone() };
                source.report(&Event::Page(closed));
            }
            tokio::time::sleep(AGAIN).await;
            if self.open().is_ok() {
                self.announce(Some(source));
            }
        }
        let listener = tokio::net::TcpListener::from_std(self.opened.map_err(Error::other)?)?;
        Ok((listener, self.admission, self.certificate))
    }
}

/// Returns the address for a browser. If the web page listens on every address, it has the name of this computer.
fn to_open(address: SocketAddr, hostname: &str) -> String {
    match address.ip().is_unspecified() {
        true => format!("{hostname}:{}", address.port()),
        false => address.to_string(),
    }
}

/// Returns the name of this computer.
pub(super) fn hostname() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim();
    if name.is_empty() { "localhost".to_owned() } else { name.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_low_port_says_that_it_needs_root_and_another_one_does_not() {
        let port = |listen: &str| Port {
            listen: listen.to_owned(),
            addresses: vec![listen.parse().unwrap()],
            admission: Admission::default(),
            certificate: None,
            opened: Err(String::new()),
        };
        for (listen, kind, says) in [
            ("127.0.0.1:80", ErrorKind::PermissionDenied, true),
            ("127.0.0.1:1023", ErrorKind::PermissionDenied, true),
            ("127.0.0.1:1024", ErrorKind::PermissionDenied, false),
            ("127.0.0.1:80", ErrorKind::AddrInUse, false),
        ] {
            let said = port(listen).closed(&Error::from(kind));
            assert_eq!(said.contains("ports below 1024 need root"), says, "{listen}: {said}");
        }
    }

    #[test]
    fn a_page_on_every_address_is_shown_with_the_name_of_the_computer() {
        for (address, shown) in [
            ("0.0.0.0:8080", "press-7:8080"),
            ("[::]:8080", "press-7:8080"),
            ("127.0.0.1:8080", "127.0.0.1:8080"),
            ("192.168.4.7:80", "192.168.4.7:80"),
        ] {
            assert_eq!(to_open(address.parse().unwrap(), "press-7"), shown);
        }
    }
}
