//! The page's door: who comes in, how many at once, and for how long one may do nothing.
//!
//! What the page takes of the program is a share, however many knock: its connections are counted before anything is read,
//! and one beyond the share is closed at once. What is left of the file descriptors belongs to lines, command socket and
//! files.

use std::io::{self, ErrorKind, Write};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio_rustls::rustls::ServerConfig;

use super::connection::{self, Line};
use super::crowd::{Crowd, Limits};
use super::ended;
use crate::clock::Passing;
use isotherm_profile::counted;

/// What TLS shows now: its certificate may be renewed while the page is served.
pub type Shown = watch::Receiver<Arc<ServerConfig>>;

/// A listener, and what holds for who comes there.
#[derive(Debug)]
pub struct Door {
    listener: TcpListener,
    shown: Option<Shown>,
    limits: Limits,
}

impl From<TcpListener> for Door {
    fn from(listener: TcpListener) -> Door {
        Door { listener, shown: None, limits: Limits::default() }
    }
}

impl Door {
    /// Within these limits.
    #[must_use]
    pub fn within(self, limits: Limits) -> Door {
        Door { limits, ..self }
    }

    /// Takes TLS alone, where something is shown by it.
    #[must_use]
    pub fn secured(self, shown: Option<Shown>) -> Door {
        Door { shown, ..self }
    }

    pub(super) fn limits(&self) -> Limits {
        self.limits
    }

    /// `http` or `https`.
    pub(super) fn scheme(&self) -> &'static str {
        if self.shown.is_some() { "https" } else { "http" }
    }

    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Serves whoever comes until the sender of `stopped` is gone, and those who are there to their end.
    pub(super) async fn serve(self, router: Router, stopped: watch::Receiver<()>) {
        let crowd = Arc::new(Crowd::new(self.limits));
        let mut inside = JoinSet::new();
        let mut turned_away = TurnedAway::default();
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
            let Some(place) = crowd.admit(address.ip()) else {
                turned_away.one(self.limits.connections);
                refuse(stream, self.shown.is_none());
                // The loop is not the only one on this thread.
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

/// An end of the peer's is no trouble of ours. Where there is no descriptor left, looking again at once would only burn time.
async fn after(error: &io::Error) {
    /// Until others may have let go of something.
    const AGAIN: Duration = Duration::from_millis(200);
    let is_of_the_peer = matches!(
        error.kind(),
        ErrorKind::ConnectionAborted | ErrorKind::ConnectionReset | ErrorKind::Interrupted
    );
    if !is_of_the_peer {
        tracing::debug!("the page cannot take a connection: {error}");
        tokio::time::sleep(AGAIN).await;
    }
}

const FULL: &[u8] = b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 10\r\nConnection: close\r\n\
    Content-Type: text/plain; charset=utf-8\r\nContent-Length: 74\r\n\r\n\
    The page has as many connections as it may. Close some, or wait a little.\n";

/// Closes it. Whoever takes plain text and can be told without waiting is told why.
fn refuse(stream: TcpStream, is_plain: bool) {
    if is_plain && let Ok(mut stream) = stream.into_std() {
        // It does not block; what cannot be said is not said.
        let _ = stream.write(FULL);
    }
}

/// Those whom the page had no room for: one line a minute, however many.
#[derive(Default)]
struct TurnedAway {
    count: u64,
    said: Option<Duration>,
}

impl TurnedAway {
    fn one(&mut self, connections: usize) {
        const EVERY: Duration = Duration::from_secs(60);
        self.count += 1;
        let now = Passing::default().passed();
        if self.said.is_none_or(|said| now >= said + EVERY) {
            let count = counted(self.count, "connection");
            tracing::warn!(
                "the page closed {count} at once: it has {connections}, and so many of one address, and no more"
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
