//! HTTP server of the gateway: web page, status, live stream, metrics, health and commands. Each request
//! passes the following modules and checks:
//!
//! ```text
//! listener (limits) ──► request (one host) ──► peer (proxies) ──► access (method, permission)
//!                                                                       │
//!                           route  ◄── request (complete)  ◄────────────┘
//!                             ├──► status and commands (GatewayApi)
//!                             └──► live: one status a second, shared by every open page
//! ```
//!
//! The tasks of the bus lines never wait for this server. A slow client delays only itself.

mod access;
mod admission;
mod alarms;
mod compression;
mod connection;
pub(in crate::observe) mod connection_limiter;
mod events;
mod forwarded;
mod history;
mod listener;
mod live;
mod login;
mod measured;
mod openapi;
mod peer;
mod refusal;
mod refusals;
mod reply;
mod request;
mod routes;
mod sessions;
mod state;
mod tokens;

pub use admission::Admission;
pub use tokens::{TokenFile, new_token};

use std::io;
use std::num::NonZero;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{ConnectInfo, Path, RawQuery, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Json, Response};
use axum::routing::{MethodRouter, get, post};
use axum::{Extension, Router, middleware};
use tokio::sync::{Semaphore, watch};

pub use self::connection_limiter::Limits;
pub use self::listener::{HttpListener, TlsReceiver};

use self::access::{Access, Grant};
use self::peer::Peer;
use self::reply::answered;
use self::request::{parameter, words};
use self::routes::Route;
use self::state::HttpState;
use self::tokens::Role;
use super::page::PageAction;
use super::requester::{Requester, ServiceTimes};
use super::status::{Command, GatewayApi};
use super::{page, prometheus};
use isotherm_profile::IpNetwork;

/// Header that makes a proxy such as nginx forward each piece of an answer at once.
const UNBUFFERED: HeaderName = HeaderName::from_static("x-accel-buffering");

/// Maximum time for open requests to end when the gateway stops.
const GRACE: Duration = Duration::from_millis(500);

/// Headers of every answer. With these headers, the web page loads nothing from other sites and runs only its own
/// scripts. Another site cannot show the page in a frame, and so cannot cover the buttons of the page.
const HEADERS: [(HeaderName, &str); 5] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::X_FRAME_OPTIONS, "DENY"),
    // With `no-referrer`, a browser would not send the origin of the page's own forms either.
    (header::REFERRER_POLICY, "same-origin"),
    (header::CACHE_CONTROL, "no-store"),
];

