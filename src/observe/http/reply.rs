//! Response of the web server to a command.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Json, Response};
use isotherm_profile::one_line;
use schemars::JsonSchema;
use serde::Serialize;

use super::refusal::{Counts, TOO_OFTEN};
use crate::observe::status::Answer;

/// Answer to a command: whether the command was carried out, and a sentence.
#[derive(JsonSchema, Serialize)]
pub(super) struct CommandReply {
    /// Whether the command was carried out. `false` if the command waits for a condition, or was refused.
    pub(super) done: bool,
    /// Sentence about the result.
    pub(super) answer: String,
}

/// Returns the response to a command. A command that came too soon is counted in `refused`.
pub(super) fn answered(refused: &Counts, said: Result<Answer, String>) -> Response {
    let (code, done, answer) = match said {
        Ok(Answer::Done(answer)) => (StatusCode::OK, true, answer),
        Ok(Answer::Waits(answer)) => (StatusCode::ACCEPTED, false, answer),
        Ok(Answer::TooSoon(answer)) => {
            refused.count(TOO_OFTEN);
            let said = Json(CommandReply { done: false, answer });
            return (StatusCode::TOO_MANY_REQUESTS, [(header::RETRY_AFTER, "1")], said).into_response();
        }
        Err(answer) => (StatusCode::CONFLICT, false, answer),
    };
    // The answer quotes the request, and may be read on a terminal.
    let answer = one_line(&answer).into_owned();
    (code, Json(CommandReply { done, answer })).into_response()
}
