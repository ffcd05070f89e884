//! Converts the units of a DBC file, which are free texts, to the units of a profile.

use crate::Unit;
use crate::tables::signal::unit::Conversion;

/// Unit of a signal in a DBC file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum FileUnit {
    /// The signal is a number without a unit: the text is empty, or a word such as `unitless`.
    Plain,
    /// The text means a unit that a profile supports.
    Known(Unit),
    /// The text means a unit that a profile does not support, but that can be converted to a supported unit.
    Convertible {
        /// Text of the unit as it is in the file, for messages.
        written: String,
        /// Conversion to a unit of a profile.
        conversion: Conversion,
    },
    /// The text is not a known unit. The field contains the text of the unit as it is in the file.
    Unknown(String),
}

/// Characters that DBC files contain instead of a degree sign. Some look like a degree sign. Others are the bytes of a
/// degree sign in a Chinese, Korean, Japanese or DOS code page. Question marks result from a conversion to ASCII.
const DEGREES: [&str; 12] =
    ["Â°", "º", "˚", "\u{fffd}", "¡ã", "¡Æ", "\u{81}\u{8b}", "ø", "??", "?", "'", "`"];

/// Spellings of temperature units in lower case, without blanks, points and `_`. Each list of spellings comes with the
/// unit that they mean. The last three are "℃" of Chinese, Korean and Japanese code pages, read as Latin-1.
const TEMPERATURES: [(&[&str], &str); 4] = [
    (
        &[
            "°c",
            "degc",
            "degcelsius",
            "degreec",
            "degreesc",
            "degreecelsius",
            "degreescelsius",
            "celsius",
            "celcius",
            "degcelcius",
            "cel",
            "centigrade",
            "gradc",
            "gradcelsius",
            "°celsius",
            "℃",
            "¡æ",
            "¡é",
            "\u{81}\u{8e}",
        ],
        "degC",
    ),
    (&["kelvin", "°k", "degk", "degkelvin", "degreekelvin"], "K"),
    (
        &[
            "°f",
            "degf",
            "degfahrenheit",
            "degreef",
            "degreesf",
            "degreefahrenheit",
            "fahrenheit",
            "farenheit",
            "℉",
        ],
        "Fahrenheit",
    ),
    (&["degrankine", "rankine"], "Rankine"),
];

/// Spellings of other units, without blanks and `_`. Each list of spellings comes with the unit that they mean. Case
/// matters: "mPa" is not "MPa".
const OTHERS: [(&[&str], &str); 29] = [
    (&["C", "oC"], "degC"),
    (&["F", "oF"], "Fahrenheit"),
    (&["°R", "degR", "DegR"], "Rankine"),
    (&["µm", "μm", "micron", "microns", "\u{a6}Ìm", "\u{83}Êm"], "um"),
    (&["1/min", "RPM", "Rpm", "min-1", "min^-1", "U/min", "r/min", "rev/min"], "rpm"),
    (&["%", "Percent", "PERCENT", "pct"], "percent"),
    (&["Volt", "volt", "Volts", "volts"], "V"),
    (&["Amp", "Amps", "amp", "amps", "Ampere", "Amperes"], "A"),
    (&["sec", "Sec", "second", "seconds", "Seconds"], "s"),
    (&["L/min", "lpm", "LPM"], "l/min"),
    (&["N.m", "N*m", "N·m", "N-m"], "Nm"),
    (&["Watt", "watt", "Watts", "watts"], "W"),
    (&["KW", "Kw"], "kW"),
    (&["Hertz", "hertz", "HZ"], "Hz"),
    (&["Bar", "BAR"], "bar"),
    (&["m"], "m"),
    (&["cm"], "cm"),
    (&["in", "inch"], "inch"),
    (&["mm/s"], "mm/s"),
    (&["m/min"], "m/min"),
    (&["l/h", "L/h"], "l/h"),
    (&["m3/h", "m³/h", "m^3/h"], "m³/h"),
    (&["Pa"], "Pa"),
    (&["hPa", "mbar", "mBar"], "mbar"),
    (&["kPa", "KPa"], "kPa"),
    (&["psi", "PSI"], "psi"),
    (&["kN"], "kN"),
    (&["kHz", "KHz"], "kHz"),
    (&["ms"], "ms"),
];