/// Serves the web page on the listener `door` until `shutdown` completes. The function then ends the live streams, and
/// returns within a second.
///
/// The table at the top of `http/access.rs` shows who may view and who may command.
///
/// # Errors
/// The address of the listener cannot be determined.
pub async fn serve(
    door: impl Into<HttpListener>,
    source: Arc<dyn GatewayApi>,
    admission: Admission,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> io::Result<()> {
    let door: HttpListener = door.into();
    let proxies: Arc<[IpNetwork]> = admission.trusted_proxies.as_slice().into();
    let door = door.behind(proxies.clone());
    let access = Arc::new(Access::new(admission, door.address()?, door.scheme()));
    let limits = door.limits();
    let (stop, stopped) = watch::channel(());
    let live = live::Live::start(Arc::clone(&source), limits.streams, stopped.clone());
    let attendance = ServiceTimes::default();
    let readers = Arc::new(Semaphore::new(history::AT_ONCE));
    let events = Arc::new(Semaphore::new(1));
    let texts = Arc::default();
    let room = HttpState { source, access, live, attendance: attendance.clone(), readers, events, texts };
    let router = router(room.clone(), limits.body, proxies);
    let serving = door.serve(router, stopped);
    // A client that never completes its request must not delay the stop of the gateway.
    let overdue = async {
        shutdown.await;
        drop(stop);
        tokio::time::sleep(GRACE).await;
    };
    tokio::select! {
        () = serving => {}
        () = overdue => {}
        () = attendance.keep() => {}
        () = Access::keep(room) => {}
    }
    Ok(())
}

fn router(room: HttpState, body_within: Duration, proxies: Arc<[IpNetwork]>) -> Router {
    let guard = middleware::from_fn_with_state(room.clone(), access::check);
    let add =
        |router: Router<HttpState>, entry: &routes::Entry| router.route(&entry.path, handlers(entry.route));
    routes::all()
        .iter()
        .fold(Router::new(), add)
        .fallback(|| async {
            (StatusCode::NOT_FOUND, "This address does not exist. The web page is at /.\n")
        })
        .layer(middleware::from_fn_with_state(body_within, request::whole))
        .layer(guard)
        .layer(middleware::from_fn_with_state(proxies, peer::behind_proxies))
        .layer(middleware::from_fn(request::for_one_host))
        .layer(middleware::map_response(with_headers))
        .with_state(room)
}

/// Returns the handlers of a route, one for each of its methods.
fn handlers(route: Route) -> MethodRouter<HttpState> {
    match route {
        Route::Front => get(front),
        Route::File => get(file),
        Route::Login => get(login::show).post(login::begin),
        Route::Logout => post(login::end),
        Route::Command(command) => {
            let take = move |State(room): State<HttpState>,
                             ConnectInfo(peer): ConnectInfo<Peer>,
                             RawQuery(query): RawQuery,
                             headers: HeaderMap| async move {
                take(&room, command, query.as_deref(), &room.requester(&peer, &headers))
            };
            post(take)
        }
        Route::Acknowledge => post(alarms::acknowledge),
        Route::Measured => post(measured::learn).delete(measured::forget),
        Route::Status => get(status),
        Route::Live => get(stream),
        Route::Events => get(events::since),
        Route::History => get(history::course),
        Route::Download => get(history::download),
        Route::OpenApi => get(openapi::show),
        Route::Metrics => get(scrape),
        Route::Healthy => get(|| async { "ok" }),
        Route::Ready => get(ready),
    }
}

async fn with_headers(mut response: Response) -> Response {
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn front(
    State(room): State<HttpState>,
    Extension(pass): Extension<Grant>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let texts = room.texts();
    let words = words(texts.language, &headers);
    let shell = match query.and_then(|query| parameter(&query, "view")).as_deref() {
        Some("wall") => page::wall(words, texts),
        _ => page::front(words, texts, may(&room, &pass), pass.is_visit()),
    };
    compression::page(&headers, shell.into_string()).await
}

/// Returns the actions that the web page offers to this client.
fn may(room: &HttpState, pass: &Grant) -> PageAction {
    match pass.role {
        Role::Operator => PageAction::Command,
        Role::Viewer if room.access.has_operator() => PageAction::SignIn,
        Role::Viewer | Role::Scraper => PageAction::MakeToken,
    }
}

async fn file(Path(name): Path<String>, headers: HeaderMap) -> Response {
    match page::file(&name) {
        Some((name, kind, text)) => compression::file(&headers, name, kind, text).await,
        None => (StatusCode::NOT_FOUND, "The web page has no such file.\n").into_response(),
    }
}

/// Makes a response on a separate thread. For a large machine this takes long, and the tasks of the bus lines must not
/// wait.
async fn off_the_lines(make: impl FnOnce() -> Response + Send + 'static) -> Response {
    let made = tokio::task::spawn_blocking(make).await;
    made.unwrap_or_else(|_| StatusCode::INTERNAL_SERVER_ERROR.into_response())
}

async fn status(State(room): State<HttpState>) -> Response {
    off_the_lines(move || Json(room.source.status()).into_response()).await
}

async fn stream(
    State(room): State<HttpState>,
    Extension(pass): Extension<Grant>,
    RawQuery(query): RawQuery,
) -> Response {
    let page = query.and_then(|query| parameter(&query, "page"));
    let page = match page.map(|page| page.parse::<NonZero<usize>>()) {
        None => None,
        Some(Ok(number)) => Some(number.get()),
        Some(Err(_)) => return (StatusCode::BAD_REQUEST, "page: write a number from 1\n").into_response(),
    };
    let access = Arc::clone(&room.access);
    match room.live.stream(move || access.is_still(&pass), page) {
        // A proxy that collects an answer before it passes it on would show an old page.
        Some(stream) => ([(UNBUFFERED, "no")], stream).into_response(),
        None => {
            let text = "Too many clients watch this machine. Close a web page, or request /api/status.\n";
            (StatusCode::SERVICE_UNAVAILABLE, [(header::RETRY_AFTER, "10")], text).into_response()
        }
    }
}

fn take(room: &HttpState, command: Command, query: Option<&str>, requester: &Arc<Requester>) -> Response {
    let axis = query.and_then(|query| parameter(query, "axis"));
    answered(&room.access.refused, room.source.command(command, axis.as_deref(), requester))
}

async fn scrape(State(room): State<HttpState>) -> Response {
    off_the_lines(move || {
        let text = prometheus::exposition(&room.source.status(), &room.access.refused.read());
        ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response()
    })
    .await
}

async fn ready(State(room): State<HttpState>) -> Response {
    off_the_lines(move || {
        let missing = room.source.status().missing();
        let code = if missing.is_empty() { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
        (code, Json(missing)).into_response()
    })
    .await
}
