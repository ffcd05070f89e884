//! Listener of the web page, which limits the number of connections and their idle time.
//!
//! The web page may use only a part of the program's file descriptors. The listener counts each connection before
//! reading from it, and closes connections above the limit at once. The other descriptors are reserved for bus lines,
//! command socket and files.

use std::io::{self, ErrorKind, Write};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio_rustls::rustls::ServerConfig;

use super::connection::{self, Line, ended};
use super::connection_limiter::{ConnectionLimiter, Limits};
use super::forwarded::Scheme;
use crate::clock::BootClock;
use isotherm_profile::{IpNetwork, counted};

/// Receiver of the present TLS configuration. The certificate may be renewed while the page is served.
pub type TlsReceiver = watch::Receiver<Arc<ServerConfig>>;

/// Listener of the web page, with its TLS configuration and limits.
#[derive(Debug)]
pub struct HttpListener {
    listener: TcpListener,
    shown: Option<TlsReceiver>,
    limits: Limits,
    /// Trusted proxies, which may have more connections than a client.
    proxies: Arc<[IpNetwork]>,
}

impl From<TcpListener> for HttpListener {
    fn from(listener: TcpListener) -> HttpListener {
        HttpListener { listener, shown: None, limits: Limits::default(), proxies: Arc::from([]) }
    }
}

impl HttpListener {
    /// Sets the limits on connections and their timeouts.
    #[must_use]
    pub fn within(self, limits: Limits) -> HttpListener {
        HttpListener { limits, ..self }
    }

    /// Sets the TLS configuration. With `Some`, the listener accepts only TLS; with `None`, only plain text.
    #[must_use]
    pub fn secured(self, shown: Option<TlsReceiver>) -> HttpListener {
        HttpListener { shown, ..self }
    }

    /// Sets the trusted proxies, which may have more connections than a client.
    pub(super) fn behind(self, proxies: Arc<[IpNetwork]>) -> HttpListener {
        HttpListener { proxies, ..self }
    }

    pub(super) fn limits(&self) -> Limits {
        self.limits
    }

    /// Returns the scheme of this server: HTTPS with TLS, otherwise HTTP.
    pub(super) fn scheme(&self) -> Scheme {
        if self.shown.is_some() { Scheme::Https } else { Scheme::Http }
    }

    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts connections until the sender of `stopped` is dropped. Open connections are served to their end.
    pub(super) async fn serve(self, router: Router, stopped: watch::Receiver<()>) {
        let limiter = Arc::new(ConnectionLimiter::new(self.limits));
        let mut inside = JoinSet::new();
        let mut turned_away = RejectedCount::default();
        let mut closing = std::pin::pin!(ended(stopped.clone()));
        loop {
            let accepted = tokio::select! {
                accepted = self.listener.accept() => accepted,
                Some(_) = inside.join_next() => continue,
                () = &mut closing => break,
            };
            let (stream, address) = match accepted {
                Ok(accepted) => accepted,
                Err(error) => {
                    after(&error).await;
                    continue;
                }
            };
            let is_proxy = self.proxies.iter().any(|network| network.contains(address.ip()));
            let place = match is_proxy {
                true => limiter.admit_proxy(address.ip()),
                false => limiter.admit(address.ip()),
            };
            let Some(place) = place else {
                turned_away.one(self.limits.connections);
                refuse(stream, self.shown.is_none());
                // Other tasks run on this thread as well.
                tokio::task::yield_now().await;
                continue;
            };
            let line = Arc::new(Line::new(stream, place));
            let shown = self.shown.as_ref().map(|shown| shown.borrow().clone());
            let service = (router.clone(), shown);
            inside.spawn(connection::serve(line, address, service, self.limits, stopped.clone()));
        }
        drop(self.listener);
        while inside.join_next().await.is_some() {}
    }
}

/// Waits after a failed attempt to accept a connection. After an error of the client, no wait is needed. If no file
/// descriptor is free, an immediate new attempt would only use processor time.
async fn after(error: &io::Error) {
    /// Wait before a new attempt, in which other connections may end and release file descriptors.
    const AGAIN: Duration = Duration::from_millis(200);
    let is_of_the_peer = matches!(
        error.kind(),
        ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::Interrupted
    );
    if !is_of_the_peer {
        tracing::debug!("the web page cannot accept a connection: {error}");
        tokio::time::sleep(AGAIN).await;
    }
}

const FULL: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 10\r\nConnection: close\r\n\
    Content-Type: text/plain; charset=utf-8\r\nContent-Length: 65\r\n\r\n\
    The page has too many connections. Close some, or wait a little.\n";

/// Closes a connection above the limit. If the connection has no TLS, the client receives the reason, unless sending
/// would have to wait.
fn refuse(stream: TcpStream, is_plain: bool) {
    if is_plain && let Ok(mut stream) = stream.into_std() {
        // The socket is non-blocking. If it accepts nothing, the reason is not sent.
        let _ = stream.write(FULL);
    }
}

/// Number of connections that were closed because of a limit. The number is logged once a minute.
#[derive(Default)]
struct RejectedCount {
    count: u64,
    said: Option<Duration>,
}

impl RejectedCount {
    fn one(&mut self, connections: usize) {
        const EVERY: Duration = Duration::from_secs(60);
        self.count += 1;
        let now = BootClock::default().passed();
        if self.said.is_none_or(|said| now >= said + EVERY) {
            let count = counted(self.count, "connection");
            tracing::warn!(
                "the web page closed {count} at once: the limit of {connections} connections, or the limit \
                 for one address, is reached"
            );
            (self.count, self.said) = (0, Some(now));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_to_who_comes_too_late_is_as_long_as_it_says() {
        let text = String::from_utf8(FULL.to_vec()).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        assert!(head.ends_with(&format!("Content-Length: {}", body.len())), "{}", body.len());
    }
}
