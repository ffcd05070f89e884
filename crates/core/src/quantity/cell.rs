//! Cell of a log as people and loggers write it. A cell contains a number or a word for a missing value. The number may
//! have a unit, a blank after its sign, or a Fortran exponent, for example `2.0D+01`.

use std::borrow::Cow;

/// Meaning of the text in one cell of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cell<'a> {
    /// Finite number, and the unit that follows it in the cell. The unit is empty if the cell contains no unit.
    Number(f64, &'a str),
    /// No value: the cell is empty, or contains what programs write for an empty cell, such as `NaN` or `null`.
    Absent,
    /// Words for a value that is not available, such as `n/a`, `#NV` or `-`.
    Unavailable,
    /// Message of a logger instead of a value, such as `OL`, `Over` or `---`.
    Failed,
    /// Any other text, which is neither a number nor a known word for a missing value.
    Text,
}

/// Words that programs write into an empty cell.
const ABSENT: [&str; 7] = ["<na>", "nat", "nan", "null", "(null)", "none", "."];

/// Words that people, spreadsheets and data-logging servers write for a value that is not available.
const UNAVAILABLE: [&str; 21] = [
    "na",
    "n/a",
    "n.a.",
    "n. a.",
    "#n/a",
    "#n/a n/a",
    "#nv",
    "n.v.",
    "k.a.",
    "k. a.",
    "n.d.",
    "n/d",
    "\\n",
    "missing",
    "not available",
    "no value",
    "keine daten",
    "kein wert",
    "-",
    "\u{2013}",
    "\u{2014}",
];

/// Messages of loggers for a value that could not be measured.
const FAILED: [&str; 99] = [
    "ol",
    "+ol",
    "-ol",
    "o.l",
    "o.l.",
    "ovl",
    "ovld",
    "over",
    "overload",
    "overflow",
    "overrange",
    "over range",
    "ovrng",
    "+over",
    "-over",
    "under",
    "underrange",
    "under range",
    "undrng",
    "burnout",
    "burn out",
    "b.out",
    "open circuit",
    "opentc",
    "open tc",
    "error",
    "err",
    "fault",
    "fail",
    "failed",
    "invalid",
    "bad",
    "no data",
    "nodata",
    "no sensor",
    "disconnected",
    "inf",
    "+inf",
    "-inf",
    "infinity",
    "open",
    "short",
    "sensor fault",
    "out of range",
    "offline",
    "timeout",
    "#value!",
    "#wert!",
    "#div/0!",
    "#num!",
    "#zahl!",
    "#ref!",
    "#valeur!",
    "#valor!",
    "o/l",
    "err.",
    "fehler",
    "sensorfehler",
    "fühlerbruch",
    "bruch",
    "sensor error",
    "?",
    "-ol-",
    "o.r.",
    "ovf",
    "of",
    "ofl",
    "ufl",
    "overrun",
    "over temp",
    "hi",
    "lo",
    "high",
    "low",
    "hhh",
    "hhhh",
    "lll",
    "llll",
    "open t/c",
    "t/c open",
    "tc open",
    "open sensor",
    "sensor open",
    "open input",
    "n/c",
    "not connected",
    "unplugged",
    "short circuit",
    "drahtbruch",
    "leitungsbruch",
    "kurzschluss",
    "ungültig",
    "bad input",
    "bad quality",
    "no good",
    "no signal",
    "comm fail",
    "comm error",
    "i/o timeout",
];

