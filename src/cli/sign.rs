//! `isotherm sign`: a guided check with a dial gauge that an axis moves in the right direction.

use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use super::command::RunningGateway;
use super::loading::{ProfileArguments, load};
use super::print::print_json;
use super::values::typed;
use crate::cli::print::{say, say_beside};
use crate::gateway::{control, is_at_zero, sign_expectation};
use crate::observe::status::{Command, DialDirection};
use isotherm_profile::{Profile, allowed};

/// Interval at which the verb checks whether the axis is ready.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// Checks with a dial gauge that an axis moves in the right direction. The running gateway moves Cz of the axis by +5
/// µm and back, within the limits of the profile. You enter the direction in which the pointer of the gauge moved. Then
/// the verb shows the expected direction.
///
/// The axis must be armed. The verb waits until the axis compensates. An axis without a model is armed for
/// the check only, and its Cz is zero before and after. If its register holds another value, the verb first
/// moves it to zero. During the check nothing else changes Cz. If you do not answer in time, or leave, the
/// gateway removes the +5 µm.
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
    let path = &profile.path;
    let profile = load(profile, gateway.json)?;
    let (socket, axis) = (gateway.socket(&profile)?, axis.as_deref());
    let named = axis.or(profile.axes.first().map(|axis| axis.settings.name.as_str())).unwrap_or_default();
    anyhow::ensure!(
        axis.is_some() || profile.axes.len() < 2,
        "there are several axes: select one with --axis"
    );
    let own = wait_until_ready(&socket, named, path)?;
    if let Some(held) = held_without_model(&profile, &own) {
        say_beside!(
            "{named} has no model, and its register holds {held:.1} µm. The check begins at zero, so the offset \
             moves there first. Keep everyone away from the moving parts."
        );
        if answer.is_none() {
            say_beside!("Enter moves the offset to zero, Ctrl-C ends the check.");
            anyhow::ensure!(typed()?.is_some(), "no answer; nothing was moved. In scripts, use --answer");
        }
        return_to_zero(&socket, named, &profile)?;
    }
    if answer.is_none() {
        say_beside!(
            "Put a dial gauge between tool and work, along {named}, and set it to zero (or note the \
             position on the readout). Keep everyone away from the moving parts. Enter moves the offset by \
             +5 µm, Ctrl-C ends the check."
        );
        anyhow::ensure!(typed()?.is_some(), "no answer; nothing was moved. In scripts, use --answer");
    }
    let (there, _while_it_is_there) = control::sign(&socket, axis, |said| say_beside!("{said}"))?;
    say_beside!("{there}");
    let moved = match answer.as_deref() {
        Some(word) => moved(word),
        None => ask()?,
    };
    let moved = moved.ok_or_else(|| anyhow::anyhow!("no answer; the gateway removes the offset"))?;
    let said = control::send(&socket, Command::Signed(moved), axis)?;
    if gateway.json {
        let place = profile.axes.iter().position(|axis| axis.settings.name == named);
        let must = place.map(|place| format!("{named}: {}", sign_expectation(&profile, place)));
        print_json(&serde_json::json!({
            "axis": named, "must": must, "moved": moved, "right": moved == DialDirection::Plus, "answer": said.text(),
        }))?;
    } else if moved == DialDirection::Plus {
        say!("{}", said.text())?;
    }
    anyhow::ensure!(moved == DialDirection::Plus, "{}", said.text());
    Ok(())
}

/// Returns the offset in the register of an axis, µm, if the axis has no model and the offset is not zero.
/// Otherwise `None`.
fn held_without_model(profile: &Profile, own: &Value) -> Option<f64> {
    let place = profile.axes.iter().position(|axis| own["name"] == axis.settings.name.as_str())?;
    let held = own["verified_um"].as_f64().filter(|_| own["has_model"] == false)?;
    (!is_at_zero(profile, place, held)).then_some(held)
}

/// Moves the register of an axis without a model to zero. For this, it starts a check: the gateway first moves the
/// register to zero, and then ends the check.
fn return_to_zero(socket: &Path, axis: &str, profile: &Profile) -> anyhow::Result<()> {
    let ended = control::sign(socket, Some(axis), |said| say_beside!("{said}")).map(drop);
    // The gateway accepts the next check of the axis a second later.
    std::thread::sleep(LOOK_AGAIN);
    match (held_without_model(profile, &status_of(socket, axis)?), ended) {
        (None, _) => Ok(()),
        (Some(_), Err(why)) => Err(why.into()),
        (Some(held), Ok(())) => anyhow::bail!("the register of axis {axis} still holds {held:.1} µm"),
    }
}

