//! `POST /api/axes/z/measured` with `{ "error_um": 3.2 }`: sends the measured error of an axis, with optional `time`
//! and `id`. `DELETE` removes the correction that earlier errors have made.

use axum::body::Bytes;
use axum::extract::{ConnectInfo, Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::Deserialize;

use super::peer::Peer;
use super::reply::answered;
use super::state::HttpState;
use crate::observe::requester::Requester;
use isotherm_core::compensation::MeasuredReport;
use isotherm_profile::one_line;
use isotherm_profile::safe_file::quoted;

/// Measured error of an axis.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Measured {
    /// Actual minus commanded position of the axis, measured while the compensation is active, in µm.
    error_um: f64,
    /// Time of the measurement, RFC 3339.
    time: Option<String>,
    /// Identifier of the measurement. Measurements with the same identifier count once.
    id: Option<String>,
}

impl Measured {
    /// Parses the body of a request. The error is a sentence that describes why the body is invalid.
    fn read(body: &[u8]) -> Result<MeasuredReport, String> {
        let Measured { error_um, time, id } =
            serde_json::from_slice(body).map_err(|error| error.to_string())?;
        MeasuredReport::new(error_um, time.as_deref(), id.as_deref())
    }
}

pub(super) async fn learn(
    State(room): State<HttpState>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    Path(axis): Path<String>,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    match Measured::read(&body) {
        Ok(report) => answer(&room, &axis, Some(report), &room.requester(&peer, &headers)),
        Err(why) => {
            let text = format!(
                "Send {{ \"error_um\": 3.2 }}, a number in µm, actual minus commanded ({}).\n",
                one_line(&why)
            );
            (StatusCode::BAD_REQUEST, text).into_response()
        }
    }
}

pub(super) async fn forget(
    State(room): State<HttpState>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    Path(axis): Path<String>,
    headers: HeaderMap,
) -> Response {
    answer(&room, &axis, None, &room.requester(&peer, &headers))
}

fn answer(room: &HttpState, axis: &str, report: Option<MeasuredReport>, requester: &Requester) -> Response {
    let axes = room.source.status().axes;
    if !axes.iter().any(|known| known.name == axis) {
        let names: Vec<&str> = axes.iter().map(|axis| axis.name.as_str()).collect();
        let text =
            format!("There is no axis {}; the axes are {}.\n", one_line(&quoted(axis)), names.join(", "));
        return (StatusCode::NOT_FOUND, text).into_response();
    }
    answered(&room.access.refused, room.source.measured(axis, report, requester))
}
