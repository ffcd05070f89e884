//! Commands to a running gateway over its own Unix socket in the state directory: `isotherm arm`, `disarm`, `zero`, `measured`.
//!
//! One line in, one line out: `arm` → `ok z: armed`, `ok z: will be armed …` or `error …`; `measured z 3.2`, in µm, and `measured z
//! clear`. Who may open the file may command.
//!
//! One command has an answer of many lines: the exchanges of a device as they happen (`isotherm trace`). `trace cnc 60 text`
//! → `ok listening to cnc`, two lines an exchange (or with `json` one), and at last `end` with their number. It ends by
//! itself after that many seconds, or as soon as the asker is gone.

use std::io::{BufRead, BufReader, Error, ErrorKind, Lines, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt};
use tokio::net::UnixListener;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};

use super::WireLog;
use super::disk::make_directory;
use crate::fieldbus::trace::{Exchange, Listening};
use crate::observe::status::{Command, Source};

/// How long whoever arms waits to hear what comes of it.
const ARMING: Duration = Duration::from_secs(3);
const LOOK_AGAIN: Duration = Duration::from_millis(20);
/// How long another gateway is looked for.
const LOOK_FOR: Duration = Duration::from_secs(1);
const LONGEST: u64 = 256;
/// How long a gateway is waited for.
const PATIENCE: Duration = Duration::from_secs(5);

/// No wire log is kept for longer.
pub const LONGEST_TRACE: Duration = Duration::from_secs(24 * 3600);
/// How much longer than the log itself its last line may take.
const SLACK: Duration = Duration::from_secs(5);

/// The socket of a machine.
pub fn path(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.sock"))
}

/// Opens the socket, for the owner and its group only. One left behind by a gateway that is gone is replaced.
///
/// # Errors
/// Where another gateway answers on it, or the directory cannot be written.
pub fn open(path: &Path) -> std::io::Result<std::os::unix::net::UnixListener> {
    let refused = |kind, why: String| Error::new(kind, format!("{}: {why}", path.display()));
    if let Ok(found) = path.symlink_metadata() {
        if !found.file_type().is_socket() {
            let why = "the command socket belongs here, and something else lies here: move it away";
            return Err(refused(ErrorKind::AlreadyExists, why.to_owned()));
        }
        if is_answered(path) {
            let why = "another gateway of this machine is running (it answers there)";
            return Err(refused(ErrorKind::AddrInUse, why.to_owned()));
        }
        std::fs::remove_file(path).map_err(|error| refused(error.kind(), error.to_string()))?;
    }
    let open = || {
        path.parent().map_or(Ok(()), make_directory)?;
        let listener = std::os::unix::net::UnixListener::bind(path)?;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o660))?;
        Ok(listener)
    };
    let listener = open().map_err(|error: Error| {
        refused(error.kind(), format!("the command socket cannot be made: {error}"))
    })?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// Somebody listens on a socket; or has so many waiting that not even that can be known in this time.
fn is_answered(path: &Path) -> bool {
    let (tell, answer) = std::sync::mpsc::channel();
    let path = path.to_owned();
    std::thread::spawn(move || tell.send(UnixStream::connect(path).is_ok()));
    answer.recv_timeout(LOOK_FOR).unwrap_or(true)
}

/// Answers commands until the task is dropped.
///
/// # Errors
/// Where the listener cannot be used by this runtime.
pub async fn serve(
    listener: std::os::unix::net::UnixListener,
    source: Arc<dyn Source>,
    wire_log: WireLog,
) -> std::io::Result<()> {
    let listener = UnixListener::from_std(listener)?;
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        let (source, wire_log) = (source.clone(), wire_log.clone());
        tokio::spawn(async move {
            let (mut reader, mut writer) = stream.into_split();
            let heard = tokio::time::timeout(PATIENCE, hear(&mut reader)).await;
            let heard = heard.ok().flatten().unwrap_or_default();
            if let Some(request) = TraceRequest::parse(heard.trim()) {
                // It ends with its asker.
                let _ = serve_trace(request, &wire_log, reader, writer).await;
                return;
            }
            let mut done = execute(heard.trim(), source.as_ref());
            if let (Some(Ok(_)), Some(Command::Arm)) = (&done, command(heard.trim()))
                && let Some(became) = armed(source.as_ref()).await
            {
                done = Some(became);
            }
            let answer = match done {
                Some(Ok(said)) => format!("ok {said}\n"),
                Some(Err(why)) => format!("error {why}\n"),
                None => "error this socket understands arm, disarm, zero, measured, trace\n".to_owned(),
            };
            let _ = writer.write_all(answer.as_bytes()).await;
        });
    }
}

/// What comes of arming, if that is known before long.
async fn armed(source: &dyn Source) -> Option<Result<String, String>> {
    let known = async {
        loop {
            if let Some(became) = source.arming() {
                return became;
            }
            tokio::time::sleep(LOOK_AGAIN).await;
        }
    };
    tokio::time::timeout(ARMING, known).await.ok()
}

