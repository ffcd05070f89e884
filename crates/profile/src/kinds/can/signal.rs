//! Resolves signals that are read from CAN frames or CANopen objects.

use super::dbc;
use super::fields::{self, Sender};
use crate::dbc::{Described, FileUnit};
use crate::tables::register::{self, plain};
use crate::tables::signal::bad::sentinels;
use crate::tables::signal::unit::{Conversion, Unit};
use crate::tables::signal::{Located, RawSignal};
use crate::tables::{Check, KeyContext};
use isotherm_core::codec::{Address, DataType, Encoding};

/// Resolves the source of a signal: the bits of CAN frames, or a CANopen object.
pub(super) fn resolve(check: &Check<'_>, raw: &RawSignal, at: &KeyContext<'_>) -> Option<Located> {
    let device = raw.device.as_deref()?;
    let own = (raw.scale.unwrap_or(1.0), raw.offset.unwrap_or(0.0));
    let (address, (scale, offset), unit) = if let Some(name) = &raw.dbc {
        no_type(raw, at, "remove this key: the DBC file defines the bits and their type");
        let mut found = dbc::described(check, &at.key("dbc"), name, device)?;
        let unit = convert(raw, at, &mut found);
        let scale = scale_over(raw, at, &found)?;
        (Address::Frame(found.field), scale, unit)
    } else if let Some(pdo) = &raw.pdo {
        no_type(raw, at, OF_BITS);
        let node = check.raw.device.get(device).and_then(|device| device.node);
        let field = pdo.resolve(&at.key("pdo"), (device, node), Sender::Device)?;
        no_fill(&at.key("pdo").key("fill"), pdo.fill.is_some());
        (Address::Frame(field), own, None)
    } else if let Some(sdo) = &raw.sdo {
        let types = "allowed: bool, u8, i8, u16, i16, u24, i24, u32, i32, u64, i64, f32, f64; the device's manual \
                     says which";
        (fields::object(at, sdo, raw.kind, device, types)?, own, None)
    } else if let Some(frame) = &raw.frame {
        no_type(raw, at, OF_BITS);
        no_fill(&at.key("frame").key("fill"), frame.fill.is_some());
        (Address::Frame(frame.resolve(&at.key("frame"))?), own, None)
    } else {
        let places = ["register", "dbc", "pdo", "sdo", "frame"];
        if places.into_iter().all(|key| at.key(key).is_left_out()) {
            let help = "write dbc = \"Message.Signal\", pdo = { … }, sdo = \"7130:01\" or frame = { … }";
            at.wrong_key("the CAN frame or object to read is missing", help);
        }
        return None;
    };
    let data_type = fields::data_type(&address);
    let unit = unit.or((data_type == DataType::Bool && raw.dbc.is_none()).then_some(Unit("bool")));
    let bad = sentinels(raw.bad.as_ref(), &at.key("bad"));
    let scale = register::scale(&at.key("scale"), scale)?;
    Some(Located::of(address, Encoding { scale, offset, bad, ..plain(data_type) }, unit))
}

fn no_type(raw: &RawSignal, at: &KeyContext<'_>, help: &str) {
    if raw.kind.is_some() {
        at.key("type").wrong_key("on a CAN line, `type` is allowed only with `sdo`", help);
    }
}

/// Resolves scale and offset of a signal in a DBC file. The profile must replace both or neither, because replacing
/// only one would give wrong values.
fn scale_over(raw: &RawSignal, at: &KeyContext<'_>, found: &Described) -> Option<(f64, f64)> {
    let (missing, there, is_plain) = match (raw.scale, raw.offset) {
        (None, None) => return Some((found.scale, found.offset)),
        (Some(scale), Some(offset)) => return Some((scale, offset)),
        (None, Some(_)) => ("scale", "offset", (found.scale - 1.0).abs() == 0.0),
        (Some(_), None) => ("offset", "scale", found.offset.abs() == 0.0),
    };
    if is_plain {
        return Some((raw.scale.unwrap_or(1.0), raw.offset.unwrap_or(0.0)));
    }
    let converted = match &found.unit {
        FileUnit::Convertible { written, conversion } if is_converted(raw, conversion.unit) => {
            format!(", converted from \"{written}\"")
        }
        _ => String::new(),
    };
    let message = format!(
        "the DBC file has scale {} and offset {}{converted}; `scale` and `offset` can only be replaced together",
        found.scale, found.offset
    );
    at.key(there).reject(message, format!("write `{missing}` as well, or remove both"))
}

