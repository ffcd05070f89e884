//! One message on its way: a connection of its own, HTTP/1.1, over TCP or inside TLS.

use std::future::Future;
use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::Mutex;
use tokio::task::JoinHandle;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::ClientConfig;
use tokio_rustls::rustls::pki_types::ServerName;

use super::{Trust, answer, token};
use crate::tls::TlsFault;
use isotherm_profile::{Notify, Url};

/// Of several addresses of a name each has this long, but the last: it has what is left.
const EACH: Duration = Duration::from_secs(3);

/// Who takes messages.
pub trait Post {
    /// Takes one, or does not.
    fn post(&self, body: &str) -> impl Future<Output = Result<(), Failure>> + Send;
}

/// Why a message has not arrived, or may not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// There is no token to be sent along.
    #[error("{0}")]
    Token(String),
    /// Nobody knows the name.
    #[error(
        "this computer does not know the name of its host (`getent hosts NAME` asks as the gateway does)"
    )]
    Unresolved,
    /// Nobody listens there.
    #[error("nobody listens there: is the port in `url` right, does the server run?")]
    Refused,
    /// There is no way to it.
    #[error("it cannot be reached: {0}")]
    Unreachable(String),
    /// No secured connection came about.
    #[error("{0}")]
    Tls(String),
    /// It closed the connection before it had answered.
    #[error("it closed the connection before it had answered")]
    Closed,
    /// It says nothing, or too slowly.
    #[error("no answer within {} s", .0.as_secs_f64())]
    Silent(Duration),
    /// It says something that is no answer.
    #[error("whoever answers there does not speak HTTP/1.1, or is spoken to in plain text and wants https")]
    NoHttp,
    /// It says that it is elsewhere.
    #[error("it answered {0}: it is elsewhere{at}; nobody is followed there: write that address into `url`", at = place(.1.as_deref()))]
    Elsewhere(u16, Option<String>),
    /// It has not taken it, and perhaps says how long to wait.
    #[error("it answered {0}{means}", means = meaning(*.0))]
    Answered(u16, Option<Duration>),
}

fn place(location: Option<&str>) -> String {
    location.map_or(String::new(), |location| format!(" ({location})"))
}

fn meaning(code: u16) -> &'static str {
    match code {
        401 | 403 => ": is the token in `token_file` right?",
        404 | 410 => ": is the path in `url` right?",
        405 => ": it takes no POST there",
        408 | 425 | 429 => ": it has too much to do",
        400..500 => ": it does not take such a message",
        502..505 => ": whatever is behind it does not answer",
        500..600 => ": it has failed inside",
        _ => ", which means nothing here",
    }
}

impl Failure {
    /// The server will never take this message: it is not tried again.
    pub(super) fn is_final(&self) -> bool {
        // What a person mends at the server or in a token, or what passes, is tried again.
        matches!(self, Failure::Answered(code @ 400..500, _)
            if ![401, 403, 404, 407, 408, 409, 421, 423, 425, 429].contains(code))
    }

    /// Nobody has said anything: to ask again takes as long again.
    pub(super) fn is_silence(&self) -> bool {
        matches!(self, Failure::Silent(_))
    }

    /// How long the server wants to be left alone.
    pub(super) fn pause(&self) -> Option<Duration> {
        if let Failure::Answered(_, pause) = self { *pause } else { None }
    }

    /// A connection that broke.
    pub(super) fn broken(error: &io::Error) -> Failure {
        match error.kind() {
            // A server that speaks TLS 1.3 judges only after the handshake.
            _ if TlsFault::of(error).is_some() => secured(error),
            ErrorKind::ConnectionReset | ErrorKind::BrokenPipe | ErrorKind::UnexpectedEof => Failure::Closed,
            _ => Failure::Unreachable(error.to_string()),
        }
    }

    fn dialled(error: &io::Error) -> Failure {
        match error.kind() {
            ErrorKind::ConnectionRefused => Failure::Refused,
            _ => Failure::Unreachable(error.to_string()),
        }
    }
}

/// What TLS says of the other end.
fn secured(error: &io::Error) -> Failure {
    tracing::debug!(%error, "no TLS connection");
    let fault = TlsFault::in_handshake(error);
    fault.map_or(Failure::Unreachable(error.to_string()), |fault| Failure::Tls(fault.advised(remedy(fault))))
}

/// What to do about it.
fn remedy(fault: TlsFault) -> Option<&'static str> {
    Some(match fault {
        TlsFault::OtherName => "write that into `url`, or name the certificate itself with `ca`",
        TlsFault::UnknownAuthority => "name who has with `ca`",
        TlsFault::BadCertificate => "one that it has signed itself is trusted by naming it with `ca`",
        TlsFault::OursMissing => {
            "messages are posted without one; have it know them by a token (`token_file`)"
        }
        TlsFault::NoTls => "is it http?",
        TlsFault::Silent => "does it speak TLS?",
        _ => return None,
    })
}

