//! `isotherm status`: shows the content of the web page, in a terminal or as JSON.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::{Map, Value};

use super::hints::cause;
use super::loading::load_quietly;
use super::running;
use crate::cli::print::{clear, say, say_all};
use crate::gateway::control;

mod text;

/// Interval between updates with `--watch`.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Shows the state of the running gateway on this computer, with the same content as its web page.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  isotherm status my-machine.toml\n  isotherm status --healthy\n  \
                        isotherm status --json")]
pub(super) struct Arguments {
    /// The machine's profile [default: the profile of the only gateway with this state directory]
    profile: Option<PathBuf>,
    /// The state directory with which the gateway was started
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Prints one JSON document
    #[arg(long, conflicts_with = "healthy")]
    json: bool,
    /// Shows the state again every second until Ctrl-C
    #[arg(long, conflicts_with = "healthy")]
    watch: bool,
    /// Prints one line, with exit code 0 if everything works; otherwise with exit code 1. An axis that an operator has
    /// switched off does not count as a fault
    #[arg(long)]
    healthy: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let state = arguments.state.as_deref();
    let socket = match &arguments.profile {
        Some(path) => running::socket(state, &load_quietly(path, &[], arguments.json)?.profile)?,
        None => running::only(state)?,
    };
    loop {
        let status = document(&control::status(&socket)?)?;
        if arguments.healthy {
            if let Some(unhealthy) = unhealthy(&status) {
                anyhow::bail!("not healthy: {unhealthy}");
            }
            let named = status["axes"].as_object().into_iter().flatten();
            let off = named.filter(|(_, axis)| axis["left_off"] == true);
            let off: String = off
                .map(|(name, axis)| format!("; axis {name} is off: {}", text::word(&axis["why"])))
                .collect();
            return Ok(say!("healthy{off}")?);
        }
        match (arguments.json, arguments.watch) {
            (true, true) => say!("{status}")?,
            (true, false) => say!("{}", serde_json::to_string_pretty(&status)?)?,
            (false, watch) => {
                if watch {
                    clear()?;
                }
                say_all!("{}", text::of(&status))?;
            }
        }
        if !arguments.watch {
            return Ok(());
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// Returns the reasons why the machine is not compensated, in one line. The hints follow at the end, without
/// duplicates. `None` if there is no such reason.
fn unhealthy(status: &Value) -> Option<String> {
    let axes = status["axes"].as_object().into_iter().flat_map(Map::values);
    let devices = status["devices"].as_array().into_iter().flatten();
    let hints: BTreeSet<&str> = axes.chain(devices).filter_map(|one| one["hint"].as_str()).collect();
    let missing = texts(&status["missing"]);
    let without = |text: &&str| {
        hints.iter().fold((*text).to_owned(), |text, hint| cause(&text, Some(*hint)).to_owned())
    };
    let causes: Vec<String> = missing.iter().map(without).collect();
    let used = hints.iter().filter(|hint| missing.iter().any(|text| text.ends_with(**hint)));
    let used: String = used.map(|hint| format!("; to do: {hint}")).collect();
    (!missing.is_empty()).then(|| causes.join("; ") + &used)
}

/// Parses the status, and converts its list of axes to an object with the axis names as keys.
fn document(text: &str) -> anyhow::Result<Value> {
    let mut status: Value = serde_json::from_str(text)?;
    let axes = status["axes"].take();
    let named = axes
        .as_array()
        .into_iter()
        .flatten()
        .map(|axis| (text::word(&axis["name"]).to_owned(), axis.clone()));
    status["axes"] = Value::Object(named.collect::<Map<String, Value>>());
    Ok(status)
}

fn texts(value: &Value) -> Vec<&str> {
    value.as_array().into_iter().flatten().filter_map(Value::as_str).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_missing_has_each_hint_once_at_the_end() {
        let hint = "is the port right?";
        let device = |name: &str| json!({ "name": name, "state": "lost", "hint": hint });
        let mut status = json!({
            "axes": { "z": { "hint": "arm the axis" } },
            "devices": [device("module"), device("cnc")],
            "missing": [format!("device module: lost: refused: {hint}"), format!("device cnc: lost: refused: {hint}")]
        });
        let expected = "device module: lost: refused; device cnc: lost: refused; to do: is the port right?";
        assert_eq!(unhealthy(&status).as_deref(), Some(expected));
        status["missing"] = json!([]);
        assert_eq!(unhealthy(&status), None);
    }
}
