//! `isotherm measured`: reports the measured error of an axis to the running gateway.

use super::command::RunningGateway;
use super::loading::{ProfileArguments, load};
use super::values;
use crate::gateway::control;
use isotherm_core::compensation::MeasuredReport;
use isotherm_core::quantity::Moment;

/// Reports the measured error of an axis to the gateway that runs this profile on this computer. With --clear, discards
/// the correction that the gateway has derived from such errors.
///
/// The error is the one that remains with active compensation: actual minus commanded position. Measure with the
/// machine at rest, and send the error at once, because the gateway compares it with the Cz that is active now. If a
/// script may send an error twice, it must add `--time` or `--id`: the same measurement then counts once.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm measured my-machine.toml --axis z --error 3.2\n  isotherm measured my-machine.toml \
    --axis z --error 3.2 --id part-17/2"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The axis whose error was measured
    #[arg(long, value_name = "AXIS")]
    axis: String,
    /// The measured error in µm; for an axis that acts on a diameter, the error of the diameter
    #[arg(long, value_name = "UM", allow_negative_numbers = true, value_parser = finite, required_unless_present = "clear")]
    error: Option<f64>,
    /// The time of the measurement, RFC 3339 with a time zone. A measurement before the last zero point of the axis's
    /// Cz (datum) is rejected
    #[arg(long, value_name = "TIME", value_parser = MeasuredReport::time, conflicts_with = "clear")]
    time: Option<Moment>,
    /// Identifier of this measurement, at most 64 characters
    #[arg(long, value_name = "ID", value_parser = MeasuredReport::id, conflicts_with = "clear")]
    id: Option<String>,
    /// Discards the correction that the gateway has derived from measured errors
    #[arg(long, conflicts_with = "error")]
    clear: bool,
    #[command(flatten)]
    gateway: RunningGateway,
}

fn finite(text: &str) -> Result<f64, String> {
    values::number(text, |_| true, "write a number of micrometres, such as 3.2 or -0.8")
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile, axis, error, time, id, gateway, .. } = arguments;
    let report = error.map(|error_um| MeasuredReport { time: *time, id: id.clone(), ..error_um.into() });
    let profile = load(profile, gateway.json)?;
    gateway.print(control::send_measured(&gateway.socket(&profile)?, axis, report.as_ref()))
}
