//! Units of signals.

use serde_json::Value;
use toml::Spanned;
use toml::de::{DeString, DeValue};

use crate::error::{also, listed};

/// Engineering unit, one of [`Unit::WORDS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit(pub &'static str);

/// Unit that a profile does not support, and its conversion to a supported unit `known`: `known = factor · other +
/// shift`.
struct Other {
    /// Accepted spellings, in lower case and without blanks.
    spellings: &'static [&'static str],
    /// Name of the unit in messages.
    name: &'static str,
    known: &'static str,
    factor: f64,
    shift: f64,
}

/// Conversion of a value to a unit that a profile supports: `factor · value + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Conversion {
    pub(crate) unit: Unit,
    pub(crate) factor: f64,
    pub(crate) shift: f64,
}

/// Scale and offset in the table that contains a `unit`. The hint for an unsupported unit says how to change them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Scaling {
    pub(crate) scale: Option<f64>,
    pub(crate) offset: Option<f64>,
    /// Whether another layer, a template or a DBC file may set scale and offset.
    pub(crate) may_stand_elsewhere: bool,
    /// Whether a DBC file describes the value, so that the unit of the file may be converted.
    pub(crate) is_in_dbc: bool,
}

impl Scaling {
    /// Returns scale and offset of a table of the merged profile. A template or a DBC file may set a missing scale or
    /// offset.
    pub(crate) fn of(table: &Value) -> Scaling {
        let number = |key| table.get(key).and_then(Value::as_f64);
        let is_in_dbc = table.get("dbc").is_some();
        let may_stand_elsewhere = is_in_dbc || table.get("channel").is_some();
        Scaling { scale: number("scale"), offset: number("offset"), may_stand_elsewhere, is_in_dbc }
    }

    /// Returns scale and offset from the entries of a table. `layer` is the index of the layer that contains the table.
    pub(crate) fn among(entries: &[(Spanned<DeString<'_>>, Spanned<DeValue<'_>>)], layer: usize) -> Scaling {
        let find =
            |key| entries.iter().find(|(known, _)| known.get_ref() == key).map(|(_, value)| value.get_ref());
        let number = |key| match find(key)? {
            DeValue::Float(number) => number.as_str().parse().ok(),
            DeValue::Integer(number) => number.as_str().parse().ok(),
            _ => None,
        };
        let is_in_dbc = find("dbc").is_some();
        let may_stand_elsewhere = layer > 0 || is_in_dbc || find("channel").is_some();
        Scaling { scale: number("scale"), offset: number("offset"), may_stand_elsewhere, is_in_dbc }
    }
}

const fn other(
    spellings: &'static [&'static str],
    name: &'static str,
    known: &'static str,
    factor: f64,
    shift: f64,
) -> Other {
    Other { spellings, name, known, factor, shift }
}

const OTHERS: [Other; 16] = [
    other(&["f", "°f", "℉", "degf", "fahrenheit"], "Fahrenheit", "degC", 5.0 / 9.0, -160.0 / 9.0),
    other(&["r", "°r", "degr", "rankine"], "Rankine", "K", 5.0 / 9.0, 0.0),
    other(&["m", "meter", "metre"], "m", "mm", 1000.0, 0.0),
    other(&["cm"], "cm", "mm", 10.0, 0.0),
    other(&["in", "inch", "\""], "inch", "mm", 25.4, 0.0),
    other(&["mm/s"], "mm/s", "mm/min", 60.0, 0.0),
    other(&["m/min"], "m/min", "mm/min", 1000.0, 0.0),
    other(&["l/h"], "l/h", "l/min", 1.0 / 60.0, 0.0),
    other(&["m3/h", "m³/h"], "m³/h", "l/min", 1000.0 / 60.0, 0.0),
    other(&["pa"], "Pa", "bar", 1e-5, 0.0),
    other(&["hpa", "mbar"], "mbar", "bar", 1e-3, 0.0),
    other(&["kpa"], "kPa", "bar", 0.01, 0.0),
    other(&["psi"], "psi", "bar", 0.068_947_6, 0.0),
    other(&["kn"], "kN", "N", 1000.0, 0.0),
    other(&["khz"], "kHz", "Hz", 1000.0, 0.0),
    other(&["ms"], "ms", "s", 1e-3, 0.0),
];

