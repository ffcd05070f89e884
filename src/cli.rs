//! The verbs: one small file each. Results go to stdout, diagnostics to stderr.

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};
use clap::{Args, CommandFactory, Parser, Subcommand};
use tracing_appender::non_blocking::{NonBlockingBuilder, WorkerGuard};

use isotherm_profile::regular::without_numbers;
use isotherm_profile::{Axis, Errors, Loaded, Profile, one_line};

use crate::cli::say::{Out, say, say_beside};
use crate::fieldbus::{opcua_check, tls};
use crate::gateway::control::Failure;
use crate::gateway::how_to_find_a_model;
use crate::observe::status::Command;

mod backup;
#[cfg(any(feature = "identify", feature = "place"))]
mod beside;
mod broker;
mod certificate;
mod check;
mod command;
mod confirm;
mod demo;
mod descriptors;
mod events;
#[cfg(feature = "parquet")]
mod export;
mod gauge;
#[cfg(feature = "identify")]
mod identify;
mod init;
mod journal_stream;
mod logs;
mod looked;
mod machines;
mod man;
mod measured;
mod new_file;
mod notices;
#[cfg(feature = "opcua")]
mod opcua;
#[cfg(feature = "place")]
mod place;
mod port;
#[cfg(any(feature = "identify", feature = "place"))]
mod progress;
mod read;
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
mod say;
mod scan;
#[cfg(feature = "identify")]
mod select;
mod services;
mod sign;
mod signals;
mod simulate;
mod sparing;
mod status;
mod target;
mod token;
mod trace;
mod values;
mod volume;

use sparing::Sparing;
use values::key_and_value;

/// Holds a machine tool to its cold geometry.
///
/// isotherm polls thermocouple modules, computes the thermal compensation Cz of each axis and writes the offset to the
/// CNC, or the corrected position to a readout. It is not a safety function.
#[derive(Debug, Parser)]
#[command(
    version,
    max_term_width = 100,
    after_help = "Try it without hardware:  isotherm demo\nCheck a profile:          isotherm check my-machine.toml"
)]
pub struct Arguments {
    /// What is logged to stderr: error, warn, info, debug, or a filter such as `isotherm=debug`
    #[arg(long, global = true, value_name = "FILTER", env = "ISOTHERM_LOG", value_parser = values::log_filter)]
    log: Option<String>,
    /// The verb.
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// The whole job without hardware: a virtual machine on real loopback sockets, compensated live
    Demo(demo::Arguments),
    /// The gateway
    Run(run::Arguments),
    /// A first profile, from a few answers
    Init(Box<init::Arguments>),
    /// Every error of a profile with its place; then what would be read and written
    Check(check::Arguments),
    /// One reading of every signal, with its quality; or of one register, without a signal
    Read(Box<read::Arguments>),
    /// Which units of a line answer
    Scan(scan::Arguments),
    /// The devices of a profile as virtual hardware
    Virtual(simulate::Arguments),
    /// Readings into a log, for a later identification; writes to no device
    Record(record::Arguments),
    /// The gateway's own step over a recorded log
    Replay(replay::Arguments),
    /// The model of an axis from logs with its measured error, judged on runs it never saw
    #[cfg(feature = "identify")]
    Identify(Box<identify::Arguments>),
    /// Which temperature points to keep, from logs with a measured error
    #[cfg(feature = "identify")]
    Select(select::Arguments),
    /// Where the temperature sensors of a structure belong, from FE input files of its load cases
    #[cfg(feature = "place")]
    Place(Box<place::Arguments>),
    /// What logs say about drift, in the terms of ISO 230-3
    #[cfg(feature = "identify")]
    Report(report::Arguments),
    /// Another program or profile in the place of the running gateway, without moving anything
    Restart(restart::Arguments),
    /// What belongs to a machine in one file: profile, models, templates, state and ledger
    Backup(backup::Arguments),
    /// A machine out of such a file; no axis moves before a person arms it
    Restore(restore::Arguments),
    /// Let the running gateway write
    #[command(
        after_help = "Examples:\n  isotherm arm my-machine.toml\n  isotherm arm my-machine.toml --axis z --no-wait"
    )]
    Arm(command::ArmArguments),
    /// Let the running gateway write no more; what stands in the registers stays
    #[command(after_help = "Example:\n  isotherm disarm my-machine.toml --axis z")]
    Disarm(command::Arguments),
    /// Capture the "zero" references in the running gateway
    #[command(after_help = "Example:\n  isotherm zero my-machine.toml")]
    Zero(command::Arguments),
    /// A guided check with a dial gauge: does an axis move the way it must?
    Sign(sign::Arguments),
    /// An axis's measured error, for the running gateway to learn from
    Measured(measured::Arguments),
    /// Accept a device of the running gateway that a person has looked at
    Confirm(confirm::Arguments),
    /// Take the register of an output that was moved or removed back to its base
    Release(release::Arguments),
    /// The frames of a device of the running gateway, as they pass
    Trace(trace::Arguments),
    /// What happened at a machine, before the last restart too
    Events(events::Arguments),
    /// Logs and events as Parquet, a file a day, for a year of many machines in one query
    #[cfg(feature = "parquet")]
    Export(export::Arguments),
    /// What the running gateway does: the content of its page
    Status(status::Arguments),
    /// The certificates of an OPC UA line: made, shown, trusted
    #[cfg(feature = "opcua")]
    #[command(name = "opcua")]
    OpcUa(opcua::Arguments),
    /// A token for the page: who has it may look, or command
    Token(token::Arguments),
    /// The JSON Schema of the profile, for editors
    #[command(after_help = "Example:\n  isotherm schema > isotherm.schema.json")]
    Schema,
    /// Completions for a shell
    #[command(
        after_help = "Example:\n  isotherm completions bash > ~/.local/share/bash-completion/completions/isotherm"
    )]
    Completions {
        /// bash, zsh, fish, elvish, powershell
        shell: clap_complete::Shell,
    },
    Man(man::Arguments),
}

