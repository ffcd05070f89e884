//! Delivery of one message over HTTP/1.1, with TCP or TLS. Each message has a separate connection.

use std::future::Future;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::time::Duration;

use tokio::io::AsyncWriteExt;

use super::{Trust, answer, token};
use crate::net::{ConnectError, Host, Stream};
use crate::tls::TlsFault;
use isotherm_profile::{Notify, Url};

/// Destination of messages: a server, or a replacement in tests.
pub trait Post {
    /// Sends one message, and waits until the server has accepted it.
    fn post(&self, body: &str) -> impl Future<Output = Result<(), Failure>> + Send;
}

/// Reason why a message was not delivered, or may not have been delivered.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// The token for the server cannot be read; contains the reason.
    #[error("{0}")]
    Token(String),
    /// The host name cannot be resolved.
    #[error(
        "this computer finds no address for the host name of the server (test it with `getent hosts NAME`, \
         which uses the same look-up as the gateway)"
    )]
    Unresolved,
    /// No program listens at the address of the server.
    #[error("no program listens at the address: is the port in `url` right, and does the server run?")]
    Refused,
    /// The computer of the server cannot be reached; contains the reason.
    #[error("the server cannot be reached: {0}")]
    Unreachable(String),
    /// The TLS handshake failed; contains the reason.
    #[error("{0}")]
    Tls(String),
    /// The server closed the connection before it answered.
    #[error("the server closed the connection before it had answered")]
    Closed,
    /// The server did not answer within this time.
    #[error("no answer within {} s", .0.as_secs_f64())]
    Silent(Duration),
    /// The answer of the server is not HTTP/1.1.
    #[error("the server does not speak HTTP/1.1, or it requires https")]
    NoHttp,
    /// The server redirects to another address; contains the status code and the address.
    #[error("the server answered {0}, a redirection to another address{at}. The gateway does not follow it: \
             write that address into `url`", at = place(.1.as_deref()))]
    Elsewhere(u16, Option<String>),
    /// The server rejects the message; contains the status code, and the pause that the server requests.
    #[error("the server answered {0}{means}", means = meaning(*.0))]
    Answered(u16, Option<Duration>),
}

fn place(location: Option<&str>) -> String {
    location.map_or(String::new(), |location| format!(" ({location})"))
}

fn meaning(code: u16) -> &'static str {
    match code {
        401 | 403 => ": is the token in `token_file` right?",
        404 | 410 => ": is the path in `url` right?",
        405 => ": the server accepts no POST at this path",
        408 | 425 | 429 => ": the server is overloaded",
        400..500 => ": the server does not accept this message; if it expects another format, set `body`",
        502..505 => ": this server forwards messages to another server, which does not answer",
        500..600 => ": the server had an internal error",
        _ => ", which is not an expected answer",
    }
}

impl Failure {
    /// Returns whether the server will never accept this message. The message is then not sent again.
    pub(super) fn is_final(&self) -> bool {
        // Errors that are temporary, or that a person can correct at the server or in the token file, are retried.
        matches!(self, Failure::Answered(code @ 400..500, _)
            if ![401, 403, 404, 407, 408, 409, 421, 423, 425, 429].contains(code))
    }

    /// Returns whether the failure is a timeout. A further attempt may again take the whole timeout.
    pub(super) fn is_silence(&self) -> bool {
        matches!(self, Failure::Silent(_))
    }

    /// Returns the pause that the server has requested; `None` if the server has not requested a pause.
    pub(super) fn pause(&self) -> Option<Duration> {
        if let Failure::Answered(_, pause) = self { *pause } else { None }
    }

    /// Makes the failure for a broken connection.
    pub(super) fn broken(error: &io::Error) -> Failure {
        // With TLS 1.3, the server checks the client's certificate after the handshake.
        if let Some(fault) = TlsFault::of(error) {
            return ConnectError::Tls(fault).into();
        }
        match error.kind() {
            ErrorKind::ConnectionReset | ErrorKind::BrokenPipe | ErrorKind::UnexpectedEof => Failure::Closed,
            _ => Failure::Unreachable(error.to_string()),
        }
    }
}

impl From<ConnectError> for Failure {
    fn from(error: ConnectError) -> Failure {
        match error {
            ConnectError::Unresolved => Failure::Unresolved,
            ConnectError::Unreachable(error) if error.kind() == ErrorKind::ConnectionRefused => {
                Failure::Refused
            }
            ConnectError::Unreachable(error) => Failure::Unreachable(error.to_string()),
            ConnectError::UnfitName => {
                Failure::Tls("a certificate cannot contain the name in `url`".to_owned())
            }
            ConnectError::Tls(fault) => Failure::Tls(fault.advised(remedy(fault))),
        }
    }
}

/// Returns the remedy for a TLS fault. `None` if the message of the fault is sufficient.
fn remedy(fault: TlsFault) -> Option<&'static str> {
    Some(match fault {
        TlsFault::OtherName => {
            "write the name in the certificate into `url`, or the path of this certificate into `ca`"
        }
        TlsFault::UnknownAuthority => "write the path of the authority's certificate into `ca`",
        TlsFault::BadCertificate => "to trust a self-signed certificate, write its path into `ca`",
        TlsFault::OursMissing => {
            "messages are posted without a certificate; use a token instead (`token_file`)"
        }
        TlsFault::NoTls => "correct the port in `url`, or use http://",
        TlsFault::Silent => "does the server speak TLS?",
        _ => return None,
    })
}

/// Server of a `[[notify]]` entry of the profile.
pub struct Server {
    url: Url,
    token_file: Option<PathBuf>,
    /// Host of the URL, with the certificates that are trusted for this host. The error is the reason why no
    /// certificate can be trusted.
    host: Result<Host, String>,
}

impl Server {
    /// Creates the server of a `[[notify]]` entry. `trust` is used only for https.
    pub fn of(notify: &Notify, trust: Trust) -> Server {
        let (url, token_file) = (notify.url.clone(), notify.token_file.clone());
        let trust = url.tls.then_some(trust).transpose();
        let host = trust.map(|trust| Host::new(&url.host, url.port, trust));
        Server { url, token_file, host }
    }

    /// Connects to the server and completes the TLS handshake, but sends no message.
    ///
    /// # Errors
    /// The server cannot be reached.
    pub async fn reached(&self, within: Duration) -> Result<(), Failure> {
        let connected = tokio::time::timeout(within, self.connect()).await;
        connected.unwrap_or(Err(Failure::Silent(within))).map(drop)
    }

    async fn connect(&self) -> Result<Box<dyn Stream>, Failure> {
        let host = self.host.as_ref().map_err(|why| Failure::Tls(why.clone()))?;
        Ok(host.open().await?)
    }

    fn request(&self, body: &str) -> Result<String, Failure> {
        let token = self.token_file.as_ref().map(|path| token::read(path)).transpose();
        let token = token.map_err(Failure::Token)?;
        let unfit = || Failure::Token("the token has characters that an address cannot contain".to_owned());
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
        let mut stream = self.connect().await?;
        let sent = async {
            stream.write_all(request.as_bytes()).await?;
            stream.flush().await
        };
        let sent = sent.await;
        // A server may answer before it has received everything. Its answer is more useful than the error of the write.
        match (answer::read(&mut stream).await, sent) {
            (Err(Failure::Closed), Err(error)) => Err(Failure::broken(&error)),
            (answered, _) => answered,
        }
    }
}
