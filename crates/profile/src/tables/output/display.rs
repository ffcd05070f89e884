//! `beside` and `stale` of an output: additional registers of a digit display, and its text while there is no position.

use schemars::JsonSchema;
use serde::Deserialize;

use super::RawOutput;
use crate::tables::KeyContext;
use crate::tables::device::Device;
use crate::tables::register::{Notation, TypeWord, holding};
use isotherm_core::codec::{DataType, Register, Table};

/// Largest number of decimals of a digit display.
const MOST_DECIMALS: u8 = 5;

/// Word that a display receives in addition to its value, for example its colour.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Beside")]
pub(super) struct RawBeside {
    /// Holding register of the word.
    #[schemars(required)]
    register: Option<String>,
    /// Value of the word, if it is constant.
    value: Option<u16>,
    /// Factor of a word that depends on the number of decimals of `scale`. The word is the number of decimals
    /// times the factor.
    decimals: Option<u16>,
    /// Word while the axis follows its first model.
    good: Option<u16>,
    /// Word while the axis follows another model. Default: the word for `good`.
    degraded: Option<u16>,
    /// Word while the axis is frozen, ramps, is at zero or off.
    fault: Option<u16>,
}

/// Text that a display shows if there is no value.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Stale")]
pub(super) struct RawStale {
    /// First holding register of the display's text.
    #[schemars(required)]
    register: Option<String>,
    /// Text, for example "----".
    #[schemars(required)]
    text: Option<String>,
    /// Characters in one register: 1, or 2 with the first character in the high byte. Default 2.
    #[schemars(range(min = 1, max = 2))]
    characters: Option<u8>,
}

/// Additional registers of a digit display. Empty for other outputs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Display {
    /// Registers that are written together with each value.
    pub beside: Vec<ExtraWord>,
    /// Text that is written if there is no position to correct, or if the axis is off.
    pub stale: Option<Stale>,
}

/// Word that a display receives in addition to its value, for example its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExtraWord {
    /// Holding register of the word.
    pub register: u16,
    /// Value of the word while the axis follows its first model.
    pub good: u16,
    /// Value of the word while the axis follows a fallback model: any of its models except the first.
    pub degraded: u16,
    /// Value of the word while the axis follows no model: it is frozen, ramps, is at zero or off.
    pub fault: u16,
}

/// Text that a display shows if there is no value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stale {
    /// Text as the profile states it.
    pub text: String,
    /// First holding register of the text.
    pub register: u16,
    /// Register values that contain the characters of the text.
    pub words: Vec<u16>,
}

/// State of an axis as a digit display shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// The axis follows its first model.
    Good,
    /// The axis follows a fallback model: any of its models except the first.
    Degraded,
    /// The axis follows no model: it is frozen, ramps, is at zero or off.
    Fault,
}

impl ExtraWord {
    /// Returns the register value for this state of the axis.
    pub fn word(self, shown: Shown) -> u16 {
        match shown {
            Shown::Good => self.good,
            Shown::Degraded => self.degraded,
            Shown::Fault => self.fault,
        }
    }
}

impl Stale {
    /// Encodes a text as register values, with one or two characters in each. An odd last character is followed by a
    /// blank.
    pub fn words(text: &str, characters: u8) -> Vec<u16> {
        let bytes = text.as_bytes();
        if characters == 1 {
            return bytes.iter().map(|byte| u16::from(*byte)).collect();
        }
        let pair = |pair: &[u8]| u16::from_be_bytes([pair[0], pair.get(1).copied().unwrap_or(b' ')]);
        bytes.chunks(2).map(pair).collect()
    }
}

impl Display {
    /// Preview of the additional registers and the text.
    pub(super) fn preview(&self) -> Vec<String> {
        let at = |offset| Notation::from(Register { table: Table::Holding, offset });
        let beside = self.beside.iter().map(|word| {
            let ExtraWord { register, good, degraded, fault } = word;
            let register = at(*register);
            if good == fault {
                return format!("also {register}: always {good:#06x}");
            }
            format!(
                "also {register}: {good:#06x}; {degraded:#06x} with a fallback model, {fault:#06x} without a \
                 model"
            )
        });
        let stale = self.stale.iter().map(|Stale { text, register, .. }| {
            let register = at(*register);
            format!("without a position, and while the axis is off: \"{text}\" from {register} on")
        });
        beside.chain(stale).collect()
    }

