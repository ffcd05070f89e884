//! `read_back` of an output: what a control says it applies of an offset, or the object that reads what was written.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::RawOutput;
use super::share::Share;
use crate::duration::Timespan;
use crate::tables::At;
use crate::tables::register::{self, TypeWord, WordOrderWord, plain};
use isotherm_core::codec::{Encoding, Register, Scale};

/// How long a control may take to apply a change, where nothing else is said.
const SETTLE: Duration = Duration::from_secs(1);

/// What reads back an output: an object on CAN, a register on Modbus.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(rename = "ReadBackPlace", description = "")]
pub(super) enum ReadBackValue {
    Object(#[schemars(regex(pattern = "^[0-9A-Fa-f]{4}:[0-9A-Fa-f]{2}$"))] String),
    Register(RawReadBack),
}

/// The register in which a control says what it applies of an offset.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// The walk chooses among alternatives by the types that it sees: not a `$ref` to it.
#[schemars(rename = "ReadBack", inline)]
pub(super) struct RawReadBack {
    /// An input or holding register: "input:12" or "30013".
    #[schemars(required)]
    register: Option<String>,
    /// How the value lies in its registers. Default: as the output's.
    #[serde(rename = "type")]
    kind: Option<TypeWord>,
    /// Which register comes first. Default: as the output's.
    word_order: Option<WordOrderWord>,
    /// The two bytes inside every register are exchanged. Default: as the output's.
    byte_swap: Option<bool>,
    /// µm per count. Default: the output's.
    scale: Option<f64>,
    /// What it may be away from what was written, µm. Default: one count, the output's or its own, whichever is more.
    tolerance: Option<f64>,
    /// How long the control may take to apply a change. Default 1s.
    settle: Option<Timespan>,
}

/// What the control applies of an offset, where it says so in a register beside the one that is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    /// Where.
    pub address: Register,
    /// How the value lies there, in the output's unit.
    pub encoding: Encoding,
    /// It may be so far from what was written, in the output's unit.
    pub tolerance: f64,
    /// The control may take so long to apply a change.
    pub settle: Duration,
}

/// `written`: the output's own register and how the value lies in it.
pub(super) fn resolve(
    raw: &RawOutput,
    at: &At<'_>,
    share: Share,
    written: (Register, &Encoding),
    device: Option<usize>,
) -> Option<Applied> {
    let at = at.key("read_back");
    let table = match raw.read_back.as_ref()? {
        ReadBackValue::Register(table) => table,
        ReadBackValue::Object(_) => {
            let help = "write read_back = { register = \"input:12\" }, or leave it away: what is written is read back there";
            let device = raw.device.as_deref().unwrap_or_default();
            at.wrong(format!("`{device}` hangs on a Modbus line, and an object is on CAN"), help);
            return None;
        }
    };
    if share == Share::Ledger {
        let message =
            "what the control applies is the sum: it does not say how much of a shared register is ours";
        at.wrong(message, "remove `read_back`, or write share = \"whole\"");
    }
    if raw.is_no_offset() {
        let message = "only of an offset a control says what it applies";
        at.wrong(message, "remove `read_back`, or write writes = \"offset\"");
    }
    let place = at.key("register");
    if table.register.is_none() {
        let message = "`register` is missing: where does the control say what it applies?";
        place.missing(message, "write register = \"input:12\"");
    }
    let address = register::register(&place, table.register.as_ref())?;
    let (own, encoding) = written;
    if address.table.is_bits() {
        place.wrong("a bit holds no offset", "name an input or a holding register");
        return None;
    }
    if address == own {
        let message = "it is the register that is written: that is read back without being told to";
        place.wrong(message, "remove `read_back`, or name the register of what is applied");
    }
    let data_type = table.kind.map_or(encoding.data_type, |TypeWord(kind)| kind);
    let word_order = match (table.kind, table.word_order) {
        (None, None) => encoding.word_order,
        (_, given) => register::word_order(&at.key("word_order"), Some(data_type), given)?,
    };
    register::fits(&place, address, data_type);
    if let Some(device) = device.and_then(|device| at.check.devices.get(device)) {
        device.must_read(&place, address.table);
    }
    let scale = match table.scale {
        Some(scale) if scale == 0.0 || !scale.is_finite() => {
            at.key("scale").wrong("a count worth nothing says nothing", "write µm per count, as 0.1");
            return None;
        }
        Some(scale) => Scale::of(scale),
        None => encoding.scale,
    };
    let tolerance = match table.tolerance {
        Some(tolerance) if !(tolerance.is_finite() && tolerance > 0.0) => {
            at.key("tolerance").wrong("a tolerance is more than zero", "write µm, as 0.2");
            return None;
        }
        given => given.unwrap_or_else(|| encoding.scale.get().abs().max(scale.get().abs())),
    };
    let settle = table.settle.map_or(SETTLE, |Timespan(settle)| settle);
    let byte_swap = table.byte_swap.unwrap_or(encoding.byte_swap);
    let encoding = Encoding { word_order, byte_swap, scale, ..plain(data_type) };
    Some(Applied { address, encoding, tolerance, settle })
}
