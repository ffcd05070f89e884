//! Access control of the web page: who may view, and who may command.
//!
//! | client | may view | may command |
//! |---|---|---|
//! | sends the operator's token, or has signed in with it | everything | yes; after a sign-in, only from the web page |
//! | sends the viewer's token, or has signed in with it | everything | no |
//! | sends the scraper's token | `/metrics` | no |
//! | is on this computer, `commands = "local"` | everything | yes, only from the web page |
//! | is on this computer, `commands = "token"` (default) | everything, unless the profile has a viewer's token | no |
//! | any other | `/healthz`, and the sign-in page | no |
//!
//! A client is on this computer if it connects over loopback without a proxy. A client behind one of `trusted_proxies`
//! is never on this computer; its address is the address that the proxy reports.
//!
//! The host in the request of a client on this computer must be `localhost`, an IP address at which the page
//! listens, or a name from the profile. This protects against DNS rebinding: another site lets one of its own
//! names point to this computer. Scripts of that site could then read and command like scripts of the page.
//! With an IP address, this attack is not possible.

use std::net::{IpAddr, SocketAddr};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, HeaderName, Method, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use isotherm_profile::Commands;

use super::admission::Admission;
use super::forwarded::Scheme;
use super::peer::Peer;
use super::refusal::{Counts, Refusal};
use super::refusals::{Refusals, Reports, TokenReport};
use super::routes;
use super::sessions::{SessionKey, Sessions};
use super::state::HttpState;
use super::tokens::{Change, Role, Tokens, random};
use crate::clock::{BootClock, Ticks};
use crate::observe::events::{Event, PageToken};
use crate::observe::requester::{Channel, Requester};
use crate::observe::status::Command;

/// Interval at which changed token files are read and wrong tokens are reported.
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// Paths that every client may read: the health check, and the files of the sign-in page.
const FOR_EVERYBODY: [&str; 4] = ["/healthz", "/login", "/page/login.css", "/page/icon.svg"];
/// Path that a client with the scraper's token may read, in addition to [`FOR_EVERYBODY`].
const FOR_SCRAPERS: &str = "/metrics";
const LOGOUT: &str = "/api/logout";

/// Role of a client, and how the client has authenticated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grant {
    pub(super) role: Role,
    by: By,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum By {
    /// The client is on this computer, and needs no token.
    Local,
    /// The client has sent a token. The value is the version of the token, which changes when the token file contains
    /// another token.
    Token(u64),
    /// The client has signed in with a browser, which sends a cookie.
    Session(SessionKey),
}

impl Grant {
    /// Returns whether the client has signed in with a browser, and can therefore sign out.
    pub(super) fn is_visit(&self) -> bool {
        matches!(self.by, By::Session(_))
    }
}

pub(super) struct Access {
    commands: Commands,
    hosts: Vec<String>,
    listens_at: SocketAddr,
    /// Scheme of this server. A trusted proxy may report another scheme, which its clients use.
    scheme: Scheme,
    tokens: Tokens,
    sessions: Mutex<Sessions>,
    refusals: Mutex<Refusals>,
    pub(super) refused: Counts,
    /// Rate limit for reports of rejected commands.
    reports: Mutex<Reports>,
}

/// Passes an allowed request to `next`, or answers with the reason of the refusal. A method that the path
/// does not accept is refused before the token is checked, because no token permits this method.
pub(super) async fn check(
    State(room): State<HttpState>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    mut request: Request,
    next: Next,
) -> Response {
    if let Some(entry) = routes::at(request.uri().path()).filter(|entry| !entry.accepts(request.method())) {
        return entry.wrong_method();
    }
    if FOR_EVERYBODY.contains(&request.uri().path()) {
        return next.run(request).await;
    }
    let refusal = match room.access.assess(&request, &peer) {
        Ok(pass) => {
            request.extensions_mut().insert(pass);
            return next.run(request).await;
        }
        Err(refusal) => refusal,
    };
    room.access.refused.count(refusal.why());
    // The number of wrong tokens is reported separately, once a minute.
    let is_told_otherwise = matches!(refusal, Refusal::WrongToken | Refusal::TooManyWrong(_));
    let is_command = changes(&request) && request.uri().path().starts_with("/api/");
    if is_command && !is_told_otherwise && lock(&room.access.reports).take(peer.ip(), now()) {
        let command = named(request.uri().path());
        room.source.turned_away(command, &peer.requester(request.headers()), &refusal.message());
    }
    if refusal.is_mended_by_signing_in() && super::login::is_asked_by_a_person(&request) {
        return super::login::page(&room, request.headers(), request.uri(), &refusal);
    }
    refusal.into_response()
}

