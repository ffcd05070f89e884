//! Log format for the system journal on standard error. Each line begins with its priority (`<4>`) as in sd-daemon(3).
//! The lines contain no time, because the system journal adds one.

use std::fmt;

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::fmt::format::{Format, FormatEvent, FormatFields, Full, Writer};
use tracing_subscriber::fmt::{FmtContext, format};
use tracing_subscriber::registry::LookupSpan;

const ERROR: u8 = 3;
const WARNING: u8 = 4;

/// Returns whether standard error leads to the system journal of the service manager, not to a file or a pipe.
pub(super) fn is_stderr() -> bool {
    let Ok(stream) = std::env::var("JOURNAL_STREAM") else { return false };
    let Ok(stderr) = rustix::fs::fstat(std::io::stderr()) else { return false };
    stream == format!("{}:{}", stderr.st_dev, stderr.st_ino)
}

/// Log format with the priority before each line.
pub(super) struct Prioritised(Format<Full, ()>);

impl Prioritised {
    pub(super) fn new() -> Prioritised {
        Prioritised(format().without_time().with_target(false).with_ansi(false).with_level(false))
    }
}

impl<S, N> FormatEvent<S, N> for Prioritised
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        write!(writer, "<{}>", priority(*event.metadata().level()))?;
        self.0.format_event(context, writer, event)
    }
}

/// Returns a message for stderr with the priority before each of its lines.
pub(super) fn prioritised(text: &str) -> String {
    let priority = if text.starts_with("warning") { WARNING } else { ERROR };
    text.split('\n').map(|line| format!("<{priority}>{line}")).collect::<Vec<_>>().join("\n")
}

fn priority(level: Level) -> u8 {
    match level {
        Level::ERROR => ERROR,
        Level::WARN => WARNING,
        Level::INFO => 6,
        _ => 7,
    }
}
