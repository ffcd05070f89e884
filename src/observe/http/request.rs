//! Checks of a request, its parameters, and the language of its client. A request must name one host, and its body must
//! be received completely and in time.

use std::time::Duration;

use axum::body::{Body, HttpBody, to_bytes};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use isotherm_profile::Language;
use percent_encoding::percent_decode_str;

use crate::observe::page::Words;

/// Maximum size of a command's body, in bytes.
const LARGEST_BODY: usize = 1024;

/// Rejects a request that names two hosts. A proxy could use one of them, and this server the other.
pub(super) async fn for_one_host(request: Request, next: Next) -> Response {
    match names_one_host(&request) {
        true => next.run(request).await,
        false => (StatusCode::BAD_REQUEST, "This request names no host or two hosts. Send one header Host, with the same host as the request line.\n")
            .into_response(),
    }
}

fn names_one_host(request: &Request) -> bool {
    let mut hosts = request.headers().get_all(header::HOST).into_iter();
    let host = hosts.next();
    // Form of a request to a proxy: "GET http://host/ HTTP/1.1".
    let is_so = |authority: &axum::http::uri::Authority| {
        host.is_some_and(|host| host.as_bytes().eq_ignore_ascii_case(authority.as_str().as_bytes()))
    };
    hosts.next().is_none() && request.uri().authority().is_none_or(is_so)
}

/// Receives the body of a request for at most `longest`, then passes the request to `next`.
pub(super) async fn whole(State(longest): State<Duration>, request: Request, next: Next) -> Response {
    if request.body().is_end_stream() {
        return next.run(request).await;
    }
    let (head, body) = request.into_parts();
    let is_too_long = body.size_hint().lower() > LARGEST_BODY as u64;
    let read = match is_too_long {
        true => Ok(None),
        false => tokio::time::timeout(longest, to_bytes(body, LARGEST_BODY)).await.map(Result::ok),
    };
    match read {
        Ok(Some(body)) => next.run(Request::from_parts(head, Body::from(body))).await,
        Ok(None) => {
            let text = format!(
                "The body of the request may have at most {LARGEST_BODY} bytes, and must be complete.\n"
            );
            (StatusCode::PAYLOAD_TOO_LARGE, text).into_response()
        }
        Err(_) => {
            let text = format!("The body of the request did not arrive within {} s.\n", longest.as_secs());
            (StatusCode::REQUEST_TIMEOUT, [(header::CONNECTION, "close")], text).into_response()
        }
    }
}

/// Returns the address of the web page relative to this path: `../` for each directory. The address is also right if
/// the page is below a path of a proxy.
pub(super) fn top(path: &str) -> String {
    /// Maximum number of directories in a path of the page.
    const DEEPEST: usize = 16;
    "../".repeat(path.matches('/').count().saturating_sub(1).min(DEEPEST))
}

/// Returns the value of a parameter in the query; `None` if the query does not contain it.
pub(super) fn parameter(query: &str, name: &str) -> Option<String> {
    let mut pairs = query.split('&').filter_map(|pair| pair.split_once('='));
    let (_, given) = pairs.find(|(known, _)| *known == name)?;
    Some(percent_decode_str(given).decode_utf8().ok()?.into_owned())
}

/// Returns the texts of the page in the language `named`. If it is `None`, returns them in a language that the client
/// accepts.
pub(super) fn words(named: Option<Language>, headers: &HeaderMap) -> &'static Words {
    let accepted = headers.get(header::ACCEPT_LANGUAGE).and_then(|given| given.to_str().ok());
    Words::choose(named, accepted.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_found_from_every_path() {
        for (path, page) in [
            ("/", ""),
            ("/login", ""),
            ("/api/status", "../"),
            ("/api/axes/z/measured", "../../../"),
            ("", ""),
        ] {
            assert_eq!(top(path), page, "{path}");
        }
        assert!(top(&"/".repeat(50_000)).len() < 100);
    }
}
