//! `isotherm arm`, `disarm`, `zero`: commands to the running gateway.

use std::path::{Path, PathBuf};

use super::loading::{ProfileArguments, load, load_modelled};
use super::print::print_json;
use super::running;
use crate::cli::print::{say, say_beside};
use crate::gateway::control::{self, Failure};
use crate::observe::status::{Answer, Command};
use isotherm_profile::Profile;

/// Sends a command to the gateway that runs this profile on this computer.
#[derive(clap::Args, Debug)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// Only this axis [default: all axes]
    #[arg(long, value_name = "AXIS")]
    axis: Option<String>,
    #[command(flatten)]
    gateway: RunningGateway,
}

/// Asks the gateway that runs this profile on this computer to arm the axes.
///
/// If a condition is not met yet, the verb shows it and waits until the axes are armed. It also ends when the request
/// is refused, is cancelled (also by Ctrl-C), or expires after `arm_timeout` of the profile.
#[derive(clap::Args, Debug)]
pub(super) struct ArmArguments {
    #[command(flatten)]
    command: Arguments,
    /// Leaves the request pending, with exit code 1, if it cannot be granted at once
    #[arg(long)]
    no_wait: bool,
}

/// The gateway that runs a profile on this computer.
#[derive(clap::Args, Debug)]
pub(super) struct RunningGateway {
    /// The state directory that the gateway was started with; needed if several gateways of one machine run on this
    /// computer
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Prints one JSON document
    #[arg(long)]
    pub(super) json: bool,
}

impl RunningGateway {
    /// Finds the command socket of the gateway.
    pub(super) fn socket(&self, profile: &Profile) -> anyhow::Result<PathBuf> {
        running::socket(self.state.as_deref(), profile)
    }

    /// State directory given as `--state`.
    pub(super) fn state(&self) -> Option<&Path> {
        self.state.as_deref()
    }

    /// Prints the answer of the gateway. An answer other than "done" is an error.
    pub(super) fn print(&self, answer: Result<Answer, Failure>) -> anyhow::Result<()> {
        let answer = answer?;
        if self.json {
            print_json(
                &serde_json::json!({ "answer": answer.text(), "done": matches!(answer, Answer::Done(_)) }),
            )?;
        }
        match answer {
            Answer::Done(_) if self.json => Ok(()),
            Answer::Done(said) => {
                say!("{said}")?;
                Ok(())
            }
            Answer::TooSoon(why) => anyhow::bail!("{why}"),
            Answer::Waits(said) => anyhow::bail!(
                "{said}; the request stays pending (`isotherm arm` waits for it, `isotherm disarm` cancels \
                 it)"
            ),
        }
    }
}

pub(super) fn run(arguments: &Arguments, command: Command) -> anyhow::Result<()> {
    let Arguments { profile, axis, gateway } = arguments;
    let profile = load(profile, gateway.json)?;
    gateway.print(control::send(&gateway.socket(&profile)?, command, axis.as_deref()))
}

pub(super) fn arm(arguments: &ArmArguments) -> anyhow::Result<()> {
    let ArmArguments { command: Arguments { profile, axis, gateway }, no_wait } = arguments;
    let profile = load_modelled(profile, gateway.json)?.profile;
    let socket = gateway.socket(&profile)?;
    if *no_wait {
        return gateway.print(control::send(&socket, Command::Arm, axis.as_deref()));
    }
    let said = control::arm(&socket, axis.as_deref(), |waits_for| say_beside!("{waits_for}"));
    gateway.print(said.map(Answer::Done))
}
