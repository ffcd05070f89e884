//! `isotherm confirm`: accepts a device of the running gateway that an operator has checked.

use super::command::RunningGateway;
use super::loading::{ProfileArguments, load};
use crate::gateway::control;

/// Accepts a device whose readings jumped while it was not reachable, or an OPC UA server whose namespaces are
/// ambiguous. An operator must first check that the device is the right one, and has the right settings.
///
/// Until the device is accepted, the gateway rejects a reading that differs from the last good one by more than
/// `max_rate` allows. This verb does not replace the checks of the device (`verify`): they must pass too.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  isotherm confirm my-machine.toml module")]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The device, by its name in the profile
    #[arg(value_name = "DEVICE")]
    device: String,
    #[command(flatten)]
    gateway: RunningGateway,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile, device, gateway } = arguments;
    let profile = load(profile, gateway.json)?;
    gateway.print(control::send_confirm(&gateway.socket(&profile)?, device))
}
