//! `verify` of an output: how its writes are verified.

use schemars::JsonSchema;
use serde::Deserialize;

use isotherm_core::codec::Object;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum VerifyWord {
    ReadBack,
    Echo,
}

/// Way of verifying that a written value has arrived at the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verify {
    /// The written register, object or node is read after the write.
    ReadBack,
    /// A write is verified if the answer of the device repeats address and value.
    Echo,
    /// The value is read from this CANopen object, which has the type of the written value.
    ReadBackAt(Object),
    /// The write is not verified, because the value is only displayed.
    Shown,
}

impl Verify {
    /// Returns whether the written value is read back.
    pub const fn reads(self) -> bool {
        matches!(self, Verify::ReadBack | Verify::ReadBackAt(_))
    }
}