fn changes(request: &Request) -> bool {
    !matches!(*request.method(), Method::GET | Method::HEAD)
}

/// Returns the name of a command for events. An unknown path is not quoted, because it may be very long.
fn named(path: &str) -> &'static str {
    let path = path.strip_prefix("/api/").unwrap_or_default();
    match Command::ALL.into_iter().find(|(name, _)| *name == path) {
        Some((name, _)) => name,
        None if path == "acknowledge" => "acknowledge",
        None if path.starts_with("axes/") && path.ends_with("/measured") => "measured",
        None => "something unknown",
    }
}

fn now() -> Duration {
    BootClock::default().passed()
}

impl Access {
    pub(super) fn new(admission: Admission, listens_at: SocketAddr, scheme: Scheme) -> Access {
        Access {
            commands: admission.commands,
            hosts: admission.hosts,
            listens_at,
            scheme,
            tokens: Tokens::new([admission.scraper, admission.viewer, admission.operator]),
            sessions: Mutex::default(),
            refusals: Mutex::default(),
            refused: Counts::default(),
            reports: Mutex::default(),
        }
    }

    /// Runs an endless loop that reads changed token files and reports wrong tokens.
    pub(super) async fn keep(room: HttpState) {
        let mut ticks = Ticks::every(LOOK_EVERY);
        loop {
            ticks.next().await;
            for (role, change) in changed_tokens(&room).await {
                let role = role.name();
                room.source.report(&Event::Token(match change {
                    Change::Another => PageToken::Changed { role },
                    Change::Gone(why) => PageToken::Gone { role, why },
                }));
            }
            let due = lock(&room.access.refusals).due(now());
            if let Some(told) = due {
                tell(&room, &told);
            }
        }
    }

    /// Returns whether the profile has an operator's token.
    pub(super) fn has_operator(&self) -> bool {
        self.tokens.has(Role::Operator)
    }

    /// Returns whether the profile has a token with which a person can sign in: a viewer's or an operator's.
    pub(super) fn has_tokens(&self) -> bool {
        self.tokens.has(Role::Viewer) || self.tokens.has(Role::Operator)
    }

    /// Returns whether a client may continue to read the live stream. Its token must be unchanged, or its session open.
    /// In a viewer's session, an open live stream counts as use.
    pub(super) fn is_still(&self, pass: &Grant) -> bool {
        match pass.by {
            By::Local => true,
            By::Token(version) => self.tokens.version(pass.role) == version,
            By::Session(key) => self.session(key, |role| role == Role::Viewer).is_some(),
        }
    }

    /// Returns the role and the version of a token. The error is the refusal of a wrong token, or of any token while
    /// the address is blocked.
    pub(super) fn shown(&self, token: &str, from: IpAddr) -> Result<(Role, u64), Refusal> {
        let now = now();
        let mut refusals = lock(&self.refusals);
        if let Err(left) = refusals.may(from, now) {
            refusals.count_later(from);
            return Err(Refusal::TooManyWrong(left));
        }
        self.tokens.role_of(token).ok_or_else(|| {
            refusals.wrong(from, now);
            Refusal::WrongToken
        })
    }

    /// Begins a session. Returns the value of the header that sets its cookie.
    ///
    /// # Errors
    /// The kernel has no random numbers.
    pub(super) fn begin_visit(&self, shown: (Role, u64), peer: &Peer) -> std::io::Result<String> {
        let key = SessionKey::of(random()?);
        lock(&self.sessions).begin(key, shown, now());
        Ok(self.cookie(&key.text(), peer))
    }