/// A profile and what is laid over it.
#[derive(Args, Clone, Debug)]
struct ProfileArguments {
    /// The machine's profile, or the name of a shipped one
    #[arg(value_name = "PROFILE")]
    path: PathBuf,
    /// Overrides one key, as often as needed: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    set: Vec<(String, String)>,
}

/// The profile is wrong; everything about it has been printed.
#[derive(Debug, thiserror::Error)]
#[error("the profile is wrong")]
struct WrongProfile;

impl Arguments {
    /// What is logged where nothing is said.
    pub fn log_filter(&self) -> &str {
        match (&self.log, &self.verb) {
            (Some(filter), _) => filter,
            (None, Verb::Demo(demo)) => demo.quiet_log(),
            (None, Verb::Run(_) | Verb::Virtual(_)) => "info",
            (None, _) => "warn",
        }
    }
}

/// The feature that builds in each verb that some builds lack.
const FEATURE_OF_VERB: [(&str, &str); 6] = [
    ("identify", "identify"),
    ("select", "identify"),
    ("report", "identify"),
    ("place", "place"),
    ("export", "parquet"),
    ("opcua", "opcua"),
];

/// What is wrong with the arguments, quoting them so that nothing in them steers a terminal or begins a line.
#[must_use]
pub fn escaped(refused: clap::Error) -> clap::Error {
    if let Some(ContextValue::String(verb)) = refused.get(ContextKind::InvalidSubcommand)
        && let Some((verb, feature)) = FEATURE_OF_VERB.iter().find(|(name, _)| name == verb)
    {
        let message = format!(
            "this program was built without the verb `{verb}`\n\n  help: take a packaged program, or build it in: \
             `cargo build --release --features {feature}`\n"
        );
        return clap::Error::raw(refused.kind(), message).format(&mut Arguments::command());
    }
    let shown = std::env::args_os().map(|argument| one_line(&argument.to_string_lossy()).into_owned());
    Arguments::try_parse_from(shown).err().unwrap_or(refused)
}

/// Carries out the arguments.
pub fn run(arguments: Arguments) -> ExitCode {
    let log = start_log(arguments.log_filter());
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
        Verb::Select(arguments) => select::run(&arguments),
        #[cfg(feature = "place")]
        Verb::Place(arguments) => place::run(&arguments),
        #[cfg(feature = "identify")]
        Verb::Report(arguments) => report::run(&arguments),
        Verb::Arm(arguments) => command::arm(&arguments),
        Verb::Disarm(arguments) => command::run(&arguments, Command::Disarm),
        Verb::Zero(arguments) => command::run(&arguments, Command::Zero),
        Verb::Sign(arguments) => sign::run(&arguments),
        Verb::Measured(arguments) => measured::run(&arguments),
        Verb::Confirm(arguments) => confirm::run(&arguments),
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
        Verb::Man(arguments) => man::run(&arguments),
    };
    // What has been logged stands before what is said last.
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
        Err(error) => {
            say_beside!("isotherm: {}", without_numbers(&format!("{error:#}")));
            ExitCode::from(1)
        }
    }
}

/// `isotherm check … | head` is no failure.
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.downcast_ref::<std::io::Error>().is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
}

/// Lines of the log that wait for a slow reader; more are lost.
const UNREAD: usize = 2048;
/// What the OPC UA library says is said in words of ours; in its own it may name what is secret.
const SILENT: &str = "opcua_client=off,opcua_core=off,opcua_crypto=off,opcua_types=off";

