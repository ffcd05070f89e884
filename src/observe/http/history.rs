//! `GET /api/history?from=…&to=…&columns=bed,z_cz_um&points=600`: values from the decision logs, for a chart.
//! `/api/history.csv` returns the original rows.
//!
//! The tasks of the bus lines are not affected: separate threads read the files. The number of threads and their time
//! are limited.

use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::{RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Json, Response};
use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc};
use tokio_stream::wrappers::ReceiverStream;

use super::request::parameter;
use super::state::HttpState;
use crate::clock::BootClock;
use crate::observe::decision_history::{self, Column, Question};
use crate::observe::events::file::begin;
use crate::observe::status::{AxisStatus, Status};
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::one_line;
use isotherm_profile::safe_file::{quoted, without_numbers};

/// Maximum number of requests that read the logs at the same time.
pub(super) const AT_ONCE: usize = 2;
/// Maximum time for reading the values of a chart. A download may take longer.
const LONGEST: Duration = Duration::from_secs(60);
/// Timeouts of a download, for one piece and in total. Without these timeouts, a client that accepts no data would keep
/// its permit, and other clients could not read the logs.
const DOWNLOAD: DownloadTimeouts =
    DownloadTimeouts { piece: Duration::from_secs(30), all: Duration::from_mins(10) };
/// Maximum number of unsent pieces of a download.
const UNDER_WAY: usize = 4;
const POINTS: usize = 600;
const MOST_POINTS: usize = 4000;
const MOST_COLUMNS: usize = 64;

type Refused = (StatusCode, String);

/// Flag that is set when the client has disconnected: dropping this value sets it.
pub(super) struct CancelFlag(pub(super) Arc<AtomicBool>);

impl Drop for CancelFlag {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

pub(super) async fn course(State(room): State<HttpState>, RawQuery(query): RawQuery) -> Response {
    let query = query.unwrap_or_default();
    let Some(turn) = turn(&room.readers) else { return busy() };
    let gone = Arc::new(AtomicBool::new(false));
    let _leaves = CancelFlag(Arc::clone(&gone));
    // A disk that does not respond blocks only this thread and permit. Listing the logs may block as well.
    let read = tokio::task::spawn_blocking(move || {
        let _turn = turn;
        let (question, logs) = asked(&room, &query)?;
        let points = points(&query)?;
        let until = BootClock::default().passed() + LONGEST;
        let continues = || !gone.load(Ordering::Relaxed) && BootClock::default().passed() < until;
        decision_history::course(&logs, &question, points, &continues).map_err(|error| match error.kind() {
            ErrorKind::Interrupted => {
                let text = format!(
                    "reading the logs takes more than {} s: request a shorter time range",
                    LONGEST.as_secs()
                );
                (StatusCode::SERVICE_UNAVAILABLE, text)
            }
            _ => (
                StatusCode::INTERNAL_SERVER_ERROR,
                format!("a log cannot be read: {}", without_numbers(&error.to_string())),
            ),
        })
    });
    match read.await {
        Ok(Ok(course)) => Json(course).into_response(),
        Ok(Err(refused)) => answered(refused),
        Err(error) => answered((StatusCode::INTERNAL_SERVER_ERROR, error.to_string())),
    }
}

pub(super) async fn download(State(room): State<HttpState>, RawQuery(query): RawQuery) -> Response {
    let query = query.unwrap_or_default();
    let Some(turn) = turn(&room.readers) else { return busy() };
    let looked = room.clone();
    let listed = tokio::task::spawn_blocking(move || (asked(&looked, &query), turn));
    let (question, logs, turn) = match listed.await {
        Ok((Ok((question, logs)), turn)) => (question, logs, turn),
        Ok((Err(refused), _)) => return answered(refused),
        Err(error) => return answered((StatusCode::INTERNAL_SERVER_ERROR, error.to_string())),
    };
    let machine = room.source.status().machine;
    let day = |moment: Moment| moment.to_string().get(..10).unwrap_or_default().to_owned();
    let name = format!("{machine}-{}-{}.csv", day(question.from), day(question.to));
    let plain: String = name
        .chars()
        .map(|one| if one.is_ascii_alphanumeric() || "-.".contains(one) { one } else { '_' })
        .collect();
    let (sender, receiver) = mpsc::channel(UNDER_WAY + 1);
    tokio::task::spawn_blocking(move || {
        let _turn = turn;
        hand_over(sender, DOWNLOAD, |take| decision_history::download(&logs, &question, take));
    });
    let headers = [
        (header::CONTENT_TYPE, "text/csv; charset=utf-8".to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{plain}\"")),
    ];
    (headers, Body::from_stream(ReceiverStream::new(receiver))).into_response()
}

type Piece = std::io::Result<Bytes>;

/// Timeouts of a download: for one piece, and for the whole download.
#[derive(Clone, Copy)]
struct DownloadTimeouts {
    piece: Duration,
    all: Duration,
}

