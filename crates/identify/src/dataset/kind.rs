//! Kinds of log columns: temperature, speed, position and others.

use std::fmt;

/// Guessed kind of a log column of numbers.
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
    /// Active Cz in a log of the gateway, µm.
    Compensation,
    /// Log column that contains only 0 and 1.
    Switch,
    /// Log column of numbers of no other kind.
    Other,
}

impl Kind {
    /// Guesses the kind by the unit in the profile, then by the ending of the name, then by the values.
    pub fn guess<'a>(
        name: &str,
        unit: Option<&str>,
        values: impl Iterator<Item = &'a [f64]> + Clone,
    ) -> Kind {
        if let Some(kind) = Kind::of_name(name, unit) {
            return kind;
        }
        let name = name.to_ascii_lowercase();
        let numbers = || values.clone().flatten().copied().filter(|value| value.is_finite());
        if numbers().all(|value| value.abs() < 1e-12 || (value - 1.0).abs() < 1e-12) {
            return Kind::Switch;
        }
        let is_named = ["t", "temp", "temperature"].iter().any(|word| {
            name.strip_prefix(word).is_some_and(|rest| rest.bytes().all(|b| !b.is_ascii_alphabetic()))
        });
        // Range of the temperatures of a shop, its machine and its coolant. A column outside it is something else, or
        // in another unit.
        let is_plausible = numbers().all(|value| (-40.0..=150.0).contains(&value));
        if is_named || is_plausible { Kind::Temperature } else { Kind::Other }
    }

    /// Returns the kind by the unit in the profile, or by the ending of the name; `None` if only the values can decide.
    pub(crate) fn of_name(name: &str, unit: Option<&str>) -> Option<Kind> {
        if let Some(kind) = unit.and_then(of_unit) {
            return Some(kind);
        }
        let name = name.to_ascii_lowercase();
        // A slope has the kind `Other`, whatever its last word is.
        if name.contains("_per_") {
            return Some(Kind::Other);
        }
        name.rsplit('_').next().filter(|ending| ending.len() < name.len()).and_then(of_unit)
    }
}

fn of_unit(unit: &str) -> Option<Kind> {
    Some(match unit.to_ascii_lowercase().as_str() {
        "degc" | "c" | "k" | "celsius" => Kind::Temperature,
        "rpm" | "mm/min" | "m/s" | "hz" | "speed" => Kind::Speed,
        "mm" => Kind::Position,
        "um" | "µm" => Kind::Displacement,
        "bool" | "on" => Kind::Switch,
        "percent" | "l/min" | "bar" | "v" | "mv" | "a" | "ma" | "w" | "kw" | "n" | "nm" | "s" | "count" => {
            Kind::Other
        }
        _ => return None,
    })
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        serde::Serialize::serialize(self, f)
    }
}
