//! Where standard error is the journal of the system: each line begins with its priority (`<4>`), as sd-daemon(3) has it, and
//! without a time, which stands beside it there.

use std::fmt;

use tracing::{Event, Level, Subscriber};
use tracing_subscriber::fmt::format::{Format, FormatEvent, FormatFields, Full, Writer};
use tracing_subscriber::fmt::{FmtContext, format};
use tracing_subscriber::registry::LookupSpan;

const ERROR: u8 = 3;
const WARNING: u8 = 4;

/// Standard error is the stream that the service manager gave this process, and not a file or a pipe in its place.
pub(super) fn is_stderr() -> bool {
    let Ok(stream) = std::env::var("JOURNAL_STREAM") else { return false };
    let Ok(stderr) = rustix::fs::fstat(std::io::stderr()) else { return false };
    stream == format!("{}:{}", stderr.st_dev, stderr.st_ino)
}

/// A line of the log with its priority before it.
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

/// The lines of what a verb says beside its result, each with its priority.
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
