//! `GET /api/events?since=12h`: the events of a time range, here of the last twelve hours. Events of earlier runs of
//! the gateway are included.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::extract::{RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Json, Response};
use schemars::JsonSchema;
use serde::Serialize;

use super::history::CancelFlag;
use super::request::parameter;
use super::state::HttpState;
use crate::observe::events::Entry;
use crate::observe::events::file::{FileItem, begin};
use isotherm_core::quantity::time;
use isotherm_profile::one_line;
use isotherm_profile::safe_file::without_numbers;

/// Start of the time range if the query contains no `since`.
const SINCE: &str = "12h";
/// Maximum number of events in an answer. `isotherm events` shows all.
const MOST: usize = 10_000;
/// Maximum time for which a request waits for the permit to read the events.
const PATIENCE: Duration = Duration::from_secs(10);

/// Events of a time range.
#[derive(Default, JsonSchema, Serialize)]
pub(super) struct Events {
    /// Events in the time range, oldest first.
    events: VecDeque<Entry>,
    /// Number of older events in the time range that were left out.
    left_out: usize,
    /// Damage that was found in the event files, one sentence for each damage.
    damage: Vec<String>,
}

pub(super) async fn since(State(room): State<HttpState>, RawQuery(query): RawQuery) -> Response {
    let since = query.and_then(|query| parameter(&query, "since")).unwrap_or_else(|| SINCE.to_owned());
    let turn = Arc::clone(&room.events).acquire_owned();
    let Ok(turn) = tokio::time::timeout(PATIENCE, turn).await else {
        let text = "Other clients are reading the events: try again in a moment.\n";
        return (StatusCode::SERVICE_UNAVAILABLE, [(header::RETRY_AFTER, "10")], text).into_response();
    };
    let gone = Arc::new(AtomicBool::new(false));
    let _leaves = CancelFlag(Arc::clone(&gone));
    // Files are read on a separate thread.
    let read = tokio::task::spawn_blocking(move || {
        let _turn = turn;
        read(&room, &since, &|| !gone.load(Ordering::Relaxed))
    });
    let read = read.await;
    match read {
        Ok(Ok(events)) => Json(events).into_response(),
        Ok(Err((code, why))) => (code, format!("{}\n", one_line(&why))).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

/// Reads the events since `since`. `is_wanted` returns `false` when the client no longer waits; reading then stops.
fn read(room: &HttpState, since: &str, is_wanted: &dyn Fn() -> bool) -> Result<Events, (StatusCode, String)> {
    let now = time::parse(&room.source.status().now).unwrap_or_default();
    let since = begin(since, now).map_err(|why| (StatusCode::BAD_REQUEST, why))?;
    let mut found = Events::default();
    let read = room.source.events(since, &mut |one| {
        match one {
            FileItem::Damage(what) => found.damage.push(what),
            FileItem::Event(entry) => {
                if found.events.len() == MOST {
                    found.events.pop_front();
                    found.left_out += 1;
                }
                found.events.push_back(entry);
            }
        }
        is_wanted()
    });
    read.map_err(|error| {
        (
            StatusCode::INTERNAL_SERVER_ERROR,
            format!("the events cannot be read: {}", without_numbers(&error.to_string())),
        )
    })?;
    Ok(found)
}
