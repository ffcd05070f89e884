//! Reasons for the refusal of requests to the web page, with their messages and counters.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use axum::Json;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::reply::CommandReply;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// The request contains no token and no session.
    NoToken,
    /// The token is not one of this gateway's tokens.
    WrongToken,
    /// Too many wrong tokens came from the client's address. The duration is the time until a token is checked again.
    TooManyWrong(Duration),
    /// The client may view, but not send commands.
    OnlyLooks,
    /// The client's token allows it only to read the metrics.
    OnlyScrapes,
    /// The profile has no operator's token, so commands over HTTP are not possible.
    NoOperator,
    StrangeHost,
    StrangeOrigin,
    NotFromHere,
}

/// Labels of the counters, one for each reason. `too-often` counts commands that followed the same command too soon.
const WHYS: [&str; 10] = [
    "no-token",
    "wrong-token",
    "too-many-wrong",
    "only-looks",
    "only-scrapes",
    "no-operator",
    "host",
    "origin",
    "not-from-here",
    TOO_OFTEN,
];
pub(super) const TOO_OFTEN: &str = "too-often";

/// Counters of the refused requests since the start, one for each reason.
#[derive(Debug, Default)]
pub(super) struct Counts([AtomicU64; WHYS.len()]);

impl Counts {
    pub(super) fn count(&self, why: &str) {
        if let Some((_, count)) = WHYS.iter().zip(&self.0).find(|(known, _)| **known == why) {
            count.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub(super) fn read(&self) -> Vec<(&'static str, u64)> {
        WHYS.iter().zip(&self.0).map(|(why, count)| (*why, count.load(Ordering::Relaxed))).collect()
    }
}

impl Refusal {
    pub(super) fn why(self) -> &'static str {
        match self {
            Refusal::NoToken => "no-token",
            Refusal::WrongToken => "wrong-token",
            Refusal::TooManyWrong(_) => "too-many-wrong",
            Refusal::OnlyLooks => "only-looks",
            Refusal::OnlyScrapes => "only-scrapes",
            Refusal::NoOperator => "no-operator",
            Refusal::StrangeHost => "host",
            Refusal::StrangeOrigin => "origin",
            Refusal::NotFromHere => "not-from-here",
        }
    }

    /// Returns whether the client would get access after signing in.
    pub(super) fn is_mended_by_signing_in(self) -> bool {
        matches!(self, Refusal::NoToken | Refusal::WrongToken | Refusal::TooManyWrong(_))
    }

    pub(super) fn message(self) -> String {
        let text = match self {
            Refusal::NoToken => {
                "This gateway requires a token: sign in at /login in a browser, or send Authorization: \
                 Bearer."
            }
            Refusal::WrongToken => "This is not a token of this gateway.",
            Refusal::TooManyWrong(left) => {
                return format!(
                    "Too many wrong tokens came from your address: tokens are refused for {} s. Commands at \
                     the gateway's own computer (isotherm arm, disarm) still work.",
                    left.as_secs() + 1
                );
            }
            Refusal::OnlyLooks => {
                "This is the viewer's token: it only permits viewing. Commands require the operator's token."
            }
            Refusal::OnlyScrapes => {
                "This is the token for scraping: it only permits reading /metrics. Viewing requires the \
                 viewer's token."
            }
            Refusal::NoOperator => {
                "This gateway accepts no command without a token. To make a token, run isotherm token \
                 --out /etc/isotherm/operator.token (mode 0600), and write token_file = \
                 \"/etc/isotherm/operator.token\" below [web] in the profile. Or send commands on the gateway's \
                 own computer: isotherm arm, disarm."
            }
            Refusal::StrangeHost => {
                "Without a token this gateway answers only to localhost or to its own address. Use the address instead of \
                 the name, write the name into [web] hosts, or start the gateway with a token."
            }
            Refusal::StrangeOrigin => {
                "Commands from a browser are accepted only from the gateway's own page. Behind a proxy, name it in \
                 [web] trusted_proxies, and let it send X-Forwarded-Proto and X-Forwarded-Host."
            }
            Refusal::NotFromHere => {
                "Without a token this gateway answers only requests from its own computer, but not from a \
                 proxy or with HTTP/1.0. To view it from here, start the gateway with a token."
            }
        };
        text.to_owned()
    }

    pub(super) fn code(self) -> StatusCode {
        match self {
            Refusal::NoToken | Refusal::WrongToken => StatusCode::UNAUTHORIZED,
            Refusal::TooManyWrong(_) => StatusCode::TOO_MANY_REQUESTS,
            Refusal::StrangeHost => StatusCode::MISDIRECTED_REQUEST,
            Refusal::OnlyLooks
            | Refusal::OnlyScrapes
            | Refusal::NoOperator
            | Refusal::StrangeOrigin
            | Refusal::NotFromHere => StatusCode::FORBIDDEN,
        }
    }

    /// Makes the response for this refusal, with the given body. Some status codes require a header, for example
    /// `Retry-After`.
    pub(super) fn as_answer(self, body: impl IntoResponse) -> Response {
        let code = self.code();
        match self {
            Refusal::NoToken | Refusal::WrongToken => {
                (code, [(header::WWW_AUTHENTICATE, "Bearer realm=\"isotherm\"")], body).into_response()
            }
            Refusal::TooManyWrong(left) => {
                (code, [(header::RETRY_AFTER, (left.as_secs() + 1).to_string())], body).into_response()
            }
            _ => (code, body).into_response(),
        }
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        self.as_answer(Json(CommandReply { done: false, answer: self.message() }))
    }
}
