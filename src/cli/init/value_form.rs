//! Form of a value in registers: type, order of the registers, and scale.

use crate::discovery::{DataType, WordOrder};
use isotherm_profile::allowed;

/// Types of a temperature or an offset that the questions offer. A profile knows more types.
const TYPES: [DataType; 5] = [DataType::I16, DataType::U16, DataType::I32, DataType::U32, DataType::F32];

/// Form of a value in registers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ValueForm {
    pub(super) data_type: DataType,
    /// Order of the registers; `None` for a value of one register.
    pub(super) word_order: Option<WordOrder>,
    /// Value of one count of the register, in the unit of the value.
    pub(super) scale: f64,
}

/// Parses the type of a value. `first`: its first register; `None` if a template knows it.
pub(super) fn data_type(text: &str, first: Option<u16>) -> Result<DataType, String> {
    let found = TYPES.into_iter().find(|known| known.name() == text);
    let found = found.ok_or_else(|| allowed(text, TYPES.map(DataType::name)))?;
    match first {
        Some(first) if first.checked_add(found.registers() - 1).is_none() => Err(format!(
            "{text} needs {} registers, and {first} is the last one: write a type with one register, or begin again \
             with an earlier register",
            found.registers()
        )),
        _ => Ok(found),
    }
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
