//! `POST /api/axes/z/measured` with `{ "error_um": 3.2 }`: an axis's measured error. `DELETE` takes back what was learned.

use axum::body::Bytes;
use axum::extract::{ConnectInfo, Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

use super::peer::Peer;
use super::{Room, answered};
use crate::observe::asker::Asker;
use isotherm_profile::one_line;
use isotherm_profile::regular::quoted;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measured {
    /// Actual minus commanded, µm, while the compensation acts.
    error_um: f64,
}

pub(super) async fn learn(
    State(room): State<Room>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    Path(axis): Path<String>,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    match serde_json::from_slice::<Measured>(&body) {
        Ok(measured) => answer(&room, &axis, Some(measured.error_um), &room.asker(&peer, &headers)),
        Err(error) => {
            let why = error.to_string();
            let text = format!(
                "Send {{ \"error_um\": 3.2 }}, a number in µm, actual minus commanded ({}).\n",
                one_line(&why)
            );
            (StatusCode::BAD_REQUEST, text).into_response()
        }
    }
}

pub(super) async fn forget(
    State(room): State<Room>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    Path(axis): Path<String>,
    headers: HeaderMap,
) -> Response {
    answer(&room, &axis, None, &room.asker(&peer, &headers))
}

fn answer(room: &Room, axis: &str, error_um: Option<f64>, asker: &Asker) -> Response {
    let axes = room.source.status().axes;
    if !axes.iter().any(|known| known.name == axis) {
        let names: Vec<&str> = axes.iter().map(|axis| axis.name.as_str()).collect();
        let text = format!("There is no axis {}; there are {}.\n", one_line(&quoted(axis)), names.join(", "));
        return (StatusCode::NOT_FOUND, text).into_response();
    }
    answered(room, room.source.measured(axis, error_um, asker))
}
