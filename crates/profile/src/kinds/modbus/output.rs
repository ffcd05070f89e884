//! Resolves outputs that are written to holding registers.

use crate::kinds::opcua::nodes::not_here;
use crate::tables::KeyContext;
use crate::tables::device::Device;
use crate::tables::output::verify::Verify;
use crate::tables::output::{RawOutput, Target, applied, display, not_one_bit, share};
use crate::tables::register::{self, plain};
use isotherm_core::codec::{Encoding, Table};

/// Reports keys of an output that are not allowed if its device is on a Modbus line.
pub(super) fn foreign_keys(raw: &RawOutput, at: &KeyContext<'_>, device: &str) {
    not_here(at);
    let help = format!("`{device}` is on a Modbus line: write register = \"holding:100\"");
    at.not_applicable(&["pdo", "sdo", "frame"], "a device on a CAN line", &help);
    register::not_smaller_than_a_register(&at.key("type"), raw.kind, "use \"u16\" or \"i16\"");
}

/// Resolves the register of an output.
pub(super) fn resolve(raw: &RawOutput, at: &KeyContext<'_>, device: Option<&Device>) -> Option<Target> {
    if !["pdo", "sdo", "frame"].into_iter().any(|key| at.has(key)) {
        let help = "write a holding register, as \"holding:104\" or \"40105\"";
        at.key("register").missing("`register` is missing: to which register is the value written?", help);
        let help = "allowed: u16, i16, u32, i32, u64, i64, f32, f64; the device's manual says which";
        at.key("type").missing("`type` is missing: which type does the value have in its registers?", help);
    }
    let place = at.key("register");
    let address = register::holding(&place, raw.register.as_ref());
    let data_type = display::digits(raw, at);
    not_one_bit(&at.key("type"), data_type);
    let written = register::not_only_read(&at.key("type"), data_type);
    let word_order = register::word_order(&at.key("word_order"), data_type, raw.word_order);
    let scale = raw.scale(&at.key("scale"), data_type);
    let (address, data_type) = (address?, written?);
    register::fits(&place, address, data_type);
    let verify = raw.verification();
    if let Some(device) = device {
        device.must_write(&place, data_type.registers());
        if verify == Verify::ReadBack {
            device.must_read(&place, Table::Holding);
        }
    }
    let share = share::resolve(raw, at, data_type, device);
    let encoding = Encoding {
        word_order: word_order?,
        byte_swap: raw.byte_swap.unwrap_or(false),
        scale: scale?,
        bias: raw.bias(&at.key("bias"), data_type),
        ..plain(data_type)
    };
    let applied = applied::resolve(raw, at, share, (address, &encoding), device);
    let display = display::resolve(raw, at, device);
    Some(Target { address: address.into(), encoding, verify, share, applied, display })
}
