//! `isotherm arm`, `disarm`, `zero`: commands to the running gateway.

use std::path::PathBuf;

use super::run::state_directory;
use super::{Failure, ProfileArguments, load, load_modelled, print_json};
use crate::gateway::control;
use crate::observe::status::Command;

/// Sends a command to the gateway that runs this profile on this computer.
#[derive(clap::Args, Debug)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The state directory that the gateway was started with
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// One JSON document
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments, command: Command) -> Result<(), Failure> {
    let profile = match command {
        Command::Arm => load_modelled(&arguments.profile, arguments.json)?,
        _ => load(&arguments.profile, arguments.json)?,
    };
    let directory = state_directory(arguments.state.as_deref(), &profile)?;
    let said =
        control::send(&control::path(&directory, &profile.name), command).map_err(anyhow::Error::msg)?;
    if arguments.json {
        return print_json(&serde_json::json!({ "answer": said }));
    }
    println!("{said}");
    Ok(())
}
