//! `isotherm adopt`: adopts the learned model of an axis of the running gateway, or returns to the model that the axis
//! followed before. It also writes the adopted model as a block for the profile.

use std::path::{Path, PathBuf};

use anyhow::Context;
use humantime::format_duration;

use super::command::RunningGateway;
use super::loading::{ProfileArguments, load};
use super::running;
use crate::cli::print::say;
use crate::gateway::{control, preferences_in};
use crate::observe::status::Command;
use isotherm_core::compensation::LearnedModel;
use isotherm_core::compensation::model::{Expected, Growth, Model, Reference};
use isotherm_profile::{Axis, Profile};

/// Adopts the model that the gateway has learned from measurements of the probe (touches). Cz does not move: the
/// gateway adjusts the correction from probe measurements, so that Cz keeps its value.
///
/// Over the last compared days, the error of the learned model must be smaller than that of the model in use. `isotherm
/// status` and the page show both errors. If Cz cannot be kept at present, the adoption waits for the next datum (zero
/// point of Cz). The models of the profile remain as fallbacks. If these models are changed in the profile, the learned
/// model is not used any more.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm adopt my-machine.toml --axis z\n  isotherm adopt my-machine.toml --axis z --back\n  isotherm adopt my-machine.toml --axis z --export z-model.toml"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The axis; needed if several axes learn a model
    #[arg(long, value_name = "AXIS")]
    axis: Option<String>,
    /// Returns to the model that the axis followed before. If an adoption is still waiting, cancels the adoption
    /// instead
    #[arg(long)]
    back: bool,
    /// Writes the adopted model as an [[axis.…model]] block to this file, and changes nothing. The gateway need not run
    #[arg(long, value_name = "MODEL.toml", conflicts_with = "back")]
    export: Option<PathBuf>,
    #[command(flatten)]
    gateway: RunningGateway,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile, axis, back, export, gateway } = arguments;
    let profile = load(profile, gateway.json)?;
    if let Some(path) = export {
        return write(&profile, axis.as_deref(), (gateway, path));
    }
    let command = if *back { Command::AdoptBack } else { Command::Adopt };
    gateway.print(control::send(&gateway.socket(&profile)?, command, axis.as_deref()))
}

/// Writes the adopted model of an axis to a file, as a block for the profile.
fn write(
    profile: &Profile,
    axis: Option<&str>,
    (gateway, path): (&RunningGateway, &Path),
) -> anyhow::Result<()> {
    let directory = running::directory(gateway.state(), profile)?;
    let mut adopted = preferences_in(&directory, profile);
    adopted.retain(|(own, preference)| {
        axis.is_none_or(|axis| axis == own) && preference.preferred().learned().is_some()
    });
    let [(name, preference)] = adopted.as_slice() else {
        match adopted.len() {
            0 => {
                let of = axis.map_or_else(String::new, |axis| format!(" of axis {axis}"));
                anyhow::bail!("the saved state in {} contains no adopted model{of}", directory.display())
            }
            _ => anyhow::bail!("several axes follow a learned model: select one with --axis"),
        }
    };
    let own = profile.axes.iter().find(|own| own.settings.name == *name);
    let block = own.zip(preference.preferred().learned()).map(|(own, model)| block(profile, own, model));
    std::fs::write(path, block.unwrap_or_default())
        .with_context(|| format!("{} cannot be written", path.display()))?;
    say!("{name}: the adopted model is in {}", path.display())?;
    Ok(())
}

/// Returns a learned model as a block for the profile.
fn block(profile: &Profile, axis: &Axis, model: &LearnedModel) -> String {
    let slot = axis.settings.learned.as_ref().and_then(|slot| axis.settings.models.get(slot.model));
    let reference = |signal: usize| {
        let input = slot.into_iter().flat_map(Model::rises).find(|input| input.signal.0 == signal);
        match input.map(|input| input.reference) {
            Some(Reference::Fixed(number)) => format!("{:?}", number.get()),
            Some(Reference::Zero) => "\"zero\"".to_owned(),
            Some(Reference::Start) | None => "\"start\"".to_owned(),
        }
    };
    let name = &axis.settings.name;
    let mut text = format!(
        "# Cz = −e (e: measured error), learned by isotherm from touches of the probe.\n\
         # Replace the first [[axis.{name}.model]] of the profile with this block.\n\
         [[axis.{name}.model]]\nname = \"{}\"\nkind = \"linear\"\nterms = [\n",
        model.name
    );
    for term in &model.terms {
        let Some(signal) = profile.signals.get(term.signal) else { continue };
        let power = if term.squared { ", power = 2" } else { "" };
        let lag = term.lag.map(|lag| format!(", lag = \"{}\"", format_duration(lag))).unwrap_or_default();
        text += &format!(
            "  {{ signal = \"{}\"{power}, gain = {:?}, reference = {}{lag} }},\n",
            signal.name,
            term.gain,
            reference(term.signal)
        );
    }
    text += "]\n";
    if !profile.machine.settle.is_zero() {
        text +=
            &format!("identified_with = {{ settle = \"{}\" }}\n", format_duration(profile.machine.settle));
    }
    if let Some(Expected { since_datum, since_touch }) = slot.and_then(|model| model.expected) {
        let pair = |growth: Growth| format!("[{:?}, {:?}]", growth.per_hour(), growth.at_once());
        let touch = since_touch.map(|growth| format!(", since_touch = {}", pair(growth)));
        text +=
            &format!("expected = {{ since_datum = {}{} }}\n", pair(since_datum), touch.unwrap_or_default());
    }
    text
}
