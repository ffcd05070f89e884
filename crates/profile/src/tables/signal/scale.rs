//! Formats the scale of a signal for the preview, if the scale is read from another register.

use std::fmt;

use crate::document::{Json, Section, entries};
use crate::tables::register::Notation;
use isotherm_core::codec::{ScaleFrom, ScaleMeaning};

/// Register from which a scale is read, with the meaning of its content.
pub(super) struct ShownScale {
    register: Notation,
    meaning: ScaleMeaning,
}

impl From<&ScaleFrom> for ShownScale {
    fn from(from: &ScaleFrom) -> ShownScale {
        let register = Notation::of(&from.address.into(), from.encoding.data_type);
        ShownScale { register, meaning: from.meaning }
    }
}

/// Formats the factor, for example as `times ten to the power of holding:12 (40013)`.
impl fmt::Display for ShownScale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let register = &self.register;
        match self.meaning {
            ScaleMeaning::PowerOfTen => write!(f, "times ten to the power of {register}"),
            ScaleMeaning::Decimals => write!(f, "with the number of decimals in {register}"),
        }
    }
}

impl From<ShownScale> for Json {
    fn from(ShownScale { register, meaning }: ShownScale) -> Json {
        let contains = match meaning {
            ScaleMeaning::PowerOfTen => "power of ten",
            ScaleMeaning::Decimals => "decimals",
        };
        let mut section = Section::default();
        section.json("register", register);
        entries!(section, contains);
        section.into()
    }
}
