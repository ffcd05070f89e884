//! `isotherm sign`: a guided check with a dial gauge that an axis moves in the right direction.

use super::command::RunningGateway;
use super::loading::{ProfileArguments, load};
use super::print::print_json;
use super::values::typed;
use crate::cli::print::{say, say_beside};
use crate::gateway::control;
use crate::observe::status::{Command, DialDirection};

/// Checks with a dial gauge that an axis moves in the right direction. The running gateway moves Cz of the axis by +5
/// µm and back, within the limits of the profile. You enter the direction in which the pointer of the gauge moved.
///
/// The axis must be armed and compensating. During the check nothing else changes its Cz. If you do not answer in time,
/// or leave, the gateway removes the +5 µm.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm sign my-machine.toml --axis z\n  isotherm sign my-machine.toml --axis z --answer plus"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The axis; needed if the profile has several axes
    #[arg(long, value_name = "AXIS")]
    axis: Option<String>,
    /// Direction in which the gauge moved, for scripts; the verb then asks no question
    #[arg(long, value_name = "WAY", value_parser = clap::builder::PossibleValuesParser::new(["plus", "minus", "none"]))]
    answer: Option<String>,
    #[command(flatten)]
    gateway: RunningGateway,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile, axis, answer, gateway } = arguments;
    let profile = load(profile, gateway.json)?;
    let (socket, axis) = (gateway.socket(&profile)?, axis.as_deref());
    let named = axis.or(profile.axes.first().map(|axis| axis.settings.name.as_str())).unwrap_or_default();
    if answer.is_none() {
        say_beside!(
            "Put a dial gauge between tool and work, along {named}, and set it to zero (or look at the \
             readout). Keep everyone away from the moving parts. Enter moves the offset by +5 µm, Ctrl-C \
             ends the check."
        );
        typed()?;
    }
    let (must, _while_it_is_there) = control::sign(&socket, axis, |said| say_beside!("{said}"))?;
    say_beside!("{must}");
    let moved = match answer.as_deref() {
        Some(word) => moved(word),
        None => ask()?,
    };
    let moved = moved.ok_or_else(|| anyhow::anyhow!("no answer; the gateway removes the offset"))?;
    let said = control::send(&socket, Command::Signed(moved), axis)?;
    if gateway.json {
        print_json(&serde_json::json!({
            "axis": named, "must": must, "moved": moved, "right": moved == DialDirection::Plus, "answer": said.text(),
        }))?;
    } else if moved == DialDirection::Plus {
        say!("{}", said.text())?;
    }
    anyhow::ensure!(moved == DialDirection::Plus, "{}", said.text());
    Ok(())
}

fn moved(word: &str) -> Option<DialDirection> {
    DialDirection::ALL.into_iter().find(|(name, _)| *name == word).map(|(_, moved)| moved)
}

/// Asks for the direction until the answer is valid. Returns `None` if the input ends.
fn ask() -> anyhow::Result<Option<DialDirection>> {
    loop {
        let minutes = control::SIGN_ANSWERED_WITHIN.as_secs() / 60;
        say_beside!(
            "In which direction did the gauge move? Type plus, minus or none within {minutes} minutes \
             (Ctrl-C ends the check):"
        );
        let Some(text) = typed()? else { return Ok(None) };
        if let Some(moved) = moved(text.trim()) {
            return Ok(Some(moved));
        }
    }
}
