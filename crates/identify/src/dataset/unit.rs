//! Units that a log states in its header or in its cells, and the conversion to the units of the program.

/// Conversion of the values of a column to °C, µm or the unit of the column.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Conversion {
    /// The values are used as they are.
    #[default]
    Same,
    /// From °F to °C.
    Fahrenheit,
    /// From K to °C. Values below [`LEAST_ABSOLUTE`] are differences, which are the same in both.
    Kelvin,
    /// Multiplication by a factor.
    Factor(f64),
}

/// Smallest absolute temperature of a machine, K. No difference of temperatures is as large.
const LEAST_ABSOLUTE: f64 = 150.0;

impl Conversion {
    /// Returns the conversion of a value with this unit in a column of this name.
    pub(super) fn of(name: &str, unit: &str) -> Conversion {
        let is_in_um = name.to_ascii_lowercase().ends_with("_um");
        match unit.to_lowercase().as_str() {
            "°f" | "℉" | "f" | "degf" | "deg f" | "fahrenheit" => Conversion::Fahrenheit,
            "k" | "kelvin" => Conversion::Kelvin,
            "mm" if is_in_um => Conversion::Factor(1000.0),
            "nm" if is_in_um => Conversion::Factor(0.001),
            _ => Conversion::Same,
        }
    }

    /// Converts a value.
    pub(super) fn apply(self, value: f64) -> f64 {
        match self {
            Conversion::Fahrenheit => (value - 32.0) / 1.8,
            Conversion::Kelvin if value > LEAST_ABSOLUTE => value - 273.15,
            Conversion::Same | Conversion::Kelvin => value,
            Conversion::Factor(factor) => value * factor,
        }
    }
}

/// Returns the unit of a column in the words of a profile, after the conversion of its values; `None` if the unit is not
/// known.
pub(super) fn of_profile(name: &str, unit: &str) -> Option<&'static str> {
    if let Conversion::Factor(_) = Conversion::of(name, unit) {
        return Some("um");
    }
    Some(match unit.to_lowercase().as_str() {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_converted_to_the_units_of_the_program() {
        for (name, unit, value, converted) in [
            ("bed", "°F", 68.0, 20.0),
            ("bed", "degF", 212.0, 100.0),
            ("bed", "K", 293.15, 20.0),
            ("rise", "K", 3.5, 3.5),
            ("bed", "°C", 20.0, 20.0),
            ("z_error_um", "mm", 0.012, 12.0),
            ("z_error_um", "µm", 12.0, 12.0),
            ("scale", "mm", 300.0, 300.0),
        ] {
            let found = Conversion::of(name, unit).apply(value);
            assert!((found - converted).abs() < 1e-9, "{name} {unit}: {found}");
        }
    }
}
