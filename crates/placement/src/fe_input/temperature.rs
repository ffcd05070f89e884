//! Scale of the temperatures of a load case: °C or kelvin. A file does not state the scale. The first initial
//! temperature determines the scale.

use super::Fault;
use super::card::Line;

/// Scale of all temperatures of a file: °C or kelvin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    Celsius,
    Kelvin,
}

/// Plausible temperatures of a machine and its fluids, °C. A gateway rejects readings outside this range too.
const PLAUSIBLE: std::ops::RangeInclusive<f64> = -40.0..=200.0;
/// Temperature of 0 °C in kelvin.
const ZERO_CELSIUS: f64 = 273.15;

impl Scale {
    /// Returns the only scale in which this temperature is plausible; `None` if it is plausible in neither scale.
    fn of(temperature: f64) -> Option<Self> {
        [Self::Celsius, Self::Kelvin]
            .into_iter()
            .find(|scale| PLAUSIBLE.contains(&scale.celsius(temperature)))
    }

    /// Converts a temperature in this scale to °C.
    fn celsius(self, temperature: f64) -> f64 {
        match self {
            Self::Celsius => temperature,
            Self::Kelvin => temperature - ZERO_CELSIUS,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Celsius => "°C",
            Self::Kelvin => "kelvin",
        }
    }
}

/// Parses an initial temperature from the value at index `place`, and returns it in °C. The first initial temperature
/// determines the scale of the file.
pub(super) fn initial(scale: &mut Option<Scale>, line: &Line, place: usize) -> Result<f64, Fault> {
    let name = "temperature";
    let temperature = line.number(place, name)?;
    match (Scale::of(temperature), *scale) {
        (Some(found), None) => *scale = Some(found),
        (None, None) => return Err(line.fault(implausible(name, temperature))),
        _ => {}
    }
    of_load(*scale, line, place, name)
}

/// Parses the temperature of a load from the value at index `place`, and returns it in °C. `scale` is the scale of the
/// initial temperatures. It is `None` if the file has no initial temperatures, which is reported as a separate error.
pub(super) fn of_load(scale: Option<Scale>, line: &Line, place: usize, name: &str) -> Result<f64, Fault> {
    let temperature = line.number(place, name)?;
    let scale = match (scale, Scale::of(temperature)) {
        (None, _) => return Ok(temperature),
        (Some(scale), Some(found)) if scale == found => scale,
        (Some(scale), Some(found)) => {
            return Err(line.fault(format!(
                "the {name} is {temperature}, which is plausible in {} only. The initial temperatures of the file \
                 are in {}: write all temperatures in one of them",
                found.name(),
                scale.name()
            )));
        }
        (Some(_), None) => return Err(line.fault(implausible(name, temperature))),
    };
    Ok(scale.celsius(temperature))
}

fn implausible(name: &str, temperature: f64) -> String {
    let (low, high) = (*PLAUSIBLE.start(), *PLAUSIBLE.end());
    format!(
        "the {name} is {temperature}, which no machine has in °C ({low} to {high} °C) or in kelvin ({:.0} to {:.0} K): \
         correct it",
        low + ZERO_CELSIUS,
        high + ZERO_CELSIUS
    )
}
