//! What is read before arming: whether it can be read, and can ever be as it must.

use super::Check;
use crate::place::{child, element};
use crate::raw::{RawDevice, RawVerify};
use crate::{Expected, Functions};
use isotherm_core::codec::{DataType, Encoding, Scale, WordOrder};

impl Check<'_> {
    pub(super) fn verify(&mut self, path: &str, raw: &RawDevice, functions: Functions) -> Vec<Expected> {
        let entries = raw.verify.iter().flatten().enumerate();
        let of_registers = entries.filter(|(_, entry)| entry.sdo.is_none());
        of_registers.filter_map(|(place, raw)| self.expected(&element(path, place), raw, functions)).collect()
    }

    fn expected(&mut self, path: &str, raw: &RawVerify, functions: Functions) -> Option<Expected> {
        let at = child(path, "register");
        let Some(text) = &raw.register else {
            let help = "write `register`, as \"coil:268\" or \"holding:256\"";
            self.missing(path, "register", "`register` is missing: what is to be read?", help);
            return None;
        };
        let (address, bit) = self.cell(&at, text);
        let address = address?;
        if !functions.reads(address.table) {
            let word = address.table.name();
            let message =
                format!("{address} cannot be read: reading {word} registers is not among its `functions`");
            self.wrong(&at, message, "add it, if the device can do it, or remove the check");
        }
        let data_type = match (raw.kind.map(DataType::from), bit) {
            (_, Some(bit)) => DataType::Bit(bit),
            (_, None) if address.table.is_bits() => DataType::Bool,
            (Some(kind), None) => kind,
            (None, None) => DataType::U16,
        };
        let equals = self.equal(path, data_type, raw.equals)?;
        let word_order = self.word_order(path, Some(data_type), raw.word_order)?;
        self.fits(&at, address, data_type);
        let encoding = Encoding { word_order, ..plain(data_type) };
        let what = raw.what.clone().unwrap_or_else(|| "as the profile expects it".to_owned());
        let remedy = raw.remedy.clone().unwrap_or_default();
        let address = address.into();
        Some(Expected { address, encoding, equals, what, remedy })
    }

    /// What a register or an object must read, where its type can ever be that.
    pub(super) fn equal(&mut self, path: &str, data_type: DataType, equals: Option<i64>) -> Option<i64> {
        let Some((low, high)) = data_type.integer_range() else {
            let help = "take an integer type: u16, i16, u32, i32, …";
            self.wrong(&child(path, "type"), "a floating-point value is never quite equal", help);
            return None;
        };
        let equals = equals?;
        if !(low..=high).contains(&i128::from(equals)) {
            let message = format!("{} never holds {equals}", data_type.name());
            self.wrong(&child(path, "equals"), message, format!("allowed: {low} to {high}"));
        }
        Some(equals)
    }
}

/// Whole counts as they stand there.
pub(super) fn plain(data_type: DataType) -> Encoding {
    Encoding {
        data_type,
        word_order: WordOrder::MswFirst,
        byte_swap: false,
        scale: Scale::ONE,
        offset: 0.0,
        bias: 0,
        bad: Vec::new(),
    }
}