/// Returns the entry of an axis in the gateway's status. Returns an error if no gateway runs, or if the
/// gateway has no such axis.
fn status_of(socket: &Path, axis: &str) -> anyhow::Result<Value> {
    let status: Value = serde_json::from_str(&control::status(socket)?)?;
    let axes = status["axes"].as_array().map_or(&[][..], Vec::as_slice);
    let Some(own) = axes.iter().find(|own| own["name"] == axis) else {
        let names = axes.iter().filter_map(|own| own["name"].as_str());
        anyhow::bail!("the running gateway has no axis `{axis}`: {}", allowed(axis, names));
    };
    Ok(own.clone())
}

/// Waits until the axis compensates and its registers hold its offset, and returns its entry in the status. Prints each
/// new reason for which it waits. Does not wait for an axis without a model, because the check itself arms this axis.
fn wait_until_ready(socket: &Path, axis: &str, profile: &Path) -> anyhow::Result<Value> {
    let mut said = String::new();
    loop {
        let own = status_of(socket, axis)?;
        match readiness(&own) {
            Readiness::Ready => return Ok(own),
            Readiness::Off => anyhow::bail!(
                "axis {axis} is off; arm it first (`isotherm arm {} --axis {axis}`)",
                profile.display()
            ),
            Readiness::Waits => {}
        }
        let why = own["why"].as_str().filter(|why| !why.is_empty());
        let why = why.unwrap_or("its registers do not hold its offset yet");
        if why != said {
            say_beside!("{axis}: waiting until the axis is ready: {why}");
            why.clone_into(&mut said);
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

/// Readiness of an axis for a sign check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Readiness {
    /// The gateway can begin the check, or can say why it does not.
    Ready,
    /// The axis is armed or waits to be armed, and does not compensate yet.
    Waits,
    /// The axis is off, and nobody has requested to arm it.
    Off,
}

/// Returns the readiness of an axis from its entry in the status.
fn readiness(axis: &Value) -> Readiness {
    if axis["has_model"] == false {
        return Readiness::Ready;
    }
    let is_following = ["active", "degraded"].iter().any(|state| axis["state"] == *state);
    let apart = |verified: f64, cz: f64| (verified - cz).abs() > SETTLED_UM;
    let is_behind =
        axis["verified_um"].as_f64().zip(axis["cz_um"].as_f64()).is_some_and(|(at, cz)| apart(at, cz));
    match (axis["armed"] == true, axis["waiting"].is_null()) {
        (true, _) if is_following && !is_behind => Readiness::Ready,
        (false, true) => Readiness::Off,
        _ => Readiness::Waits,
    }
}

/// Largest difference between Cz and the register value with which an axis counts as ready, µm. The gateway itself
/// checks the difference without this tolerance.
const SETTLED_UM: f64 = 1.0;

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

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn the_check_waits_for_an_axis_that_will_compensate_and_for_no_other() {
        let axis = |armed: bool, state: &str, verified: f64| {
            json!({ "armed": armed, "state": state, "cz_um": 3.0,
            "verified_um": verified, "waiting": null, "has_model": true })
        };
        for (axis, expected) in [
            (axis(true, "active", 3.0), Readiness::Ready),
            (axis(true, "degraded", 3.4), Readiness::Ready),
            (axis(true, "active", 0.0), Readiness::Waits),
            (axis(true, "holding", 3.0), Readiness::Waits),
            (axis(false, "off", 3.0), Readiness::Off),
            (json!({ "armed": false, "state": "off", "waiting": {}, "has_model": true }), Readiness::Waits),
            (
                json!({ "armed": false, "state": "off", "waiting": null, "has_model": false }),
                Readiness::Ready,
            ),
            (
                json!({ "armed": true, "state": "active", "verified_um": null, "cz_um": 1.0 }),
                Readiness::Ready,
            ),
        ] {
            assert_eq!(readiness(&axis), expected, "{axis}");
        }
    }
}
