//! Commands that arrive on the MQTT topics below `GROUP/MACHINE/command`.

use isotherm_core::compensation::MeasuredReport;
use serde::Deserialize;

use crate::interface::{Command, Outcome};

/// Maximum length of a received command, in bytes.
const LONGEST: usize = 1000;
/// Maximum length of a command name in a refusal, in characters. The rest of a longer name is cut.
const LONGEST_NAME: usize = 40;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Measured {
    axis: String,
    /// Actual minus commanded position of the axis, measured while the compensation is active, in µm.
    error_um: f64,
    time: Option<String>,
    id: Option<String>,
}

impl Measured {
    fn command(payload: &[u8]) -> Result<Command, String> {
        let Measured { axis, error_um, time, id } =
            serde_json::from_slice(payload).map_err(|error| error.to_string())?;
        let report = MeasuredReport::new(error_um, time.as_deref(), id.as_deref())?;
        Ok(Command::Measured { axis, report })
    }
}

/// Parses a received command. `command` is the last level of its topic. The outcome of an invalid command contains the
/// reason.
pub(super) fn read(command: &str, payload: &[u8]) -> Outcome {
    let refused = |why: String| {
        let command = command.chars().take(LONGEST_NAME).collect();
        Outcome::Refused { command, why }
    };
    if command != "measured" {
        return refused("the gateway accepts only measured errors over MQTT".to_owned());
    }
    if payload.len() > LONGEST {
        return refused(format!("{} bytes are too many for a measured error", payload.len()));
    }
    match Measured::command(payload) {
        Ok(command) => Outcome::Asked(command),
        Err(error) => refused(format!(
            "send {{ \"axis\": \"z\", \"error_um\": 3.2 }}, a number in µm, actual minus commanded ({error})"
        )),
    }
}
