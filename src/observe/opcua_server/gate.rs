//! Gate in front of the OPC UA library. The gate accepts the connections of clients, limits them, and forwards their
//! bytes to the library over a loopback connection.
//!
//! The library accepts any number of connections, and stores any number of answers for a client that does not read. The
//! gate therefore limits:
//!
//! - the number of connections, in total and for each client address, so that enough file descriptors remain for bus
//!   lines and files;
//! - the bytes that a client may send in a second, which also limits the processor time that the client can use;
//! - the time for which a client may read nothing. During this time, no bytes of the client are forwarded;
//! - the kinds of messages, to those that an endpoint offers ([`Screen`]);
//! - the number of secure channels that are opened in a second, because the library must decrypt and sign for each
//!   channel.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Mutex, Notify};
use tokio::task::JoinSet;

use super::door::Door;
use super::refusals::Refusals;
use super::screen::{Refusal, Rules, Screen, Then};
use crate::clock::Silence;
use crate::observe::http::connection_limiter::ConnectionLimiter;

/// Maximum time for which a client may read nothing before its connection is closed.
const STALL: Duration = Duration::from_secs(10);
/// Maximum number of bytes that a client may send in a second.
const RATE: f64 = 256.0 * 1024.0;
/// Maximum number of bytes that are forwarded in one step.
const PIECE: usize = 16 * 1024;
/// Size of the send buffer of a client's connection in the kernel, in bytes. A client may leave this many bytes unread.
const UNREAD: usize = 256 * 1024;
/// Minimum time between the openings of two secure channels. Sixteen clients that connect at the same time can be
/// served before the library's timeout.
const OPENING: Duration = Duration::from_millis(200);
/// Wait after a connection could not be accepted. During this wait, other connections may end and release file
/// descriptors.
const AGAIN: Duration = Duration::from_millis(200);

/// Count of the open connections of clients.
#[derive(Debug, Default)]
pub(super) struct Clients {
    count: AtomicUsize,
    /// Notification for the updates of the values when the first client connects.
    pub(super) first: Notify,
}

impl Clients {
    /// Returns the number of open connections.
    pub(super) fn count(&self) -> usize {
        self.count.load(Ordering::Relaxed)
    }

    fn enter(self: &Arc<Clients>) -> Client {
        if self.count.fetch_add(1, Ordering::Relaxed) == 0 {
            self.first.notify_one();
        }
        Client(self.clone())
    }
}

/// One open connection. When the value is dropped, the connection is no longer counted.
struct Client(Arc<Clients>);

impl Drop for Client {
    fn drop(&mut self) {
        self.0.count.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Accepts connections in an endless loop, and forwards their bytes through the protected port of the library.
pub(super) async fn serve(
    listener: TcpListener,
    (door, rules): (Arc<Door>, Arc<Rules>),
    limiter: Arc<ConnectionLimiter>,
    clients: Arc<Clients>,
    refusals: Arc<Refusals>,
) {
    let (mut open, pace) = (JoinSet::new(), Arc::new(Pace::default()));
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            Some(_) = open.join_next() => continue,
        };
        let (stream, address) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::debug!("the OPC UA server cannot accept a connection: {error}");
                tokio::time::sleep(AGAIN).await;
                continue;
            }
        };
        // A connection above the limit is closed at once.
        let Some(permit) = limiter.admit(address.ip()) else { continue };
        let client = clients.enter();
        let (door, pace, screen) = (door.clone(), pace.clone(), Screen::new(rules.clone()));
        let refusals = refusals.clone();
        open.spawn(async move {
            let _held = (permit, client);
            if let Some(Refusal::Untrusted(certificate)) = pass_on(stream, &door, (screen, &pace)).await {
                refusals.client(certificate);
            }
        });
    }
}

/// Forwards the bytes of one client until either end closes the connection, or until the client stops
/// reading. Returns the reason if the client was refused; `None` otherwise.
async fn pass_on(client: TcpStream, door: &Door, limits: (Screen, &Pace)) -> Option<Refusal> {
    let server = door.connect().await.ok()?;
    // Both directions consist of small messages that are answered at once.
    let _ = (client.set_nodelay(true), server.set_nodelay(true));
    let _ = SockRef::from(&client).set_send_buffer_size(UNREAD);
    let (from_client, to_client) = client.into_split();
    let (from_server, to_server) = server.into_split();
    relay((from_client, to_client), (from_server, to_server), limits).await
}

