//! `[output.*]`: one value that the gateway writes to a device, for example the compensation value Cz of an axis.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::KeyContext;
use super::handshake::RawHandshake;
use super::register::{self, TypeWord, WordOrderWord};
use super::signal::ChannelValue;
use crate::duration::Timespan;
use crate::kinds::can::fields::{RawFrame, RawPdo};
use crate::kinds::opcua::nodes::Place;
use crate::{AxisId, DeviceId, SetId};
use applied::{Applied, ReadBackValue};
use display::{Display, RawBeside, RawStale};
use isotherm_core::codec::{Address, DataType, Encoding, Scale};
use isotherm_core::compensation::model::Condition;
use isotherm_core::quantity::Micron;
use isotherm_core::reading::SignalId;
use share::Share;
use verify::{Verify, VerifyWord};
use writes::{Writes, WritesWord};

pub(crate) mod applied;
pub(crate) mod display;
mod preview;
pub(super) mod range;
mod resolve;
pub(crate) mod share;
pub(crate) mod stated;
pub(crate) mod verify;
pub(crate) mod writes;

/// Value that is written to a device.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Output", extend("x-layers" = "arrives"))]
pub(crate) struct RawOutput {
    /// Axis whose Cz is written.
    #[schemars(required)]
    pub(crate) axis: Option<String>,
    /// Device that is written to.
    #[schemars(required)]
    pub(crate) device: Option<String>,
    /// Target of the device's template, which sets register, type and scale.
    #[allow(dead_code, reason = "templates are resolved before the profile is checked")]
    channel: Option<ChannelValue>,
    /// Quantity that is written. "corrected": position + Cz. "offset": Cz. "intercept", "slope" and "reference": K0
    /// (µm), tanβ (µm/mm) and P0 (mm), for a control that applies K0 + tanβ·(P − P0) itself.
    #[schemars(required)]
    writes: Option<WritesWord>,
    /// Only for writes = "corrected": signal with the position that the linear scale measures, in mm.
    position: Option<String>,
    /// Holding register, for example "holding:104" or "40105".
    pub(crate) register: Option<String>,
    /// Node of an OPC UA server that is written, for example "ns=2;s=…".
    pub(crate) node: Option<String>,
    /// Type of the value. Required for registers, CANopen objects and nodes.
    #[serde(rename = "type")]
    pub(crate) kind: Option<TypeWord>,
    /// CANopen process data that is written, for example { cob_id = 0x20C, start = 0, length = 32, signed = true }.
    pub(crate) pdo: Option<RawPdo>,
    /// CANopen object that is written, for example "2000:01".
    #[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))]
    pub(crate) sdo: Option<String>,
    /// CAN frame that is written, for example { id = 0x300, start = 0, length = 32, order = "little", signed = true }.
    pub(crate) frame: Option<RawFrame>,
    /// Address from which a write is verified, if this is not the written address. Modbus: the register in
    /// which the control reports the applied value. Process data and frames: the CANopen object that contains
    /// the written value, with the same length, for example "6004:00". Required for process data and frames,
    /// except for a display.
    pub(crate) read_back: Option<ReadBackValue>,
    /// Order of the registers. Required for 32 bits and more.
    pub(crate) word_order: Option<WordOrderWord>,
    /// Whether the two bytes of each register are exchanged. Default false.
    pub(crate) byte_swap: Option<bool>,
    /// Size of one count. offset and intercept: µm. slope: µm/mm. corrected and reference: mm. Required for integers;
    /// default 1 for f32 and f64.
    scale: Option<f64>,
    /// Number added to the raw count. Default 0.
    bias: Option<i64>,
    /// Verification of a write. "read-back" reads the value again. "echo" accepts the answer of the device. With
    /// "echo", an offset outside of an output set is still read back if possible. Default "read-back".
    pub(crate) verify: Option<VerifyWord>,
    /// Period for writing an unchanged value again.
    #[schemars(extend("x-layers" = "free"))]
    pub(super) refresh: Option<Timespan>,
    /// Interlock: condition on signals. While the condition is not met, the gateway does not write to the
    /// output.
    when: Option<String>,
    /// Ownership of the register. "whole": the gateway owns it. "ledger": an operator also writes to it. The
    /// register ledger on disk stores the gateway share (part of the value that the gateway has added). Default
    /// "whole".
    pub(crate) share: Option<Share>,
    /// Name of the output set that contains this output. The control receives all outputs of a set together.
    pub(super) set: Option<String>,
    /// Handshake for each write: the gateway sets a strobe signal, and the control acknowledges it.
    pub(super) handshake: Option<RawHandshake>,
    /// Detection of a CNC restart, in addition to the register becoming zero.
    pub(super) restart: Option<RawRestart>,
    /// Largest step that the control can follow within `shortest_every`, µm. The axis's `step` must not be larger.
    largest_step: Option<f64>,
    /// Shortest time between two updates that the control can follow. The axis's `every` must not be shorter.
    shortest_every: Option<Timespan>,
    /// Only for writes = "corrected": additional registers of a digit display, for example for its decimal point and
    /// colour.
    beside: Option<Vec<RawBeside>>,
    /// Only for writes = "corrected": text on a digit display if there is no position to correct, or the axis is off.
    stale: Option<RawStale>,
}

/// Detection of a CNC restart.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Restart")]
pub(super) struct RawRestart {
    /// Register that changes at every start of the CNC, read with the device's signals. On an OPC UA server a node: {
    /// node = "ns=2;s=…" }.
    #[schemars(required)]
    pub(super) boot_counter: Option<Place>,
}

