//! `verify` of an output: verification of its writes.

use schemars::JsonSchema;
use serde::Deserialize;

use super::applied::{Applied, ReadBackValue};
use super::{Output, RawOutput};
use crate::duration::shown;
use crate::tables::device::Device;
use crate::tables::register::Notation;
use crate::tables::{KeyContext, can};
use isotherm_core::codec::{Address, DataType, Object};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(super) enum VerifyWord {
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

/// Resolves the verification of a frame, which has no answer. The value is read in another object, or only shown on a
/// display.
pub(super) fn of_a_frame(
    raw: &RawOutput,
    at: &KeyContext<'_>,
    data_type: DataType,
    owner: &str,
) -> Option<Verify> {
    let place = at.key("read_back");
    let kept = |verify: &VerifyWord| *verify == VerifyWord::ReadBack && raw.read_back.is_some();
    if let Some(verify) = raw.verify.filter(|verify| !kept(verify)) {
        let word = if verify == VerifyWord::Echo { "echo" } else { "read-back" };
        let message = format!("a frame has no answer: verify = \"{word}\" is not possible");
        let help = "remove this key, and write read_back = \"6004:00\", the CANopen object that returns the \
                    written value";
        at.key("verify").invalid(message, help);
    }
    let text = match &raw.read_back {
        Some(ReadBackValue::Object(text)) => text,
        Some(ReadBackValue::Register(_)) => {
            let help = "write read_back = \"6004:00\", the CANopen object that returns the written value";
            return place.reject("registers are only for Modbus: on CAN an object is read back", help);
        }
        None if raw.is_written_as_cz() => {
            let message = "`read_back` is missing: an offset must be read back";
            let help = "write read_back = \"6004:00\", the CANopen object that returns the written value. \
                        Without `read_back`, only a display of a corrected position can be written";
            place.missing(message, help);
            return None;
        }
        None => return (!place.is_written()).then_some(Verify::Shown),
    };
    can::needs_node(&place, owner);
    let entry = can::entry(&place, text);
    if !data_type.width().is_multiple_of(8) {
        let message = format!("an object has whole bytes, and {} bits are written", data_type.width());
        return place.reject(message, "write 8, 16, 24, 32 or 64 bits, as the object has them");
    }
    Some(Verify::ReadBackAt(Object { entry: entry?, data_type }))
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
