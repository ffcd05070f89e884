//! `isotherm arm`, `disarm`, `zero`: commands to the running gateway; and how verbs find it.

use std::path::PathBuf;

use super::run::state_directory;
use super::{ProfileArguments, load, load_modelled, print_json};
use crate::gateway::control;
use crate::observe::status::Command;
use isotherm_profile::Profile;

/// Sends a command to the gateway that runs this profile on this computer.
#[derive(clap::Args, Debug)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    #[command(flatten)]
    gateway: RunningGateway,
}

/// The gateway that runs a profile on this computer.
#[derive(clap::Args, Debug)]
pub(super) struct RunningGateway {
    /// The state directory that the gateway was started with
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// One JSON document
    #[arg(long)]
    pub(super) json: bool,
}

impl RunningGateway {
    /// Its command socket.
    pub(super) fn socket(&self, profile: &Profile) -> anyhow::Result<PathBuf> {
        Ok(control::path(&state_directory(self.state.as_deref(), profile)?, &profile.name))
    }

    /// Prints what it answered.
    pub(super) fn print(&self, answer: Result<String, String>) -> anyhow::Result<()> {
        let answer = answer.map_err(anyhow::Error::msg)?;
        if self.json {
            return print_json(&serde_json::json!({ "answer": answer }));
        }
        println!("{answer}");
        Ok(())
    }
}

pub(super) fn run(arguments: &Arguments, command: Command) -> anyhow::Result<()> {
    let Arguments { profile, gateway } = arguments;
    let profile = match command {
        Command::Arm => load_modelled(profile, gateway.json)?,
        _ => load(profile, gateway.json)?,
    };
    gateway.print(control::send(&gateway.socket(&profile)?, command))
}
