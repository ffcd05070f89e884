//! `share` of an output: who writes to its register.

use schemars::JsonSchema;
use serde::Deserialize;

use super::RawOutput;
use crate::tables::KeyContext;
use crate::tables::device::Device;
use isotherm_core::codec::{DataType, Table};

/// Who writes to the register of an output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(rename = "ShareWord", description = "")]
pub enum Share {
    /// Only the gateway writes to the register.
    #[default]
    Whole,
    /// An operator also writes to the register. The register ledger on disk stores the gateway share (part of the value
    /// that the gateway has added).
    Ledger,
}

impl Share {
    /// Returns the smallest permitted step of the axis, in counts of the register. A shared register needs
    /// two counts, because its value must never become zero. Zero is the value after a restart of the CNC.
    pub const fn counts_of_a_step(self) -> u32 {
        match self {
            Share::Whole => 1,
            Share::Ledger => 2,
        }
    }
}

/// Resolves the key `share`. Reports an error if the output lacks a requirement for sharing its register with an
/// operator.
pub(crate) fn resolve(
    raw: &RawOutput,
    at: &KeyContext<'_>,
    data_type: DataType,
    device: Option<&Device>,
) -> Share {
    let share = raw.share.unwrap_or_default();
    if share == Share::Whole {
        return share;
    }
    let place = at.key("share");
    if raw.is_accepted_by_echo() {
        let message = "the gateway share is known only if the register is read: verify = \"echo\" is not \
                       enough for share = \"ledger\"";
        at.key("verify").invalid(message, "remove `verify`, or write verify = \"read-back\"");
        // Otherwise the check of the read-back reports it.
        if device.is_some_and(|device| !device.functions.reads(Table::Holding)) {
            let message = "the gateway share is known only if the register is read, but `functions` of the \
                           device does not allow reading";
            let help = "add \"read-holding\" to `functions` of the device, if the device supports it";
            place.invalid(message, help);
        }
    }
    if raw.is_no_offset() {
        let message = "only an offset can share its register with an operator";
        place.invalid(message, "write writes = \"offset\", or share = \"whole\"");
    }
    if !matches!(data_type, DataType::I16 | DataType::U16 | DataType::I32 | DataType::U32) {
        let message = format!(
            "{} cannot hold an exact sum: share = \"ledger\" needs an integer type of at most 32 bits",
            data_type.name()
        );
        let help = "use type = \"i16\", \"u16\", \"i32\" or \"u32\", or share = \"whole\"";
        place.invalid(message, help);
    }
    share
}