/// Texts that mean a number without a unit, in lower case.
const PLAIN: [&str; 10] = ["", "-", "--", "1", "none", "n/a", "na", "unitless", "bit", "raw"];

/// Returns the unit that a text of a DBC file means. Blanks and `_` in the text are ignored.
pub(super) fn of(text: &str) -> FileUnit {
    let bare: String = text.chars().filter(|one| !one.is_whitespace() && *one != '_').collect();
    let degree = DEGREES.iter().find(|degree| bare.starts_with(**degree));
    let bare = degree.map_or(bare.clone(), |degree| bare.replacen(*degree, "°", 1));
    let small = bare.to_lowercase();
    if PLAIN.contains(&small.as_str()) {
        return FileUnit::Plain;
    }
    let small = small.replace('.', "");
    let found = Unit::named(&bare).map(|unit| unit.0);
    let found = found.or_else(|| listed(&OTHERS, &bare)).or_else(|| listed(&TEMPERATURES, &small));
    let meant = found.and_then(|name| match Unit::named(name) {
        Some(unit) => Some(FileUnit::Known(unit)),
        None => Unit::conversion(name)
            .map(|conversion| FileUnit::Convertible { written: text.trim().to_owned(), conversion }),
    });
    meant.unwrap_or_else(|| FileUnit::Unknown(text.trim().to_owned()))
}

fn listed(list: &[(&[&str], &'static str)], written: &str) -> Option<&'static str> {
    list.iter().find(|(spellings, _)| spellings.contains(&written)).map(|(_, name)| *name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_spelling_of_a_unit_is_understood() {
        const CASES: [(&[&str], &str); 9] = [
            (
                &[
                    "degC",
                    "deg C",
                    "°C",
                    "ºC",
                    "Â°C",
                    "\u{fffd}C",
                    "℃",
                    "¡æ",
                    "C",
                    "Celsius",
                    "DegreeC",
                    "deg.C",
                    "?C",
                    "??C",
                    "'C",
                    "oC",
                    "¡ãC",
                    "¡Æ C",
                    "¡É",
                    "\u{81}\u{8b}C",
                    "øC",
                    "Celcius",
                    "Cel",
                ],
                "degC",
            ),
            (&["K", "Kelvin", "°K"], "K"),
            (&["µm", "μm", "um"], "um"),
            (&["rpm", "RPM", "1/min", "U/min"], "rpm"),
            (&["%", "Percent"], "percent"),
            (&["V", "Volt"], "V"),
            (&["bar", "Bar"], "bar"),
            (&["Nm", "N.m", "N*m"], "Nm"),
            (&["kW", "KW"], "kW"),
        ];
        for (texts, unit) in CASES {
            for text in texts {
                assert_eq!(of(text), FileUnit::Known(Unit::named(unit).unwrap()), "{text}");
            }
        }
    }

    #[test]
    fn a_unit_that_a_profile_does_not_have_is_converted() {
        const CASES: [(&[&str], &str, f64, f64); 7] = [
            (&["degF", "°F", "deg F", "F", "Fahrenheit", "ºF", "?F", "℉"], "degC", 212.0, 100.0),
            (&["degR", "Rankine"], "K", 491.67, 273.15),
            (&["kPa"], "bar", 250.0, 2.5),
            (&["mbar", "hPa"], "bar", 1013.0, 1.013),
            (&["m"], "mm", 0.25, 250.0),
            (&["in", "inch"], "mm", 2.0, 50.8),
            (&["mm/s"], "mm/min", 2.0, 120.0),
        ];
        for (texts, unit, raw, value) in CASES {
            for text in texts {
                let FileUnit::Convertible { written, conversion } = of(text) else { panic!("{text}") };
                assert_eq!((written.as_str(), conversion.unit.0), (*text, unit));
                let found = raw * conversion.factor + conversion.shift;
                assert!((found - value).abs() < 1e-9 * value.abs(), "{text}: {found}");
            }
        }
    }

    #[test]
    fn other_texts_are_no_unit_and_none_is_guessed() {
        for text in ["", " ", "-", "1", "n/a", "Bit"] {
            assert_eq!(of(text), FileUnit::Plain, "{text:?}");
        }
        for text in ["km/h", "MPa", "mPa", "deg/s", "degr", "c", "f", "OC", "kV", "Ohm", "°", "?", "''"] {
            assert_eq!(of(text), FileUnit::Unknown(text.to_owned()), "{text}");
        }
    }
}