/// Units that may follow a number in a cell or a name in a header. The comparison ignores case.
const UNITS: [&str; 115] = [
    "°c",
    "℃",
    "degc",
    "deg c",
    "c",
    "celsius",
    "°f",
    "℉",
    "degf",
    "deg f",
    "f",
    "fahrenheit",
    "k",
    "kelvin",
    "µm",
    "μm",
    "um",
    "nm",
    "mm",
    "rpm",
    "1/min",
    "u/min",
    "min-1",
    "r/min",
    "mm/min",
    "m/min",
    "m/s",
    "hz",
    "%",
    "%rh",
    "% rh",
    "rh",
    "percent",
    "bar",
    "mbar",
    "hpa",
    "kpa",
    "pa",
    "psi",
    "v",
    "mv",
    "a",
    "ma",
    "w",
    "kw",
    "n",
    "kn",
    "l/min",
    "l/h",
    "s",
    "ms",
    "min",
    "h",
    "°",
    "deg",
    "count",
    "mm/s",
    "mm/s2",
    "mm/s²",
    "m/s2",
    "m/s²",
    "km/h",
    "mm/rev",
    "g",
    "kg",
    "khz",
    "mhz",
    "wh",
    "kwh",
    "va",
    "kva",
    "uv",
    "µv",
    "kv",
    "ohm",
    "kohm",
    "ω",
    "kω",
    "mω",
    "mpa",
    "psig",
    "psia",
    "inhg",
    "mmhg",
    "torr",
    "l/s",
    "ml/min",
    "m3/h",
    "m³/h",
    "m3/min",
    "m³/min",
    "gpm",
    "cfm",
    "ppm",
    "ppb",
    "db",
    "dba",
    "db(a)",
    "lux",
    "lx",
    "µm/m",
    "um/m",
    "µε",
    "µs/cm",
    "us/cm",
    "ms/cm",
    "g/m3",
    "g/m³",
    "g/kg",
    "w/m2",
    "w/m²",
    "rad",
    "mrad",
    "counts",
    "stk",
];

/// Units that may follow a number without a blank, although they are letters. `A`, `V`, `N` and `W` are not among them,
/// because `7A` may be the name of a run.
const ATTACHED: [&str; 16] = [
    "c", "degc", "f", "degf", "k", "um", "nm", "mm", "rpm", "mm/min", "l/min", "bar", "hz", "ma", "ms", "min",
];

/// Returns a unit in lower case and in its usual spelling: `º C` becomes `°c`.
#[must_use]
pub fn spelled(unit: &str) -> String {
    // People also type the ordinal sign or the ring above instead of the degree sign.
    let unit = unit.to_lowercase().replace(['º', '˚'], "°");
    match unit.as_str() {
        "° c" | "deg. c" | "deg.c" | "grad c" | "grad celsius" | "degrees c" | "deg celsius" | "°celsius" => {
            "°c"
        }
        "° f" | "deg. f" | "deg.f" | "degrees f" | "deg fahrenheit" | "°fahrenheit" => "°f",
        "µ" | "μ" => "µm",
        _ => return unit,
    }
    .to_owned()
}

/// Returns whether this text is a unit that a log may state.
#[must_use]
pub fn is_unit(text: &str) -> bool {
    UNITS.contains(&spelled(text).as_str())
}

/// Returns whether this is the name of a column for comments. Loggers leave out the cells of this column at the end of
/// a row.
#[must_use]
pub fn is_comment(name: &str) -> bool {
    const NAMES: [&str; 7] = ["comment", "comments", "remark", "remarks", "note", "kommentar", "bemerkung"];
    NAMES.iter().any(|known| name.eq_ignore_ascii_case(known))
}

/// Separates the name of a column from the unit after it: `Spindle [°C]`, `bed (µm)`, `air / °C`, `t in s`. The unit is
/// `None` if the name ends with none of the known units.
#[must_use]
pub fn name_and_unit(header: &str) -> (&str, Option<&str>) {
    let header = header.trim();
    let closed = [('[', ']'), ('(', ')')].into_iter().find_map(|(open, close)| {
        let (name, unit) = header.strip_suffix(close)?.rsplit_once(open)?;
        Some((name, unit))
    });
    let found = closed.into_iter().chain(open_units(header)).find(|(_, unit)| is_unit(unit.trim()));
    match found {
        Some((name, unit)) if !name.trim().is_empty() && !is_unit(header) => (name.trim(), Some(unit.trim())),
        _ => (header, None),
    }
}