    /// Ends the session of a request. Returns the value of the header that removes the cookie.
    pub(super) fn end_visit(&self, headers: &HeaderMap, peer: &Peer) -> String {
        self.keys(headers, peer).into_iter().for_each(|key| lock(&self.sessions).end(key));
        self.cookie("; Max-Age=0", peer)
    }

    /// Returns the text of a cookie that is valid only for the web page. Browsers send the cookie only over TLS if the
    /// page uses TLS.
    fn cookie(&self, value: &str, peer: &Peer) -> String {
        let secure = match peer.scheme(self.scheme) {
            Scheme::Https => "; Secure",
            Scheme::Http => "",
        };
        let (name, prefix) = (self.cookie_name(peer), peer.prefix());
        format!("{name}={value}; Path={prefix}/; HttpOnly; SameSite=Strict{secure}")
    }

    /// Returns the name of the cookie. The name contains the port, because a browser sends a cookie to all
    /// ports of a host, and each port may be another gateway. A browser accepts the prefix `__Host-` only for
    /// the top path of a host.
    fn cookie_name(&self, peer: &Peer) -> String {
        let prefix = match peer.scheme(self.scheme) {
            Scheme::Https if peer.prefix().is_empty() => "__Host-",
            Scheme::Https => "__Secure-",
            Scheme::Http => "",
        };
        format!("{prefix}isotherm_visit_{}", self.listens_at.port())
    }

    fn session(&self, key: SessionKey, uses: impl Fn(Role) -> bool) -> Option<Role> {
        let (role, version) = lock(&self.sessions).role_of(key, now(), uses)?;
        if self.tokens.version(role) != version {
            lock(&self.sessions).end(key);
            return None;
        }
        Some(role)
    }

    fn assess(&self, request: &Request, peer: &Peer) -> Result<Grant, Refusal> {
        let (headers, changes) = (request.headers(), changes(request));
        let Some(pass) = self.who(request, peer)? else {
            let is_named = self.tokens.any() || !is_local(request, peer) || self.knows_host(headers);
            return Err(match () {
                () if !is_named => Refusal::StrangeHost,
                () if changes && !self.has_operator() => Refusal::NoOperator,
                () if self.tokens.any() => Refusal::NoToken,
                () => Refusal::NotFromHere,
            });
        };
        if pass.role == Role::Scraper && (changes || request.uri().path() != FOR_SCRAPERS) {
            return Err(Refusal::OnlyScrapes);
        }
        if !changes {
            return Ok(pass);
        }
        if !matches!(pass.by, By::Token(_)) && !self.is_own_page(headers, peer) {
            return Err(Refusal::StrangeOrigin);
        }
        match pass.by {
            _ if pass.role == Role::Operator || request.uri().path() == LOGOUT => Ok(pass),
            _ if !self.has_operator() => Err(Refusal::NoOperator),
            By::Local => Err(Refusal::NoToken),
            By::Token(_) | By::Session(_) => Err(Refusal::OnlyLooks),
        }
    }

    /// Returns the role of the client; `None` if the client has no role. If the profile has tokens and the
    /// client sends a token, this is the role of that token. Otherwise, it is the role of the session or of
    /// this computer, whichever has more rights. The error is the refusal of a wrong token.
    fn who(&self, request: &Request, peer: &Peer) -> Result<Option<Grant>, Refusal> {
        let headers = request.headers();
        if let Some(token) = bearer(headers).filter(|_| self.tokens.any()) {
            let (role, version) = self.shown(token, peer.ip())?;
            return Ok(Some(Grant { role, by: By::Token(version) }));
        }
        // Automatic requests of an open page do not extend an operator's session.
        let is_use = changes(request) || request.uri().path() == "/";
        let uses = |role| is_use || role == Role::Viewer;
        let session = |key| Some(Grant { role: self.session(key, uses)?, by: By::Session(key) });
        let session = self.keys(headers, peer).into_iter().find_map(session);
        let may_command = session.is_some_and(|pass| pass.role == Role::Operator);
        let here = if may_command { None } else { self.role_here(request, peer) };
        Ok(here
            .map(|role| Grant { role, by: By::Local })
            .filter(|here| session.is_none_or(|session| here.role > session.role))
            .or(session))
    }