/// A server of the profile.
pub struct Server {
    url: Url,
    token_file: Option<PathBuf>,
    trust: Option<Trust>,
    /// A question for its name that has not been answered yet: there is never more than one, however often that hangs.
    lookup: Mutex<Option<JoinHandle<io::Result<Vec<SocketAddr>>>>>,
}

impl Server {
    /// The one of this table; `trust` is asked for https alone.
    pub fn of(notify: &Notify, trust: Trust) -> Server {
        let (url, token_file) = (notify.url.clone(), notify.token_file.clone());
        let trust = url.tls.then_some(trust);
        Server { url, token_file, trust, lookup: Mutex::default() }
    }

    /// Connects, as far as to the end of a TLS handshake, and sends nothing.
    ///
    /// # Errors
    /// What is in the way.
    pub async fn reached(&self, within: Duration) -> Result<(), Failure> {
        let reached = async {
            let stream = self.connected().await?;
            self.secured(stream).await.map(drop)
        };
        tokio::time::timeout(within, reached).await.unwrap_or(Err(Failure::Silent(within)))
    }

    async fn connected(&self) -> Result<TcpStream, Failure> {
        let found = self.addresses().await?;
        let (last, others) = found.split_last().ok_or(Failure::Unresolved)?;
        for address in others {
            if let Ok(Ok(stream)) = tokio::time::timeout(EACH, TcpStream::connect(address)).await {
                return Ok(stream);
            }
        }
        TcpStream::connect(last).await.map_err(|error| Failure::dialled(&error))
    }

    async fn addresses(&self) -> Result<Vec<SocketAddr>, Failure> {
        let (host, port) = (self.url.host.clone(), self.url.port);
        if let Ok(address) = host.parse::<IpAddr>() {
            return Ok(vec![SocketAddr::new(address, port)]);
        }
        let mut lookup = self.lookup.lock().await;
        let ask = move || (host, port).to_socket_addrs().map(Iterator::collect);
        // Whoever does not wait for it any longer leaves it to the next one.
        let found = lookup.get_or_insert_with(|| tokio::task::spawn_blocking(ask)).await;
        *lookup = None;
        found.map_err(|_| Failure::Unresolved)?.map_err(|_| Failure::Unresolved)
    }

    async fn secured(&self, stream: TcpStream) -> Result<Stream, Failure> {
        let config: &Arc<ClientConfig> = match &self.trust {
            None => return Ok(Stream::Plain(stream)),
            Some(Ok(config)) => config,
            Some(Err(why)) => return Err(Failure::Tls(why.clone())),
        };
        let wrong = |_| Failure::Tls("no certificate can be for the name in `url`".to_owned());
        let name = ServerName::try_from(self.url.host.clone()).map_err(wrong)?;
        let connected = TlsConnector::from(config.clone()).connect(name, stream).await;
        connected.map(|stream| Stream::Secured(Box::new(stream))).map_err(|error| secured(&error))
    }

    fn request(&self, body: &str) -> Result<String, Failure> {
        let token = self.token_file.as_ref().map(|path| token::read(path)).transpose();
        let token = token.map_err(Failure::Token)?;
        let unfit = || Failure::Token("the token has letters that no address can have".to_owned());
        let target = self.url.target(token.as_deref().filter(|_| self.url.has_token())).ok_or_else(unfit)?;
        let beside = token.filter(|_| !self.url.has_token());
        let beside = beside.map_or(String::new(), |token| format!("Authorization: Bearer {token}\r\n"));
        Ok(format!(
            "POST {target} HTTP/1.1\r\nHost: {}\r\nUser-Agent: isotherm/{}\r\nContent-Type: application/json\r\n\
             Content-Length: {}\r\n{beside}Accept: */*\r\nConnection: close\r\n\r\n{body}",
            self.url.authority(),
            env!("CARGO_PKG_VERSION"),
            body.len()
        ))
    }
}

impl Post for Server {
    async fn post(&self, body: &str) -> Result<(), Failure> {
        let request = self.request(body)?;
        let stream = self.connected().await?;
        match self.secured(stream).await? {
            Stream::Plain(stream) => exchange(stream, &request).await,
            Stream::Secured(stream) => exchange(stream, &request).await,
        }
    }
}

enum Stream {
    Plain(TcpStream),
    Secured(Box<TlsStream<TcpStream>>),
}

async fn exchange(mut stream: impl AsyncRead + AsyncWrite + Unpin, request: &str) -> Result<(), Failure> {
    let sent = async {
        stream.write_all(request.as_bytes()).await?;
        stream.flush().await
    };
    let sent = sent.await;
    // A server may have answered before it had all of it: what it says tells more than that it took no more.
    match (answer::read(&mut stream).await, sent) {
        (Err(Failure::Closed), Err(error)) => Err(Failure::broken(&error)),
        (answered, _) => answered,
    }
}
