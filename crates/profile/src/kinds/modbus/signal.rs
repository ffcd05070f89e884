//! Resolves signals that are read from registers, coils and discrete inputs.

use super::scale_from;
use crate::tables::KeyContext;
use crate::tables::device::Device;
use crate::tables::register::{self, Bits, Cell, TypeWord, plain};
use crate::tables::signal::bad::sentinels;
use crate::tables::signal::unit::Unit;
use crate::tables::signal::{Located, PLACES, RawSignal};
use isotherm_core::codec::{DataType, Encoding};

/// Resolves the register of a signal, with its type and scale. `None` if they have an error.
pub(super) fn resolve(raw: &RawSignal, at: &KeyContext<'_>, device: Option<&Device>) -> Option<Located> {
    if raw.register.is_none() && PLACES.into_iter().any(|key| at.has(key)) {
        // A place on another kind of line has been reported.
        return None;
    }
    let place = at.key("register");
    let help = "write a zero-based protocol address (\"input:0\") or a Modicon number (\"30001\")";
    place.missing("`register` is missing: from which register is the signal read?", help);
    let cell = raw.register.as_ref().and_then(|text| register::cell(&place, text));
    // An error of the register must not hide other errors.
    let data_type = match cell {
        Some(cell) => type_in(raw, at, cell),
        None => raw.kind.map(|TypeWord(kind)| kind),
    };
    let word_order = register::word_order(&at.key("word_order"), data_type, raw.word_order);
    let scale = register::scale(&at.key("scale"), raw.scale.unwrap_or(1.0));
    let (cell, data_type) = (cell?, data_type?);
    let address = cell.address;
    register::fits(&place, address, data_type);
    if let Some(device) = device {
        device.must_read(&place, address.table);
        // A value in two answers could consist of parts of different values.
        let most = device.quirks.max_registers_per_request;
        if data_type.registers() > most {
            let (name, registers) = (data_type.name(), data_type.registers());
            let message = format!("{name} needs {registers} registers, but one request reads {most}");
            let help = "raise `max_registers_per_request` in the quirks, or use a smaller type";
            at.key("type").invalid(message, help);
        }
    }
    let is_bit = matches!(data_type, DataType::Bool | DataType::Bit(_));
    let encoding = Encoding {
        word_order: word_order?,
        byte_swap: raw.byte_swap.unwrap_or(false),
        scale: scale?,
        offset: raw.offset.unwrap_or(0.0),
        bad: sentinels(raw.bad.as_ref(), &at.key("bad")),
        ..plain(data_type)
    };
    let unit = is_bit.then_some(Unit("bool"));
    let scale_from = scale_from::resolve(raw, at, (cell, data_type), device);
    Some(Located { scale_from, ..Located::of(address.into(), encoding, unit) })
}

/// Resolves the type of a signal whose value is whole registers, one bit, or several bits of a register.
fn type_in(raw: &RawSignal, at: &KeyContext<'_>, cell: Cell) -> Option<DataType> {
    let kind = raw.kind.map(|TypeWord(kind)| kind);
    let is_bits = cell.address.table.is_bits();
    let bit = match cell.bits {
        Bits::All if !is_bits => {
            let help = "allowed: bool, u16, i16, u24, i24, u32, i32, u64, i64, f32, f64, decimal24, bcd16, bcd32, \
                        sm16, sm32; the device's manual says which";
            at.key("type")
                .missing("`type` is missing: which type does the value have in its registers?", help);
            return kind;
        }
        Bits::All => None,
        Bits::One(bit) => Some(bit),
        Bits::Range(first, last) => return Cell::part(at, (first, last), kind),
    };
    if let Some(wrong) = kind.filter(|kind| *kind != DataType::Bool) {
        let (at, message) = (at.key("type"), format!("{} is not possible for one bit", wrong.name()));
        if is_bits {
            return at.reject(message, "a coil and a discrete input are \"bool\": leave `type` out");
        }
        at.invalid(message, "one bit is \"bool\": leave `type` out");
    }
    Some(bit.map_or(DataType::Bool, DataType::Bit))
}