/// Returns the ways to separate a header into a name and the text after it, if no brackets enclose that text.
fn open_units(header: &str) -> impl Iterator<Item = (&str, &str)> {
    let between = [" / ", " in ", ", "].into_iter().filter_map(|between| header.rsplit_once(between));
    // `flow l/min` and `Temp deg C` end with a unit that contains a separator.
    let two_words = header.rmatch_indices(' ').nth(1).map(|(at, _)| header.split_at(at));
    // One letter may be the number of a sensor: `bearing A`, `motor F`.
    let is_letter = |text: &str| text.len() == 1 && text.bytes().all(|byte| byte.is_ascii_alphabetic());
    let last_word = header.rsplit_once(' ').filter(|(_, last)| !is_letter(last));
    between.chain(two_words).chain(last_word).chain(header.rsplit_once('/'))
}

/// Returns the meaning of a cell that contains no number.
pub(super) fn word(text: &str) -> Cell<'static> {
    let is_one_of = |words: &[&str]| words.iter().any(|word| text.eq_ignore_ascii_case(word));
    match text {
        "" => Cell::Absent,
        "true" => Cell::Number(1.0, ""),
        "false" => Cell::Number(0.0, ""),
        _ if is_one_of(&ABSENT) => Cell::Absent,
        _ if is_one_of(&UNAVAILABLE) => Cell::Unavailable,
        _ if is_one_of(&FAILED) || is_filler(text) || is_of_windows(text) => Cell::Failed,
        _ if is_of_spreadsheet(text) || is_numbered_error(text) => Cell::Failed,
        _ => Cell::Text,
    }
}

/// Returns whether the text is an error of a spreadsheet in any language: `#VALUE!`, `#BEZUG!`, `#NAME?`.
fn is_of_spreadsheet(text: &str) -> bool {
    let word = text.strip_prefix('#').and_then(|rest| rest.strip_suffix(['!', '?']));
    word.is_some_and(|word| !word.is_empty() && !word.contains(char::is_whitespace))
}

/// Returns whether the text is an error of a logger with its number: `Err1`, `Error 12`, `ERR:03`.
fn is_numbered_error(text: &str) -> bool {
    let text = text.to_ascii_lowercase();
    let rest = text.strip_prefix("error").or_else(|| text.strip_prefix("err"));
    let number = rest.map(|rest| rest.trim_start_matches([' ', '.', ':', '-', '_', '#']));
    number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
}

/// Returns whether the text repeats one sign, as displays do for an overload: `---`, `+++++++`, `****`.
fn is_filler(text: &str) -> bool {
    let signs = text.replace(['.', ','], "");
    signs.len() > 1 && ['-', '+', '*', '#', '?', '_'].iter().any(|sign| signs.chars().all(|own| own == *sign))
}

/// Returns whether the text is NaN or infinity as programs of Windows print it: `1.#QNAN`, `-1.#IND`, `1.#INF`. With
/// two decimals, they print `1.#R` and `1.#J`. Later versions print `nan(ind)` and `nan(snan)`.
fn is_of_windows(text: &str) -> bool {
    let text = text.trim_start_matches(['+', '-']).to_ascii_uppercase();
    if ["NAN(IND)", "NAN(SNAN)", "QNAN", "SNAN"].contains(&text.as_str()) {
        return true;
    }
    let rest = text.strip_prefix("1.#").or_else(|| text.strip_prefix("1,#"));
    rest.is_some_and(|rest| ["QN", "SN", "NAN", "IN", "R", "J"].iter().any(|word| rest.starts_with(word)))
}

