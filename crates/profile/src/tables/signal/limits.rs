//! `range` and `max_rate` of a signal, and the default limits of a temperature for which the profile does not state
//! these keys.
//!
//! The value of an open or unsupplied sensor is often a number of the device, for example −3276.8 °C. If nothing
//! rejects such a value, an axis moves to its limit. Therefore every temperature has limits unless the profile removes
//! them:
//!
//! | temperature | `range` | `max_rate` |
//! |---|---|---|
//! | a model uses it | −40 to 200 °C | 5 °C/s |
//! | any other | not below absolute zero | none |
//! | `difference = true` | none | none |
//!
//! Default limits are stored separately from the limits that the profile states. A replay applies only the
//! limits of the profile. The log of an earlier version therefore gives the same decisions again.

use serde::{Deserialize, Serialize};

use super::unit::Unit;
use super::{RawSignal, Signal};
use crate::key_context::KeyContext;
use crate::schema_of::schema_of;

/// Largest plausible rate of change of a temperature that a model uses, in °C/s. The number is the same in K/s.
const DEFAULT_RATE: f64 = 5.0;

/// Value of the key `range`: two numbers, or "none".
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum RangeValue {
    Bounds([f64; 2]),
    Word(NoLimit),
}

/// Value of the key `max_rate`: a number, or "none".
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum RateValue {
    Number(f64),
    Word(NoLimit),
}

/// Word that removes a limit, including a limit of the template.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum NoLimit {
    None,
}

schema_of!(RangeValue as "PlausibleRange": { "anyOf": [
    { "type": "array", "items": { "type": "number" }, "minItems": 2, "maxItems": 2 },
    { "type": "string", "enum": ["none"] },
] });
schema_of!(RateValue as "PlausibleRate": { "anyOf": [{ "type": "number" }, { "type": "string", "enum": ["none"] }] });

impl RangeValue {
    /// Resolves the smallest and the largest value. `None` if the profile writes "none".
    pub(super) fn resolve(self, at: &KeyContext<'_>) -> Option<(f64, f64)> {
        let (low, high) = match self {
            RangeValue::Bounds([low, high]) => (low, high),
            RangeValue::Word(NoLimit::None) => return None,
        };
        if low >= high {
            let message = format!("the range {low} to {high} is empty");
            at.invalid(message, "write the smaller value first, as [-10.0, 80.0]");
        }
        Some((low, high))
    }
}

impl RateValue {
    /// Returns the number. `None` if the profile writes "none".
    pub(super) fn number(self) -> Option<f64> {
        match self {
            RateValue::Number(rate) => Some(rate),
            RateValue::Word(NoLimit::None) => None,
        }
    }
}

/// Plausible values of a temperature for which the profile and its template state no `range`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DefaultRange {
    /// A model uses the temperature: smallest and largest plausible value.
    Within(f64, f64),
    /// No model uses the temperature: absolute zero.
    NotBelow(f64),
}

impl DefaultRange {
    /// Returns the smallest and the largest plausible value. Infinity stands for no limit.
    pub fn bounds(self) -> (f64, f64) {
        match self {
            DefaultRange::Within(low, high) => (low, high),
            DefaultRange::NotBelow(low) => (low, f64::INFINITY),
        }
    }
}

/// Default limits of a temperature. They apply if the profile and its template state no limits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DefaultLimits {
    /// Plausible values. `None` if the profile or its template states a `range` or removes it. Also `None` if the
    /// signal is not a temperature, or is a difference of temperatures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<DefaultRange>,
    /// Largest plausible change per second. `None` under the same conditions as `range`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_rate: Option<f64>,
}

impl DefaultLimits {
    /// Returns whether the signal has no default range and no default rate.
    pub fn is_empty(&self) -> bool {
        self.range.is_none() && self.max_rate.is_none()
    }

    /// Describes the default limits as conditions under which a reading in this unit is rejected.
    pub fn conditions(&self, unit: Unit) -> Vec<String> {
        self.range_condition(unit).into_iter().chain(self.rate_condition(unit)).collect()
    }

    /// Describes the default range as a condition under which a reading in this unit is rejected. `None` if there is no
    /// default range.
    pub fn range_condition(&self, unit: Unit) -> Option<String> {
        self.range.map(|range| match range {
            DefaultRange::Within(low, high) => format!("outside {low} to {high} {unit}"),
            DefaultRange::NotBelow(low) => format!("below {low} {unit}"),
        })
    }

    /// Describes the default rate as a condition under which a reading in this unit is rejected. `None` if there is no
    /// default rate.
    pub fn rate_condition(&self, unit: Unit) -> Option<String> {
        self.max_rate.map(|rate| format!("faster than {rate} {unit} per second"))
    }
}

/// Temperature unit of a signal: °C or K.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Temperature {
    Celsius,
    Kelvin,
}

impl Temperature {
    fn of(unit: Unit) -> Option<Temperature> {
        match unit.0 {
            "degC" => Some(Temperature::Celsius),
            "K" => Some(Temperature::Kelvin),
            _ => None,
        }
    }

    /// Returns the default range of a temperature that a model uses: −40 to 200 °C.
    fn usual(self) -> DefaultRange {
        match self {
            Temperature::Celsius => DefaultRange::Within(-40.0, 200.0),
            Temperature::Kelvin => DefaultRange::Within(233.15, 473.15),
        }
    }

    /// Returns the default range of a temperature that no model uses: not below absolute zero.
    fn physical(self) -> DefaultRange {
        DefaultRange::NotBelow(match self {
            Temperature::Celsius => -273.15,
            Temperature::Kelvin => 0.0,
        })
    }
}

impl RawSignal {
    /// Returns whether the profile marks the signal as a difference of two temperatures.
    pub(crate) fn is_marked_difference(&self) -> bool {
        self.difference.unwrap_or(false)
    }

    /// Resolves the key `difference`: whether the signal is a difference of two temperatures. Reports the key
    /// at a signal with another unit than °C or K.
    pub(super) fn is_difference(&self, at: &KeyContext<'_>, unit: Option<Unit>) -> bool {
        let is_difference = self.is_marked_difference();
        if let Some(unit) = unit.filter(|unit| is_difference && Temperature::of(*unit).is_none()) {
            let message = format!("a value in \"{}\" is not a difference of temperatures", unit.0);
            at.invalid(message, "remove `difference`: it is only for a signal in \"degC\" or \"K\"");
        }
        is_difference
    }

    /// Returns the default limits of a signal, which apply if the profile states none. `is_used` says whether a model
    /// uses the signal.
    pub(in crate::tables) fn defaults(&self, signal: &Signal, is_used: bool) -> DefaultLimits {
        let Some(temperature) = Temperature::of(signal.unit).filter(|_| !signal.is_difference) else {
            return DefaultLimits::default();
        };
        let range = if is_used { temperature.usual() } else { temperature.physical() };
        let has_rate = is_used && self.max_rate.is_none() && self.counter.is_none();
        DefaultLimits {
            range: self.range.is_none().then_some(range),
            max_rate: has_rate.then_some(DEFAULT_RATE),
        }
    }
}
