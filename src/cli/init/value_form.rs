//! Form of a value in registers or in a node: type, order of the registers, and scale.

use crate::discovery::{DataType, WordOrder};
use isotherm_profile::{Bits, Cell, allowed};

/// Types of a temperature or an offset that the questions offer. A profile knows more types.
const TYPES: [DataType; 5] = [DataType::I16, DataType::U16, DataType::I32, DataType::U32, DataType::F32];

/// Types of a node that can hold an offset.
const TYPES_OF_NODES: [DataType; 10] = [
    DataType::Signed(8),
    DataType::Unsigned(8),
    DataType::I16,
    DataType::U16,
    DataType::I32,
    DataType::U32,
    DataType::I64,
    DataType::U64,
    DataType::F32,
    DataType::F64,
];

/// Form of a value in registers or in a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ValueForm {
    pub(super) data_type: DataType,
    /// Order of the registers; `None` for a value of one register or of a node.
    pub(super) word_order: Option<WordOrder>,
    /// Value of one count of the register or node, in °C for a temperature and in µm for an offset.
    pub(super) scale: f64,
    /// Register of the device with the power of ten of the scale; `None` if the scale is fixed.
    pub(super) scale_from: Option<Cell>,
}

/// Parses the type of a value. `first`: its first register; `None` if a template knows it.
pub(super) fn data_type(text: &str, first: Option<Cell>) -> Result<DataType, String> {
    let found = TYPES.into_iter().find(|known| known.name() == text);
    let found = found.ok_or_else(|| allowed(text, TYPES.map(DataType::name)))?;
    let Some(Cell { address, bits }) = first else { return Ok(found) };
    if address.offset.checked_add(found.registers() - 1).is_none() {
        return Err(format!(
            "{text} needs {} registers, and {} is the last one: write a type with one register, or begin again with \
             an earlier register",
            found.registers(),
            address.offset
        ));
    }
    match bits {
        Bits::Range(..) if found == DataType::F32 => {
            Err("f32 is not possible for a part of a register: write i16 or u16, or i32 or u32 for a part of two \
                 registers"
                .to_owned())
        }
        Bits::Range(_, last) if u16::from(last) >= 16 * found.registers() => {
            Err(format!("bit {last} is beyond one register: write i32 or u32 for a part of two registers"))
        }
        _ => Ok(found),
    }
}

/// Parses the type of a node that holds an offset.
pub(super) fn node_type(text: &str) -> Result<DataType, String> {
    let found = TYPES_OF_NODES.into_iter().find(|known| known.name() == text);
    found.ok_or_else(|| allowed(text, TYPES_OF_NODES.map(DataType::name)))
}

pub(super) fn word_order(text: &str) -> Result<WordOrder, String> {
    match text {
        "msw-first" => Ok(WordOrder::MswFirst),
        "lsw-first" => Ok(WordOrder::LswFirst),
        _ => Err(allowed(text, ["msw-first", "lsw-first"])),
    }
}

/// Parses a scale. Every number except zero is allowed, because a control may subtract the offset.
pub(super) fn scale(text: &str) -> Result<f64, String> {
    let scale =
        text.replace(',', ".").parse::<f64>().ok().filter(|scale| scale.is_finite() && scale.abs() > 0.0);
    scale.ok_or_else(|| "write a number other than 0, such as 0.1 or -0.1".to_owned())
}

/// Parses a scale, or the register of the device with the power of ten of the scale. With a register, the
/// returned scale is 1. `first`: first register of the value, which cannot contain the scale.
pub(super) fn scale_or_register(text: &str, first: Option<Cell>) -> Result<(f64, Option<Cell>), String> {
    // A number of five digits is a register in Modicon notation. No scale is so large.
    let digits = text.split('.').next().unwrap_or_default();
    let is_modicon = digits.len() >= 5 && digits.bytes().all(|byte| byte.is_ascii_digit());
    if !text.contains(':') && !is_modicon {
        return Ok((scale(text)?, None));
    }
    let from: Cell = text.parse()?;
    if from.address.table.is_bits() || matches!(from.bits, Bits::One(_)) {
        return Err(format!(
            "{text} is one bit, which cannot hold a scale: write a register such as holding:12"
        ));
    }
    if Some(from) == first {
        return Err(format!("{text} is the register of the value itself: write the register of the scale"));
    }
    Ok((1.0, Some(from)))
}
