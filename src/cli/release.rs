//! `isotherm release`: returns the register of a moved or removed output to its base value.

use std::io::IsTerminal;
use std::time::Duration;

use serde_json::Value;

use super::command::RunningGateway;
use super::loading::{ProfileArguments, load};
use super::restart;
use super::values::typed;
use crate::cli::print::say_beside;
use crate::clock::BootClock;
use crate::gateway::control;
use crate::observe::status::Answer;
use isotherm_profile::duration_text;
use isotherm_profile::safe_file::quoted;

/// Answer that confirms the release.
const YES: &str = "yes";

/// Returns the register of an output that was moved or removed in the profile to its base value. The gateway removes
/// its own offset in steps, within the limit, step and rate that the output had. An operator offset in the same
/// register stays.
///
/// The gateway is restarted as by `isotherm restart --keep`, so that the current profile takes effect; nothing else
/// moves. The release begins only if the register holds the value that is shown here. If the gateway ends before the
/// release is complete, the register keeps its value, and you must release it again. Without a terminal, `--yes` is
/// needed.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm release my-machine.toml cnc_z\n  isotherm release my-machine.toml cnc_z --yes"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The output that was moved or removed, by its former name
    #[arg(value_name = "OUTPUT")]
    output: String,
    /// Releases without a question
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    gateway: RunningGateway,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let Arguments { profile, output, yes, gateway } = arguments;
    let clock = BootClock::default();
    let begun = clock.passed();
    let profile = load(profile, gateway.json)?;
    let within = restart::limit(clock.passed() - begun);
    let socket = gateway.socket(&profile)?;
    let status: Value = serde_json::from_str(&control::status(&socket)?).unwrap_or_default();
    let left = status["left"].as_array().map_or(&[][..], Vec::as_slice);
    let of_output: Vec<&Value> = left.iter().filter(|one| one["output"] == output.as_str()).collect();
    if of_output.is_empty() {
        let present = status["outputs"].as_array().map_or(&[][..], Vec::as_slice);
        let is_present = present.iter().any(|known| known["name"] == output.as_str());
        anyhow::bail!("{}", nothing_left(output, is_present, left));
    }
    if let Some(returning) = of_output.iter().find(|one| one["state"] == "returning") {
        let said = format!("output {output} is being released already: {}", way(returning));
        return gateway.print(Ok(Answer::Done(said)));
    }
    let obstacle = |one: &&&Value| one["obstacle"].as_str().map(str::to_owned);
    let can: Vec<&&Value> = of_output.iter().filter(|one| obstacle(one).is_none()).collect();
    if can.is_empty() {
        let why = of_output.iter().find_map(|one| obstacle(&one)).unwrap_or_default();
        anyhow::bail!("output {output}: {} cannot be released: {why}", word(&of_output[0]["register"]));
    }
    for one in &can {
        say_beside!("output {output}: {}", way(one));
    }
    let seen: Vec<f64> = can.iter().map(|one| seen(one)).collect();
    say_beside!(
        "For the release, the gateway is restarted as by `isotherm restart --keep`, with the current profile."
    );
    anyhow::ensure!(*yes || is_wanted()?, "nothing is released");
    let replaced = control::release(&socket, (output, &seen), within, |said| say_beside!("{said}"));
    let status = restart::taken_over(&socket, replaced)?;
    if let Some(why) = not_released(&status, output) {
        anyhow::bail!("output {output}: nothing is released: {why}");
    }
    gateway.print(Ok(Answer::Done(restart::sentence(&status))))
}

/// Asks the operator on the terminal for confirmation. Returns whether the operator has confirmed.
fn is_wanted() -> anyhow::Result<bool> {
    anyhow::ensure!(
        std::io::stdin().is_terminal(),
        "nothing is released, because there is no terminal for the question: add --yes"
    );
    say_beside!("Remove the gateway's offset from the register, in steps? Type {YES}:");
    Ok(typed()?.is_some_and(|text| text.trim() == YES))
}

/// Returns the message that explains why no register of an output can be released. `is_present`: the gateway still
/// writes to the output. `left`: registers of other outputs, which can be released.
fn nothing_left(output: &str, is_present: bool, left: &[Value]) -> String {
    let mut names: Vec<&str> = left.iter().map(|one| word(&one["output"])).collect();
    names.dedup();
    let others = match names.as_slice() {
        [] => "there is nothing to release now".to_owned(),
        names => format!("these can be released: {}", names.join(", ")),
    };
    match is_present {
        true => format!(
            "the running gateway writes to output {output}, and no other register has an offset of this \
             output. To release its register, first move or remove the output in the profile, and run \
             `isotherm restart --keep`; {others}"
        ),
        false => format!(
            "no register of an output {} that was moved or removed holds a value of the gateway; {others}",
            quoted(output)
        ),
    }
}