/// Compares the unit of the DBC file with the unit of the profile. If the profile does not support the unit
/// of the file, scale and offset of `found` are converted to a supported unit where possible, see
/// `is_converted`. Reports an error if the profile states a different unit and no `scale`. Returns the
/// supported unit of the file, or the unit after the conversion. Otherwise returns `None`.
fn convert(raw: &RawSignal, at: &KeyContext<'_>, found: &mut Described) -> Option<Unit> {
    let own = raw.unit.as_deref().and_then(Unit::named);
    let is_replaced = raw.scale.is_some();
    match &found.unit {
        FileUnit::Plain => None,
        FileUnit::Known(unit) => {
            if let Some(own) = own.filter(|own| own != unit && !is_replaced) {
                let help = format!(
                    "write unit = \"{}\", or the `scale` and `offset` that convert the raw count to \"{}\"",
                    unit.0, own.0
                );
                at.key("unit")
                    .invalid(format!("the DBC file states the unit \"{}\" for this signal", unit.0), help);
            }
            Some(*unit)
        }
        FileUnit::Convertible { written, conversion } => {
            let Conversion { unit, factor, shift } = *conversion;
            if !is_converted(raw, unit) {
                if let Some(own) = own.filter(|_| !is_replaced) {
                    let help = format!(
                        "write unit = \"{}\", to which the value is converted, or the `scale` and `offset` that \
                         convert the raw count to \"{}\"",
                        unit.0, own.0
                    );
                    at.key("unit")
                        .invalid(format!("the DBC file states the unit \"{written}\" for this signal"), help);
                }
                return None;
            }
            found.scale *= factor;
            found.offset *= factor;
            if !raw.is_marked_difference() {
                found.offset += shift;
            }
            Some(unit)
        }
        FileUnit::Unknown(written) => {
            let is_number = |own: &Unit| matches!(own.0, "1" | "count" | "bool");
            if let Some(own) = own.filter(|own| !is_number(own) && !is_replaced) {
                let help = format!(
                    "if this unit means \"{}\", write scale = {} and offset = {}, as in the DBC file. If not, \
                     write the `scale` and `offset` that convert the raw count",
                    own.0,
                    toml_number(found.scale),
                    toml_number(found.offset)
                );
                let message = format!(
                    "isotherm does not support the unit \"{written}\", which the DBC file states for this signal"
                );
                at.key("unit").invalid(message, help);
            }
            None
        }
    }
}

/// Returns whether scale and offset of the DBC file are converted to the unit `to`. This is the case if the profile
/// states this unit. It is also the case for a temperature if the profile states neither unit nor scale. For other
/// quantities, the unit of the file may be intended.
fn is_converted(raw: &RawSignal, to: Unit) -> bool {
    match raw.unit.as_deref() {
        Some(own) => own == to.0,
        None => matches!(to.0, "degC" | "K") && raw.scale.is_none(),
    }
}

/// Formats a number for a TOML file as a float, with a decimal point or an exponent.
fn toml_number(number: f64) -> String {
    format!("{number:?}")
}

/// Hint for the key `type` of a value in CAN frames, which is not allowed there.
const OF_BITS: &str = "remove this key: `length`, `signed` and `float` define the type";

fn no_fill(at: &KeyContext<'_>, is_there: bool) {
    if is_there {
        let help = "remove this key: `fill` is only for an output";
        at.wrong_key("`fill` has no effect here: the sender of the frame fills it", help);
    }
}
