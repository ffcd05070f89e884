//! `isotherm trace`: shows the frames between the running gateway and one device.

use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use super::loading::{ProfileArguments, load};
use super::values;
use super::{command::RunningGateway, new_file};
use crate::cli::print::{Out, say_beside};
use crate::gateway::control;

/// Shows the traffic between the running gateway and one of its devices: the bytes and meaning of each frame, and the
/// response time. Timeouts and invalid answers are included.
///
/// A trace changes nothing on the line. While no trace is active, tracing uses no processor time. Times are
/// UTC.
#[derive(clap::Args, Debug)]
#[command(
    mut_arg("json", |json| json.help("Prints one JSON document on each line")),
    after_help = "Examples:\n  isotherm trace my-machine.toml --device cnc\n  isotherm trace my-machine.toml --device cnc \
                  --for 10min --out cnc.log"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The device, by its name in the profile
    #[arg(long, value_name = "DEVICE")]
    device: String,
    /// Duration of the trace, at most 24h
    #[arg(long = "for", value_name = "SPAN", default_value = "60s", value_parser = span)]
    span: Duration,
    /// Writes the trace to a new file instead of stdout
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    gateway: RunningGateway,
}

fn span(text: &str) -> Result<Duration, String> {
    values::span(text, control::LONGEST_TRACE, "write a time above zero and of at most 24h, such as 60s")
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile, device, span, out, gateway } = arguments;
    let profile = load(profile, gateway.json)?;
    let socket = gateway.socket(&profile)?;
    let mut to: Box<dyn Write> = match out {
        Some(path) => Box::new(new_file::create(path, "")?),
        None => Box::new(Out),
    };
    let mut written = Ok(());
    let said = control::trace(&socket, device, *span, gateway.json, |line| {
        written = writeln!(to, "{line}").and_then(|()| to.flush());
        written.is_ok()
    });
    written.map_err(|error| match out {
        Some(path) => new_file::cannot_be_written(path, &error),
        None => error.into(),
    })?;
    say_beside!("{}", said?);
    Ok(())
}
