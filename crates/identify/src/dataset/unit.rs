//! Units that a log states, converted to the unit names of a profile.

use isotherm_core::quantity::{Conversion, spelled};

/// Returns the profile name of the unit into which the values of a column are converted; `None` if the unit of the
/// column is not known.
pub(super) fn of_profile(name: &str, unit: &str) -> Option<&'static str> {
    let is_in_um = name.to_ascii_lowercase().ends_with("_um");
    Some(match spelled(unit).as_str() {
        "mm" | "nm" if is_in_um => "um",
        "°c" | "℃" | "degc" | "deg c" | "c" | "celsius" | "°f" | "℉" | "degf" | "deg f" | "f"
        | "fahrenheit" | "k" | "kelvin" => "degC",
        "µm" | "μm" | "um" => "um",
        "mm" => "mm",
        "rpm" | "1/min" | "u/min" | "min-1" | "r/min" => "rpm",
        "mm/min" | "m/min" => "mm/min",
        "m/s" => "m/s",
        "hz" => "Hz",
        unit if isotherm_core::quantity::is_unit(unit) => "percent",
        _ => return None,
    })
}

/// Returns whether `unit` and `other` are two spellings of the same unit. The cells of the column `name` may
/// then use both spellings.
pub(super) fn are_alike(name: &str, unit: &str, other: &str) -> bool {
    // All units of other quantities have one word.
    let word = of_profile(name, unit).filter(|word| *word != "percent");
    let is_known = word.is_some() && of_profile(name, other) == word;
    (is_known && Conversion::of(name, unit) == Conversion::of(name, other)) || spelled(unit) == spelled(other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_one_column_may_differ_in_spelling_only() {
        for (unit, other) in [("°C", "degC"), ("°C", "ºC"), ("µm", "um"), ("1/min", "rpm"), ("Bar", "bar")]
        {
            assert!(are_alike("a", unit, other), "{unit} {other}");
        }
        for (unit, other) in [("°C", "°F"), ("µm", "mm"), ("m/min", "mm/min"), ("bar", "mbar"), ("°C", "K")]
        {
            assert!(!are_alike("a", unit, other), "{unit} {other}");
        }
    }
}
