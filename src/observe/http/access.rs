//! Who may see, and who may command.
//!
//! | token | seeing | commands |
//! |---|---|---|
//! | set | `Authorization: Bearer`, or the cookie that `/?token=` gives once | the same; with the cookie only from our own page |
//! | none | anybody who names us by `localhost` or by address | from this computer only, and only from our own page |
//!
//! Naming by address: a foreign site can point a name of its own at this computer and then read and command as if
//! it were ours (DNS rebinding), but it cannot do so with an address. `/healthz` is for everybody.

use std::hint::black_box;
use std::net::IpAddr;
use std::sync::atomic::{AtomicU64, Ordering};

use super::peer::Peer;
use super::{Room, parameter};
use crate::clock::Passing;
use axum::extract::{ConnectInfo, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// How often it is reported that a command was turned away, in seconds.
const REPORTED_EVERY_S: u64 = 10;
const COOKIE: &str = "isotherm_token";

/// This request brought the token in its address: the answer sets the cookie.
#[derive(Clone, Copy)]
pub(super) struct Entered;

pub(super) struct Access {
    token: Option<String>,
    listens_at: IpAddr,
    /// `http`, or `https`.
    scheme: &'static str,
    /// When a command was turned away that was reported, in seconds since the computer was started.
    reported: AtomicU64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Refusal {
    NoToken,
    StrangeHost,
    StrangeOrigin,
    NotFromHere,
}

/// Lets a request through, or answers why not.
pub(super) async fn check(
    State(room): State<Room>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    mut request: Request,
    next: Next,
) -> Response {
    if request.uri().path() == "/healthz" {
        return next.run(request).await;
    }
    match room.access.judge(&request, peer.ip()) {
        Ok(entered) => {
            if let Some(entered) = entered {
                request.extensions_mut().insert(entered);
            }
            next.run(request).await
        }
        Err(refusal) => {
            let command = request.uri().path().strip_prefix("/api/");
            if let Some(command) = command.filter(|_| changes(&request) && room.access.may_report()) {
                room.source.turned_away(
                    command,
                    &peer.asker(request.headers()),
                    refusal.message().trim_end(),
                );
            }
            refusal.into_response()
        }
    }
}

fn changes(request: &Request) -> bool {
    !matches!(*request.method(), Method::GET | Method::HEAD)
}

impl Access {
    pub(super) fn new(token: Option<String>, listens_at: IpAddr, scheme: &'static str) -> Access {
        Access { token, listens_at, scheme, reported: AtomicU64::default() }
    }

    /// One that was turned away is reported once in a while: who guesses tokens must not fill the disk with it.
    fn may_report(&self) -> bool {
        let now = Passing::default().passed().as_secs();
        let last = self.reported.load(Ordering::Relaxed);
        let is_due = last == 0 || now >= last + REPORTED_EVERY_S;
        is_due && self.reported.compare_exchange(last, now, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }

    /// A browser there may command, as far as one knows before it does.
    pub(super) fn takes_commands_from(&self, peer: IpAddr) -> bool {
        self.token.is_some() || peer.to_canonical().is_loopback()
    }

    /// The cookie for a browser that came with the token. Hexadecimal, because a token may hold any character.
    pub(super) fn cookie(&self, _proof: &Entered) -> Option<String> {
        let token = self.token.as_deref()?;
        Some(format!("{COOKIE}={}; Path=/; HttpOnly; SameSite=Strict", hexadecimal(token)))
    }

    fn judge(&self, request: &Request, peer: IpAddr) -> Result<Option<Entered>, Refusal> {
        let headers = request.headers();
        let changes = changes(request);
        let Some(token) = self.token.as_deref() else {
            return match () {
                () if !self.knows_host(headers) => Err(Refusal::StrangeHost),
                () if changes && !peer.to_canonical().is_loopback() => Err(Refusal::NotFromHere),
                () if changes && !self.is_own_page(headers) => Err(Refusal::StrangeOrigin),
                () => Ok(None),
            };
        };
        if bearer(headers).is_some_and(|given| same(given, token)) {
            return Ok(None);
        }
        if cookies(headers).any(|given| same(given, &hexadecimal(token))) {
            return if changes && !self.is_own_page(headers) {
                Err(Refusal::StrangeOrigin)
            } else {
                Ok(None)
            };
        }
        let in_address = request.uri().query().and_then(|query| parameter(query, "token"));
        match in_address {
            Some(given) if !changes && request.uri().path() == "/" && same(&given, token) => {
                Ok(Some(Entered))
            }
            _ => Err(Refusal::NoToken),
        }
    }

    fn knows_host(&self, headers: &HeaderMap) -> bool {
        let Some(host) = text(headers, "host").map(without_port) else { return false };
        if host.eq_ignore_ascii_case("localhost") {
            return true;
        }
        let bare = host.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(host);
        let ours = self.listens_at.to_canonical();
        bare.parse::<IpAddr>().is_ok_and(|named| {
            let named = named.to_canonical();
            // A listener on every address cannot list them; any literal address is as safe.
            named.is_loopback() || named == ours || ours.is_unspecified()
        })
    }

    /// A browser says where a request comes from; a program that sends no `Origin` is no browser.
    fn is_own_page(&self, headers: &HeaderMap) -> bool {
        match text(headers, "origin") {
            Some(origin) => {
                let place = origin.strip_prefix(self.scheme).and_then(|rest| rest.strip_prefix("://"));
                let host = text(headers, "host");
                place.zip(host).is_some_and(|(place, host)| place.eq_ignore_ascii_case(host))
            }
            None => {
                !headers.contains_key("origin")
                    && text(headers, "sec-fetch-site").is_none_or(|site| site == "same-origin")
            }
        }
    }
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

fn cookies(headers: &HeaderMap) -> impl Iterator<Item = &str> {
    let pairs = headers.get_all(header::COOKIE).into_iter().filter_map(|line| line.to_str().ok());
    pairs
        .flat_map(|line| line.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .filter(|(name, _)| *name == COOKIE)
        .map(|(_, value)| value)
}

fn hexadecimal(token: &str) -> String {
    token.bytes().map(|byte| format!("{byte:02x}")).collect()
}

/// Takes as long for a first wrong character as for a last one, so that nobody can guess them one by one.
fn same(given: &str, token: &str) -> bool {
    let differences = given.bytes().zip(token.bytes()).fold(0, |seen, (a, b)| black_box(seen | (a ^ b)));
    given.len() == token.len() && differences == 0
}

impl Refusal {
    fn message(self) -> &'static str {
        match self {
            Refusal::NoToken => {
                "This gateway wants its token: open /?token=… once in a browser, or send Authorization: Bearer.\n"
            }
            Refusal::StrangeHost => {
                "Without a token this gateway answers only to localhost or to its own address. \
                 Use the address instead of the name, or start the gateway with a token.\n"
            }
            Refusal::StrangeOrigin => "Commands from a browser are taken only from the gateway's own page.\n",
            Refusal::NotFromHere => {
                "Without a token, commands are taken only from the computer the gateway runs on. \
                 Start the gateway with a token to command it from here.\n"
            }
        }
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let code = match self {
            Refusal::NoToken => {
                let realm = [(header::WWW_AUTHENTICATE, "Bearer realm=\"isotherm\"")];
                return (StatusCode::UNAUTHORIZED, realm, self.message()).into_response();
            }
            Refusal::StrangeHost => StatusCode::MISDIRECTED_REQUEST,
            Refusal::StrangeOrigin | Refusal::NotFromHere => StatusCode::FORBIDDEN,
        };
        (code, self.message()).into_response()
    }
}
