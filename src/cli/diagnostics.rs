//! Log of the program on stderr.

use std::io::IsTerminal;

use tracing_appender::non_blocking::{NonBlockingBuilder, WorkerGuard};

use super::journal_stream;
use super::log_rate_limit::LogRateLimit;
use isotherm_profile::one_line;

/// Maximum number of log lines that wait for a slow reader. Further lines are dropped.
const UNREAD: usize = 2048;
/// Filter that disables the log of the OPC UA library, because that log may contain secrets. The gateway logs its own
/// messages about OPC UA instead.
const SILENT: &str = "opcua_client=off,opcua_core=off,opcua_crypto=off,opcua_nodes=off,opcua_server=off,\
                      opcua_types=off";

/// Starts the log on stderr, in the format of the system journal if stderr leads to the journal. A separate thread
/// writes the lines, so that a slow reader of stderr does not block the program. When the returned value is dropped,
/// the pending lines are written.
pub(super) fn start_log(filter: &str) -> WorkerGuard {
    use tracing_subscriber::field::MakeExt;
    use tracing_subscriber::filter::{FilterExt, Targets};
    use tracing_subscriber::fmt::format::debug_fn;
    use tracing_subscriber::layer::{Layer, SubscriberExt};
    use tracing_subscriber::util::SubscriberInitExt;
    let targets = |filter: &str| format!("{filter},{SILENT}").parse::<Targets>();
    let filter = targets(filter).or_else(|_| targets("info")).unwrap_or_default();
    let (writer, guard) =
        NonBlockingBuilder::default().buffered_lines_limit(UNREAD).finish(std::io::stderr());
    // Text from outside must not end a line or control the terminal. All values except the message are quoted.
    let fields = debug_fn(|writer, field, value| match field.name() {
        "message" => write!(writer, "{}", one_line(&format!("{value:?}"))),
        name => write!(writer, "{name}={}", one_line(&format!("{value:?}"))),
    });
    let lines = tracing_subscriber::fmt::layer()
        .fmt_fields(fields.delimited(" "))
        .with_writer(writer)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false);
    let lines = match journal_stream::is_stderr() {
        true => lines.event_format(journal_stream::Prioritised::new()).boxed(),
        false => lines.boxed(),
    };
    // If this process has started a log already, as in tests, that log remains.
    let _ =
        tracing_subscriber::registry().with(lines.with_filter(filter.and(LogRateLimit::begin()))).try_init();
    guard
}
