//! Verbs (subcommands) of the command line, one module each. Results go to stdout, diagnostics to stderr.

use std::io::Write;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};
use clap::{CommandFactory, Parser, Subcommand};

use isotherm_profile::one_line;
use isotherm_profile::safe_file::without_numbers;

use crate::cli::print::{Out, print_json, say_beside};
use crate::gateway::control::Failure;
use crate::observe::status::Command;

mod adopt;
mod backup;
mod broker;
mod certificate;
mod check;
#[cfg(feature = "identify")]
mod columns;
mod command;
mod confirm;
mod connection_test;
mod demo;
mod descriptors;
mod diagnostics;
mod events;
#[cfg(feature = "identify")]
mod explain;
#[cfg(feature = "parquet")]
mod export;
#[cfg(any(feature = "identify", feature = "place"))]
mod extra_files;
mod hints;
#[cfg(feature = "identify")]
mod identify;
mod init;
mod journal_stream;
#[cfg(feature = "identify")]
mod learn;
mod loading;
mod log_rate_limit;
mod logs;
mod machines;
mod man;
mod measured;
mod new_file;
mod notices;
#[cfg(feature = "opcua")]
mod opcua;
#[cfg(feature = "opcua")]
mod opcua_server;
#[cfg(feature = "place")]
mod place;
mod port;
mod print;
#[cfg(any(feature = "identify", feature = "place"))]
mod progress;
mod read;
mod read_once;
mod record;
mod release;
pub mod replay;
#[cfg(feature = "identify")]
mod report;
mod restart;
mod restore;
mod run;
mod run_profile;
mod running;
#[cfg(feature = "identify")]
mod runs;
mod runtime;
mod scan;
#[cfg(feature = "identify")]
mod select;
mod service_user;
mod services;
mod sign;
mod signals;
mod simulate;
mod status;
mod target;
mod token;
mod trace;
mod values;
mod volume;

use loading::WrongProfile;
use values::WrongArguments;