    /// Returns the role that every client on this computer has without a token. `None` if the client is elsewhere, or
    /// if such clients have no role.
    fn role_here(&self, request: &Request, peer: &Peer) -> Option<Role> {
        if !is_local(request, peer) || !self.knows_host(request.headers()) {
            return None;
        }
        match self.commands {
            Commands::Local => Some(Role::Operator),
            Commands::Token => (!self.tokens.has(Role::Viewer)).then_some(Role::Viewer),
        }
    }

    fn knows_host(&self, headers: &HeaderMap) -> bool {
        let Some(host) = text(headers, "host").map(without_port) else { return false };
        if host.eq_ignore_ascii_case("localhost")
            || self.hosts.iter().any(|known| host.eq_ignore_ascii_case(known))
        {
            return true;
        }
        let bare = host.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(host);
        let ours = self.listens_at.ip().to_canonical();
        bare.parse::<IpAddr>().is_ok_and(|named| {
            let named = named.to_canonical();
            // A listener on every address cannot list them. Any address is equally safe.
            named.is_loopback() || named == ours || ours.is_unspecified()
        })
    }

    /// Returns whether a request comes from the gateway's own web page. Browsers send the origin of a request; a
    /// request without `Origin` comes from another program.
    pub(super) fn is_own_page(&self, headers: &HeaderMap, peer: &Peer) -> bool {
        match text(headers, "origin") {
            Some(origin) => {
                let scheme = match peer.scheme(self.scheme) {
                    Scheme::Https => "https://",
                    Scheme::Http => "http://",
                };
                let (place, host) = (origin.strip_prefix(scheme), peer.host(headers));
                place.zip(host).is_some_and(|(place, host)| place.eq_ignore_ascii_case(host))
            }
            None => {
                !headers.contains_key("origin")
                    && text(headers, "sec-fetch-site").is_none_or(|site| site == "same-origin")
            }
        }
    }

    fn keys(&self, headers: &HeaderMap, peer: &Peer) -> Vec<SessionKey> {
        let name = self.cookie_name(peer);
        let lines = headers.get_all(header::COOKIE).into_iter().filter_map(|line| line.to_str().ok());
        let pairs = lines.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.filter(|(known, _)| *known == name).filter_map(|(_, value)| SessionKey::parse(value)).collect()
    }
}

/// Reads changed token files on a separate thread, and returns the changes.
async fn changed_tokens(room: &HttpState) -> Vec<(Role, Change)> {
    if !room.access.tokens.any() {
        return Vec::new();
    }
    let room = room.clone();
    tokio::task::spawn_blocking(move || room.access.tokens.check()).await.unwrap_or_default()
}

fn tell(room: &HttpState, TokenReport { count, last, closed }: &TokenReport) {
    let tokens = if *count == 1 { "wrong token" } else { "wrong tokens" };
    let closed = match closed {
        0 => String::new(),
        1 => "; tokens from one address are refused for a minute".to_owned(),
        many => format!("; tokens from {many} addresses are refused for a minute"),
    };
    let why = format!("{count} {tokens} since the last report{closed}");
    room.source.turned_away("sign in", &Requester::new(Channel::Api, last.to_string()), &why);
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns whether a request comes from this computer without a proxy, according to its headers. A request with
/// HTTP/1.0 counts as a request through a proxy. nginx uses this version by default, and adds no header; current
/// browsers do not use it. A request from the address of a trusted proxy is never local, even without the headers of a
/// proxy.
fn is_local(request: &Request, peer: &Peer) -> bool {
    let was_sent_on = |name: &HeaderName| {
        let name = name.as_str();
        name.starts_with("x-forwarded") || ["forwarded", "x-real-ip", "via"].contains(&name)
    };
    let is_of_today = request.version() > Version::HTTP_10;
    let is_direct = !peer.is_proxied() && !request.headers().keys().any(was_sent_on);
    is_of_today && is_direct && peer.ip().to_canonical().is_loopback()
}

fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name)?.to_str().ok()
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|digit| digit.is_ascii_digit()) => name,
        _ => host,
    }
}

fn bearer(headers: &HeaderMap) -> Option<&str> {
    let (scheme, given) = text(headers, "authorization")?.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| given.trim())
}
