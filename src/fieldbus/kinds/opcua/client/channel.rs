//! Secure channel of OPC UA on a socket of the gateway. The channel processes its events only while a caller waits for
//! an answer.

use std::future::Future;
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use ::opcua::client::transport::{
    Connector, RequestRecv, SecureChannelEventLoop, SecureChannelState, StreamConnection, StreamConnector,
    StreamTransport, TransportConfiguration, TransportPollResult,
};
use ::opcua::client::{AsyncSecureChannel, SessionRetryPolicy};
use ::opcua::core::comms::tcp_codec::TcpCodec;
use ::opcua::crypto::{CertificateStore, PrivateKey, SecurityPolicy, X509};
use ::opcua::sync::RwLock;
use ::opcua::types::{ContextOwned, DecodingOptions, EndpointDescription, Error, NamespaceMap, StatusCode};
use tokio::io::{ReadHalf, WriteHalf};
use tokio::net::TcpStream;
use tokio_util::codec::FramedRead;

use super::chain::ChainOpener;
use super::chunks::{Chunks, Peer, Reply};
use super::panic_guard::contained;

/// Requested lifetime of the keys in milliseconds. The library renews the keys with the first request after three
/// quarters of this time.
const LIFETIME: u32 = 600_000;
/// Largest chunk and message that the gateway accepts, in bytes. The answer to a read of a thousand nodes is far
/// smaller.
const CHUNK: usize = 65_535;
const MESSAGE: usize = 4_000_000;
const CHUNKS: usize = 100;

/// Maximum number of elements in a received list. A message of the permitted size contains no more elements.
/// The limit is necessary because a decoded list needs far more memory than its bytes.
const ELEMENTS: usize = 65_535;

type Transport = StreamTransport<Chunks<ReadHalf<TcpStream>>, WriteHalf<TcpStream>>;

/// Returns a channel to this endpoint. The channel is not open yet.
pub(super) fn secured(endpoint: &EndpointDescription) -> AsyncSecureChannel {
    // The certificate store of the library is not used, because certificates come with the profile.
    let store = Arc::new(RwLock::new(CertificateStore::new(std::path::Path::new(""))));
    let info = endpoint.clone().into();
    let config = TransportConfiguration {
        send_buffer_size: CHUNK,
        recv_buffer_size: CHUNK,
        max_message_size: MESSAGE,
        max_chunk_count: CHUNKS,
    };
    let limits = DecodingOptions {
        max_message_size: MESSAGE,
        max_chunk_count: CHUNKS,
        max_string_length: MESSAGE,
        max_byte_string_length: MESSAGE,
        max_array_length: ELEMENTS,
        ..DecodingOptions::default()
    };
    let context = ContextOwned::new_default(NamespaceMap::new(), limits);
    let never = SessionRetryPolicy::never();
    let context = Arc::new(RwLock::new(context));
    // The clock of the server may differ from that of this computer.
    AsyncSecureChannel::new(store, info, never, true, Arc::default(), config, LIFETIME, context)
}

/// Open socket of a channel, with the certificate that the gateway sends on this channel.
pub(super) struct Socket {
    url: String,
    stream: Mutex<Option<TcpStream>>,
    own: Option<(X509, PrivateKey)>,
    state: Mutex<Option<Arc<SecureChannelState>>>,
    peer: Arc<Peer>,
}

impl Socket {
    /// Returns a socket for a channel without security.
    pub(super) fn plain(url: &str, stream: TcpStream) -> Socket {
        Socket::with(url, stream, None, Peer::default())
    }

    /// Returns a socket for a channel to this endpoint. `own` is the certificate that the gateway sends.
    pub(super) fn new(
        url: &str,
        stream: TcpStream,
        own: Option<&(X509, PrivateKey)>,
        endpoint: &EndpointDescription,
    ) -> Socket {
        let policy = SecurityPolicy::from_uri(endpoint.security_policy_uri.as_ref());
        let opener = own.map(|own| ChainOpener::new(own, endpoint.server_certificate.as_ref(), policy));
        Socket::with(url, stream, own, Peer::new(opener))
    }

    fn with(url: &str, stream: TcpStream, own: Option<&(X509, PrivateKey)>, peer: Peer) -> Socket {
        let (stream, state) = (Mutex::new(Some(stream)), Mutex::new(None));
        Socket { url: url.to_owned(), stream, own: own.cloned(), state, peer: Arc::new(peer) }
    }

    /// Returns the first reply of the server on this connection, as far as it has arrived.
    pub(super) fn reply(&self) -> Reply {
        self.peer.reply()
    }

    fn state(&self) -> Option<Arc<SecureChannelState>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn take(&self) -> Result<TcpStream, Error> {
        let stream = self.stream.lock().unwrap_or_else(PoisonError::into_inner).take();
        stream.ok_or_else(|| Error::new(StatusCode::BadNotConnected, "the channel already uses the socket"))
    }
}

