//! Commands to a running gateway over its own Unix socket in the state directory: `isotherm arm`, `disarm`, `zero`,
//! `cancel`, `measured`, `confirm`, `release`.
//!
//! The client sends one line and receives one line: `disarm` → `ok z: off …` or `error …`. `measured z 3.2` sends a
//! measured error in µm; `measured z clear` removes the correction from such errors. `confirm module` accepts a
//! device. Every program that may open the socket file may send commands. The gateway accepts each verb once per
//! second for an axis. A line may end with these words:
//!
//! | word | meaning |
//! |---|---|
//! | `axis=z` | Only this axis |
//! | `until=8123.25` | Execute the command before this many seconds after the start of the computer (CLOCK_BOOTTIME), or never |
//! | `time=2026-01-31T12:00:00Z`, `id=part-17/2` | With `measured`: time and name of the measurement, which counts once |
//! | `stay` | With `arm` and `sign`: send answers until the request is done. It is cancelled when the client disconnects |
//!
//! `arm` → `ok z: armed`, `error …`, or after 3 s `waits z: waiting to arm: …`. With `stay`, more lines follow:
//! `waits` for each new reason, `still` once a second, and finally `ok` or `error`.
//!
//! `sign axis=z stay` moves Cz (the compensation value) by a small amount in the plus direction, as soon as
//! the axis is ready. The answers are `waits …`, and `ok` when the output has this Cz, so that the operator
//! may read the gauge. The connection stays open until the check is over; if the client closes it, the check
//! ends. `sign-plus`, `sign-minus` and `sign-none`, on another connection, report in which direction the
//! gauge moved. The answer contains the direction in which the gauge must move. Cz then returns to the value
//! of the model.
//!
//! `adopt axis=z` adopts the learned model of an axis, and `adopt-back axis=z` returns to the previous model.
//!
//! `status` → `ok` and the state as one line of JSON. `restart` and `release`: see [`restart`].
//!
//! One command has an answer of many lines: the exchanges of a device as they happen (`isotherm trace`).
//! `trace cnc 60 text` → `ok listening to cnc`, two lines for each exchange (or one with `json`), and finally `end`
//! with the number of exchanges. The trace ends after 60 seconds, or as soon as the client disconnects.
//!
//! The number of connections is limited. At the limit, a new connection replaces the connection that has been silent
//! longest. Therefore a command does not wait for connections that send nothing. At most half of the permitted
//! connections may wait for a result or trace a device.

use std::io::{Error, ErrorKind};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt};
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{UnixListener, UnixStream};
use tokio::sync::Semaphore;

use crate::clock::Ticks;
use crate::fieldbus::explain::system;
use crate::fieldbus::trace::{Exchange, ExchangeReceiver};
use crate::gateway::lifecycle::successor::Successor;
use crate::gateway::line::wire_log::WireLog;
use crate::gateway::store::disk::make_directory;
use crate::observe::requester::{ANSWER_TIMEOUT, Channel, Connection, Requester, ServiceTimes};
use crate::observe::status::{Answer, Command, GatewayApi, Status};
use isotherm_core::compensation::MeasuredReport;
use isotherm_profile::{counted, one_line};
use silent_connections::{Closed, SilentConnections};

mod client;
mod restart;
mod silent_connections;
mod sockets;
mod user;

pub use crate::gateway::state::sign::PATIENCE as SIGN_ANSWERED_WITHIN;
pub use client::{
    Failure, Presence, arm, presence, release, restart, restart_is_wrong, send, send_confirm, send_measured,
    sign, status, trace,
};
pub use sockets::{listening, path};
pub use user::forbidden;

/// Maximum time that a client without `stay` waits for the result of `arm`.
const ARMING: Duration = Duration::from_secs(3);
/// Delay after which a client with `stay` receives `waits …` with the reason why the gateway has not carried out the
/// request yet.
const SHORTLY: Duration = Duration::from_millis(500);
const LOOK_AGAIN: Duration = Duration::from_millis(50);
/// Interval of the `still` lines to a client that waits with `stay`.
const STILL: Duration = Duration::from_secs(1);
const LONGEST: u64 = 256;
/// Interval of the checks whether the socket file was deleted.
const DELETED: Duration = Duration::from_secs(1);

