//! Connection to the web page: HTTP/1.1 over TCP or TLS, with its timeouts.
//!
//! | phase | timeout |
//! |---|---|
//! | TLS handshake, or head of a request from its first byte | `head` |
//! | answer of which the client accepts no byte | `stall` |
//! | between two requests, also while the client still receives the end of an answer | `idle` |

use std::io;
use std::net::{Shutdown, SocketAddr};
use std::os::fd::{AsFd, BorrowedFd};
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use axum::Router;
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::ConnectInfo;
use hyper::Request;
use hyper::body::{Frame, Incoming, SizeHint};
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::TokioIo;
use hyper_util::service::TowerToHyperService;
use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;

use super::connection_limiter::{Limits, Permit};
use super::peer::Peer;

/// Maximum size of the head of a request, and of the unsent part of an answer, in bytes.
const BUFFER: usize = 64 * 1024;

/// TCP connection with its phase: receiving the head of a request, answering, or idle. When the last reference is
/// dropped, the permit of the connection is released.
#[derive(Debug)]
pub(super) struct Line {
    stream: TcpStream,
    phase: watch::Sender<Phase>,
    _place: Permit,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Head,
    Answering,
    Idle,
}

/// Serves the connection until the client closes it, or until a timeout expires.
pub(super) async fn serve(
    line: Arc<Line>,
    address: SocketAddr,
    (router, shown): (Router, Option<Arc<ServerConfig>>),
    limits: Limits,
    stopped: watch::Receiver<()>,
) {
    let peer = Peer::new(address, line.clone());
    let wire = Wire { line: line.clone(), has_read: false };
    let served = async {
        match shown {
            None => converse(wire, &line, peer, router, stopped).await,
            Some(shown) => match TlsAcceptor::from(shown).accept(wire).await {
                Ok(secured) => converse(secured, &line, peer, router, stopped).await,
                Err(error) => tracing::debug!(%address, %error, "no TLS connection to the web page"),
            },
        }
    };
    tokio::select! {
        () = served => {}
        () = overdue(line.phase.subscribe(), limits) => {}
    }
}

async fn converse<S>(stream: S, line: &Arc<Line>, peer: Peer, router: Router, stopped: watch::Receiver<()>)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let router = TowerToHyperService::new(router);
    let service = service_fn(move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(ConnectInfo(peer.clone()));
        let answering = AnswerGuard::begin(line);
        let answer = router.call(request);
        async move { answer.await.map(|answer| answer.map(|body| Answer { body, _answering: answering })) }
    });
    let serving = http1::Builder::new().max_buf_size(BUFFER).serve_connection(TokioIo::new(stream), service);
    let mut serving = pin!(serving);
    let mut closing = pin!(ended(stopped));
    tokio::select! {
        // The result concerns only the client.
        _ = serving.as_mut() => return,
        () = &mut closing => serving.as_mut().graceful_shutdown(),
    }
    let _ = serving.await;
}

/// Completes when the connection has been in one phase for longer than its timeout.
async fn overdue(mut phase: watch::Receiver<Phase>, limits: Limits) {
    loop {
        let longest = match *phase.borrow_and_update() {
            Phase::Head => limits.head,
            Phase::Answering => limits.stall,
            Phase::Idle => limits.idle,
        };
        if tokio::time::timeout(longest, phase.changed()).await.is_err() {
            return;
        }
    }
}

/// Completes when the sender of `stopped` has been dropped, because the server ends.
pub(super) async fn ended(mut stopped: watch::Receiver<()>) {
    while stopped.changed().await.is_ok() {}
}

impl Line {
    pub(super) fn new(stream: TcpStream, place: Permit) -> Line {
        Line { stream, phase: watch::Sender::new(Phase::Head), _place: place }
    }

    /// Records received data. In an idle connection, the data are the start of a request.
    fn receives(&self) {
        self.phase.send_if_modified(|phase| {
            let begins = *phase == Phase::Idle;
            if begins {
                *phase = Phase::Head;
            }
            begins
        });
    }

    /// Records that the client has accepted data, and restarts the timeout.
    fn is_read(&self) {
        self.phase.send_if_modified(|phase| *phase != Phase::Head);
    }
}

impl AsFd for Line {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.stream.as_fd()
    }
}

/// Value that marks the connection as busy from a request to the end of its answer. When the value is dropped, the
/// connection is idle.
struct AnswerGuard(Arc<Line>);

impl AnswerGuard {
    fn begin(line: &Arc<Line>) -> AnswerGuard {
        line.phase.send_replace(Phase::Answering);
        AnswerGuard(line.clone())
    }
}

impl Drop for AnswerGuard {
    fn drop(&mut self) {
        self.0.phase.send_replace(Phase::Idle);
    }
}

/// Body of an answer, with the value that marks the connection as busy until the body is sent.
struct Answer {
    body: Body,
    _answering: AnswerGuard,
}

impl HttpBody for Answer {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// TCP connection as a byte stream that records its phase.
struct Wire {
    line: Arc<Line>,
    has_read: bool,
}

impl AsyncRead for Wire {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        into: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        // A request begins before the close of its connection is detected. The refusal of a request without a waiting
        // client is therefore reported.
        if std::mem::take(&mut self.has_read) {
            cx.waker().wake_by_ref();
            return Poll::Pending;
        }
        loop {
            ready!(self.line.stream.poll_read_ready(cx))?;
            match self.line.stream.try_read(into.initialize_unfilled()) {
                Ok(count) => {
                    into.advance(count);
                    self.has_read = true;
                    self.line.receives();
                    return Poll::Ready(Ok(()));
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) => return Poll::Ready(Err(error)),
            }
        }
    }
}

impl Wire {
    fn write(
        &self,
        cx: &mut Context<'_>,
        attempt: impl Fn(&TcpStream) -> io::Result<usize>,
    ) -> Poll<io::Result<usize>> {
        loop {
            ready!(self.line.stream.poll_write_ready(cx))?;
            match attempt(&self.line.stream) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                written => {
                    self.line.is_read();
                    return Poll::Ready(written);
                }
            }
        }
    }
}

impl AsyncWrite for Wire {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        self.write(cx, |stream| stream.try_write(bytes))
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        self.write(cx, |stream| stream.try_write_vectored(parts))
    }

    fn is_write_vectored(&self) -> bool {
        true
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(SockRef::from(&self.line.stream).shutdown(Shutdown::Write))
    }
}
