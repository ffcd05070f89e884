//! Calculates the registers of each channel of a template group. The registers of the channels follow each other.

use serde_json::{Map, Value};

use crate::tables::register::{Bits, Cell};

/// Changes every register in the value of `key` to the register of the channel with the index `place`. The
/// value may contain tables and lists. `stride` is the distance between two channels. `base` is added to all
/// register numbers. The error is a sentence about an invalid register.
pub(crate) fn moved(value: Value, key: &str, place: u16, stride: u16, base: u16) -> Result<Value, String> {
    let inner = |(key, value): (String, Value)| Ok((key.clone(), moved(value, &key, place, stride, base)?));
    Ok(match value {
        Value::String(text) if is_register(key) => Value::from(shifted(&text, place, stride, base)?),
        Value::Object(table) => {
            Value::Object(table.into_iter().map(inner).collect::<Result<Map<_, _>, String>>()?)
        }
        Value::Array(list) => {
            let list = list.into_iter().map(|item| moved(item, "", place, stride, base));
            Value::Array(list.collect::<Result<Vec<_>, String>>()?)
        }
        other => other,
    })
}

/// Returns whether the value of a key with this name is a register.
fn is_register(key: &str) -> bool {
    let of_signals = matches!(key, "register" | "scale_from" | "decimals_from");
    of_signals
        || matches!(key, "sequence" | "complement" | "heartbeat" | "control" | "strobe" | "acknowledge")
}

/// Returns the register of the channel with the index `place`. If the register is a single bit, the channels
/// are `stride` bits apart. Otherwise they are `stride` registers apart, with the same bits of each register.
/// The error is a sentence about an invalid register.
pub(crate) fn shifted(register: &str, place: u16, stride: u16, base: u16) -> Result<String, String> {
    let mut cell: Cell = register.parse()?;
    let far = u32::from(place) * u32::from(stride);
    let mut offset = u32::from(cell.address.offset) + u32::from(base);
    match cell.bits {
        Bits::One(bit) => {
            let bits = u32::from(bit) + far;
            offset += bits / 16;
            cell.bits = u8::try_from(bits % 16).map_or(cell.bits, Bits::One);
        }
        Bits::All | Bits::Range(..) => offset += far,
    }
    cell.address.offset = u16::try_from(offset)
        .map_err(|_| format!("{register} plus {far} registers is beyond the last register, 65535"))?;
    Ok(cell.to_string())
}