/// Answer to a request with `stay` or `trace` while too many clients already wait or trace.
const TOO_MANY: &str = "error too many clients wait or trace: end one of them, then try again\n";

/// First words of the answer to an unknown line. All versions of isotherm use them, so that clients recognise them.
const UNKNOWN: &str = "this socket understands";

/// Text of the command that reads the state of the gateway and changes nothing.
const STATUS: &str = "status";

/// Maximum duration of a trace.
pub const LONGEST_TRACE: Duration = Duration::from_secs(24 * 3600);
/// Time after the end of a trace in which the gateway may still send the last line of the trace.
const SLACK: Duration = Duration::from_secs(5);

/// Returns advice for the operator if the path is too long for a socket, otherwise `None`.
pub fn too_long(path: &Path) -> Option<String> {
    /// Longest path that fits into `sockaddr_un`, in bytes.
    const LONGEST_PATH: usize = 107;
    let length = path.as_os_str().len();
    (length > LONGEST_PATH).then(|| {
        format!(
            "the path of the command socket has {length} bytes, at most {LONGEST_PATH} are possible: shorten \
             the state directory (--state, or [history] directory) or machine name"
        )
    })
}

/// Opens the command socket, for its owner and group only. Replaces a socket file that an ended gateway has left
/// behind.
///
/// # Errors
/// Another gateway answers on the socket, or the directory cannot be written.
pub fn open(path: &Path) -> std::io::Result<std::os::unix::net::UnixListener> {
    let refused = |kind, why: String| Error::new(kind, format!("{}: {why}", path.display()));
    if let Some(why) = too_long(path) {
        return Err(refused(ErrorKind::InvalidInput, why));
    }
    if let Ok(found) = path.symlink_metadata() {
        if !found.file_type().is_socket() {
            let why = "another file is at the path of the command socket: move that file away";
            return Err(refused(ErrorKind::AlreadyExists, why.to_owned()));
        }
        match presence(path) {
            Presence::Absent => {}
            Presence::Answers => {
                let why = "another gateway of this machine is running (it answers on this socket): end it first, \
                           or replace it with `isotherm restart PROFILE --keep`";
                return Err(refused(ErrorKind::AddrInUse, why.to_owned()));
            }
            Presence::Forbidden => {
                let why = format!("perhaps another gateway of this machine is running: {}", forbidden(path));
                return Err(refused(ErrorKind::PermissionDenied, why));
            }
        }
        std::fs::remove_file(path).map_err(|error| refused(error.kind(), system(&error)))?;
    }
    let open = || {
        path.parent().map_or(Ok(()), make_directory)?;
        let listener = std::os::unix::net::UnixListener::bind(path)?;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o660))?;
        Ok(listener)
    };
    let listener = open().map_err(|error: Error| {
        refused(error.kind(), format!("the command socket cannot be created: {}", system(&error)))
    })?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// Context that all connections of the command socket share: handles of the gateway, and limits.
#[derive(Clone)]
struct ControlContext {
    source: Arc<dyn GatewayApi>,
    wire_log: WireLog,
    successor: Option<Successor>,
    attendance: ServiceTimes,
    /// Permits for clients that wait with `stay`, trace a device, or restart the gateway. The number of permits is
    /// half the limit of connections.
    stays: Arc<Semaphore>,
}

/// Answers commands on at most `most` connections at once, until the task is dropped.
///
/// # Errors
/// The asynchronous runtime cannot use the listener.
pub async fn serve(
    listener: std::os::unix::net::UnixListener,
    source: Arc<dyn GatewayApi>,
    wire_log: WireLog,
    successor: Option<Successor>,
    most: usize,
) -> std::io::Result<()> {
    let mut listener = UnixListener::from_std(listener)?;
    let attendance = ServiceTimes::default();
    let stays = Arc::new(Semaphore::new(most.div_ceil(2)));
    let desk = ControlContext { source, wire_log, successor, attendance: attendance.clone(), stays };
    let places = Arc::new(Semaphore::new(most));
    let silent = SilentConnections::of(most);
    let mut deleted = Ticks::every(DELETED);
    let accepting = async {
        loop {
            let accepted = tokio::select! {
                accepted = listener.accept() => accepted,
                () = deleted.next() => {
                    listener = made_again(listener);
                    continue;
                }
            };
            let Ok((stream, _)) = accepted else {
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            };
            // The semaphore is never closed.
            let Some(place) = silent.place(&places).await else { return };
            let (desk, closed) = (desk.clone(), silent.enter());
            tokio::spawn(async move {
                // An error only means that the client has disconnected.
                let _ = desk.serve(stream, closed).await;
                drop(place);
            });
        }
    };
    tokio::select! {
        () = accepting => Ok(()),
        () = attendance.keep() => Ok(()),
    }
}

