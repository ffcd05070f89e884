//! `POST /api/acknowledge?alarm=signal%20bed`: acknowledges the alarm with the identifier `signal bed`. Without the
//! parameter `alarm`, all active alarms are acknowledged.

use axum::extract::{ConnectInfo, RawQuery, State};
use axum::http::HeaderMap;
use axum::response::Response;

use super::peer::Peer;
use super::reply::answered;
use super::request::parameter;
use super::state::HttpState;

pub(super) async fn acknowledge(
    State(room): State<HttpState>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let alarm = query.and_then(|query| parameter(&query, "alarm"));
    let said = room.source.acknowledge(alarm.as_deref(), &room.requester(&peer, &headers));
    answered(&room.access.refused, said)
}
