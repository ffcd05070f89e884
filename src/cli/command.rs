//! Commands to the running gateway: `isotherm arm` permits axes to write to their outputs, `disarm` stops
//! them from writing. `zero` captures the present signal values as the references of the models.

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
/// If the conditions for arming are not met yet, the verb shows them and waits until the axes are armed. It also ends
/// when the request is refused or cancelled (also by Ctrl-C), or when it expires after `arm_timeout` of the profile.
#[derive(clap::Args, Debug)]
pub(super) struct ArmArguments {
    #[command(flatten)]
    command: Arguments,
    /// Does not wait: if the request cannot be granted at once, leaves it pending and ends with exit code 1
    #[arg(long)]
    no_wait: bool,
}

/// Selection of the gateway that runs a profile on this computer.
#[derive(clap::Args, Debug)]
pub(super) struct RunningGateway {
    /// The state directory with which the gateway was started; needed if several gateways of one machine run on this
    /// computer
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Prints one JSON document
    #[arg(long)]
    pub(super) json: bool,
}

impl RunningGateway {
    /// Returns the path of the Unix socket at which the selected gateway accepts commands.
    pub(super) fn socket(&self, profile: &Profile) -> anyhow::Result<PathBuf> {
        running::socket(self.state.as_deref(), profile)
    }

    /// Returns the state directory given by `--state`; `None` without this option.
    pub(super) fn state(&self) -> Option<&Path> {
        self.state.as_deref()
    }

    /// Prints the answer of the gateway. Returns an error for any answer other than "done".
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