    /// Iterates over the additional registers of the display, which do not contain its value.
    pub fn registers(&self) -> impl Iterator<Item = Register> + '_ {
        let texts = self.stale.iter().flat_map(|stale| (stale.register..).take(stale.words.len()));
        let words = self.beside.iter().map(|beside| beside.register);
        words.chain(texts).map(|offset| Register { table: Table::Holding, offset })
    }
}

/// Resolves the additional registers and the text of a display.
pub(crate) fn resolve(raw: &RawOutput, at: &KeyContext<'_>, device: Option<&Device>) -> Display {
    for key in ["beside", "stale"].into_iter().filter(|key| at.has(key) && raw.is_written_as_cz()) {
        let help = "remove this key, or write writes = \"corrected\"";
        at.key(key).wrong_key("this key is only for a display of a corrected position", help);
    }
    let list = at.key("beside");
    let beside = raw.beside.iter().flatten().enumerate();
    let beside =
        beside.filter_map(|(place, raw_word)| raw_word.resolve(&list.item(place), raw.scale, device));
    let beside = beside.collect();
    let stale = raw.stale.as_ref().and_then(|stale| stale.resolve(&at.key("stale"), device));
    Display { beside, stale }
}

/// Returns the type of an output at the key `type`. The type of a digit display includes the number of
/// decimals, which results from `scale`. `None` if the type is missing, or if `scale` does not result in a
/// number of decimals, which is reported.
pub(crate) fn digits(raw: &RawOutput, at: &KeyContext<'_>) -> Option<DataType> {
    let TypeWord(kind) = raw.kind?;
    match (kind, raw.scale) {
        (DataType::Decimal24(_), Some(scale)) => decimals(&at.key("scale"), scale).map(DataType::Decimal24),
        _ => Some(kind),
    }
}

fn decimals(at: &KeyContext<'_>, scale: f64) -> Option<u8> {
    let is_near = |decimals: &u8| (scale * 10f64.powi(i32::from(*decimals)) - 1.0).abs() < 1e-9;
    let found = (0..=MOST_DECIMALS).find(is_near);
    if found.is_none() {
        let help = "write `scale` as 1.0, 0.1, 0.01, 0.001, 0.0001 or 0.00001 mm";
        at.invalid(format!("`scale` is {scale}, which is not the value of a digit of a display"), help);
    }
    found
}

impl RawBeside {
    fn resolve(&self, at: &KeyContext<'_>, scale: Option<f64>, device: Option<&Device>) -> Option<ExtraWord> {
        let register = holding(&at.key("register"), self.register.as_ref())?.offset;
        if let Some(device) = device {
            device.must_write(&at.key("register"), 1);
        }
        let by_state = self.good.zip(self.fault);
        let ways = [self.value.is_some(), self.decimals.is_some(), by_state.is_some()];
        if ways.into_iter().filter(|is_there| *is_there).count() != 1 {
            let help = "write one of: value = 0; decimals = 256; good = 1, degraded = 2, fault = 3";
            at.wrong_key("exactly one way to give the value of the register is required", help);
            return None;
        }
        if let Some((good, fault)) = by_state {
            return Some(ExtraWord { register, good, degraded: self.degraded.unwrap_or(good), fault });
        }
        let word = match (self.value, self.decimals) {
            (Some(value), _) => value,
            (None, times) => u16::from(decimals(at, scale?)?).saturating_mul(times.unwrap_or(1)),
        };
        Some(ExtraWord { register, good: word, degraded: word, fault: word })
    }
}

impl RawStale {
    fn resolve(&self, at: &KeyContext<'_>, device: Option<&Device>) -> Option<Stale> {
        let register = holding(&at.key("register"), self.register.as_ref())?.offset;
        let text = self.text.clone()?;
        if text.is_empty() || !text.bytes().all(|byte| (0x20..0x7f).contains(&byte)) {
            let help = "write characters that a display has, as \"----\"";
            return at.key("text").reject(format!("`{text}` cannot be shown"), help);
        }
        let words = Stale::words(&text, self.characters.unwrap_or(2));
        if let Some(device) = device {
            device.must_write(&at.key("register"), u16::try_from(words.len()).unwrap_or(u16::MAX));
        }
        Some(Stale { text, register, words })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_lies_in_registers_as_its_display_reads_it() {
        assert_eq!(Stale::words("----", 2), [0x2d2d, 0x2d2d]);
        assert_eq!(Stale::words("-a-", 2), [0x2d61, 0x2d20]);
        assert_eq!(Stale::words("--", 1), [0x2d, 0x2d]);
    }
}
