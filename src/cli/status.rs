//! `isotherm status`: what the page shows, in a terminal or for a program.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::{Map, Value};

use super::{load_quietly, running};
use crate::cli::say::{clear, say, say_all};
use crate::gateway::control;
use isotherm_profile::{Unit, labelled};

/// How often `--watch` looks.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// What the running gateway of this computer does: the content of its page.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  isotherm status my-machine.toml\n  isotherm status --healthy\n  \
                        isotherm status --json")]
pub(super) struct Arguments {
    /// The profile; without one the only gateway that runs with this state directory
    profile: Option<PathBuf>,
    /// The state directory that the gateway was started with
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// One JSON document
    #[arg(long, conflicts_with = "healthy")]
    json: bool,
    /// Again every second, until Ctrl-C
    #[arg(long, conflicts_with = "healthy")]
    watch: bool,
    /// One line, and exit code 0 where everything holds the machine to its cold geometry, else 1
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
            let missing: Vec<&str> = texts(&status["missing"]);
            anyhow::ensure!(missing.is_empty(), "not healthy: {}", missing.join("; "));
            return Ok(say!("healthy")?);
        }
        match (arguments.json, arguments.watch) {
            (true, true) => say!("{status}")?,
            (true, false) => say!("{}", serde_json::to_string_pretty(&status)?)?,
            (false, watch) => {
                if watch {
                    clear()?;
                }
                say_all!("{}", text(&status))?;
            }
        }
        if !arguments.watch {
            return Ok(());
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// As programs read it: axes by their names.
fn document(text: &str) -> anyhow::Result<Value> {
    let mut status: Value = serde_json::from_str(text)?;
    let axes = status["axes"].take();
    let named =
        axes.as_array().into_iter().flatten().map(|axis| (word(&axis["name"]).to_owned(), axis.clone()));
    status["axes"] = Value::Object(named.collect::<Map<String, Value>>());
    Ok(status)
}

fn word(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn texts(value: &Value) -> Vec<&str> {
    value.as_array().into_iter().flatten().filter_map(Value::as_str).collect()
}

fn micron(value: &Value) -> String {
    value.as_f64().map_or("—".to_owned(), |value| format!("{value:+.1} µm"))
}

fn span(value: &Value) -> String {
    let span = Duration::try_from_secs_f64(value.as_f64().unwrap_or_default()).unwrap_or_default();
    humantime::format_duration(Duration::from_secs(span.as_secs())).to_string()
}

/// What people call it, at the end of its line: characters of some scripts are wider than others.
fn aside(what: &Value) -> String {
    match word(&what["label"]) {
        "" => String::new(),
        label => format!("  ({label})"),
    }
}

/// As a person reads it.
fn text(status: &Value) -> String {
    let mut text = format!(
        "{} at {}, clock {}, up for {}\n",
        labelled(word(&status["machine"]), word(&status["label"])),
        word(&status["now"]).get(..19).unwrap_or_default().replace('T', " "),
        word(&status["clock"]),
        span(&status["uptime_s"])
    );
    // Writing to a string never fails.
    for (name, axis) in status["axes"].as_object().into_iter().flatten() {
        let _ = writeln!(text, "\naxis {}: {}", labelled(name, word(&axis["label"])), word(&axis["display"]));
        let why = word(&axis["why"]);
        if !why.is_empty() {
            let _ = writeln!(text, "  {why}");
        }
        let age = axis["verified_age_s"].as_f64().map_or(String::new(), |age| format!(", {age:.0} s ago"));
        let (wanted, verified) = (micron(&axis["cz_um"]), micron(&axis["verified_um"]));
        let _ = writeln!(text, "  Cz {wanted} wanted, {verified} verified{age}");
    }
    let rows = |key: &str, row: &dyn Fn(&Value) -> String| -> String {
        status[key].as_array().into_iter().flatten().map(row).collect()
    };
    let overridden = rows("overridden", &|one| {
        let profile = one["profile"].as_str().unwrap_or("nothing");
        let (key, now, from) = (word(&one["key"]), word(&one["now"]), word(&one["from"]));
        format!("  {key} = {now}, in the profile {profile}, from {from}\n")
    });
    if !overridden.is_empty() {
        text += &format!("\nset above the profile\n{overridden}");
    }
    text += "\nsignals\n";
    text += &rows("signals", &|signal| {
        let unit = Unit::named(word(&signal["unit"])).map_or(String::new(), |unit| unit.to_string());
        let (value, unit) = match signal["value"].as_f64() {
            Some(value) if unit == "bool" => (if value > 0.0 { "on" } else { "off" }.to_owned(), ""),
            Some(value) => (format!("{value:.3}"), unit.as_str()),
            None => ("—".to_owned(), unit.as_str()),
        };
        let quality = if signal["quality"] == "good" { "good" } else { word(&signal["reason"]) };
        format!("  {:<16}{value:>12} {unit:<6} {quality}{}\n", word(&signal["name"]), aside(signal))
    });
    text += "\ndevices\n";
    text += &rows("devices", &|device| {
        let fault = word(&device["fault"]);
        let fault = if fault.is_empty() { String::new() } else { format!(": {fault}") };
        format!("  {:<16}{}{fault}{}\n", word(&device["name"]), word(&device["state"]), aside(device))
    });
    text
}
