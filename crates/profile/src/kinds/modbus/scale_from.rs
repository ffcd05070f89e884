//! `scale_from` and `decimals_from` of a signal: a register from which the scale of the value is read.

use crate::tables::device::Device;
use crate::tables::register::{Bits, Cell, cell, plain};
use crate::tables::signal::RawSignal;
use crate::tables::{Check, KeyContext};
use isotherm_core::codec::{DataType, Encoding, Part, ScaleFrom, ScaleMeaning, Whole};

/// Resolves the register from which a signal's scale is read. `None` if the signal has a fixed scale, or if the
/// register has an error. `value` is the register of the value, with its type.
pub(super) fn resolve(
    raw: &RawSignal,
    at: &KeyContext<'_>,
    value: (Cell, DataType),
    device: Option<&Device>,
) -> Option<ScaleFrom> {
    let (key, text, meaning, data_type, whole) = match (&raw.scale_from, &raw.decimals_from) {
        (None, None) => return None,
        (Some(_), Some(_)) => {
            let message = "`scale_from` and `decimals_from` exclude each other";
            let help = "keep `scale_from` for a power of ten (-1 means a tenth), or `decimals_from` for a number of \
                        decimals (1 means a tenth)";
            at.key("decimals_from").wrong_key(message, help);
            return None;
        }
        (Some(text), None) => ("scale_from", text, ScaleMeaning::PowerOfTen, DataType::I16, Whole::I16),
        (None, Some(text)) => ("decimals_from", text, ScaleMeaning::Decimals, DataType::U16, Whole::U16),
    };
    if at.has("counter") {
        let message = format!("`{key}` and `counter` exclude each other: a count has a fixed scale");
        at.key(key).wrong_key(message, "remove one of the two keys");
    }
    let at = at.key(key);
    let Cell { address, bits } = cell(&at, text)?;
    let help = "write the register of the scale, as \"holding:12\", or its bits, as \"holding:12.8-11\"";
    if address.table.is_bits() {
        return at.reject(format!("{address} is one bit, which cannot hold a scale"), help);
    }
    let data_type = match bits {
        Bits::All => Some(data_type),
        Bits::Range(first, last) => Part::new(first, last, whole).map(DataType::Part),
        Bits::One(_) => None,
    };
    let Some(data_type) = data_type else {
        return at.reject(
            format!("`{text}` cannot hold a scale: it is one bit, or not inside one register"),
            help,
        );
    };
    let (value, of_value) = value;
    if matches!(of_value, DataType::Bool | DataType::Bit(_)) {
        return at.reject("a bit has no scale", "remove this key: only a number has a scale");
    }
    let first = value.address.offset;
    let is_inside = (first..=first.saturating_add(of_value.registers() - 1)).contains(&address.offset);
    if is_inside && address.table == value.address.table && bits == Bits::All {
        return at.reject(format!("{address} is a register of the value itself"), help);
    }
    if let Some(device) = device {
        device.must_read(&at, address.table);
    }
    let byte_swap = raw.byte_swap.unwrap_or(false);
    Some(ScaleFrom { address, encoding: Encoding { byte_swap, ..plain(data_type) }, meaning })
}

/// Reports signals whose scale is read from a register, but which have no limit for the rate of change. This limit
/// shows after a change of the scale whether a value is plausible.
pub(super) fn check(check: &Check<'_>) {
    for signal in check.signals.valid() {
        let Some(from) = &signal.scale_from else { continue };
        if signal.rate_limit().is_none() {
            let key = match from.meaning {
                ScaleMeaning::PowerOfTen => "scale_from",
                ScaleMeaning::Decimals => "decimals_from",
            };
            let at = check.at("signal").key(&signal.name).key(key);
            let message = format!("`{key}` needs a limit of the rate of change");
            let unit = signal.unit.0;
            let help = format!(
                "write `max_rate`, in {unit} per second: after a change of the scale, this limit shows whether the \
                 value is plausible"
            );
            at.wrong_key(message, help);
        }
    }
}
