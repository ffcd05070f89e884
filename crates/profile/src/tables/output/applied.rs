//! `read_back` of an output: the register in which a control reports the applied value, or the object from which the
//! written value is read.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::RawOutput;
use super::share::Share;
use crate::duration::Timespan;
use crate::tables::KeyContext;
use crate::tables::device::Device;
use crate::tables::register::{self, TypeWord, WordOrderWord, plain};
use isotherm_core::codec::{Encoding, Register, Scale};

/// Default time within which the control must apply a change.
const SETTLE: Duration = Duration::from_secs(1);

/// Value of the key `read_back`: a CANopen object, or a Modbus register.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "ReadBackPlace", description = "")]
pub(crate) enum ReadBackValue {
    Object(#[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))] String),
    Register(RawReadBack),
}

/// Register in which a control reports the applied value of an offset.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// Inlined, because the schema check selects an alternative by its type, which a `$ref` hides.
#[schemars(rename = "ReadBack", inline)]
pub(crate) struct RawReadBack {
    /// Input or holding register, for example "input:12" or "30013".
    #[schemars(required)]
    register: Option<String>,
    /// Type of the value. Default: the type of the output.
    #[serde(rename = "type")]
    kind: Option<TypeWord>,
    /// Order of the registers. Default: the order of the output.
    word_order: Option<WordOrderWord>,
    /// Whether the two bytes of each register are exchanged. Default: as for the output.
    byte_swap: Option<bool>,
    /// Size of one count, µm. Default: the size of one count of the output.
    scale: Option<f64>,
    /// Largest deviation from the written value, µm. Default: the size of one count of the output or of this register,
    /// whichever is larger.
    tolerance: Option<f64>,
    /// Time within which the control must apply a change. Default "1s".
    settle: Option<Timespan>,
}

/// Register in which the control reports the offset that it has applied.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    /// First register of the applied value.
    pub address: Register,
    /// Encoding of the value, in the unit of the output.
    pub encoding: Encoding,
    /// Largest deviation from the written value, in the unit of the output.
    pub tolerance: f64,
    /// Time within which the control must apply a change.
    pub settle: Duration,
}

/// Resolves `read_back` of an output on a Modbus device. `written` is the register of the output, with its
/// encoding. `None` if the profile states no `read_back`, or no usable one. Errors are reported.
pub(crate) fn resolve(
    raw: &RawOutput,
    at: &KeyContext<'_>,
    share: Share,
    written: (Register, &Encoding),
    device: Option<&Device>,
) -> Option<Applied> {
    let at = at.key("read_back");
    let table = match raw.read_back.as_ref()? {
        ReadBackValue::Register(table) => table,
        ReadBackValue::Object(_) => {
            let help = "write read_back = { register = \"input:12\" }, or remove `read_back`: the gateway \
                        reads back the register that it writes";
            let device = raw.device.as_deref().unwrap_or_default();
            return at.reject(
                format!("`{device}` is on a Modbus line, but a CANopen object exists only on CAN"),
                help,
            );
        }
    };
    if share == Share::Ledger {
        let message =
            "this register would contain the operator offset too: the gateway share cannot be read from it";
        at.invalid(message, "remove `read_back`, or write share = \"whole\"");
    }
    if raw.is_no_offset() {
        let message = "`read_back` is only for an offset";
        at.invalid(message, "remove `read_back`, or write writes = \"offset\"");
    }
    let place = at.key("register");
    let message = "`register` is missing: in which register does the control report the applied value?";
    place.missing(message, "write register = \"input:12\"");
    let address = register::register(&place, table.register.as_ref())?;
    let (own, encoding) = written;
    if address.table.is_bits() {
        return place.reject("a bit cannot hold an offset", "write an input or a holding register");
    }
    if address == own {
        let message = "this is the register that is written: the gateway reads it back in any case";
        place.invalid(message, "remove `read_back`, or write the register of the applied value");
    }
    let data_type = table.kind.map_or(encoding.data_type, |TypeWord(kind)| kind);
    let word_order = match (table.kind, table.word_order) {
        (None, None) => encoding.word_order,
        (_, given) => register::word_order(&at.key("word_order"), Some(data_type), given)?,
    };
    register::fits(&place, address, data_type);
    if let Some(device) = device {
        device.must_read(&place, address.table);
    }
    let scale = match table.scale {
        Some(scale) if scale == 0.0 || !scale.is_finite() => {
            return at.key("scale").reject("a scale of zero is not allowed", "write µm per count, as 0.1");
        }
        Some(scale) => Scale::of(scale),
        None => encoding.scale,
    };
    let tolerance = match table.tolerance {
        Some(tolerance) if !(tolerance.is_finite() && tolerance > 0.0) => {
            return at.key("tolerance").reject("a tolerance must be more than zero", "write µm, as 0.2");
        }
        given => given.unwrap_or_else(|| encoding.scale.get().abs().max(scale.get().abs())),
    };
    let settle = table.settle.map_or(SETTLE, |Timespan(settle)| settle);
    let byte_swap = table.byte_swap.unwrap_or(encoding.byte_swap);
    let encoding = Encoding { word_order, byte_swap, scale, ..plain(data_type) };
    Some(Applied { address, encoding, tolerance, settle })
}