impl Connector for Socket {
    type Transport = Transport;

    async fn connect(
        &self,
        channel: Arc<SecureChannelState>,
        outgoing: RequestRecv,
        config: TransportConfiguration,
    ) -> Result<Transport, Error> {
        {
            let mut secure = channel.secure_channel().write();
            let (cert, key) = self.own.clone().unzip();
            secure.set_cert(cert);
            secure.set_private_key(key);
        }
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = Some(channel.clone());
        let open = |url: String, options: DecodingOptions| {
            let (stream, peer) = (self.take(), self.peer.clone());
            async move {
                let (reader, writer) = tokio::io::split(stream?);
                let reader = FramedRead::new(Chunks::new(reader, CHUNK, peer), TcpCodec::new(options));
                Ok(StreamConnection::new(reader, writer, url))
            }
        };
        StreamConnector::new(open, self.url.clone()).connect(channel, outgoing, config).await
    }

    fn default_endpoint(&self) -> EndpointDescription {
        EndpointDescription::from(self.url.as_str())
    }
}

/// Open secure channel to a server.
pub(super) struct Link {
    pub(super) channel: Arc<AsyncSecureChannel>,
    events: SecureChannelEventLoop<Transport>,
    state: Arc<SecureChannelState>,
    /// Whether the OPC UA library has panicked in this channel. The channel must then not be used again.
    is_broken: bool,
}

fn not_understood() -> Error {
    Error::new(StatusCode::BadDecodingError, "the library has panicked")
}

impl Link {
    pub(super) async fn open(channel: Arc<AsyncSecureChannel>, socket: &Socket) -> Result<Link, Error> {
        let opened = contained(channel.connect_no_retry(socket)).await;
        let events = opened.unwrap_or_else(|_| Err(not_understood()))?;
        let state = socket.state();
        let state = state.ok_or_else(|| Error::new(StatusCode::BadNotConnected, "no channel"))?;
        Ok(Link { channel, events, state, is_broken: false })
    }

    /// Waits for an answer of the server, and meanwhile processes the events of the socket.
    pub(super) async fn ask<T>(
        &mut self,
        answer: impl Future<Output = Result<T, Error>>,
    ) -> Result<T, Error> {
        if self.is_broken {
            return Err(Error::new(StatusCode::BadConnectionClosed, "broken"));
        }
        let asked = contained(self.asked(answer)).await;
        self.is_broken = asked.is_err();
        asked.unwrap_or_else(|_| Err(not_understood()))
    }

    async fn asked<T>(&mut self, answer: impl Future<Output = Result<T, Error>>) -> Result<T, Error> {
        let mut answer = pin!(answer);
        loop {
            tokio::select! {
                biased;
                answered = &mut answer => return answered,
                event = self.events.poll() => {
                    if let TransportPollResult::Closed(status) = event {
                        let status = if status.is_good() { StatusCode::BadConnectionClosed } else { status };
                        return Err(Error::new(status, "closed"));
                    }
                }
            }
        }
    }

    /// Returns whether the other end has closed the idle channel. Discards received messages, because they answer no
    /// request.
    pub(super) async fn is_closed(&mut self) -> bool {
        if self.is_broken {
            return true;
        }
        let looked = contained(self.has_ended()).await;
        self.is_broken = looked.is_err();
        looked.unwrap_or(true)
    }

    async fn has_ended(&mut self) -> bool {
        loop {
            tokio::select! {
                biased;
                event = self.events.poll() => {
                    if matches!(event, TransportPollResult::Closed(_)) {
                        return true;
                    }
                }
                () = std::future::ready(()) => return false,
            }
        }
    }

    /// Closes the channel, so that another client can use a channel of the server. The call waits until the close
    /// message has been sent.
    pub(super) async fn close(mut self) {
        if !self.is_broken {
            let channel = self.channel.clone();
            let _ = contained(async {
                channel.close_channel().await;
                while !matches!(self.events.poll().await, TransportPollResult::Closed(_)) {}
            })
            .await;
        }
    }

    /// Returns whether the library would renew the keys of the channel before the next request.
    pub(super) fn is_due_for_new_keys(&self) -> bool {
        self.state.secure_channel().read().should_renew_security_token()
    }

    /// Sets the nonce (random number) of the server, which the next signature of its session must include.
    pub(super) fn set_nonce(&self, nonce: &::opcua::types::ByteString) -> Result<(), Error> {
        self.state.secure_channel().write().set_remote_nonce_from_byte_string(nonce)
    }
}

/// Returns the longest time that the library waits for an answer: twice the timeout, so that the line gives up first.
pub(super) const fn patience(timeout: Duration) -> Duration {
    timeout.saturating_mul(2)
}
