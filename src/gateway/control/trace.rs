//! `isotherm trace`: the one command whose answer is many lines: the exchanges of a device as they happen.
//!
//! `trace cnc 60 text` → `ok listening to cnc`, two lines an exchange (or with `json` one), and at last `end` with their
//! number. It ends by itself after that many seconds, or as soon as the asker is gone.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};

use super::no_gateway;
use crate::fieldbus::trace::{Exchange, Listening};
use crate::gateway::WireLog;

/// No wire log is kept for longer.
pub const LONGEST: Duration = Duration::from_secs(24 * 3600);
/// How much longer than the log itself its last line may take.
const SLACK: Duration = Duration::from_secs(5);

/// What a line asks for.
pub(super) struct TraceRequest {
    device: String,
    pub(super) span: Duration,
    json: bool,
}

impl TraceRequest {
    /// `None` where the line is another command.
    pub(super) fn parse(line: &str) -> Option<TraceRequest> {
        let mut parts = line.strip_prefix("trace ")?.split(' ');
        let (device, seconds, form) = (parts.next()?, parts.next()?, parts.next()?);
        let json = match form {
            "text" => false,
            "json" => true,
            _ => return None,
        };
        let span = Duration::try_from_secs_f64(seconds.parse().ok()?).ok()?.min(LONGEST);
        Some(TraceRequest { device: device.to_owned(), span, json })
    }
}

/// Shows the exchanges of a device to the asker.
pub(super) async fn serve(
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
    let explain = |error: std::io::Error| no_gateway(path, &error);
    let mut stream = UnixStream::connect(path).map_err(explain)?;
    stream.set_read_timeout(Some(span.min(LONGEST) + SLACK)).map_err(explain)?;
    let form = if json { "json" } else { "text" };
    writeln!(stream, "trace {device} {} {form}", span.as_secs_f64()).map_err(explain)?;
    let mut lines = BufReader::new(stream).lines();
    match lines.next().transpose().map_err(explain)?.as_deref().and_then(|line| line.split_once(' ')) {
        Some(("ok", _)) => {}
        Some((_, why)) => return Err(why.to_owned()),
        None => return Err("the gateway gave no answer".to_owned()),
    }
    for line in lines {
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
