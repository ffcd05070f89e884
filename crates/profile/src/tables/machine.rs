//! `[machine]`: settings of the whole machine.

use std::collections::HashSet;
use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{KeyContext, label};
use crate::duration::Timespan;
use crate::error::allowed;
use isotherm_core::compensation::settings::MachineSettings;

/// Settings of the whole machine.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Machine")]
pub(crate) struct RawMachine {
    /// Name of the machine in topics, metrics and file names.
    #[schemars(required, regex(pattern = "^[a-z0-9-]+$"))]
    name: Option<String>,
    /// Version of the profile's format. This program supports 1. Default 1.
    version: Option<u64>,
    /// Description of the machine in one line.
    description: Option<String>,
    /// Display name of the machine in any writing system, for example Chinese. It is shown next to the name.
    label: Option<String>,
    /// Signal whose rising edge starts `t`, the time since machine start. Default: the first good reading starts it.
    on: Option<String>,
    /// Signal whose rising edge captures the references given as "zero".
    zero: Option<String>,
    /// Averaging time of captured references. Default "0s": the first good reading.
    pub(super) settle: Option<Timespan>,
    /// Arming of the axes. "auto": automatically, once all devices are verified and all readings are good. "manual": by
    /// the operator. Default "auto".
    arm: Option<Arm>,
    /// Timeout of a request to arm that cannot be executed yet. The request is shown while it waits. Default "10min".
    arm_timeout: Option<Timespan>,
    /// Action on the registers when the gateway stops. "fault-action": the fault actions of the axes. "hold": the
    /// register values stay. Default "fault-action".
    on_stop: Option<OnStop>,
    /// Keys that layers above this file (local file, environment, `--set`) may set, although they protect an axis or
    /// change the data that the machine receives. The manual's chapter on the profile marks these keys, for example
    /// "axis.z.limit", "machine.arm" and "output.cnc_z.scale". Default: none. Layers may always reduce `limit`, `step`
    /// and `rate`, and set `arm` to "manual".
    allow_override: Option<Vec<String>>,
}

/// Version of the profile's format that this program supports.
const FORM: u64 = 1;
/// Longest name of a machine, in characters. With a date and an extension, the name must be a valid file name.
const LONGEST_NAME: usize = 64;
/// Default timeout of a request to arm.
const ARM_TIMEOUT: Duration = Duration::from_secs(600);
/// Longest timeout of a request to arm. An older request may not be what the operator wants now.
const LONGEST_ARM_TIMEOUT: Duration = Duration::from_secs(24 * 3600);

/// Whether axes are armed automatically, or only by the operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ArmWord", description = "")]
pub enum Arm {
    /// The axis is armed automatically, once its devices are verified and its readings are good.
    #[default]
    Auto,
    /// Only the operator arms the axis.
    Manual,
}

/// Action on the registers when the gateway stops.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "OnStopWord", description = "")]
pub enum OnStop {
    /// The axes execute their fault actions, without the waiting time before a ramp.
    #[default]
    FaultAction,
    /// The register values stay, and the next start resumes from them.
    Hold,
}

/// Resolved settings of the whole machine. They become fields of `Profile`.
#[derive(Default)]
pub(super) struct Machine {
    pub(super) name: String,
    pub(super) description: String,
    pub(super) label: String,
    pub(super) settings: MachineSettings,
    pub(super) arm: Arm,
    pub(super) arm_timeout: Duration,
    pub(super) on_stop: OnStop,
}

/// Resolves the table `[machine]`. `guarded` returns the keys that a layer above the profile file may set only with
/// permission.
pub(super) fn resolve(
    at: &KeyContext<'_>,
    raw: Option<&RawMachine>,
    guarded: impl Fn() -> Vec<String>,
) -> Machine {
    let Some(raw) = raw else { return Machine::default() };
    let name = raw.name.clone().unwrap_or_default();
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    if raw.name.is_some() && (name.is_empty() || !name.bytes().all(is_plain)) {
        let help = "allowed: small letters a to z, digits and `-`; the name is used in topics, metrics and \
                    file names";
        at.key("name").invalid(format!("`{name}` cannot be a machine's name"), help);
    } else if name.len() > LONGEST_NAME {
        let message = format!("a machine's name of {} characters is too long for file names", name.len());
        at.key("name").invalid(message, format!("allowed: up to {LONGEST_NAME}"));
    }
    if let Some(version) = raw.version.filter(|version| *version != FORM) {
        let message =
            format!("the profile has version {version}, but this isotherm supports only version {FORM}");
        at.key("version").invalid(message, "install the isotherm version of this profile, or remove the key");
    }
    let settings = MachineSettings {
        on: at.key("on").signal(raw.on.as_ref()),
        zero: at.key("zero").signal(raw.zero.as_ref()),
        settle: raw.settle.map(|Timespan(span)| span).unwrap_or_default(),
        ..MachineSettings::default()
    };
    let arm_timeout = at.key("arm_timeout").duration(raw.arm_timeout).unwrap_or(ARM_TIMEOUT);
    if arm_timeout > LONGEST_ARM_TIMEOUT {
        let message = "`arm_timeout` is longer than a day".to_owned();
        at.key("arm_timeout").invalid(message, "write at most \"24h\"");
    }
    if let Some(keys) = &raw.allow_override {
        only_guarded(&at.key("allow_override"), keys, &guarded());
    }
    Machine {
        name,
        description: raw.description.clone().unwrap_or_default(),
        label: label::resolve(&at.key("label"), raw.label.as_ref()),
        settings,
        arm: raw.arm.unwrap_or_default(),
        arm_timeout,
        on_stop: raw.on_stop.unwrap_or_default(),
    }
}

/// Rejects keys in `allow_override` that need no permission, or that do not exist.
fn only_guarded(at: &KeyContext<'_>, keys: &[String], guarded: &[String]) {
    let known: HashSet<&String> = guarded.iter().collect();
    for (place, key) in keys.iter().enumerate().filter(|(_, key)| !known.contains(key)) {
        let help = allowed(key, guarded.iter().map(String::as_str));
        at.item(place).invalid(format!("`{key}` is not a protected key, or does not exist"), help);
    }
}
