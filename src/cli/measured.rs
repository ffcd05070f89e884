//! `isotherm measured`: an axis's measured error for the running gateway.

use super::command::RunningGateway;
use super::{ProfileArguments, load, values};
use crate::gateway::control;

/// Hands an axis's measured error to the gateway that runs this profile on this computer, or takes back what such errors
/// have taught.
///
/// The error is what remains while the compensation acts, actual minus commanded. Measure with the machine at rest and
/// send it at once: it is held against the Cz that stands in the machine now.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  isotherm measured my-machine.toml --axis z --error 3.2")]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The axis
    #[arg(long, value_name = "AXIS")]
    axis: String,
    /// The measured error in µm; of the diameter where the axis acts on one
    #[arg(long, value_name = "UM", allow_negative_numbers = true, value_parser = finite, required_unless_present = "clear")]
    error: Option<f64>,
    /// Take back what measured errors have taught
    #[arg(long, conflicts_with = "error")]
    clear: bool,
    #[command(flatten)]
    gateway: RunningGateway,
}

fn finite(text: &str) -> Result<f64, String> {
    values::number(text, |_| true, "write a number of micrometres, as 3.2 or -0.8")
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile, axis, error, gateway, .. } = arguments;
    let profile = load(profile, gateway.json)?;
    gateway.print(control::send_measured(&gateway.socket(&profile)?, axis, *error))
}