/// Minimum length, in bytes, of a word in which spelling mistakes are accepted. The next constant is the number of
/// accepted mistakes.
const SPELLED_OUT: usize = 6;
const SLIPS: usize = 2;

impl Unit {
    /// Units that a profile may name. "1" is a number without a unit.
    pub const WORDS: [&'static str; 23] = [
        "degC", "K", "mm", "um", "rpm", "bool", "percent", "mm/min", "m/s", "l/min", "bar", "V", "mV", "A",
        "mA", "W", "kW", "N", "Nm", "Hz", "s", "count", "1",
    ];

    /// Returns the unit with this name.
    pub fn named(name: &str) -> Option<Unit> {
        Unit::WORDS.into_iter().find(|known| *known == name).map(Unit)
    }

    /// Returns the conversion of an unsupported unit. `name` is the name of that unit in messages.
    pub(crate) fn conversion(name: &str) -> Option<Conversion> {
        let other = OTHERS.iter().find(|other| other.name == name)?;
        let unit = Unit::named(other.known)?;
        Some(Conversion { unit, factor: other.factor, shift: other.shift })
    }

    /// Builds the hint for a text that is not a unit. A unit with a similar name is not suggested, because it may be
    /// another quantity, or differ by a factor of a thousand.
    pub(crate) fn help(text: &str, beside: Scaling) -> String {
        let plain: String = text.chars().filter(|one| !one.is_whitespace() && *one != '_').collect();
        let plain = plain.to_lowercase();
        if let Some(other) =
            OTHERS.iter().find(|other| other.spellings.iter().any(|one| is_meant(&plain, one)))
        {
            return other.converted(beside);
        }
        let is_word = |known: &&&str| {
            let known = known.to_lowercase();
            known == plain
                || is_meant(&plain, &known)
                || (plain.len() > 3 && letters(&known) == letters(&plain))
        };
        let near = also(&plain, &Unit::WORDS, is_meant).or_else(|| Unit::WORDS.iter().find(is_word).copied());
        listed(near, &Unit::WORDS)
    }
}

/// Returns whether a text probably means this word: they are equal, or a long word has at most two spelling mistakes.
fn is_meant(text: &str, word: &str) -> bool {
    text == word || (word.len() >= SPELLED_OUT && strsim::damerau_levenshtein(text, word) <= SLIPS)
}

fn letters(text: &str) -> Vec<char> {
    let mut letters: Vec<char> = text.chars().collect();
    letters.sort_unstable();
    letters
}

impl Other {
    /// Describes how to convert a value of this unit into a supported one.
    fn converted(&self, beside: Scaling) -> String {
        let Other { name, known, factor, shift, .. } = *self;
        let begin = format!("there is no {name}: write \"{known}\"");
        let part = figures(factor);
        let less = match shift {
            shift if shift < 0.0 => format!(" - {}", figures(-shift)),
            _ => String::new(),
        };
        if beside.is_in_dbc && beside.scale.is_none() && beside.offset.is_none() {
            return format!(
                "{begin}. The gateway converts a value that the DBC file has in {name}. If the DBC file \
                 has no unit, also write `scale` = {part} × the factor of the file, and `offset` = {part} × \
                 the offset of the file{less}. `range` and `max_rate` are in {known}"
            );
        }
        if beside.may_stand_elsewhere && (beside.scale.is_none() || beside.offset.is_none()) {
            return format!(
                "{begin}, with `scale` = {part} × its present value (default 1), and `offset` = {part} × its \
                 present value (default 0){less}; `range` and `max_rate` are then in {known}"
            );
        }
        let scale = figures(beside.scale.unwrap_or(1.0) * factor);
        let offset = beside.offset.unwrap_or(0.0) * factor + shift;
        let offset =
            if offset.abs() > 0.0 { format!(" and offset = {}", figures(offset)) } else { String::new() };
        format!("{begin} with scale = {scale}{offset}; `range` and `max_rate` are then in {known}")
    }
}

