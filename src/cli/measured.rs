//! `isotherm measured`: an axis's measured error for the running gateway.

use std::path::PathBuf;

use super::run::state_directory;
use super::{Failure, ProfileArguments, load, print_json, values};
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
    /// The state directory that the gateway was started with
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// One JSON document
    #[arg(long)]
    json: bool,
}

fn finite(text: &str) -> Result<f64, String> {
    values::number(text, |_| true, "write a number of micrometres, as 3.2 or -0.8")
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let profile = load(&arguments.profile, arguments.json)?;
    let directory = state_directory(arguments.state.as_deref(), &profile)?;
    let socket = control::path(&directory, &profile.name);
    let said =
        control::send_measured(&socket, &arguments.axis, arguments.error).map_err(anyhow::Error::msg)?;
    if arguments.json {
        return print_json(&serde_json::json!({ "answer": said }));
    }
    println!("{said}");
    Ok(())
}
