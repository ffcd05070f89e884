//! Kinds of log columns: temperature, speed, position and others.

use std::fmt;

use super::Series;

/// Kind of quantity in a log column of numbers, guessed from unit, name and values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Temperature, °C.
    Temperature,
    /// Speed, rpm or mm/min.
    Speed,
    /// Position, mm.
    Position,
    /// Displacement, µm.
    Displacement,
    /// Active Cz (compensation value) in a log of the gateway, µm.
    Compensation,
    /// Log column that contains only 0 and 1.
    Switch,
    /// Any other log column of numbers.
    Other,
}

/// Function that guesses the kind of a column from its name and from its values in one file.
pub(super) type KindOf<'a> = &'a dyn Fn(&str, &Series) -> Kind;

impl Kind {
    /// Guesses the kind of a column from its unit in the profile. Without a unit, the end of the name decides, then the
    /// values.
    pub fn guess(name: &str, unit: Option<&str>, values: impl Iterator<Item = f64> + Clone) -> Kind {
        if let Some(kind) = Kind::of_name(name, unit) {
            return kind;
        }
        let name = name.to_ascii_lowercase();
        let numbers = || values.clone().filter(|value| value.is_finite());
        if numbers().all(|value| value.abs() < 1e-12 || (value - 1.0).abs() < 1e-12) {
            return Kind::Switch;
        }
        let is_named = ["t", "temp", "temperature"].iter().any(|word| {
            name.strip_prefix(word).is_some_and(|rest| rest.bytes().all(|b| !b.is_ascii_alphabetic()))
        });
        // Range of the temperatures of a shop, its machine and its coolant. A column outside it is something else, or
        // in another unit. Some overloads of a logger do not make another quantity of a temperature.
        let (mut all, mut outside, mut is_plausible, mut is_of_any) = (0usize, 0usize, true, true);
        for value in numbers() {
            all += 1;
            if !(-40.0..=150.0).contains(&value) {
                outside += 1;
                is_plausible &= is_suspicious(Kind::Temperature, value);
                // The values of a speed are those that loggers write instead of any quantity.
                is_of_any &= is_suspicious(Kind::Speed, value);
            }
        }
        // Many overloads are refused by name, so the column must still be known as a temperature.
        let is_plausible = is_plausible && (20 * outside <= all || (is_of_any && 2 * outside < all));
        if is_named || is_plausible { Kind::Temperature } else { Kind::Other }
    }

    /// Returns the kind by the unit in the profile, or by the end of the name; `None` if only the values can show the
    /// kind.
    pub(crate) fn of_name(name: &str, unit: Option<&str>) -> Option<Kind> {
        if let Some(kind) = unit.and_then(of_unit) {
            return Some(kind);
        }
        let name = name.to_lowercase();
        // A slope has the kind `Other`, whatever its last word is.
        if name.contains("_per_") {
            return Some(Kind::Other);
        }
        let by_ending = name.rsplit('_').next().filter(|ending| ending.len() < name.len()).and_then(of_unit);
        by_ending.or_else(|| names_another_quantity(&name).then_some(Kind::Other))
    }
}

/// Values that loggers write instead of a measured value of any quantity. The same values with a minus sign also occur.
const OF_ANY: [f64; 19] = [
    999.0, 999.9, 999.99, 9999.0, 9999.9, 99_999.0, 888.8, 8888.0, 777.7, 327.67, 327.68, 3276.7, 3276.8,
    32_767.0, 32_768.0, 655.35, 6553.5, 65_535.0, 99_999.9,
];
/// Values that input modules and sensors output instead of a measured temperature, °C, for example if a wire is broken.
const OF_TEMPERATURES: [f64; 22] = [
    0.0, 85.0, 125.0, 127.0, -127.0, 128.0, 150.0, 400.0, 600.0, 650.0, 760.0, 800.0, 850.0, 988.79, 1000.0,
    1200.0, 1300.0, 1370.0, 1372.0, 1768.0, 1820.0, -242.02,
];
/// Lower limits of the measuring ranges of temperature sensors, °C. A sensor with a fault may output such a value.
const COLDEST: [f64; 5] = [-40.0, -50.0, -200.0, -270.0, -273.15];

/// Limit of an absolute value. No temperature, displacement or speed of a machine reaches this number, in its unit.
pub(super) const HUGE: f64 = 1e6;

/// Returns whether a logger or sensor may have output this number to report a fault, instead of a measured value of
/// this kind.
pub(super) fn is_suspicious(kind: Kind, value: f64) -> bool {
    let is = |known: &f64| (value - known).abs() < 0.004;
    let is_of_any = value.abs() >= HUGE || OF_ANY.iter().any(|known| is(known) || is(&-known));
    match kind {
        Kind::Temperature => is_of_any || OF_TEMPERATURES.iter().chain(&COLDEST).any(is),
        Kind::Displacement => is_of_any || is(&0.0),
        Kind::Speed => is_of_any,
        Kind::Position | Kind::Compensation | Kind::Switch | Kind::Other => false,
    }
}

/// Words in column names of other quantities. The values of such columns may look like temperatures.
const OTHER_QUANTITIES: [&str; 45] = [
    "humidity",
    "rh",
    "feuchte",
    "luftfeuchte",
    "pressure",
    "druck",
    "oeldruck",
    "flow",
    "durchfluss",
    "power",
    "leistung",
    "load",
    "last",
    "current",
    "strom",
    "voltage",
    "spannung",
    "torque",
    "drehmoment",
    "vibration",
    "battery",
    "record",
    "luftfeuchtigkeit",
    "feuchtigkeit",
    "humidité",
    "humedad",
    "luftdruck",
    "öldruck",
    "hydraulikdruck",
    "pression",
    "presión",
    "volumenstrom",
    "füllstand",
    "débit",
    "caudal",
    "energy",
    "energie",
    "frequency",
    "frequenz",
    "conductivity",
    "leitfähigkeit",
    "weight",
    "gewicht",
    "batt",
    "rssi",
];
/// Whole column names of counters and of other quantities. The values of such columns may look like temperatures.
const OTHER_NAMES: [&str; 18] = [
    "scan", "index", "no", "no.", "nr", "nr.", "number", "nummer", "#", "id", "count", "counter", "zähler",
    "row", "zeile", "ms", "ph", "co2",
];

/// Returns whether a word of the column name means a quantity other than temperature, length or speed. If the name also
/// contains a word for a temperature, as in `power_supply_temp`, the result is `false`.
fn names_another_quantity(name: &str) -> bool {
    let words = || name.split(|letter: char| !letter.is_alphabetic());
    let is_temperature = words().any(|word| word.starts_with("temp"));
    OTHER_NAMES.contains(&name.trim())
        || (!is_temperature && words().any(|word| OTHER_QUANTITIES.contains(&word)))
}

fn of_unit(unit: &str) -> Option<Kind> {
    Some(match unit.to_ascii_lowercase().as_str() {
        "degc" | "c" | "k" | "celsius" => Kind::Temperature,
        "rpm" | "mm/min" | "m/s" | "hz" | "speed" => Kind::Speed,
        "mm" => Kind::Position,
        "um" | "µm" => Kind::Displacement,
        "bool" | "on" => Kind::Switch,
        "percent" | "%" | "l/min" | "bar" | "v" | "mv" | "a" | "ma" | "w" | "kw" | "n" | "nm" | "s"
        | "count" => Kind::Other,
        _ => return None,
    })
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        serde::Serialize::serialize(self, f)
    }
}