/// Pace at which secure channels are opened, for all connections together.
#[derive(Default)]
struct Pace {
    /// Time since the last secure channel was opened; `None` before the first secure channel.
    last: Mutex<Option<Silence>>,
}

impl Pace {
    /// Waits until the time [`OPENING`] has passed since the last secure channel was opened.
    async fn turn(&self) {
        let mut last = self.last.lock().await;
        if let Some(last) = *last {
            tokio::time::sleep(last.left_of(OPENING)).await;
        }
        *last = Some(Silence::begin());
    }
}

/// State that the two directions of a connection share.
#[derive(Default)]
struct Shared {
    /// Lock that is held while an answer waits for the client.
    writing: Mutex<()>,
    /// Notification that the library has sent an answer.
    answered: Notify,
}

async fn relay(
    (from_client, mut to_client): (impl AsyncRead + Unpin, impl AsyncWrite + Unpin),
    (from_server, to_server): (impl AsyncRead + Unpin, impl AsyncWrite + Unpin),
    limits: (Screen, &Pace),
) -> Option<Refusal> {
    let shared = Shared::default();
    let refusal = tokio::select! {
        refusal = requests(from_client, to_server, &shared, limits) => refusal,
        () = answers(from_server, &mut to_client, &shared) => None,
    };
    if let Some(refusal) = &refusal {
        // The client may be gone already.
        let _ = tokio::time::timeout(STALL, to_client.write_all(&refusal.message())).await;
    }
    refusal
}

/// Forwards requests, at most [`RATE`] bytes a second, and none while an answer waits for the client. Returns the
/// reason if a message is refused, and `None` if either end has closed the connection.
async fn requests(
    mut from: impl AsyncRead + Unpin,
    mut to: impl AsyncWrite + Unpin,
    Shared { writing, answered }: &Shared,
    (mut screen, pace): (Screen, &Pace),
) -> Option<Refusal> {
    let (mut piece, mut passed) = (vec![0; PIECE], Vec::new());
    loop {
        let Ok(length @ 1..) = from.read(&mut piece).await else { return None };
        let mut rest = &piece[..length];
        while !rest.is_empty() {
            drop(writing.lock().await);
            passed.clear();
            let (used, then) = match screen.pass(rest, &mut passed) {
                Ok(found) => found,
                Err(refusal) => return Some(refusal),
            };
            rest = &rest[used..];
            if then == Then::Open {
                pace.turn().await;
            }
            to.write_all(&passed).await.ok()?;
            if then != Then::GoOn {
                answered.notified().await;
            }
        }
        let bytes = u32::try_from(length).map_or(RATE, f64::from);
        tokio::time::sleep(Duration::from_secs_f64(bytes / RATE)).await;
    }
}

