//! What a column seems to be.

use std::fmt;

/// What a column of numbers seems to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// °C.
    Temperature,
    /// rpm, mm/min.
    Speed,
    /// mm.
    Position,
    /// µm.
    Displacement,
    /// The Cz that acted, µm, as the gateway logged it.
    Compensation,
    /// Nothing but 0 and 1.
    Switch,
    /// None of these.
    Other,
}

impl Kind {
    /// By the unit that a profile knows, else by the name's ending, else by the values.
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
        // A shop, its machine and its coolant; a column that leaves this is something else, or in another unit.
        let is_plausible = numbers().all(|value| (-40.0..=150.0).contains(&value));
        if is_named || is_plausible { Kind::Temperature } else { Kind::Other }
    }

    /// By the unit that a profile knows, or by the name's ending, which leave some to their values.
    pub(crate) fn of_name(name: &str, unit: Option<&str>) -> Option<Kind> {
        if let Some(kind) = unit.and_then(of_unit) {
            return Some(kind);
        }
        let name = name.to_ascii_lowercase();
        // A slope is none of these, whatever its last word.
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