/// Separates a number from the unit after it. Removes blanks after its sign, and replaces the `D` of a Fortran exponent
/// (`2.0D+01`) by `e`. `None` if the text is not a number with a known unit.
pub(super) fn number_and_unit(text: &str) -> Option<(Cow<'_, str>, &str)> {
    let text = text.trim();
    let unsigned = text.strip_prefix(['+', '-', '−']).unwrap_or(text);
    let is_negative = text.starts_with(['-', '−']);
    let has_sign = unsigned.len() < text.len();
    let unsigned = unsigned.trim_start();
    let (groups, plain) = groups(unsigned).map_or((None, unsigned), |(joined, rest)| (Some(joined), rest));
    let mantissa =
        plain.bytes().take_while(|byte| byte.is_ascii_digit() || matches!(byte, b'.' | b',')).count();
    if groups.is_none() && !plain.as_bytes()[..mantissa].iter().any(u8::is_ascii_digit) {
        return None;
    }
    let exponent = length_of_exponent(&plain[mantissa..]);
    let (number, rest) = plain.split_at(mantissa + exponent);
    let unit = rest.trim();
    let is_apart = rest.len() > unit.len() || !unit.starts_with(|first: char| first.is_ascii_alphabetic());
    let is_attached = || ATTACHED.iter().any(|known| unit.eq_ignore_ascii_case(known));
    if !unit.is_empty() && !(is_unit(unit) && (is_apart || is_attached())) {
        return None;
    }
    let is_of_fortran =
        plain.as_bytes().get(mantissa).is_some_and(|byte| matches!(byte, b'd' | b'D')) && exponent > 0;
    if !has_sign && !is_of_fortran && groups.is_none() {
        return Some((Cow::Borrowed(number), unit));
    }
    let sign = if is_negative { "-" } else { "" };
    let number = if is_of_fortran { number.replace(['d', 'D'], "e") } else { number.to_owned() };
    Some((Cow::Owned(format!("{sign}{}{number}", groups.unwrap_or_default())), unit))
}

/// Characters that only separate thousands: blanks and apostrophes.
const OF_THOUSANDS: [char; 6] = [' ', '\u{a0}', '\u{2009}', '\u{202f}', '\'', '\u{2019}'];

/// Joins the groups of three digits at the beginning of this text, as in `1 020,5` or `1'020.5`. Returns the digits, and
/// the text after them; `None` if there are no such groups.
fn groups(text: &str) -> Option<(String, &str)> {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let first = digits(text);
    if !(1..=3).contains(&first) || text.starts_with('0') {
        return None;
    }
    let sign = text[first..].chars().next().filter(|sign| OF_THOUSANDS.contains(sign))?;
    let (mut joined, mut rest) = (text[..first].to_owned(), &text[first..]);
    while let Some(group) = rest.strip_prefix(sign).filter(|group| digits(group) == 3) {
        joined.push_str(&group[..3]);
        rest = &group[3..];
    }
    (joined.len() > first).then_some((joined, rest))
}

