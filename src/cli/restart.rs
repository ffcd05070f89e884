//! `isotherm restart --keep`: replaces the running gateway by another program or profile.

use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use super::command::RunningGateway;
use super::loading::{ProfileArguments, WrongProfile, load_quietly};
use super::running;
use crate::cli::print::say_beside;
use crate::clock::BootClock;
use crate::gateway::control::{self, Failure};
use crate::observe::status::Answer;
use isotherm_profile::safe_file;

/// Time limit within which the new gateway must have an answer of every device and a decision of every axis.
const READY_WITHIN: Duration = Duration::from_secs(15);
const LOOK_EVERY: Duration = Duration::from_millis(100);
/// Shortest time limit for the check of the new program, and then for its start. The limit is three times the duration
/// of the same check in this process, if that is longer.
const SHORTEST: Duration = Duration::from_secs(10);

/// Replaces the gateway that runs this profile on this computer. The new program is the file that is now at the path of
/// the running program. It gets the same arguments and the current profile. No register changes: an armed axis resumes
/// from the register value, and an axis that is off stays off.
///
/// This verb first checks the profile. If the profile is wrong (exit code 64), the running gateway continues.
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  isotherm restart my-machine.toml --keep")]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// Keeps all register values. This option is required: for a restart without it, stop the gateway and start it
    /// again
    #[arg(long, required = true)]
    keep: bool,
    #[command(flatten)]
    gateway: RunningGateway,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile, gateway, .. } = arguments;
    let clock = BootClock::default();
    let begun = clock.passed();
    let loaded = load_quietly(&profile.path, &profile.set, gateway.json).inspect_err(|_| {
        // The gateway also reports that the profile is wrong, if it can be found.
        if let Some(said) = report_wrong(&profile.path, gateway) {
            say_beside!("{said}");
        }
    })?;
    let socket = gateway.socket(&loaded.profile)?;
    let within = limit(clock.passed() - begun);
    let replaced = control::restart(&socket, within, |said| say_beside!("{said}"));
    gateway.print(Ok(Answer::Done(sentence(&taken_over(&socket, replaced)?))))
}

/// Waits until the new gateway has taken over completely, at most for [`READY_WITHIN`], and returns its status.
/// `replaced` is the first status of the new gateway, or the reason why it did not replace the old one.
///
/// # Errors
/// The profile is wrong, and its errors were printed; or the running gateway was not replaced.
pub(super) fn taken_over(socket: &Path, replaced: Result<String, Failure>) -> anyhow::Result<Value> {
    match replaced {
        Err(Failure::WrongProfile(why)) => {
            say_beside!("isotherm: {why}");
            Err(WrongProfile.into())
        }
        replaced => Ok(ready(socket, replaced?)),
    }
}

/// Returns the time limit for the check of the new program, and then for its start. `own_check` is the duration of the
/// same check in this process.
pub(super) fn limit(own_check: Duration) -> Duration {
    SHORTEST.max(own_check * 3)
}

/// Polls the new gateway until every device has answered and every axis has decided, or the time limit is over. Returns
/// its last status.
fn ready(socket: &Path, first: String) -> Value {
    let until = BootClock::default().passed() + READY_WITHIN;
    let mut text = first;
    loop {
        let status: Value = serde_json::from_str(&text).unwrap_or_default();
        let is_complete = status["missing"].as_array().is_some_and(Vec::is_empty);
        if is_complete || BootClock::default().passed() >= until {
            return status;
        }
        std::thread::sleep(LOOK_EVERY);
        text = control::status(socket).unwrap_or(text);
    }
}

/// Returns the sentence that names the running version and the state of each axis.
pub(super) fn sentence(status: &Value) -> String {
    let word = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let axis = |axis: &Value| match word(&axis["why"]) {
        why if why.is_empty() => format!("{}: {}", word(&axis["name"]), word(&axis["display"])),
        why => format!("{}: {}: {why}", word(&axis["name"]), word(&axis["display"])),
    };
    let axes: Vec<String> = status["axes"].as_array().into_iter().flatten().map(axis).collect();
    format!(
        "{}: isotherm {} has taken over; {}",
        word(&status["machine"]),
        word(&status["version"]),
        axes.join("; ")
    )
}

/// Reports the errors of the profile to the gateway that runs it, and returns the answer. Returns `None` if no such
/// gateway is found.
fn report_wrong(profile: &Path, gateway: &RunningGateway) -> Option<String> {
    let text = safe_file::read_text(profile).unwrap_or_default();
    if let Some(name) = name_in(&text) {
        let socket = running::of_machine(gateway.state(), None, name).ok()?;
        return control::restart_is_wrong(&socket, None).ok();
    }
    // Each gateway compares the path with that of its own profile.
    let profile = std::path::absolute(profile).ok()?;
    let sockets = running::all(gateway.state()).ok()?;
    sockets.iter().find_map(|socket| control::restart_is_wrong(socket, Some(&profile)).ok())
}

/// Returns the machine's name in the text of a profile, which may contain errors; `None` if it is not found.
fn name_in(text: &str) -> Option<&str> {
    let machine = text.lines().map(str::trim).skip_while(|line| *line != "[machine]").skip(1);
    let name =
        machine.take_while(|line| !line.starts_with('[')).find_map(|line| line.strip_prefix("name"))?;
    name.split('"').nth(1).filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_program_has_ten_seconds_or_three_times_as_long_as_this_check() {
        for (own, limit) in [(0, 10_000), (3_333, 10_000), (3_334, 10_002), (40_000, 120_000)] {
            assert_eq!(self::limit(Duration::from_millis(own)), Duration::from_millis(limit));
        }
    }

    #[test]
    fn the_name_of_a_machine_is_found_where_the_profile_is_wrong() {
        assert_eq!(
            name_in("# mine\n[machine]\nlabel = \"a\"\nname   = \"mill-7\" # ours\n[bus.a\n"),
            Some("mill-7")
        );
        assert_eq!(name_in("[machine]\n[device.a]\nname = \"b\"\n"), None);
    }
}
