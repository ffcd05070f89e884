//! `verify` of an output: verification of its writes.

use schemars::JsonSchema;
use serde::Deserialize;

use super::Output;
use super::applied::Applied;
use crate::duration::shown;
use crate::tables::device::Device;
use crate::tables::register::Notation;
use isotherm_core::codec::{Address, Object};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum VerifyWord {
    ReadBack,
    Echo,
}

/// Verification of a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verify {
    /// The register is read after the write.
    ReadBack,
    /// The answer of the device to the write repeats address and value.
    Echo,
    /// This CANopen object is read, which has the same type as the written value.
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

/// Describes the verification of this output's writes in a sentence.
pub(super) fn preview(output: &Output, device: &Device) -> String {
    let is_object = matches!(output.address, Address::Object(_));
    let is_node = matches!(output.address, Address::Node(_));
    if let Some(Applied { address, tolerance, settle, .. }) = &output.applied {
        let (register, settle) = (Notation::from(*address), shown(*settle));
        return format!(
            "once {register} reports the value as applied, within {tolerance} µm after {settle} at most; the \
             written register is also compared"
        );
    }
    let accepted = match output.verify {
        Verify::Echo if output.is_single_offset() && device.functions.reads_at(&output.reads_at()) => {
            "once the value is read back: the register is read before and after each write, whatever the \
             answer is"
        }
        Verify::ReadBack if is_node => "once the node was read and contains the written value",
        Verify::Echo if is_node => "once the server has answered Good; the node is not read back",
        Verify::ReadBack if is_object => "once the object was read and contains the written value",
        Verify::Echo if is_object => "once the node has accepted the value; the object is not read back",
        Verify::ReadBack => "once the register was read and contains the written value",
        Verify::Echo => "once the answer repeats what was written; the register is not read back",
        Verify::ReadBackAt(object) => return format!("once object {object} was read and contains the value"),
        Verify::Shown => "as soon as the value is sent: it is only displayed, and not verified",
    };
    accepted.to_owned()
}