/// Starts the log on stderr, in the journal's form where that is the journal. A thread of its own writes it, so that nobody
/// waits for a reader who does not read; what it has not written is written when the guard is dropped.
fn start_log(filter: &str) -> WorkerGuard {
    use tracing_subscriber::field::MakeExt;
    use tracing_subscriber::filter::{FilterExt, Targets};
    use tracing_subscriber::fmt::format::debug_fn;
    use tracing_subscriber::layer::{Layer, SubscriberExt};
    use tracing_subscriber::util::SubscriberInitExt;
    let targets = |filter: &str| format!("{filter},{SILENT}").parse::<Targets>();
    let filter = targets(filter).or_else(|_| targets("info")).unwrap_or_default();
    let (writer, guard) =
        NonBlockingBuilder::default().buffered_lines_limit(UNREAD).finish(std::io::stderr());
    // What others wrote ends no line and steers no terminal. Any other value than the sentence is quoted.
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
    // A second start in one process, as tests make, keeps the first.
    let _ = tracing_subscriber::registry().with(lines.with_filter(filter.and(Sparing::begin()))).try_init();
    guard
}

/// Refuses arguments that are wrong together, as clap refuses single ones.
fn refuse(why: &str) -> ! {
    Arguments::command().error(clap::error::ErrorKind::MissingRequiredArgument, why).exit()
}

/// Loads a profile, or prints everything that is wrong with it.
fn load(arguments: &ProfileArguments, json: bool) -> anyhow::Result<Profile> {
    load_with(&arguments.path, &arguments.set, json)
}

fn load_with(path: &Path, set: &[(String, String)], json: bool) -> anyhow::Result<Profile> {
    Ok(load_quietly(path, set, json)?.profile)
}

/// The profile, its warnings printed: by the verbs that are about the profile, `check` and `run`.
fn warned(loaded: Loaded) -> Profile {
    for warning in &loaded.warnings {
        say_beside!("warning: {warning}");
    }
    loaded.profile
}

/// A profile with a model for one of its axes at least: one in the making is recorded and identified, but nothing can
/// follow it.
fn load_modelled(arguments: &ProfileArguments, json: bool) -> anyhow::Result<Loaded> {
    modelled(&arguments.path, load_quietly(&arguments.path, &arguments.set, json)?)
}

/// The profile of this path, if it has such a model.
fn modelled(path: &Path, loaded: Loaded) -> anyhow::Result<Loaded> {
    let axes = &loaded.profile.axes;
    let unmodelled: Vec<&str> = axes.iter().map(|axis| axis.settings.name.as_str()).collect();
    if axes.is_empty() || axes.iter().any(Axis::has_model) {
        return Ok(loaded);
    }
    anyhow::bail!(
        "{}: axis {} has no model, so there is nothing to compensate with; {}",
        path.display(),
        unmodelled.join(", "),
        how_to_find_a_model(&loaded.profile, 0)
    )
}

/// A profile, its warnings left to the caller.
fn load_quietly(path: &Path, set: &[(String, String)], json: bool) -> anyhow::Result<Loaded> {
    let environment = isotherm_profile::environment();
    load_by(path, json, || match shipped(path) {
        Some((path, text)) => isotherm_profile::parse_with(&path, text, &machines::FILES, set, &environment),
        None => isotherm_profile::load(path, set, &environment),
    })
}

/// A shipped machine may be named without having its file.
fn shipped(path: &Path) -> Option<(PathBuf, &'static str)> {
    path.to_str().filter(|_| !path.exists()).and_then(machines::text)
}

/// The profile that `load` gives, with everything checked that only this program can.
fn load_by(path: &Path, json: bool, load: impl FnOnce() -> Result<Loaded, Errors>) -> anyhow::Result<Loaded> {
    // A file that a profile names may be large.
    #[cfg(any(feature = "identify", feature = "place"))]
    let _checking = progress::Progress::begin("checking the profile");
    let loaded = load();
    let loaded = loaded.and_then(|loaded| tls::check(&loaded.profile).map(|()| loaded));
    let loaded = loaded.and_then(|loaded| opcua_check::check(&loaded.profile).map(|()| loaded));
    let loaded = loaded.and_then(|loaded| broker::check(&loaded.profile).map(|()| loaded));
    let loaded = loaded.map_err(|mut errors| {
        if let (Some(meant), [error]) = (machines::meant(path), errors.0.as_mut_slice()) {
            error.help = Some(format!("did you mean the shipped machine `{meant}`?"));
        }
        errors
    });
    reported(loaded, json)
}

/// What is loaded; where it is wrong, everything about that is printed.
fn reported(loaded: Result<Loaded, Errors>, json: bool) -> anyhow::Result<Loaded> {
    loaded.or_else(|errors| {
        if json {
            print_json(&errors)?;
        } else {
            say_beside!("{errors}");
        }
        Err(WrongProfile.into())
    })
}

fn print_json(document: &impl serde::Serialize) -> anyhow::Result<()> {
    Ok(say!("{}", serde_json::to_string_pretty(document)?)?)
}

/// What a verb that talks to devices runs on.
fn runtime() -> std::io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_current_thread().enable_all().build()
}