/// Compensates the thermal error of a machine tool.
///
/// isotherm polls thermocouple modules and computes the thermal compensation Cz of each axis. It writes Cz as an offset
/// to the CNC, or the corrected position to a readout. It is not a safety function.
#[derive(Debug, Parser)]
#[command(
    version,
    max_term_width = 100,
    after_help = "Try it without hardware:  isotherm demo\nCheck a profile:          isotherm check my-machine.toml"
)]
pub struct Arguments {
    /// Log filter for stderr: error, warn, info, debug, or a filter such as `isotherm=debug`
    #[arg(long, global = true, value_name = "FILTER", env = "ISOTHERM_LOG", value_parser = values::log_filter)]
    log: Option<String>,
    /// Verb of the command line, with its arguments.
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Run the gateway with a virtual machine on real loopback sockets, without hardware
    Demo(demo::Arguments),
    /// Run the gateway
    Run(run::Arguments),
    /// Write a first profile from a few answers
    Init(Box<init::Arguments>),
    /// Check a profile: show every error with its line number; without errors, show everything that the gateway would
    /// read and write
    Check(check::Arguments),
    /// Read every signal once and show its quality, or read one register without a signal
    Read(Box<read::Arguments>),
    /// List the units (Modbus addresses) that answer on a bus line
    Scan(scan::Arguments),
    /// Serve the devices of a profile as virtual hardware
    Virtual(simulate::Arguments),
    /// Log readings for a later identification; write to no device
    Record(record::Arguments),
    /// Repeat the decisions of a recorded log with the code of the gateway, and compare them
    Replay(replay::Arguments),
    /// Identify the model of an axis from logs with the measured error, and test the model on runs that were not used
    /// to find it
    #[cfg(feature = "identify")]
    Identify(Box<identify::Arguments>),
    /// Learn the model of an axis from measurements of its probe, and compare this model with the model in use
    #[cfg(feature = "identify")]
    Learn(Box<learn::Arguments>),
    /// Select the temperature points to keep, from logs with a measured error
    #[cfg(feature = "identify")]
    Select(select::Arguments),
    /// Find places for the temperature sensors of a structure, from finite-element input files of its load cases
    #[cfg(feature = "place")]
    Place(Box<place::Arguments>),
    /// Report the drift in logs, in the terms of ISO 230-3
    #[cfg(feature = "identify")]
    Report(report::Arguments),
    /// Show how isotherm reads the logs of other programs
    #[cfg(feature = "identify")]
    Logs(explain::Arguments),
    /// Replace the running gateway by another program or profile; no axis moves
    Restart(restart::Arguments),
    /// Save the files of a machine in one file: profile, models, templates, and saved state
    Backup(backup::Arguments),
    /// Restore a machine from its backup; no axis moves before an operator arms it
    Restore(restore::Arguments),
    /// Permit the running gateway to write to the outputs
    #[command(
        after_help = "Examples:\n  isotherm arm my-machine.toml\n  isotherm arm my-machine.toml --axis z --no-wait"
    )]
    Arm(command::ArmArguments),
    /// Stop the running gateway from writing; the registers keep their values
    #[command(after_help = "Example:\n  isotherm disarm my-machine.toml --axis z")]
    Disarm(command::Arguments),
    /// Capture zero: the running gateway takes the present signal values as the references `"zero"` of its models
    #[command(after_help = "Example:\n  isotherm zero my-machine.toml")]
    Zero(command::Arguments),
    /// Check with a dial gauge, step by step, that an axis moves in the right direction
    Sign(sign::Arguments),
    /// Report the measured error of an axis to the running gateway, which learns from it
    Measured(measured::Arguments),
    /// Accept a device of the running gateway that an operator has checked
    Confirm(confirm::Arguments),
    /// Adopt the learned model of an axis in the running gateway, or return to the previous model; Cz does not move
    Adopt(adopt::Arguments),
    /// Return the register of an output that was moved or removed in the profile to its base value
    Release(release::Arguments),
    /// Show the frames between the running gateway and one of its devices
    Trace(trace::Arguments),
    /// Show the events of a machine, including those before the last restart
    Events(events::Arguments),
    /// Export logs and events as Parquet, one file a day, to query many machines at once
    #[cfg(feature = "parquet")]
    Export(export::Arguments),
    /// Show the state of the running gateway, as its web page does
    Status(status::Arguments),
    /// Create, show and trust the certificates of an OPC UA line
    #[cfg(feature = "opcua")]
    #[command(name = "opcua")]
    OpcUa(opcua::Arguments),
    /// Create a token for the web page, for viewing or for commands
    Token(token::Arguments),
    /// Print the JSON Schema of the profile, for editors
    #[command(after_help = "Example:\n  isotherm schema > isotherm.schema.json")]
    Schema,
    /// Print completions for a shell
    #[command(
        after_help = "Example:\n  isotherm completions bash > ~/.local/share/bash-completion/completions/isotherm"
    )]
    Completions {
        /// Shell: bash, zsh, fish, elvish or powershell
        shell: clap_complete::Shell,
    },
    Man(man::Arguments),
}

impl Arguments {
    /// Returns the log filter given by `--log`, or else the default filter of the verb.
    pub fn log_filter(&self) -> &str {
        match (&self.log, &self.verb) {
            (Some(filter), _) => filter,
            (None, Verb::Demo(demo)) => demo.quiet_log(),
            (None, Verb::Run(_) | Verb::Virtual(_)) => "info",
            (None, _) => "warn",
        }
    }
}

/// Verbs that exist only in builds with a Cargo feature: name of the verb, and name of the feature.
const FEATURE_OF_VERB: [(&str, &str); 8] = [
    ("identify", "identify"),
    ("learn", "identify"),
    ("select", "identify"),
    ("report", "identify"),
    ("logs", "identify"),
    ("place", "place"),
    ("export", "parquet"),
    ("opcua", "opcua"),
];

/// Returns the error for wrong arguments, with their control characters escaped. An unescaped argument could control
/// the terminal, or begin a new line. The error for a verb that this build lacks names the missing feature.
#[must_use]
pub fn escaped(refused: clap::Error) -> clap::Error {
    if let Some(ContextValue::String(verb)) = refused.get(ContextKind::InvalidSubcommand)
        && let Some((verb, feature)) = FEATURE_OF_VERB.iter().find(|(name, _)| name == verb)
    {
        let message = format!(
            "this program was built without the verb `{verb}`\n\n  help: use a packaged program, or build one \
             with the verb: `cargo build --release --features {feature}`\n"
        );
        return clap::Error::raw(refused.kind(), message).format(&mut Arguments::command());
    }
    let shown = std::env::args_os().map(|argument| one_line(&argument.to_string_lossy()).into_owned());
    Arguments::try_parse_from(shown).err().unwrap_or(refused)
}

