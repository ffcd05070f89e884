//! `stand_ins` of a model: relations between sensors, for detecting a frozen sensor and replacing a lost one.
//!
//! ```json
//! { "format": "isotherm-stand-ins", "version": 1, "sensors": [
//!   { "signal": "bed", "threshold": 0.31, "stands_in": true,
//!     "terms": [{ "signal": "column", "lag_s": 0, "gain": 0.42 }, …] }, … ] }
//! ```
//! The expected rise of a sensor since machine start is the sum of its terms. A term is a gain (°C/°C) times the lagged
//! rise of another sensor. A sensor is frozen if this sum changes by more than `threshold` (°C) while the reading of
//! the sensor stays the same.

use std::time::Duration;

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::file::{bytes, read, taken};
use super::inputs::LONGEST_LAG;
use super::seals::RawSeals;
use crate::error::allowed;
use crate::tables::KeyContext;
use crate::tables::signal::Signal;
use crate::wording::counted;
use isotherm_core::compensation::model::StandIns;
use isotherm_core::compensation::model::stand_ins::{Described, Replaces};
use isotherm_core::reading::SignalId;

/// Largest number of sensors in a file and of terms per sensor. The gateway calculates all terms at the end of each
/// minute, so the limits bound the duration of this calculation.
const MOST_SENSORS: usize = 128;
const MOST_TERMS: usize = 1024;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StandInsFile {
    #[serde(rename = "format")]
    _format: IgnoredAny,
    #[serde(rename = "version")]
    _version: IgnoredAny,
    sensors: Vec<SensorOfFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SensorOfFile {
    signal: String,
    threshold: f64,
    stands_in: bool,
    terms: Vec<TermOfFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TermOfFile {
    signal: String,
    lag_s: f64,
    gain: f64,
}

/// Resolves the relations between sensors in the file with this name.
pub(super) fn resolve(seals: Option<&RawSeals>, at: &KeyContext<'_>, name: &str) -> Option<StandIns> {
    let bytes = bytes(seals, "stand_ins", at, name)?;
    let file: StandInsFile = taken(at, name, read(&bytes, "isotherm-stand-ins"))?;
    let described = taken(at, name, file.described(&at.report.signals))?;
    for sensor in &described {
        doubt(at, name, sensor.signal);
        let predictors = sensor.terms.iter().map(|(input, _)| input.signal);
        predictors.chain([sensor.signal]).for_each(|id| at.uses(id));
    }
    Some(StandIns::new(described, fingerprint(&bytes)))
}

/// Warns about a sensor that is not a temperature, because a constant reading of another quantity does not show a
/// fault.
fn doubt(at: &KeyContext<'_>, file: &str, id: SignalId) {
    let Some(unit) = at.unit_of(id) else { return };
    if !matches!(unit.0, "degC" | "K") {
        let name = &at.report.signals[id.0];
        at.warn(
            format!(
                "{file}: {name} is checked for a frozen reading, but is not a temperature (its unit is {unit})"
            ),
            format!(
                "set the unit of the signal if it is a temperature, or remove {name} from the sensors of the \
                 file"
            ),
        );
    }
}

impl StandInsFile {
    fn described(&self, names: &[String]) -> Result<Vec<Described>, String> {
        if self.sensors.is_empty() || self.sensors.len() > MOST_SENSORS {
            return Err(format!(
                "the file has {} sensors; 1 to {MOST_SENSORS} are allowed",
                self.sensors.len()
            ));
        }
        for (place, sensor) in self.sensors.iter().enumerate() {
            if self.sensors.iter().take(place).any(|other| other.signal == sensor.signal) {
                return Err(format!("sensor {} is listed twice: remove one of the two", sensor.signal));
            }
        }
        self.sensors.iter().map(|sensor| sensor.described(names)).collect()
    }
}

impl SensorOfFile {
    fn described(&self, names: &[String]) -> Result<Described, String> {
        let (own, count) = (&self.signal, self.terms.len());
        let signal = place(own, names)?;
        if !(self.threshold > 0.0 && self.threshold.is_finite()) {
            return Err(format!("{own}: the threshold must be above 0 °C"));
        }
        if count == 0 || count > MOST_TERMS {
            return Err(format!("{own}: this sensor has {count} terms; 1 to {MOST_TERMS} are allowed"));
        }
        let term = |term: &TermOfFile| {
            if term.signal == *own {
                return Err(format!("{own}: a sensor cannot replace itself"));
            }
            if !(0.0..=LONGEST_LAG.as_secs_f64()).contains(&term.lag_s) {
                return Err(format!("{own}: a lag of {} s is not between 0 and a week", term.lag_s));
            }
            let lag = Duration::from_secs_f64(term.lag_s);
            Ok(Described::term(place(&term.signal, names)?, (!lag.is_zero()).then_some(lag), term.gain))
        };
        let terms = self.terms.iter().map(term).collect::<Result<_, String>>()?;
        Ok(Described { signal, threshold: self.threshold, stands_in: self.stands_in, terms })
    }
}

fn place(name: &str, names: &[String]) -> Result<SignalId, String> {
    let found = names.iter().position(|known| known == name).map(SignalId);
    found.ok_or_else(|| {
        format!("the profile has no signal `{name}`; {}", allowed(name, names.iter().map(String::as_str)))
    })
}

/// Returns a hash by which different files are distinguished (FNV-1a with 64 bits, by Fowler, Noll and Vo).
fn fingerprint(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Describes which sensors are monitored for frozen readings, and which of them can be replaced by a calculation from
/// other sensors.
pub(super) fn preview(signals: &[Signal], stand_ins: &StandIns) -> String {
    let count = stand_ins.watched().count();
    let are = if count == 1 { "is" } else { "are" };
    let mut text = format!("{} {are} checked for frozen readings", counted(count, "sensor"));
    let groups = [
        (Replaces::FrozenOrLost, "replaced by other sensors if frozen or lost:"),
        (Replaces::Frozen, "replaced by other sensors if frozen, but not if lost:"),
        (Replaces::Nothing, "not replaced by other sensors:"),
    ];
    for (wanted, words) in groups {
        let found = stand_ins.watched().filter(|(_, replaces)| *replaces == wanted);
        let names: Vec<&str> = found.map(|(signal, _)| signals[signal.0].name.as_str()).collect();
        if !names.is_empty() {
            text += &format!("; {words} {}", names.join(", "));
        }
    }
    text
}
