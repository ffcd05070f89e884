//! Bytes of an input, as numbers, addresses and answers.

use isotherm::fieldbus::wire::Answer;
use isotherm_core::codec::{DataType, Encoding, Part, Register, Scale, Table, Whole, WordOrder};

/// Input that is consumed from the front. It yields zeros at the end.
pub(super) struct Bytes<'a>(pub(super) &'a [u8]);

impl Bytes<'_> {
    pub(super) fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut taken = [0; N];
        let count = N.min(self.0.len());
        taken[..count].copy_from_slice(&self.0[..count]);
        self.0 = &self.0[count..];
        taken
    }

    pub(super) fn byte(&mut self) -> u8 {
        self.take::<1>()[0]
    }

    pub(super) fn word(&mut self) -> u16 {
        u16::from_be_bytes(self.take())
    }

    pub(super) fn encoding(&mut self) -> Encoding {
        let kinds = self.byte();
        let scale = f64::from_bits(u64::from_be_bytes(self.take()));
        let offset = f64::from_bits(u64::from_be_bytes(self.take()));
        Encoding {
            data_type: data_type(kinds),
            word_order: if kinds & 0x40 == 0 { WordOrder::MswFirst } else { WordOrder::LswFirst },
            byte_swap: kinds & 0x80 != 0,
            // Values that a profile may have: finite, and no scale of zero.
            scale: Scale::of(if scale.is_finite() && scale.abs() > 0.0 { scale } else { 1.0 }),
            offset: if offset.is_finite() { offset } else { 0.0 },
            bias: i64::from(i32::from_be_bytes(self.take())),
            bad: vec![i64::from_be_bytes(self.take()).into()],
        }
    }

    pub(super) fn address(&mut self) -> Register {
        let table = [Table::Coil, Table::Discrete, Table::Input, Table::Holding];
        Register { table: table[usize::from(self.byte() % 4)], offset: self.word() }
    }

    pub(super) fn answer(&mut self) -> Answer {
        let count = usize::from(self.byte());
        match count % 3 {
            0 => Answer::Bits((0..count).map(|_| self.byte() & 1 == 1).collect()),
            1 => Answer::Done,
            _ => Answer::Registers((0..count).map(|_| self.word()).collect()),
        }
    }
}

/// Returns one of the types that a value in registers can have.
fn data_type(kind: u8) -> DataType {
    let part = |first, last, whole| Part::new(first, last, whole).map(DataType::Part);
    let parts = [part(4, 15, Whole::I16), part(0, 3, Whole::U16), part(8, 27, Whole::I32)];
    let bits = DataType::Bit(kind >> 4);
    let wide = [DataType::unsigned(24), DataType::signed(24), bits, DataType::Bcd(4), DataType::Bcd(8)];
    let all: Vec<DataType> =
        DataType::ALL.into_iter().chain(wide).chain(parts.into_iter().flatten()).collect();
    all[usize::from(kind) % all.len()]
}
