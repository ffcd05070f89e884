//! `isotherm read`: reads every signal once, or one register without a signal.

use std::io::IsTerminal;

use super::hints::Hints;
use super::print::print_json;
use super::read_once;
use super::run::known_directory;
use super::target::Target;
use super::values::wrong_arguments;
use crate::cli::print::{clear, say_all, say_beside};
use crate::discovery::new_connection::NewConnectionAdvice;
use crate::observe::status::Status;

#[cfg(feature = "opcua")]
mod nodes;
mod register;

/// Reads every signal once and shows its quality. With --register, reads one register that needs no signal in the
/// profile. Writes nothing.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm read my-machine.toml\n  isotherm read my-machine.toml --watch\n  \
                  isotherm read my-machine.toml --device cnc --register holding:104 --type i32\n  \
                  isotherm read --bus tcp://192.168.0.10:502 --unit 1 --register 40101 --type i32 --word-order msw-first \
                  --count 4 --scale 0.1 --watch"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    target: Target,
    #[command(flatten)]
    one: register::One,
    #[cfg(feature = "opcua")]
    #[command(flatten)]
    nodes: nodes::Nodes,
    /// Reads again each second until Ctrl-C
    #[arg(long)]
    watch: bool,
    /// Prints one JSON document; with --watch, one document on each line
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.one.is_asked_for() {
        return register::run(&arguments.target, &arguments.one, arguments.watch, arguments.json);
    }
    #[cfg(feature = "opcua")]
    if arguments.nodes.is_asked_for() {
        return nodes::run(&arguments.target, &arguments.nodes, arguments.json);
    }
    if arguments.target.is_at_a_server() {
        return Err(wrong_arguments("an OPC UA server has nodes, not registers: add --browse"));
    }
    let Some(profile) = arguments.target.load(arguments.json)? else {
        return Err(wrong_arguments(
            "give a PROFILE, or a bus line, a unit and a register: --bus tcp://HOST --unit 1 --register holding:0",
        ));
    };
    if arguments.target.bus.is_some() || arguments.target.timeout.is_some() {
        return Err(wrong_arguments("--bus and --timeout need --register, the register to read"));
    }
    let document = |status: &Status| serde_json::json!({ "now": status.now, "signals": status.signals });
    let directory = known_directory(profile.history.directory.as_deref());
    if !arguments.watch {
        let status = read_once::once(profile.clone(), directory)?;
        if arguments.json {
            print_json(&document(&status))?;
        } else {
            say_all!("{}", read_once::signals(&status, &mut Hints::default()))?;
        }
        for NewConnectionAdvice { device, advice, .. } in read_once::examined(&profile, &status)? {
            say_beside!("device {device}: {advice}");
        }
        return read_once::assess(&status);
    }
    let redraws = std::io::stdout().is_terminal() && !arguments.json;
    read_once::watch(profile, directory, |status| {
        let text = if arguments.json {
            format!("{}\n", document(&status))
        } else {
            format!("{}\n{}", status.now, read_once::signals(&status, &mut Hints::default()))
        };
        // A closed stdout ends it.
        (!redraws || clear().is_ok()) && say_all!("{text}").is_ok()
    })
}
