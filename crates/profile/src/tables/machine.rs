//! `[machine]`.

use schemars::JsonSchema;
use serde::Deserialize;

use super::At;
use crate::duration::Timespan;
use isotherm_core::compensation::settings::MachineSettings;

/// What the machine is.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Machine")]
pub(crate) struct RawMachine {
    /// Used in topics, metrics and file names.
    #[schemars(required, regex(pattern = "^[a-z0-9-]+$"))]
    name: Option<String>,
    /// One line for people.
    description: Option<String>,
    /// The signal whose rising edge starts machine-on time t. Default: the first good reading starts it.
    on: Option<String>,
    /// The signal whose rising edge captures the references given as "zero".
    zero: Option<String>,
    /// Captured references are the mean over this long. Default "0s": the first good reading.
    settle: Option<Timespan>,
    /// When an axis begins to write: by itself once all is verified and good, or when a person says so. Default "auto".
    arm: Option<Arm>,
}

/// When an axis may begin to write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ArmWord", description = "")]
pub enum Arm {
    /// Once its devices are verified and its readings good.
    #[default]
    Auto,
    /// When a person says so.
    Manual,
}

/// What of a profile is about the whole machine.
#[derive(Default)]
pub(super) struct Machine {
    pub(super) name: String,
    pub(super) description: String,
    pub(super) settings: MachineSettings,
    pub(super) arm: Arm,
}

pub(super) fn resolve(at: &At<'_>, raw: Option<&RawMachine>) -> Machine {
    let Some(raw) = raw else { return Machine::default() };
    let name = raw.name.clone().unwrap_or_default();
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    if raw.name.is_some() && (name.is_empty() || !name.bytes().all(is_plain)) {
        let help =
            "allowed: small letters a to z, digits and `-`; it goes into topics, metrics and file names";
        at.key("name").wrong(format!("`{name}` cannot be a machine's name"), help);
    }
    let settings = MachineSettings {
        on: at.key("on").signal(raw.on.as_ref()),
        zero: at.key("zero").signal(raw.zero.as_ref()),
        settle: raw.settle.map(|Timespan(span)| span).unwrap_or_default(),
        ..MachineSettings::default()
    };
    Machine {
        name,
        description: raw.description.clone().unwrap_or_default(),
        settings,
        arm: raw.arm.unwrap_or_default(),
    }
}
