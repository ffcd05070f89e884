//! Sign-in and sign-out with a browser, by a plain form that works without scripts.
//!
//! `POST /login` with the token in its body begins a session. `POST /api/logout` ends the session.

use std::num::NonZero;

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{ConnectInfo, RawQuery, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use axum::response::{Html, IntoResponse, Json, Redirect, Response};

use super::peer::Peer;
use super::refusal::Refusal;
use super::reply::CommandReply;
use super::request::{parameter, top, words};
use super::state::HttpState;
use super::tokens::Role;
use crate::observe::page::{self, LoginPlace};

const WALL: &str = "wall";

/// Name and value of a query or form parameter.
type Parameter = (&'static str, String);

/// Returns whether the request comes from a browser that shows the answer to a person as a page.
pub(super) fn is_asked_by_a_person(request: &Request) -> bool {
    request.method() == Method::GET && accepts_html(request.headers())
}

fn accepts_html(headers: &HeaderMap) -> bool {
    headers
        .get(header::ACCEPT)
        .and_then(|kinds| kinds.to_str().ok())
        .is_some_and(|kinds| kinds.contains("text/html"))
}

/// Makes the sign-in page in a language of the profile or of the browser. `parameters` belong to the address
/// that the browser shows after the sign-in. `trouble` is the key of an error message. `top` is the relative
/// address of the web page.
fn sign_in_page(
    room: &HttpState,
    headers: &HeaderMap,
    top: &str,
    (parameters, trouble): (&[Parameter], Option<&'static str>),
) -> Html<String> {
    let texts = room.texts();
    let place = LoginPlace { machine: texts.title(), top };
    Html(page::login(words(texts.language, headers), place, parameters, trouble).into_string())
}

/// Returns the parameters of the address to show after signing in. The text `given` is a query or a form.
fn shown_afterwards(given: &str) -> Vec<Parameter> {
    let view = parameter(given, "view").filter(|view| view == WALL);
    let page = parameter(given, "page").and_then(|page| page.parse::<NonZero<usize>>().ok());
    let view = view.map(|view| ("view", view));
    view.into_iter().chain(page.map(|page| ("page", page.to_string()))).collect()
}

/// Makes the sign-in page, as the answer to a refused request for this address.
pub(super) fn page(room: &HttpState, headers: &HeaderMap, uri: &Uri, refusal: &Refusal) -> Response {
    page_at(room, headers, (uri.path(), uri.query()), refusal)
}

/// Makes the sign-in page for this path, with the parameters of a query or a form.
fn page_at(
    room: &HttpState,
    headers: &HeaderMap,
    (path, query): (&str, Option<&str>),
    refusal: &Refusal,
) -> Response {
    let trouble = match refusal {
        Refusal::WrongToken => Some("sign_in_wrong"),
        Refusal::TooManyWrong(_) => Some("sign_in_wait"),
        _ => None,
    };
    let parameters = shown_afterwards(query.unwrap_or_default());
    refusal.as_answer(sign_in_page(room, headers, &top(path), (&parameters, trouble)))
}

pub(super) async fn show(
    State(room): State<HttpState>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    if !room.access.has_tokens() {
        return Redirect::to("./").into_response();
    }
    let parameters = shown_afterwards(&query.unwrap_or_default());
    sign_in_page(&room, &headers, "", (&parameters, None)).into_response()
}

pub(super) async fn begin(
    State(room): State<HttpState>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    headers: HeaderMap,
    body: Result<Bytes, BytesRejection>,
) -> Response {
    let refused = |refusal: Refusal, form: &str| {
        room.access.refused.count(refusal.why());
        if accepts_html(&headers) && refusal.is_mended_by_signing_in() {
            return page_at(&room, &headers, ("/login", Some(form)), &refusal);
        }
        refusal.into_response()
    };
    let form = match &body {
        Ok(body) => String::from_utf8_lossy(body),
        Err(why) => return (why.status(), "The token is too long.\n").into_response(),
    };
    if !room.access.is_own_page(&headers, &peer) {
        return refused(Refusal::StrangeOrigin, &form);
    }
    if !room.access.has_tokens() {
        return refused(Refusal::NoOperator, &form);
    }
    // A form encodes a blank as +.
    let token = parameter(&form.replace('+', "%20"), "token").unwrap_or_default();
    let shown = match room.access.shown(token.trim(), peer.ip()) {
        Ok((Role::Scraper, _)) => return refused(Refusal::OnlyScrapes, &form),
        Ok(shown) => shown,
        Err(refusal) => return refused(refusal, &form),
    };
    let _ended = room.access.end_visit(&headers, &peer);
    let Ok(cookie) = room.access.begin_visit(shown, &peer) else {
        let text = "The kernel has no random numbers, so signing in is not possible.\n";
        return (StatusCode::SERVICE_UNAVAILABLE, text).into_response();
    };
    // Relative addresses, because the page may be below a path of a proxy.
    let parameters = shown_afterwards(&form).into_iter().map(|(name, value)| format!("{name}={value}"));
    let query = parameters.collect::<Vec<_>>().join("&");
    let to = if query.is_empty() { "./".to_owned() } else { format!("./?{query}") };
    ([(header::SET_COOKIE, cookie)], Redirect::to(&to)).into_response()
}

pub(super) async fn end(
    State(room): State<HttpState>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    headers: HeaderMap,
) -> Response {
    let gone = [(header::SET_COOKIE, room.access.end_visit(&headers, &peer))];
    if accepts_html(&headers) {
        return (gone, Redirect::to("../")).into_response();
    }
    (gone, Json(CommandReply { done: true, answer: "signed out".to_owned() })).into_response()
}
