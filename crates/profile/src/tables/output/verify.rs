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
    /// The register is read again.
    ReadBack,
    /// The answer repeats address and value.
    Echo,
    /// This object is read. It has the same type as the written value.
    ReadBackAt(Object),
    /// None: only a display shows the value.
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
        Verify::ReadBack if is_node => "once the node reads back what was written",
        Verify::Echo if is_node => "once the server has answered Good; the node is not read back",
        Verify::ReadBack if is_object => "once the object reads back what was written",
        Verify::Echo if is_object => "once the node has accepted the value; the object is not read back",
        Verify::ReadBack => "once the register reads back what was written",
        Verify::Echo => "once the answer repeats what was written; the register is not read back",
        Verify::ReadBackAt(object) => return format!("once object {object} reads back what was written"),
        Verify::Shown => "as soon as the value is sent: it is only displayed, and not verified",
    };
    accepted.to_owned()
}
