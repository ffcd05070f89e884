//! `isotherm confirm`: accepts a device of the running gateway that a person has looked at.

use super::command::RunningGateway;
use super::{ProfileArguments, load};
use crate::gateway::control;

/// Accepts a device whose readings have jumped while it was away, or an OPC UA server whose namespaces cannot be told: a person has
/// found that it is the right one with the right settings.
///
/// Until then the gateway does not use a reading that differs from the last good one by more than `max_rate` allowed in between. The
/// checks of the device (`verify`) are not confirmed by this: they must pass.
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