/// Returns the reason why a register of the output is not being released. Returns `None` if each register returns to
/// its base value, or has reached it.
fn not_released(status: &Value, output: &str) -> Option<String> {
    let mut left = status["left"].as_array()?.iter();
    let left = left.find(|one| one["output"] == output && one["state"] == "left")?;
    let holds = || match left["found_um"].as_f64() {
        Some(um) => format!(
            "{} holds {um:.1} µm: compare this value with the control, and release the register again",
            word(&left["register"])
        ),
        None => format!("`isotherm events` shows what happened to {}", word(&left["register"])),
    };
    Some(left["obstacle"].as_str().map_or_else(holds, str::to_owned))
}

/// Returns the offset of the gateway in a register as the operator has seen it on the terminal, µm.
fn seen(left: &Value) -> f64 {
    left["found_um"].as_f64().or(left["held_um"].as_f64()).unwrap_or_default()
}

/// Describes the offset that the gateway left in a register, and how the register returns to its base value.
fn way(left: &Value) -> String {
    let figure = |key: &str| left[key].as_f64();
    let micron =
        |key: &str| figure(key).map_or("an unknown number of µm".to_owned(), |um| format!("{um:.1} µm"));
    let register = word(&left["register"]);
    let holds = match figure("found_um") {
        None => format!("{} from the gateway were verified in {register}", micron("held_um")),
        Some(_) => format!(
            "{register} held {} when it was read last; before that, {} from the gateway were verified in it",
            micron("found_um"),
            micron("held_um")
        ),
    };
    let beside = figure("operator").map_or(String::new(), |part| {
        format!(", with an operator offset of {part} in the unit of the register")
    });
    let bound = |key: &str| figure(key).map_or("unknown".to_owned(), |um| format!("{um} µm"));
    let seconds = figure("back_s").and_then(|seconds| Duration::try_from_secs_f64(seconds.ceil()).ok());
    format!(
        "{holds}{beside}; the register returns to its base value by at most {} per update and {}/s, within \
         ±{}: this takes about {}",
        bound("step_um"),
        bound("rate_um_per_s"),
        bound("limit_um"),
        duration_text(seconds.unwrap_or_default())
    )
}

fn word(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_person_sees_value_bounds_and_time() {
        let mut left = json!({
            "output": "cnc_z", "register": "holding:104 (40105) of unit 1 at 10.0.0.7:502", "held_um": 20.0, "found_um": null,
            "limit_um": 40.0, "step_um": 1.0, "rate_um_per_s": 0.25, "back_s": 80.0,
        });
        assert_eq!(
            way(&left),
            "20.0 µm from the gateway were verified in holding:104 (40105) of unit 1 at 10.0.0.7:502; \
             the register returns to its base value by at most 1 µm per update and 0.25 µm/s, within ±40 \
             µm: this takes about 1m 20s"
        );
        left["operator"] = 3.5.into();
        assert!(
            way(&left).contains(
                "at 10.0.0.7:502, with an operator offset of 3.5 in the unit of the register; the register \
                 returns"
            ),
            "{}",
            way(&left)
        );
        assert!((seen(&left) - 20.0).abs() < 1e-9);
        left["found_um"] = 5.0.into();
        assert!((seen(&left) - 5.0).abs() < 1e-9);
        assert!(
            way(&left).contains("held 5.0 µm when it was read last; before that, 20.0 µm from the gateway"),
            "{}",
            way(&left)
        );
    }

    #[test]
    fn a_register_that_stays_as_it_is_is_no_success() {
        let of = |state: &str, found: Value, obstacle: Value| {
            let left = json!({ "output": "cnc_z", "register": "holding:104", "state": state, "found_um": found, "obstacle": obstacle });
            not_released(&json!({ "left": [left] }), "cnc_z")
        };
        assert_eq!(of("returning", Value::Null, Value::Null), None);
        assert_eq!(not_released(&json!({ "left": [] }), "cnc_z"), None);
        assert_eq!(of("left", Value::Null, json!("a reason")), Some("a reason".to_owned()));
        assert!(of("left", json!(5.0), Value::Null).unwrap().contains("holding:104 holds 5.0 µm"));
        assert!(of("left", Value::Null, Value::Null).unwrap().contains("isotherm events"));
    }

    #[test]
    fn an_output_of_which_nothing_is_left_is_answered_with_those_of_which_something_is() {
        let left = [json!({ "output": "cnc_x" }), json!({ "output": "cnc_x" }), json!({ "output": "cnc_y" })];
        let said = nothing_left("cnc_z", false, &left);
        assert!(said.contains("cnc_z") && said.ends_with("these can be released: cnc_x, cnc_y"), "{said}");
        let said = nothing_left("cnc_z", true, &[]);
        assert!(
            said.contains("the running gateway writes to output cnc_z") && said.contains("restart --keep"),
            "{said}"
        );
        assert!(said.ends_with("there is nothing to release now"), "{said}");
    }
}
