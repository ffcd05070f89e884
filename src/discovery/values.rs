//! Decoding of register values for commands that read any registers of a device, also those without a signal in a
//! profile.

use serde::Serialize;

use crate::fieldbus::wire::Answer;
use isotherm_core::codec::{DataType, Encoding, Register, Scale, WordOrder};

/// Format of the values in registers.
#[derive(Clone, Debug, PartialEq)]
pub struct ValueFormat {
    /// Data type. With `None`, a register is shown as unsigned 16-bit number, and also as a signed number if that
    /// differs.
    pub data_type: Option<DataType>,
    /// Word order. With `None`, a value of several registers is shown in both word orders.
    pub word_order: Option<WordOrder>,
    /// Whether the two bytes of every register are swapped.
    pub byte_swap: bool,
    /// Scale factor: engineering units per count of the raw value.
    pub scale: f64,
    /// Engineering value that belongs to the raw value 0.
    pub offset: f64,
}

/// One decoded value, with its address and the raw content of its registers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegisterValue {
    /// Zero-based address of the first register, with its table.
    pub register: String,
    /// Number of the first register in the one-based Modicon notation.
    pub modicon: String,
    /// Registers in hexadecimal digits, lowest address first; for a bit, 0 or 1.
    pub raw: String,
    /// Decoded value, in each possible format: several entries if the format is ambiguous.
    pub readings: Vec<Reading>,
}

/// Value decoded in one format.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// Format in which the value was decoded: `msw-first`, `lsw-first`, `u16` or `i16`; empty if only one format is
    /// possible.
    pub way: &'static str,
    /// Value as text, or the reason why the registers have no value in this format.
    pub value: String,
}

impl ValueFormat {
    /// Returns the number of registers that one value occupies; 1 for a bit.
    pub fn registers(&self) -> u16 {
        self.data_type.map_or(1, DataType::registers)
    }

    /// Returns whether a value has several registers and the word order is not known.
    pub fn lacks_order(&self) -> bool {
        self.registers() > 1 && self.word_order.is_none()
    }

    /// Decodes the values in an answer to a read that begins at the register `from`.
    pub fn values(&self, from: Register, answer: &Answer) -> Vec<RegisterValue> {
        let width = usize::from(self.registers());
        match answer {
            Answer::Registers(registers) => registers
                .chunks_exact(width)
                .enumerate()
                .map(|(place, words)| register_value(from, place * width, hex(words), self.readings(words)))
                .collect(),
            Answer::Bits(bits) => bits
                .iter()
                .enumerate()
                .map(|(place, bit)| {
                    let bit = u8::from(*bit).to_string();
                    register_value(from, place, bit.clone(), vec![Reading { way: "", value: bit }])
                })
                .collect(),
            Answer::Done | Answer::Nodes(_) => Vec::new(),
        }
    }

    fn readings(&self, words: &[u16]) -> Vec<Reading> {
        let read = |way, data_type, order| Reading { way, value: self.value(data_type, order, words) };
        let msw = WordOrder::MswFirst;
        match (self.data_type, self.word_order) {
            (None, _) if words.iter().all(|word| *word < 0x8000) => vec![read("", DataType::U16, msw)],
            (None, _) => vec![read("u16", DataType::U16, msw), read("i16", DataType::I16, msw)],
            (Some(data_type), Some(order)) => vec![read("", data_type, order)],
            (Some(data_type), None) if words.len() == 1 => vec![read("", data_type, msw)],
            (Some(data_type), None) => {
                vec![read("msw-first", data_type, msw), read("lsw-first", data_type, WordOrder::LswFirst)]
            }
        }
    }

    fn value(&self, data_type: DataType, word_order: WordOrder, words: &[u16]) -> String {
        let ValueFormat { byte_swap, scale, offset, .. } = *self;
        let encoding = Encoding {
            data_type,
            word_order,
            byte_swap,
            scale: Scale::of(scale),
            offset,
            bias: 0,
            bad: Vec::new(),
        };
        // Whole counts stay integers: a floating-point conversion would lose digits of 64 bits.
        let is_plain = scale.to_bits() == 1f64.to_bits() && offset.abs() < f64::MIN_POSITIVE;
        match encoding.counts(words).filter(|_| is_plain) {
            Some(counts) => counts.to_string(),
            None => match encoding.decode(words) {
                Ok(value) => value.to_string(),
                Err(why) => why.to_string(),
            },
        }
    }
}

fn register_value(from: Register, place: usize, raw: String, readings: Vec<Reading>) -> RegisterValue {
    let offset = from.offset.saturating_add(u16::try_from(place).unwrap_or(u16::MAX));
    let address = Register { offset, ..from };
    RegisterValue { register: address.to_string(), modicon: address.modicon(), raw, readings }
}

fn hex(words: &[u16]) -> String {
    let words: Vec<String> = words.iter().map(|word| format!("{word:04X}")).collect();
    words.join(" ")
}

#[cfg(test)]
mod tests;
