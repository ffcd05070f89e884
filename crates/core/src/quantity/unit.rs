//! Units that a log states in its header or in its cells, and the conversion to the units of the program.

use std::collections::HashMap;

use super::cell::{name_and_unit, spelled};

/// Conversion of the values of a log column to °C, µm or the unit of the column.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Conversion {
    /// The values are used as they are.
    #[default]
    Same,
    /// From °F to °C.
    Fahrenheit,
    /// From K to °C. Values up to 150 K are differences, which are the same in both units.
    Kelvin,
    /// Multiplication by a factor: mm to µm, or m/min to mm/min.
    Factor(f64),
}

/// Smallest absolute temperature of a machine, K. No difference of temperatures is as large.
const LEAST_ABSOLUTE: f64 = 150.0;

impl Conversion {
    /// Returns the conversion of a value with this unit in a column of this name.
    #[must_use]
    pub fn of(name: &str, unit: &str) -> Conversion {
        let is_in_um = name.to_ascii_lowercase().ends_with("_um");
        match spelled(unit).as_str() {
            "°f" | "℉" | "f" | "degf" | "deg f" | "fahrenheit" => Conversion::Fahrenheit,
            "k" | "kelvin" => Conversion::Kelvin,
            "mm" if is_in_um => Conversion::Factor(1000.0),
            "nm" if is_in_um => Conversion::Factor(0.001),
            "m/min" => Conversion::Factor(1000.0),
            _ => Conversion::Same,
        }
    }

    /// Converts a value of the log to the unit of the program.
    #[must_use]
    pub fn apply(self, value: f64) -> f64 {
        match self {
            Conversion::Fahrenheit => (value - 32.0) / 1.8,
            Conversion::Kelvin if value > LEAST_ABSOLUTE => value - 273.15,
            Conversion::Same | Conversion::Kelvin => value,
            Conversion::Factor(factor) => value * factor,
        }
    }

    /// Reverses [`Conversion::apply`]: returns the value in the log that was converted to `value`, rounded to
    /// nine significant digits.
    #[must_use]
    pub fn revert(self, value: f64) -> f64 {
        let logged = match self {
            Conversion::Fahrenheit => value * 1.8 + 32.0,
            Conversion::Kelvin if value + 273.15 > LEAST_ABSOLUTE => value + 273.15,
            Conversion::Factor(factor) => value / factor,
            Conversion::Same | Conversion::Kelvin => return value,
        };
        // The conversion and its inverse are not exact.
        format!("{logged:.8e}").parse().unwrap_or(logged)
    }
}

/// Returns the name of each column without the unit in its header, and the unit. A name keeps its unit if the name
/// without the unit would not be unique.
#[must_use]
pub fn names_and_units(headers: &[String]) -> Vec<(String, String)> {
    let mut alike: HashMap<&str, usize> = HashMap::new();
    for header in headers {
        *alike.entry(name_and_unit(header).0).or_default() += 1;
    }
    let without = |header: &String| {
        let (name, unit) = name_and_unit(header);
        let name = if alike.get(name) == Some(&1) { name } else { header.as_str() };
        (name.to_owned(), unit.unwrap_or_default().to_owned())
    };
    headers.iter().map(without).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_converted_to_the_units_of_the_program_and_back() {
        for (name, unit, value, converted) in [
            ("bed", "°F", 68.0, 20.0),
            ("bed", "degF", 212.0, 100.0),
            ("bed", "ºF", 212.0, 100.0),
            ("bed", "Deg. F", 68.0, 20.0),
            ("bed", "°F", -9999.0, -5_572.777_777_777_778),
            ("bed", "K", 293.15, 20.0),
            ("bed", "°C", 20.0, 20.0),
            ("z_error_um", "mm", 0.012, 12.0),
            ("z_error_um", "µm", 12.0, 12.0),
            ("scale", "mm", 300.0, 300.0),
        ] {
            let conversion = Conversion::of(name, unit);
            let found = conversion.apply(value);
            assert!((found - converted).abs() < 1e-9, "{name} {unit}: {found}");
            assert_eq!(conversion.revert(found).to_string(), value.to_string(), "{name} {unit}");
        }
        let rise = Conversion::of("rise", "K").apply(3.5);
        assert!((rise - 3.5).abs() < 1e-9, "a difference is the same in K and in °C: {rise}");
    }

    #[test]
    fn a_unit_in_the_header_is_no_part_of_the_name_unless_two_columns_differ_by_it() {
        let headers = ["time", "bed [°C]", "air [°C]", "air [%]"].map(str::to_owned);
        let found = names_and_units(&headers);
        let found: Vec<(&str, &str)> =
            found.iter().map(|(name, unit)| (name.as_str(), unit.as_str())).collect();
        assert_eq!(found, [("time", ""), ("bed", "°C"), ("air [°C]", "°C"), ("air [%]", "%")]);
    }
}
