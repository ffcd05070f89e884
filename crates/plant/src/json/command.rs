//! What arrives below `GROUP/MACHINE/command`.

use serde::Deserialize;

use crate::seam::{Command, Outcome};

/// More is no command.
const LONGEST: usize = 1000;
/// Of a name that is quoted.
const LONGEST_NAME: usize = 40;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measured {
    axis: String,
    /// Actual minus commanded, µm, while the compensation acts.
    error_um: f64,
}

/// What this command asks for, or why it is not done.
pub(super) fn read(command: &str, payload: &[u8]) -> Outcome {
    let refused = |why: String| {
        let command = command.chars().take(LONGEST_NAME).collect();
        Outcome::Refused { command, why }
    };
    if command != "measured" {
        return refused("nothing but measured errors is taken over the broker".to_owned());
    }
    if payload.len() > LONGEST {
        return refused(format!("{} bytes are no measured error", payload.len()));
    }
    match serde_json::from_slice::<Measured>(payload) {
        Ok(Measured { axis, error_um }) => Outcome::Asked(Command::Measured { axis, error_um }),
        Err(error) => refused(format!(
            "send {{ \"axis\": \"z\", \"error_um\": 3.2 }}, a number in µm, actual minus commanded ({error})"
        )),
    }
}
