//! Why somebody is turned away, as he reads it, and how often that happened.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use axum::Json;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::Said;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// Nothing says who it is.
    NoToken,
    /// What he brings is none of the tokens.
    WrongToken,
    /// So were others from there; one is looked at again after so long.
    TooManyWrong(Duration),
    /// He may look.
    OnlyLooks,
    /// He may read the metrics.
    OnlyScrapes,
    /// Nobody may command over HTTP.
    NoOperator,
    StrangeHost,
    StrangeOrigin,
    NotFromHere,
}

/// Each reason for the counter; `too-often` is of commands that came too soon after another.
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

/// How often each happened since the start.
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

    /// A person can show who he is.
    pub(super) fn is_mended_by_signing_in(self) -> bool {
        matches!(self, Refusal::NoToken | Refusal::WrongToken | Refusal::TooManyWrong(_))
    }

    pub(super) fn message(self) -> String {
        let text = match self {
            Refusal::NoToken => {
                "This gateway wants its token: sign in at /login in a browser, or send Authorization: Bearer."
            }
            Refusal::WrongToken => "That is no token of this gateway.",
            Refusal::TooManyWrong(left) => {
                return format!(
                    "Too many wrong tokens came from your address: none is looked at for {} s. Commands at the gateway's own \
                     computer (isotherm arm, disarm) work meanwhile.",
                    left.as_secs() + 1
                );
            }
            Refusal::OnlyLooks => "This is the viewer's token: it may look. Commands want the operator's.",
            Refusal::OnlyScrapes => {
                "This is the token for scraping: it may read /metrics, and nothing else. Looking wants the viewer's."
            }
            Refusal::NoOperator => {
                "No command is taken here without a token. These two lines make one: isotherm token --out \
                 /etc/isotherm/operator.token (mode 0600), and token_file = \"/etc/isotherm/operator.token\" below [web] in \
                 the profile. Or command at the gateway's own computer: isotherm arm, disarm."
            }
            Refusal::StrangeHost => {
                "Without a token this gateway answers only to localhost or to its own address. Use the address instead of \
                 the name, name it in [web] hosts, or start the gateway with a token."
            }
            Refusal::StrangeOrigin => "Commands from a browser are taken only from the gateway's own page.",
            Refusal::NotFromHere => {
                "Without a token this gateway answers only to the computer it runs on, and to no proxy, nor to HTTP/1.0. \
                 Start it with a token to look from here."
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

    /// This answer, with what belongs to its code.
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
        self.as_answer(Json(Said { done: false, answer: self.message() }))
    }
}