/// Sends the pieces from `read` as long as the client accepts them. When a timeout expires, the download is
/// closed with an error, so that the client detects the missing rows. One slot of the channel is reserved for
/// this error.
fn hand_over(
    sender: mpsc::Sender<Piece>,
    patience: DownloadTimeouts,
    read: impl FnOnce(&mut dyn FnMut(Vec<u8>) -> bool) -> std::io::Result<()>,
) {
    let now = || BootClock::default().passed();
    let Ok(last) = sender.clone().try_reserve_owned() else { return };
    let (end, mut is_taken) = (now() + patience.all, true);
    let mut take = |piece: Vec<u8>| {
        let until = end.min(now() + patience.piece);
        let mut piece = Ok(Bytes::from(piece));
        is_taken = loop {
            match sender.try_send(piece) {
                Ok(()) => break true,
                Err(TrySendError::Full(back)) if now() < until => piece = back,
                Err(_) => break false,
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        is_taken &= now() < end;
        is_taken
    };
    let read = read(&mut take);
    match read {
        Ok(()) if is_taken => {}
        Ok(()) => drop(last.send(Err(ErrorKind::TimedOut.into()))),
        Err(error) => drop(last.send(Err(error))),
    }
}

fn turn(readers: &Arc<Semaphore>) -> Option<OwnedSemaphorePermit> {
    Arc::clone(readers).try_acquire_owned().ok()
}

fn busy() -> Response {
    let text = format!("{AT_ONCE} requests are reading the logs already: try again in a moment");
    ([(header::RETRY_AFTER, "2")], answered((StatusCode::SERVICE_UNAVAILABLE, text))).into_response()
}

fn answered((code, why): Refused) -> Response {
    (code, format!("{}\n", one_line(&why))).into_response()
}

/// Parses the query of a request. Returns the requested values, and the log files that may contain them.
fn asked(room: &HttpState, query: &str) -> Result<(Question, Vec<PathBuf>), Refused> {
    let wrong = |why: String| (StatusCode::BAD_REQUEST, why);
    let status = room.source.status();
    let now = time::parse(&status.now).unwrap_or_default();
    let moment = |name: &str, default: Moment| match parameter(query, name) {
        Some(text) => begin(&text, now).map_err(|why| wrong(format!("{name}: {why}"))),
        None => Ok(default),
    };
    let to = moment("to", now)?;
    let from = moment("from", to.before(Duration::from_hours(8)))?;
    if from >= to {
        return Err(wrong(format!("from {from} to {to}: the time range ends before it begins")));
    }
    let columns = columns(&status, parameter(query, "columns").as_deref()).map_err(wrong)?;
    let logs = room.source.logs(from, to);
    let logs = logs.ok_or_else(|| (StatusCode::NOT_FOUND, "this gateway stores no logs".to_owned()))?;
    Ok((Question { from, to, columns }, logs))
}

fn points(query: &str) -> Result<usize, Refused> {
    let Some(text) = parameter(query, "points") else { return Ok(POINTS) };
    let points = text.parse().ok().filter(|points| (2..=MOST_POINTS).contains(points));
    points.ok_or_else(|| (StatusCode::BAD_REQUEST, format!("points: write a number from 2 to {MOST_POINTS}")))
}

/// Returns the log columns that the query names, or all log columns. The error names an unknown column.
fn columns(status: &Status, named: Option<&str>) -> Result<Vec<Column>, String> {
    let signals = status.signals.iter().map(|signal| Column { name: signal.name.clone(), unit: signal.unit });
    let of_axis = |axis: &AxisStatus| -> Vec<Column> {
        let truth = if axis.truth.is_some() { ["error_um", "left_um"].as_slice() } else { &[] };
        let columns = ["cz_um", "raw_um"].iter().chain(truth);
        columns.map(|what| Column { name: format!("{}_{what}", axis.name), unit: "um" }).collect()
    };
    let mut known: Vec<Column> =
        status.axes.iter().filter(|axis| !axis.arming.release).flat_map(of_axis).chain(signals).collect();
    let Some(named) = named else {
        known.truncate(MOST_COLUMNS);
        return Ok(known);
    };
    let chosen: Vec<Column> = named
        .split(',')
        .map(|name| {
            known.iter().find(|column| column.name == name).cloned().ok_or_else(|| {
                let names: Vec<&str> = known.iter().map(|column| column.name.as_str()).collect();
                format!("there is no column {}; the columns are {}", quoted(name), names.join(", "))
            })
        })
        .collect::<Result<_, _>>()?;
    if chosen.len() > MOST_COLUMNS {
        return Err(format!(
            "{} columns are more than {MOST_COLUMNS}: divide them over several requests",
            chosen.len()
        ));
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a download of a thousand pieces, in which the client accepts one piece every `each`, or no piece
    /// if `each` is `None`. Returns the number of accepted pieces, whether the download was cut off, and its
    /// duration.
    fn taken(each: Option<Duration>, patience: DownloadTimeouts) -> (usize, bool, Duration) {
        let (sender, mut receiver) = mpsc::channel(UNDER_WAY + 1);
        let begun = BootClock::default().passed();
        let reading = std::thread::spawn(move || {
            hand_over(sender, patience, |take| {
                let _ = (0..1000).all(|_| take(vec![7; 10]));
                Ok(())
            });
            BootClock::default().passed() - begun
        });
        let (mut count, mut is_cut) = (0, false);
        if let Some(each) = each {
            while let Some(piece) = receiver.blocking_recv() {
                is_cut |= piece.is_err();
                count += usize::from(piece.is_ok());
                std::thread::sleep(each);
            }
        }
        let took = reading.join().unwrap();
        while let Ok(piece) = receiver.try_recv() {
            is_cut |= piece.is_err();
        }
        (count, is_cut, took)
    }

    #[test]
    fn a_download_is_handed_over_whole_or_seen_to_be_cut_off_and_nobody_keeps_its_turn() {
        let [short, long] = [Duration::from_millis(200), Duration::from_mins(10)];
        let (count, is_cut, _) = taken(Some(Duration::ZERO), DOWNLOAD);
        assert_eq!((count, is_cut), (1000, false));
        let (_, is_cut, took) = taken(None, DownloadTimeouts { piece: short, all: long });
        assert!(is_cut && took < Duration::from_mins(1), "he takes nothing: {took:?}");
        let (count, is_cut, took) =
            taken(Some(Duration::from_millis(50)), DownloadTimeouts { piece: long, all: short });
        assert!(is_cut && count < 1000 && took < Duration::from_mins(1), "drop by drop: {count} {took:?}");
    }
}