/// Forwards answers until the client accepts no byte for [`STALL`].
async fn answers(
    mut from: impl AsyncRead + Unpin,
    mut to: impl AsyncWrite + Unpin,
    Shared { writing, answered }: &Shared,
) {
    let mut piece = vec![0; PIECE];
    loop {
        let Ok(length @ 1..) = from.read(&mut piece).await else { return };
        answered.notify_one();
        let _writing = writing.lock().await;
        let mut rest = &piece[..length];
        while !rest.is_empty() {
            match tokio::time::timeout(STALL, to.write(rest)).await {
                Ok(Ok(written @ 1..)) => rest = &rest[written..],
                _ => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::screen::tests::message;
    use super::*;
    use isotherm_profile::Security;
    use tokio::io::{DuplexStream, duplex};
    use tokio::time::timeout;

    /// Starts a relay to a server without security. Returns the client's end and the server's end of it.
    fn between(buffer: usize) -> (DuplexStream, DuplexStream) {
        let (client, outer) = duplex(buffer);
        let (server, inner) = duplex(buffer);
        let (outer, inner) = (tokio::io::split(outer), tokio::io::split(inner));
        tokio::spawn(async move {
            let screen = Screen::new(Arc::new(Rules::of(Security::None, &[])));
            relay(outer, inner, (screen, &Pace::default())).await;
        });
        (client, server)
    }

    async fn received(from: &mut DuplexStream, length: usize) -> Vec<u8> {
        let mut bytes = vec![0; length];
        from.read_exact(&mut bytes).await.unwrap();
        bytes
    }

    #[tokio::test(start_paused = true)]
    async fn bytes_arrive_unchanged_in_both_directions_and_an_end_ends_both() {
        let (mut client, mut server) = between(4096);
        let hello = message("HELF", b"how are you");
        client.write_all(&hello).await.unwrap();
        assert_eq!(received(&mut server, hello.len()).await, hello);
        server.write_all(b"there").await.unwrap();
        assert_eq!(received(&mut client, 5).await, b"there");
        drop(server);
        assert_eq!(client.read(&mut [0; 5]).await.unwrap(), 0);
    }

    #[tokio::test(start_paused = true)]
    async fn what_follows_a_hello_waits_for_the_answer_to_it() {
        let (mut client, mut server) = between(4096);
        let (hello, close) = (message("HELF", b"how are you"), message("CLOF", b"bye"));
        client.write_all(&[hello.clone(), close.clone()].concat()).await.unwrap();
        assert_eq!(received(&mut server, hello.len()).await, hello);
        assert!(timeout(STALL, server.read(&mut [0; 1])).await.is_err(), "it waits for the answer");
        server.write_all(b"well").await.unwrap();
        assert_eq!(received(&mut server, close.len()).await, close);
    }

    #[tokio::test(start_paused = true)]
    async fn who_sends_no_message_of_opc_ua_gets_the_reason_and_the_server_nothing() {
        let (mut client, mut server) = between(4096);
        client.write_all(b"GET / HTTP/1.1\r\n\r\n").await.unwrap();
        let mut answer = Vec::new();
        client.read_to_end(&mut answer).await.unwrap();
        assert_eq!(answer, Refusal::NoMessage.message());
        assert_eq!(server.read(&mut [0; 1]).await.unwrap(), 0);
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_that_reads_nothing_is_not_served_any_longer_and_closed_in_the_end() {
        let (mut client, mut server) = between(1024);
        let flood = async { while server.write_all(&[7; 512]).await.is_ok() {} };
        assert!(timeout(STALL / 2, flood).await.is_err(), "it waits for the client");
        client.write_all(&message("CLOF", b"more")).await.unwrap();
        let mut four = [0; 4];
        assert!(timeout(STALL / 4, server.read_exact(&mut four)).await.is_err(), "no request is passed on");
        let flood = async { while server.write_all(&[7; 512]).await.is_ok() {} };
        assert!(timeout(STALL * 2, flood).await.is_ok(), "the connection is closed");
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_sends_no_more_than_its_rate() {
        let (mut client, mut server) = between(PIECE);
        let long = message("CLOF", &vec![1; PIECE]).repeat(8);
        let mut all = vec![0; long.len()];
        tokio::spawn(async move {
            let _ = client.write_all(&long).await;
            tokio::time::sleep(Duration::from_secs(60)).await;
        });
        let least = Duration::from_secs_f64(6.0 * 16.0 * 1024.0 / RATE);
        assert!(timeout(least, server.read_exact(&mut all)).await.is_err());
    }

    #[tokio::test(start_paused = true)]
    async fn channels_are_opened_one_after_the_other_however_many_clients_connect() {
        let (pace, begin) = (Pace::default(), Silence::begin());
        tokio::join!(pace.turn(), pace.turn(), pace.turn());
        assert!(begin.left_of(OPENING * 2).is_zero() && !begin.left_of(OPENING * 3).is_zero());
        tokio::time::sleep(OPENING * 2).await;
        let begin = Silence::begin();
        pace.turn().await;
        assert!(!begin.left_of(OPENING / 2).is_zero());
    }

    #[test]
    fn the_first_client_wakes_the_updates_and_each_is_counted() {
        let clients = Arc::new(Clients::default());
        let (one, two) = (clients.enter(), clients.enter());
        assert_eq!(clients.count(), 2);
        drop((one, two));
        assert_eq!(clients.count(), 0);
    }
}