/// Returns the listener. If the socket file of the listener was deleted, tries to create the socket again, and
/// returns the new listener.
fn made_again(listener: UnixListener) -> UnixListener {
    let address = listener.local_addr().ok();
    let gone = address.as_ref().and_then(|address| address.as_pathname()).filter(|path| !path.exists());
    let again = gone.and_then(|path| open(path).ok()).and_then(|again| UnixListener::from_std(again).ok());
    again.unwrap_or(listener)
}

impl ControlContext {
    async fn serve(&self, stream: UnixStream, closed: Closed) -> std::io::Result<()> {
        let who = user::name(&stream);
        let connection: Arc<Connection> = Arc::new(stream.as_fd().try_clone_to_owned()?);
        let (mut reader, mut writer) = stream.into_split();
        let received = tokio::select! {
            biased;
            received = tokio::time::timeout(ANSWER_TIMEOUT, receive(&mut reader)) => received.ok().flatten().unwrap_or_default(),
            _ = closed => return Ok(()),
        };
        let (trace, line) = (TraceRequest::parse(received.trim()), Line::parse(received.trim()));
        let restart = restart::Request::parse(received.trim());
        let stays = trace.is_some()
            || restart.is_some_and(restart::Request::stays)
            || line.as_ref().is_some_and(|line| line.stays);
        let _place = match stays.then(|| self.stays.try_acquire()).transpose() {
            Ok(place) => place,
            Err(_) => return say(&mut writer, TOO_MANY).await,
        };
        if let Some(request) = trace {
            return serve_trace(request, &self.wire_log, reader, writer).await;
        }
        if let Some(request) = restart {
            return restart::serve(self, request, (who, &connection), &mut writer).await;
        }
        if received.trim() == STATUS {
            return say(&mut writer, &format!("ok {}\n", document(&self.source.status()))).await;
        }
        let Some(line) = line else {
            let known = format!(
                "error {UNKNOWN} arm, disarm, zero, cancel, sign, adopt, measured, confirm, release, trace, status, restart\n"
            );
            return say(&mut writer, &known).await;
        };
        let requester = line.requester(who, &connection, &self.attendance);
        let said = match line.execute(self.source.as_ref(), &requester) {
            Ok(Answer::Waits(_)) => return follow(self.source.as_ref(), &line, &mut writer).await,
            Ok(Answer::Done(said)) => said_in_a_line("ok", &said),
            Ok(Answer::TooSoon(why)) | Err(why) => said_in_a_line("error", &why),
        };
        say(&mut writer, &said).await
    }
}

/// Sends text to a client. Returns an error if the client does not read the text in time; its connection is then
/// closed.
async fn say(writer: &mut OwnedWriteHalf, text: &str) -> std::io::Result<()> {
    tokio::time::timeout(ANSWER_TIMEOUT, writer.write_all(text.as_bytes())).await?
}

/// Formats an answer as one line. Line breaks and control characters of the text are replaced.
fn said_in_a_line(word: &str, text: &str) -> String {
    format!("{word} {}\n", one_line(text))
}