/// Does what a line asks for; `None` where it is not understood.
fn execute(line: &str, source: &dyn Source) -> Option<Result<String, String>> {
    let Some(measured) = line.strip_prefix("measured ") else { return Some(source.command(command(line)?)) };
    let (axis, error) = measured.rsplit_once(' ')?;
    let error = if error == "clear" { None } else { Some(error.parse().ok()?) };
    Some(source.measured(axis, error))
}

async fn hear(reader: &mut OwnedReadHalf) -> Option<String> {
    let mut line = String::new();
    tokio::io::BufReader::new(reader.take(LONGEST)).read_line(&mut line).await.ok()?;
    Some(line)
}

/// Sends a command to the running gateway; the answer is a sentence.
///
/// # Errors
/// A sentence: no gateway runs there, or what it refused and why.
pub fn send(path: &Path, command: Command) -> Result<String, String> {
    let name = Command::ALL.into_iter().find(|(_, known)| *known == command);
    Ok(ask(path, name.map_or("", |(name, _)| name), PATIENCE)?.0)
}

/// Sends an axis's measured error, µm; `None` takes back what such errors have taught.
///
/// # Errors
/// A sentence: no gateway runs there, or what it refused and why.
pub fn send_measured(path: &Path, axis: &str, error_um: Option<f64>) -> Result<String, String> {
    let error = error_um.map_or_else(|| "clear".to_owned(), |error| error.to_string());
    Ok(ask(path, &format!("measured {axis} {error}"), PATIENCE)?.0)
}

/// Sends a line: what the first line of the answer says, and the lines behind it.
fn ask(
    path: &Path,
    line: &str,
    patience: Duration,
) -> Result<(String, Lines<BufReader<UnixStream>>), String> {
    let no_gateway = |error: std::io::Error| {
        let path = path.display();
        format!("no gateway of this machine is running here ({path}: {error}); start it with `isotherm run`")
    };
    let mut stream = UnixStream::connect(path).map_err(no_gateway)?;
    stream.set_read_timeout(Some(patience)).map_err(no_gateway)?;
    writeln!(stream, "{line}").map_err(no_gateway)?;
    let mut lines = BufReader::new(stream).lines();
    let answer = lines.next().transpose().map_err(no_gateway)?.unwrap_or_default();
    match answer.split_once(' ') {
        Some(("ok", said)) => Ok((said.to_owned(), lines)),
        Some((_, why)) => Err(why.to_owned()),
        None => Err("the gateway gave no answer".to_owned()),
    }
}

fn command(name: &str) -> Option<Command> {
    Command::ALL.into_iter().find(|(known, _)| *known == name).map(|(_, command)| command)
}

/// What a line asks for.
struct TraceRequest {
    device: String,
    span: Duration,
    json: bool,
}

impl TraceRequest {
    /// `None` where the line is another command.
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

/// Shows the exchanges of a device to the asker.
async fn serve_trace(
    request: TraceRequest,
    wire_log: &WireLog,
    mut reader: OwnedReadHalf,
    mut writer: OwnedWriteHalf,
) -> std::io::Result<()> {
    let mut listening = match wire_log.listen(&request.device) {
        Ok(listening) => listening,
        Err(why) => return writer.write_all(format!("error {why}\n").as_bytes()).await,
    };
    writer.write_all(format!("ok listening to {}\n", request.device).as_bytes()).await?;
    let mut count = 0_u64;
    let over = tokio::time::timeout(request.span, async {
        let mut nothing = [0];
        tokio::select! {
            shown = show(&mut listening, &mut writer, request.json, &mut count) => shown,
            // Nobody is there any more.
            _ = reader.read(&mut nothing) => Err(std::io::ErrorKind::BrokenPipe.into()),
        }
    });
    if let Ok(gone) = over.await {
        return gone;
    }
    let dropped = listening.dropped();
    drop(listening);
    // One who reads nothing does not keep it.
    tokio::time::timeout(SLACK, writer.write_all(ended(count, dropped).as_bytes())).await?
}

async fn show(
    listening: &mut Listening,
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
        dropped => format!(", {dropped} more were left out because they were not taken fast enough"),
    };
    match count {
        0 => "end nothing was sent to it: it is left alone after a failure (see the events), or has nothing to read\n"
            .to_owned(),
        count => format!("end {count} exchanges{left_out}\n"),
    }
}

/// Listens to a device of the running gateway for this long; each line is shown as it comes, while `show` says so. The
/// answer is a sentence about all of them.
///
/// # Errors
/// A sentence: no gateway runs there, or what it refused and why.
pub fn trace(
    path: &Path,
    device: &str,
    span: Duration,
    json: bool,
    mut show: impl FnMut(&str) -> bool,
) -> Result<String, String> {
    let form = if json { "json" } else { "text" };
    let request = format!("trace {device} {} {form}", span.as_secs_f64());
    for line in ask(path, &request, span.min(LONGEST_TRACE) + SLACK)?.1 {
        let line = line.map_err(|error| format!("the gateway fell silent: {error}"))?;
        if let Some(said) = line.strip_prefix("end ") {
            return Ok(said.to_owned());
        }
        if !show(&line) {
            return Ok("ended".to_owned());
        }
    }
    Err("the gateway has ended".to_owned())
}

#[cfg(test)]
mod tests;
