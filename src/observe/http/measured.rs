//! `POST /api/axes/z/measured` with `{ "error_um": 3.2 }`: an axis's measured error. `DELETE` takes back what was learned.

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

use super::{Room, answered};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measured {
    /// Actual minus commanded, µm, while the compensation acts.
    error_um: f64,
}

pub(super) async fn learn(
    State(room): State<Room>,
    Path(axis): Path<String>,
    body: Result<Bytes, BytesRejection>,
) -> Response {
    let body = match body {
        Ok(body) => body,
        Err(refused) => {
            return (refused.status(), "A measured error is not as long as that.\n").into_response();
        }
    };
    match serde_json::from_slice::<Measured>(&body) {
        Ok(measured) => answer(&room, &axis, Some(measured.error_um)),
        Err(error) => {
            let text =
                format!("Send {{ \"error_um\": 3.2 }}, a number in µm, actual minus commanded ({error}).\n");
            (StatusCode::BAD_REQUEST, text).into_response()
        }
    }
}

pub(super) async fn forget(State(room): State<Room>, Path(axis): Path<String>) -> Response {
    answer(&room, &axis, None)
}

fn answer(room: &Room, axis: &str, error_um: Option<f64>) -> Response {
    let axes = room.source.status().axes;
    if !axes.iter().any(|known| known.name == axis) {
        let names: Vec<&str> = axes.iter().map(|axis| axis.name.as_str()).collect();
        let text = format!("There is no axis {axis}; there are {}.\n", names.join(", "));
        return (StatusCode::NOT_FOUND, text).into_response();
    }
    answered(room.source.measured(axis, error_um))
}
