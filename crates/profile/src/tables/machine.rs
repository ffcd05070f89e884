//! `[machine]`.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::{At, label};
use crate::duration::Timespan;
use crate::error::allowed;
use crate::guarded::guarded_keys;
use isotherm_core::compensation::settings::MachineSettings;

/// What the machine is.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Machine")]
pub(crate) struct RawMachine {
    /// Used in topics, metrics and file names.
    #[schemars(required, regex(pattern = "^[a-z0-9-]+$"))]
    name: Option<String>,
    /// The form of the profile itself; this program knows 1. Default 1.
    version: Option<u64>,
    /// One line for people.
    description: Option<String>,
    /// What people call it, in any script: shown beside the name.
    label: Option<String>,
    /// The signal whose rising edge starts `t`, the time since machine start. Default: the first good reading starts it.
    on: Option<String>,
    /// The signal whose rising edge captures the references given as "zero".
    zero: Option<String>,
    /// Captured references are the mean over this long. Default "0s": the first good reading.
    pub(super) settle: Option<Timespan>,
    /// When an axis begins to write: by itself once all is verified and good, or when a person says so. Default "auto".
    arm: Option<Arm>,
    /// How long a request to arm that cannot be served yet waits, visibly. Default "10min".
    arm_timeout: Option<Timespan>,
    /// What a stop does to the registers: the axes' fault actions run, or what stands there stays. Default "fault-action".
    on_stop: Option<OnStop>,
    /// Keys that a layer above this file may set though they guard an axis, as "axis.z.limit" and "machine.arm", or change what
    /// arrives at the machine, as "output.cnc_z.scale": those that are marked in this chapter. Default: none; layers may make
    /// `limit`, `step` and `rate` smaller, and `arm` "manual".
    allow_override: Option<Vec<String>>,
}

/// The form of a profile that this program knows.
const FORM: u64 = 1;
/// With a date and an ending it is the name of a file.
const LONGEST_NAME: usize = 64;
/// A request to arm waits this long where nothing else is said.
const ARM_TIMEOUT: Duration = Duration::from_secs(600);
/// A request that is older says nothing of what a person wants now.
const LONGEST_ARM_TIMEOUT: Duration = Duration::from_secs(24 * 3600);

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

/// What a stop of the gateway does to the registers that it writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "OnStopWord", description = "")]
pub enum OnStop {
    /// The axes' fault actions run, without their waiting time.
    #[default]
    FaultAction,
    /// What stands there stays, and the next start goes on from it.
    Hold,
}

impl OnStop {
    /// Its word in a profile.
    pub fn word(self) -> &'static str {
        match self {
            OnStop::FaultAction => "fault-action",
            OnStop::Hold => "hold",
        }
    }
}

/// What of a profile is about the whole machine.
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

pub(super) fn resolve(at: &At<'_>, raw: Option<&RawMachine>) -> Machine {
    let Some(raw) = raw else { return Machine::default() };
    let name = raw.name.clone().unwrap_or_default();
    let is_plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
    if raw.name.is_some() && (name.is_empty() || !name.bytes().all(is_plain)) {
        let help =
            "allowed: small letters a to z, digits and `-`; it goes into topics, metrics and file names";
        at.key("name").wrong(format!("`{name}` cannot be a machine's name"), help);
    } else if name.len() > LONGEST_NAME {
        let message = format!("a machine's name of {} characters does not fit into file names", name.len());
        at.key("name").wrong(message, format!("allowed: up to {LONGEST_NAME}"));
    }
    if let Some(version) = raw.version.filter(|version| *version != FORM) {
        let message = format!("a profile of version {version}; this isotherm knows version {FORM}");
        at.key("version")
            .wrong(message, "install the isotherm that it was written for, or leave the key out");
    }
    let settings = MachineSettings {
        on: at.key("on").signal(raw.on.as_ref()),
        zero: at.key("zero").signal(raw.zero.as_ref()),
        settle: raw.settle.map(|Timespan(span)| span).unwrap_or_default(),
        ..MachineSettings::default()
    };
    let arm_timeout = at.key("arm_timeout").duration(raw.arm_timeout).unwrap_or(ARM_TIMEOUT);
    if arm_timeout > LONGEST_ARM_TIMEOUT {
        let message = "a request to arm would wait for more than a day".to_owned();
        at.key("arm_timeout").wrong(message, "write at most \"24h\"");
    }
    if let Some(keys) = &raw.allow_override {
        only_guarded(&at.key("allow_override"), keys);
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

/// Each of these keys is one that a layer would otherwise not set.
fn only_guarded(at: &At<'_>, keys: &[String]) {
    let check = at.check;
    let guarded = guarded_keys(&[
        ("axis", &check.axes.names),
        ("output", &check.outputs.names),
        ("set", &check.sets.names),
        ("heartbeat", &[]),
        ("bus", &check.buses.names),
        ("device", &check.devices.names),
        ("signal", &check.signals.names),
    ]);
    for (place, key) in keys.iter().enumerate().filter(|(_, key)| !guarded.contains(key)) {
        let help = allowed(key, guarded.iter().map(String::as_str));
        at.item(place).wrong(format!("`{key}` is no key that layers may not set"), help);
    }
}
