//! `isotherm read`: one reading of every signal.

use std::io::{IsTerminal, Write};

use super::gauge::{self, Gauge};
use super::{Failure, ProfileArguments, load, print_json};

/// One reading of every signal with its quality. Reads only.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  isotherm read my-machine.toml\n  isotherm read my-machine.toml --watch")]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// Keep going, each second, until Ctrl-C
    #[arg(long)]
    watch: bool,
    /// One JSON document (with --watch one a line)
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let profile = load(&arguments.profile, arguments.json)?;
    if !arguments.watch {
        let status = gauge::once(profile)?;
        if arguments.json {
            print_json(&serde_json::json!({ "now": status.now, "signals": status.signals }))?;
        } else {
            print!("{}", Gauge(&status));
        }
        return gauge::judge(&status);
    }
    let redraw = std::io::stdout().is_terminal() && !arguments.json;
    gauge::watch(profile, |status| {
        let text = if arguments.json {
            format!("{}\n", serde_json::json!({ "now": status.now, "signals": status.signals }))
        } else if redraw {
            format!("\x1b[H\x1b[2J{}\n{}", status.now, Gauge(&status))
        } else {
            format!("{}\n{}", status.now, Gauge(&status))
        };
        // A reader that went away ends it.
        std::io::stdout().write_all(text.as_bytes()).and_then(|()| std::io::stdout().flush()).is_ok()
    })
}