/// Sends the result of arming or of a sign check to the client. If the request contains `stay`, the client first
/// receives the conditions that are not met yet.
async fn follow(
    source: &dyn GatewayApi,
    line: &Line<'_>,
    writer: &mut OwnedWriteHalf,
) -> std::io::Result<()> {
    let (mut waited, mut said, mut still) = (Duration::ZERO, String::new(), Duration::ZERO);
    loop {
        let progress = match line.what {
            ParsedCommand::Command(Command::Sign) => source.signing(line.axis),
            _ => source.arming(line.axis),
        };
        let text = match progress {
            Ok(Answer::Done(text)) => {
                say(writer, &said_in_a_line("ok", &text)).await?;
                wait_for_answer(source, line).await;
                return Ok(());
            }
            Ok(Answer::TooSoon(why)) | Err(why) => {
                return say(writer, &said_in_a_line("error", &why)).await;
            }
            Ok(Answer::Waits(text)) => text,
        };
        if !line.stays && waited >= ARMING {
            return say(writer, &said_in_a_line("waits", &text)).await;
        }
        if line.stays && waited >= SHORTLY && text != said {
            say(writer, &said_in_a_line("waits", &text)).await?;
            (said, still) = (text, Duration::ZERO);
        } else if line.stays && still >= STILL {
            say(writer, "still\n").await?;
            still = Duration::ZERO;
        }
        tokio::time::sleep(LOOK_AGAIN).await;
        waited += LOOK_AGAIN;
        still += LOOK_AGAIN;
    }
}

/// Waits until the sign check of the client is over, because the end of its connection would end the sign check.
/// Returns at once for any other request.
async fn wait_for_answer(source: &dyn GatewayApi, line: &Line<'_>) {
    let is_sign_check = line.stays && line.what == ParsedCommand::Command(Command::Sign);
    while is_sign_check && source.signing(line.axis).is_ok() {
        tokio::time::sleep(LOOK_AGAIN).await;
    }
}