/// Output of the profile, after all its keys were checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Output {
    /// Name of the output: `cnc_z` for the table `[output.cnc_z]`.
    pub name: String,
    /// Axis whose Cz (compensation value) is written.
    pub axis: AxisId,
    /// Device that is written to.
    pub device: DeviceId,
    /// Address of the output: its first register, its object or node, or its bits in a frame.
    pub address: Address,
    /// Encoding of the value in registers.
    pub encoding: Encoding,
    /// Quantity that is written, for example Cz or a position plus Cz.
    pub writes: Writes,
    /// Way in which the gateway verifies each write.
    pub verify: Verify,
    /// Period for writing an unchanged value again. `None` if only changes are written.
    pub refresh: Option<Duration>,
    /// Interlock: condition for writing. `None` if the output has no interlock.
    pub when: Option<Condition>,
    /// Output set that contains the output. An output with its own handshake is the only output of its set.
    /// `None` if the output is written alone, without a handshake.
    pub set: Option<SetId>,
    /// Signal that changes at every start of the CNC (boot counter). `None` if the profile names no boot counter.
    pub boot_counter: Option<SignalId>,
    /// Who writes to the register: only the gateway, or an operator too.
    pub share: Share,
    /// Register in which the control reports the applied value. `None` if the control does not report the value.
    pub applied: Option<Applied>,
    /// Additional registers of a digit display, and its text while there is no value.
    pub display: Display,
    /// Settings of the profile file itself, without the layers above it (local file, environment, `--set`). `None` if
    /// there are no such layers.
    pub stated: Option<Stated>,
}

/// Scale, bias, diameter and limit of an output as the profile file states them, without the layers above it. A key
/// that the file lacks, or names in `allow_override`, has the value of the merged profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stated {
    scale: Scale,
    bias: i64,
    diameter: bool,
    limit: Micron,
}

impl Output {
    /// Returns whether the output is written alone and with the period of its axis. `false` for an output in an output
    /// set, and for a position plus Cz, which is written when the position is read.
    pub fn is_single_offset(&self) -> bool {
        let is_offset = self.writes.is_scheduled();
        is_offset && self.set.is_none()
    }

    /// Iterates over the register numbers of the output, each with its value from `contents`. The iterator is
    /// empty if the output is not in registers.
    pub fn cells(&self, contents: &[u16]) -> impl Iterator<Item = (u16, u16)> {
        let first = self.address.register().map(|register| register.offset..);
        first.into_iter().flatten().zip(contents.iter().copied())
    }

    /// Returns the address from which the value is read back. This is the written address, unless the profile names a
    /// CANopen object for reading back.
    pub fn reads_at(&self) -> Address {
        match self.verify {
            Verify::ReadBackAt(object) => Address::Object(object),
            _ => self.address.clone(),
        }
    }
}

/// Resolved address, encoding and verification of an output.
pub(crate) struct Target {
    pub(crate) address: Address,
    pub(crate) encoding: Encoding,
    pub(crate) verify: Verify,
    pub(crate) share: Share,
    pub(crate) applied: Option<Applied>,
    pub(crate) display: Display,
}

impl RawOutput {
    /// Returns whether the key `writes` is present, and is not "corrected" (a position plus Cz).
    pub(crate) fn is_written_as_cz(&self) -> bool {
        self.writes.is_some_and(|writes| writes != WritesWord::Corrected)
    }

    /// Returns whether the key `writes` is present, and is not "offset".
    fn is_no_offset(&self) -> bool {
        self.writes.is_some_and(|writes| writes != WritesWord::Offset)
    }

    pub(super) fn is_accepted_by_echo(&self) -> bool {
        self.verify == Some(VerifyWord::Echo)
    }

    /// Returns the verification of an output whose written address can be read: by the answer to the write if the
    /// profile says `verify = "echo"`, else by reading back.
    pub(crate) fn verification(&self) -> Verify {
        if self.is_accepted_by_echo() { Verify::Echo } else { Verify::ReadBack }
    }

    /// Resolves the key `scale`: the size of one count, in the unit of the output. `None` if the type or the
    /// scale has an error, which is reported.
    pub(crate) fn scale(&self, at: &KeyContext<'_>, data_type: Option<DataType>) -> Option<Scale> {
        let is_whole = data_type?.integer_range().is_some();
        match self.scale {
            Some(scale) => register::scale(at, scale),
            None if is_whole => {
                let help = "write the size of one count: µm for an offset or intercept, µm/mm for a slope, \
                            mm for a position";
                at.missing("`scale` is missing: what is the size of one count?", help);
                None
            }
            None => (!at.is_written()).then_some(Scale::ONE),
        }
    }

    pub(crate) fn bias(&self, at: &KeyContext<'_>, data_type: DataType) -> i64 {
        let bias = self.bias.unwrap_or(0);
        if data_type.integer_range().is_none() && bias != 0 {
            let help = "remove `bias`: a floating-point register can hold negative values";
            at.invalid("`bias` is allowed only with integer types", help);
        }
        bias
    }
}

/// Reports the type of a single bit at this key, because an output needs a number.
pub(crate) fn not_one_bit(at: &KeyContext<'_>, data_type: Option<DataType>) {
    if data_type == Some(DataType::Bool) {
        let help = "write an integer or floating-point type: i16, i32, f32, …";
        at.invalid("one bit cannot hold a compensation value", help);
    }
}