/// Executes the verb, and returns the exit code: 0 success, 1 failure, 3 no answer of the gateway, 64 wrong profile.
/// Wrong arguments end the program with the exit code of clap.
pub fn run(arguments: Arguments) -> ExitCode {
    let log = diagnostics::start_log(arguments.log_filter());
    let mut replacement = None;
    let done = match arguments.verb {
        Verb::Demo(arguments) => demo::run(&arguments),
        Verb::Run(arguments) => run::run(&arguments).map(|next| replacement = next),
        Verb::Restart(arguments) => restart::run(&arguments),
        Verb::Backup(arguments) => backup::run(&arguments),
        Verb::Restore(arguments) => restore::run(&arguments),
        Verb::Init(arguments) => init::run(&arguments),
        Verb::Check(arguments) => check::run(&arguments),
        Verb::Read(arguments) => read::run(&arguments),
        Verb::Scan(arguments) => scan::run(&arguments),
        Verb::Trace(arguments) => trace::run(&arguments),
        Verb::Virtual(arguments) => simulate::run(&arguments),
        Verb::Record(arguments) => record::run(&arguments),
        Verb::Replay(arguments) => replay::run(&arguments),
        #[cfg(feature = "identify")]
        Verb::Identify(arguments) => identify::run(&arguments),
        #[cfg(feature = "identify")]
        Verb::Learn(arguments) => learn::run(&arguments),
        #[cfg(feature = "identify")]
        Verb::Select(arguments) => select::run(&arguments),
        #[cfg(feature = "place")]
        Verb::Place(arguments) => place::run(&arguments),
        #[cfg(feature = "identify")]
        Verb::Report(arguments) => report::run(&arguments),
        #[cfg(feature = "identify")]
        Verb::Logs(arguments) => explain::run(&arguments),
        Verb::Arm(arguments) => command::arm(&arguments),
        Verb::Disarm(arguments) => command::run(&arguments, Command::Disarm),
        Verb::Zero(arguments) => command::run(&arguments, Command::Zero),
        Verb::Sign(arguments) => sign::run(&arguments),
        Verb::Measured(arguments) => measured::run(&arguments),
        Verb::Confirm(arguments) => confirm::run(&arguments),
        Verb::Adopt(arguments) => adopt::run(&arguments),
        Verb::Release(arguments) => release::run(&arguments),
        Verb::Events(arguments) => events::run(&arguments),
        #[cfg(feature = "parquet")]
        Verb::Export(arguments) => export::run(&arguments),
        Verb::Status(arguments) => status::run(&arguments),
        #[cfg(feature = "opcua")]
        Verb::OpcUa(arguments) => opcua::run(&arguments),
        Verb::Token(arguments) => token::run(&arguments),
        Verb::Schema => print_json(isotherm_profile::schema()),
        Verb::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), "isotherm", &mut script);
            Out.write_all(&script).map_err(Into::into)
        }
        Verb::Man(arguments) => man::run(&arguments, Arguments::command()),
    };
    // Pending log lines are written before the last message.
    let done = match replacement {
        Some(replacement) => Err(replacement.take_over(log)),
        None => {
            drop(log);
            done
        }
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if error.is::<WrongProfile>() => ExitCode::from(64),
        Err(error) if matches!(error.downcast_ref(), Some(Failure::NoAnswer | Failure::Ended)) => {
            say_beside!("isotherm: {}", without_numbers(&format!("{error:#}")));
            ExitCode::from(3)
        }
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) if error.is::<WrongArguments>() => {
            Arguments::command().error(clap::error::ErrorKind::MissingRequiredArgument, error).exit()
        }
        Err(error) => {
            say_beside!("isotherm: {}", without_numbers(&format!("{error:#}")));
            ExitCode::from(1)
        }
    }
}

/// Returns whether the program that reads stdout has closed the pipe, as in `isotherm check … | head`. This is not a
/// failure.
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.downcast_ref::<std::io::Error>().is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
}
