//! Commands to a running gateway over its own Unix socket in the state directory: `isotherm arm`, `disarm`, `zero`, `measured`.
//!
//! One line in, one line out: `arm` → `ok z: armed`, `ok z: will be armed …` or `error …`; `measured z 3.2`, in µm, and `measured z
//! clear`. `trace` has an answer of many lines. Who may open the file may command.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt};
use tokio::net::{UnixListener, unix::OwnedReadHalf};

use super::WireLog;
use crate::observe::status::{Command, Source};

mod trace;

pub use trace::{LONGEST as LONGEST_TRACE, trace};

/// How long whoever arms waits to hear what comes of it.
const ARMING: Duration = Duration::from_secs(3);
const LOOK_AGAIN: Duration = Duration::from_millis(20);
const LONGEST: u64 = 256;

/// The socket of a machine.
pub fn path(directory: &Path, machine: &str) -> PathBuf {
    directory.join(format!("{machine}.sock"))
}

/// Opens the socket, for the owner and its group only. One left behind by a gateway that is gone is replaced.
///
/// # Errors
/// Where another gateway answers on it, or the directory cannot be written.
pub fn open(path: &Path) -> std::io::Result<std::os::unix::net::UnixListener> {
    if UnixStream::connect(path).is_ok() {
        let message =
            format!("another gateway of this machine is running (it answers on {})", path.display());
        return Err(std::io::Error::new(std::io::ErrorKind::AddrInUse, message));
    }
    let _ = std::fs::remove_file(path);
    if let Some(directory) = path.parent() {
        std::fs::create_dir_all(directory)?;
    }
    let listener = std::os::unix::net::UnixListener::bind(path)?;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o660))?;
    listener.set_nonblocking(true)?;
    Ok(listener)
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
            let heard = tokio::time::timeout(Duration::from_secs(5), hear(&mut reader)).await;
            let heard = heard.ok().flatten().unwrap_or_default();
            if let Some(request) = trace::TraceRequest::parse(heard.trim()) {
                // It ends with its asker.
                let _ = trace::serve(request, &wire_log, reader, writer).await;
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
    ask(path, name.map_or("", |(name, _)| name))
}

/// Sends an axis's measured error, µm; `None` takes back what such errors have taught.
///
/// # Errors
/// A sentence: no gateway runs there, or what it refused and why.
pub fn send_measured(path: &Path, axis: &str, error_um: Option<f64>) -> Result<String, String> {
    let error = error_um.map_or_else(|| "clear".to_owned(), |error| error.to_string());
    ask(path, &format!("measured {axis} {error}"))
}

fn ask(path: &Path, line: &str) -> Result<String, String> {
    let explain = |error: std::io::Error| no_gateway(path, &error);
    let mut stream = UnixStream::connect(path).map_err(explain)?;
    stream.set_read_timeout(Some(Duration::from_secs(5))).map_err(explain)?;
    writeln!(stream, "{line}").map_err(explain)?;
    let mut answer = String::new();
    BufReader::new(stream).read_line(&mut answer).map_err(explain)?;
    match answer.trim().split_once(' ') {
        Some(("ok", said)) => Ok(said.to_owned()),
        Some((_, why)) => Err(why.to_owned()),
        None => Err("the gateway gave no answer".to_owned()),
    }
}

fn no_gateway(path: &Path, error: &std::io::Error) -> String {
    format!(
        "no gateway of this machine is running here ({}: {error}); start it with `isotherm run`",
        path.display()
    )
}

fn command(name: &str) -> Option<Command> {
    Command::ALL.into_iter().find(|(known, _)| *known == name).map(|(_, command)| command)
}

#[cfg(test)]
mod tests;
