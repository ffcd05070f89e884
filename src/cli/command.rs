//! `isotherm arm`, `disarm`, `zero`: commands to the running gateway.

use std::path::{Path, PathBuf};

use super::{ProfileArguments, load, load_modelled, print_json, running};
use crate::cli::say::{say, say_beside};
use crate::gateway::control::{self, Failure};
use crate::observe::status::{Answer, Command};
use isotherm_profile::Profile;

/// Sends a command to the gateway that runs this profile on this computer.
#[derive(clap::Args, Debug)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// Only this axis; all of them where nothing is said
    #[arg(long, value_name = "AXIS")]
    axis: Option<String>,
    #[command(flatten)]
    gateway: RunningGateway,
}

/// Asks the gateway that runs this profile on this computer to let the axes write.
///
/// Where something is missing it stays, and says what is waited for, until the axes are armed, or the request is refused, is
/// cancelled (by Ctrl-C too), or expires after `arm_timeout` of the profile.
#[derive(clap::Args, Debug)]
pub(super) struct ArmArguments {
    #[command(flatten)]
    command: Arguments,
    /// Leave the request waiting, with exit code 1, where it cannot be served at once
    #[arg(long)]
    no_wait: bool,
}

/// The gateway that runs a profile on this computer.
#[derive(clap::Args, Debug)]
pub(super) struct RunningGateway {
    /// The state directory that the gateway was started with, where several of one machine run on this computer
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// One JSON document
    #[arg(long)]
    pub(super) json: bool,
}

impl RunningGateway {
    /// Its command socket.
    pub(super) fn socket(&self, profile: &Profile) -> anyhow::Result<PathBuf> {
        running::socket(self.state.as_deref(), profile)
    }

    /// The state directory that was named.
    pub(super) fn state(&self) -> Option<&Path> {
        self.state.as_deref()
    }

    /// Prints what it answered. What is not done yet is a failure.
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
                "{said}; it goes on waiting (`isotherm arm` stays and shows it, `isotherm disarm` ends it)"
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