/// Returns the length of the exponent at the beginning of this text, in bytes; 0 if the text has no exponent there.
fn length_of_exponent(text: &str) -> usize {
    let bytes = text.as_bytes();
    if !bytes.first().is_some_and(|byte| matches!(byte, b'e' | b'E' | b'd' | b'D')) {
        return 0;
    }
    let sign = usize::from(bytes.get(1).is_some_and(|byte| matches!(byte, b'+' | b'-')));
    let digits = bytes[1 + sign..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    if digits == 0 { 0 } else { 1 + sign + digits }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_separated_from_their_signs_units_and_exponents() {
        for (text, number, unit) in [
            ("20.01", "20.01", ""),
            ("+   23.40", "23.40", ""),
            ("- 3", "-3", ""),
            ("−5,5", "-5,5", ""),
            ("20.01 °C", "20.01", "°C"),
            ("20.01°C", "20.01", "°C"),
            ("20.01C", "20.01", "C"),
            ("0.19 µm", "0.19", "µm"),
            ("0.19 \u{3bc}m", "0.19", "\u{3bc}m"),
            ("68 °F", "68", "°F"),
            ("20.01 ºC", "20.01", "ºC"),
            ("45 %", "45", "%"),
            ("45%", "45", "%"),
            ("2.0D+01", "2.0e+01", ""),
            ("-2.0d01", "-2.0e01", ""),
            ("1.5E-3 mm", "1.5E-3", "mm"),
            ("1,020", "1,020", ""),
            ("1 020,5", "1020,5", ""),
            ("-1'020.5 mm", "-1020.5", "mm"),
            ("12\u{202f}345\u{202f}678", "12345678", ""),
            ("293.15K", "293.15", "K"),
            ("68F", "68", "F"),
        ] {
            assert_eq!(number_and_unit(text), Some((Cow::Borrowed(number), unit)), "{text}");
        }
        for text in [
            "A7",
            "7A",
            "7B",
            "",
            "+",
            "°C",
            "20 apples",
            "12:30",
            "1-2",
            "e5",
            "2.0D",
            "20 20",
            "0 123",
            "1 0200",
            "1 020 30",
        ] {
            assert_eq!(number_and_unit(text), None, "{text}");
        }
    }

    #[test]
    fn words_are_missing_values_messages_of_a_logger_or_texts() {
        for text in ["", "NaN", "nan", "null", "<NA>", "None"] {
            assert_eq!(word(text), Cell::Absent, "{text}");
        }
        for text in ["n/a", "N/A", "#N/A", "#NV", "-", "–", "—", "NA", "k.A.", "\\N", "missing"] {
            assert_eq!(word(text), Cell::Unavailable, "{text}");
        }
        for text in [
            "OL",
            "Over",
            "---",
            "+++++++",
            "1.#QNAN",
            "-1.#IND",
            "1.#INF",
            "1.#R",
            "BURNOUT",
            "****",
            "-.--",
            "#DIV/0!",
            "Err",
            "O/L",
            "Fehler",
            "#NAME?",
            "#BEZUG!",
            "#VALEUR!",
            "Err1",
            "Error 12",
            "-nan(ind)",
            "nan(ind)",
            "OVF",
            "Drahtbruch",
            "T/C open",
            "Comm Fail",
            "HHHH",
            "Lo",
        ] {
            assert_eq!(word(text), Cell::Failed, "{text}");
        }
        for text in
            ["A7", "idle", "oops", "closed", "armed", "x", "#1", "#!", "errand", "error x", "terror 1"]
        {
            assert_eq!(word(text), Cell::Text, "{text}");
        }
        assert_eq!(word("true"), Cell::Number(1.0, ""));
    }

    #[test]
    fn a_unit_is_separated_from_the_name_of_its_column() {
        for (header, name, unit) in [
            ("Spindle [°C]", "Spindle", Some("°C")),
            ("bed (µm)", "bed", Some("µm")),
            ("air / degC", "air", Some("degC")),
            ("Zeit in s", "Zeit", Some("s")),
            ("spindle/°C", "spindle", Some("°C")),
            ("flow l/min", "flow", Some("l/min")),
            ("Temp deg C", "Temp", Some("deg C")),
            ("bed, front µm", "bed, front", Some("µm")),
            ("bearing A", "bearing A", None),
            ("motor F", "motor F", None),
            ("mm/min", "mm/min", None),
            ("Datum & Uhrzeit", "Datum & Uhrzeit", None),
            ("spindle", "spindle", None),
            ("bed (ºC)", "bed", Some("ºC")),
            ("bed [Deg. C]", "bed", Some("Deg. C")),
            ("bed ° C", "bed", Some("° C")),
            ("z_error_um [µ]", "z_error_um", Some("µ")),
            ("CO2 [ppm]", "CO2", Some("ppm")),
            ("Coil (Ω)", "Coil", Some("Ω")),
            ("Flow [m³/h]", "Flow", Some("m³/h")),
            ("Vibration mm/s", "Vibration", Some("mm/s")),
            ("bearing g", "bearing g", None),
            ("coolant in", "coolant in", None),
            ("bed (front)", "bed (front)", None),
            ("[°C]", "[°C]", None),
            ("z_error_um", "z_error_um", None),
        ] {
            assert_eq!(name_and_unit(header), (name, unit), "{header}");
        }
    }
}