/// Formats a number with four significant digits.
fn figures(number: f64) -> String {
    let digits = (0..12).find(|digits| number.abs() * 10f64.powi(*digits) >= 1000.0).unwrap_or(12);
    let text = format!("{number:.*}", usize::try_from(digits).unwrap_or(0));
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

impl std::fmt::Display for Unit {
    /// Formats the unit with its usual symbol, for example °C.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self.0 {
            "degC" => "°C",
            "um" => "µm",
            "percent" => "%",
            "1" => "",
            name => name,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_that_is_none_is_converted_at_the_scale_that_stands_there() {
        let beside = |scale, offset| Scaling { scale, offset, ..Scaling::default() };
        for (text, beside, words) in [
            ("degF", beside(None, None), "write \"degC\" with scale = 0.5556 and offset = -17.78;"),
            ("°F", beside(Some(0.1), None), "scale = 0.05556 and offset = -17.78;"),
            ("Farenheit", beside(Some(0.1), Some(32.0)), "scale = 0.05556;"),
            ("F", beside(Some(0.01), Some(-40.0)), "scale = 0.005556 and offset = -40;"),
            ("Rankine", beside(Some(1.0), None), "no Rankine: write \"K\" with scale = 0.5556;"),
            ("mm/s", beside(Some(0.1), None), "write \"mm/min\" with scale = 6;"),
            ("kN", beside(None, None), "write \"N\" with scale = 1000;"),
            ("inch", beside(Some(1e-4), None), "scale = 0.00254;"),
        ] {
            let help = Unit::help(text, beside);
            assert!(help.contains(words), "{text}: {help}");
        }
        let help = Unit::help("degF", Scaling { may_stand_elsewhere: true, ..Scaling::default() });
        assert!(help.contains("`scale` = 0.5556 × its") && help.contains("(default 0) - 17.78"), "{help}");
        // The scale of a DBC file is converted too: 0.5556 alone would replace it.
        let dbc = Scaling { may_stand_elsewhere: true, is_in_dbc: true, ..Scaling::default() };
        let help = Unit::help("degF", dbc);
        assert!(
            help.contains("write \"degC\". The gateway converts a value that the DBC file has in Fahrenheit"),
            "{help}"
        );
        assert!(!help.contains("default 1"), "{help}");
        let own = Unit::help("degF", Scaling { scale: Some(0.1), offset: Some(0.0), ..dbc });
        assert!(own.contains("write \"degC\" with scale = 0.05556 and offset = -17.78;"), "{own}");
    }

    #[test]
    fn a_unit_that_is_spelled_otherwise_is_named_and_one_that_is_merely_near_is_not() {
        for (text, unit) in [
            ("C", "degC"),
            ("°C", "degC"),
            ("℃", "degC"),
            ("deg C", "degC"),
            ("Celsius", "degC"),
            ("Celcius", "degC"),
            ("dgeC", "degC"),
            ("degk", "K"),
            ("Kelvin", "K"),
            ("precent", "percent"),
            ("1/min", "rpm"),
            ("µm", "um"),
            ("KW", "kW"),
        ] {
            let help = Unit::help(text, Scaling::default());
            assert!(help.starts_with(&format!("did you mean `{unit}`?")), "{text}: {help}");
        }
        for text in ["degX", "kV", "mN", "GW", "kohm", "bit", "deg", ""] {
            let help = Unit::help(text, Scaling::default());
            assert!(help.starts_with("allowed: degC, K"), "{text}: {help}");
        }
    }
}