/// Parsed command line of a client: the command and its further words.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Line<'a> {
    what: ParsedCommand<'a>,
    axis: Option<&'a str>,
    /// Time and identification (`time=` and `id=`) of a measurement, as text.
    time: Option<&'a str>,
    id: Option<&'a str>,
    /// Deadline of the command, as time since the start of the computer. After the deadline, the command is not carried
    /// out.
    until: Option<Duration>,
    stays: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum ParsedCommand<'a> {
    Command(Command),
    /// Axis and its measured error, µm. With `None`, the correction from earlier measured errors is removed.
    Measured(&'a str, Option<f64>),
    /// Name of a device that the operator has checked.
    Confirm(&'a str),
}

impl<'a> Line<'a> {
    /// Parses a line of text. Returns `None` if a word of the line is unknown or invalid.
    fn parse(text: &'a str) -> Option<Line<'a>> {
        let mut words = text.split(' ');
        let what = match words.next()? {
            "measured" => {
                let (axis, error) = (words.next()?, words.next()?);
                ParsedCommand::Measured(axis, if error == "clear" { None } else { Some(error.parse().ok()?) })
            }
            "confirm" => ParsedCommand::Confirm(words.next()?),
            word => ParsedCommand::Command(Command::ALL.into_iter().find(|(name, _)| *name == word)?.1),
        };
        let mut line = Line { what, axis: None, time: None, id: None, until: None, stays: false };
        for word in words {
            match word.split_once('=') {
                Some(("axis", axis)) if matches!(what, ParsedCommand::Command(_)) => line.axis = Some(axis),
                Some(("time", time)) if matches!(what, ParsedCommand::Measured(_, Some(_))) => {
                    line.time = Some(time)
                }
                Some(("id", id)) if matches!(what, ParsedCommand::Measured(_, Some(_))) => line.id = Some(id),
                Some(("until", seconds)) => {
                    line.until = Some(Duration::try_from_secs_f64(seconds.parse().ok()?).ok()?);
                }
                None if word == "stay" && line.may_stay() => line.stays = true,
                _ => return None,
            }
        }
        Some(line)
    }

    /// Returns whether the command may be sent with `stay`.
    fn may_stay(&self) -> bool {
        matches!(self.what, ParsedCommand::Command(Command::Arm | Command::Sign))
    }

    fn requester(
        &self,
        who: String,
        connection: &Arc<Connection>,
        attendance: &ServiceTimes,
    ) -> Arc<Requester> {
        let until = self.until.unwrap_or_else(|| attendance.until());
        let requester = Requester::new(Channel::Socket, who).until(until).at(connection);
        Arc::new(if self.stays { requester.staying() } else { requester })
    }

    fn execute(&self, source: &dyn GatewayApi, requester: &Arc<Requester>) -> Result<Answer, String> {
        match self.what {
            ParsedCommand::Command(command) => source.command(command, self.axis, requester),
            ParsedCommand::Measured(axis, error) => {
                let report = error.map(|error| MeasuredReport::new(error, self.time, self.id));
                source.measured(axis, report.transpose()?, requester)
            }
            ParsedCommand::Confirm(device) => source.confirm(device, requester),
        }
    }
}

/// Formats the state as JSON, with a text for the state of each axis and with the reasons why the machine is not
/// compensated.
fn document(status: &Status) -> serde_json::Value {
    // Numbers and texts always have a JSON form.
    let mut document = serde_json::to_value(status).unwrap_or_default();
    for (place, axis) in status.axes.iter().enumerate() {
        document["axes"][place]["display"] = axis.display().into();
    }
    document["missing"] = status.missing().into();
    document
}

async fn receive(reader: &mut OwnedReadHalf) -> Option<String> {
    let mut line = String::new();
    tokio::io::BufReader::new(reader.take(LONGEST)).read_line(&mut line).await.ok()?;
    Some(line)
}

/// Request to trace the exchanges of a device.
struct TraceRequest {
    device: String,
    span: Duration,
    json: bool,
}

impl TraceRequest {
    /// Parses a request to trace a device. Returns `None` if the line is another command.
    fn parse(line: &str) -> Option<TraceRequest> {
        let mut parts = line.strip_prefix("trace ")?.split(' ');
        let (device, seconds, form) = (parts.next()?, parts.next()?, parts.next()?);
        let json = match form {
            "text" => false,
            "json" => true,
            _ => return None,
        };
        let span = Duration::try_from_secs_f64(seconds.parse().ok()?).ok()?.min(LONGEST_TRACE);
        Some(TraceRequest { device: device.to_owned(), span, json })
    }
}

/// Sends each exchange with the device to the client, until the duration is over or the client disconnects.
async fn serve_trace(
    request: TraceRequest,
    wire_log: &WireLog,
    mut reader: OwnedReadHalf,
    mut writer: OwnedWriteHalf,
) -> std::io::Result<()> {
    let mut listening = match wire_log.listen(&request.device) {
        Ok(listening) => listening,
        Err(why) => return say(&mut writer, &format!("error {why}\n")).await,
    };
    say(&mut writer, &format!("ok listening to {}\n", request.device)).await?;
    let mut count = 0_u64;
    let over = tokio::time::timeout(request.span, async {
        let mut nothing = [0];
        tokio::select! {
            shown = show(&mut listening, &mut writer, request.json, &mut count) => shown,
            // The client has disconnected.
            _ = reader.read(&mut nothing) => Err(std::io::ErrorKind::BrokenPipe.into()),
        }
    });
    if let Ok(gone) = over.await {
        return gone;
    }
    let dropped = listening.dropped();
    drop(listening);
    say(&mut writer, &ended(count, dropped)).await
}

async fn show(
    listening: &mut ExchangeReceiver,
    writer: &mut OwnedWriteHalf,
    json: bool,
    count: &mut u64,
) -> std::io::Result<()> {
    while let Some(exchange) = listening.next().await {
        writer.write_all(line(&exchange, json).as_bytes()).await?;
        *count += 1;
    }
    Ok(())
}

fn line(exchange: &Exchange, json: bool) -> String {
    if json {
        // Numbers and texts always have a JSON form.
        serde_json::to_string(exchange).unwrap_or_default() + "\n"
    } else {
        format!("{exchange}\n")
    }
}

fn ended(count: u64, dropped: u64) -> String {
    let left_out = match dropped {
        0 => String::new(),
        dropped => format!(", {dropped} more left out because the client was too slow"),
    };
    match count {
        0 => {
            "end nothing was sent to the device: the gateway pauses after a failure (see the events), or the \
             profile reads nothing from the device\n"
                .to_owned()
        }
        count => format!("end {}{left_out}\n", counted(count, "exchange")),
    }
}

#[cfg(test)]
mod tests;
