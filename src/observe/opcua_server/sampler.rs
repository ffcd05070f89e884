//! Values of the variables at one moment: value, quality and source time, from the status of the gateway.

use std::time::Duration;

use serde::Serialize;
use serde_json::Value as Json;

use super::catalogue::Kind;
use super::tree::{List, Records, Source, Variable};
use crate::observe::events::{Alarm, Entry};
use crate::observe::status::{AxisStatus, DeviceStatus, OutputStatus, SignalStatus, Status};
use isotherm_core::quantity::{Moment, time};

/// Maximum number of entries in an array of records. If there are more records, the newest are shown.
const MOST_RECORDS: usize = 50;
/// Kinds of outputs whose register value is Cz.
const CZ_OUTPUTS: [&str; 2] = ["offset", "intercept"];

/// Value of a variable, as the status contains it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// The status has no value for the variable.
    Null,
    Number(f64),
    Count(u64),
    Flag(bool),
    Text(String),
    Texts(Vec<String>),
}

/// Quality of a value, from which the OPC UA status code is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quality {
    /// The value may be used.
    Good,
    /// The value was valid when it was last read. Its register is not read now, or the last write to it failed.
    LastUsable,
    /// The value was valid when it was last read. The device does not answer now.
    LastUsableNoAnswer,
    /// The status has no value for this field at present. This is not a fault.
    NoData,
    /// The signal or the register has not been read yet.
    Waiting,
    /// The device does not answer, or its last value is too old.
    NoCommunication,
    /// The sensor has a fault, or its value is not a measurement.
    SensorFailure,
    /// The value, or its change, is outside its limits.
    OutOfRange,
    /// The channel of the sensor is switched off.
    OutOfService,
    /// The profile does not fit the device or the signal, for example in its data type.
    Configuration,
    /// The device refuses the value, or sends an unexpected value.
    DeviceFailure,
}

/// Value of a variable with its quality and its time.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sample {
    pub(super) value: Value,
    pub(super) quality: Quality,
    /// Time of the measurement. For values that are not measured, the time at which the value changed.
    pub(super) at: Moment,
}

/// Sampler of the variables, with the last sample of each variable.
#[derive(Debug, Default)]
pub(super) struct Sampler {
    last: Vec<Sample>,
}

/// Parts of the status: the fields of the machine as JSON, and each list.
struct Lists {
    machine: Json,
    axes: Vec<AxisStatus>,
    signals: Vec<SignalStatus>,
    outputs: Vec<OutputStatus>,
    devices: Vec<DeviceStatus>,
    alarms: Vec<Alarm>,
    events: Vec<Entry>,
}

/// List item that was converted to JSON last. It is kept because consecutive variables belong to the same item.
#[derive(Default)]
struct Item {
    of: Option<(List, usize)>,
    json: Json,
}

impl Quality {
    /// Returns the quality for the quality code of a signal in the status, for example `stale`.
    fn of_code(code: &str) -> Quality {
        match code {
            "good" => Quality::Good,
            "never-read" => Quality::Waiting,
            "stale" | "timeout" | "link-down" | "bad-reply" => Quality::NoCommunication,
            "sentinel" | "open-circuit" | "short-circuit" | "sensor-fault" | "not-a-number" | "checksum"
            | "power-on-value" | "all-zero" | "fault-bit" => Quality::SensorFailure,
            "above-range" | "below-range" | "out-of-range" | "too-fast" | "jumped" | "scale-changed" => {
                Quality::OutOfRange
            }
            "switched-off" => Quality::OutOfService,
            "wrong-type" | "no-number" | "no-element" | "no-scale" | "not-found" | "several-found"
            | "not-as-expected" => Quality::Configuration,
            _ => Quality::DeviceFailure,
        }
    }

    /// Returns the quality of a register value, from the state of its output and the state of the device.
    fn of_register(value: Option<f64>, output: &str, device: &str) -> Quality {
        match (value, output, device) {
            // The last run may have left the value of a register that cannot be read.
            (Some(_), _, "lost" | "never-answered") => Quality::LastUsableNoAnswer,
            (Some(_), _, "not-as-expected") | (Some(_), "unverified" | "interlocked", _) => {
                Quality::LastUsable
            }
            (Some(_), ..) => Quality::Good,
            (None, output, "ok") if output != "unknown" => Quality::NoData,
            (None, ..) => Quality::Waiting,
        }
    }
}

impl Lists {
    fn of(mut status: Status) -> Lists {
        let (axes, signals) = (std::mem::take(&mut status.axes), std::mem::take(&mut status.signals));
        let (outputs, devices) = (std::mem::take(&mut status.outputs), std::mem::take(&mut status.devices));
        let (alarms, events) = (std::mem::take(&mut status.alarms), std::mem::take(&mut status.events));
        status.buses.clear();
        status.event_counts.clear();
        Lists { machine: json(&status), axes, signals, outputs, devices, alarms, events }
    }

    fn item(&self, list: List, place: usize) -> Json {
        match list {
            List::Axes => json(&self.axes.get(place)),
            List::Signals => json(&self.signals.get(place)),
            List::Outputs => json(&self.outputs.get(place)),
            List::Devices => json(&self.devices.get(place)),
        }
    }

    fn records(&self, records: Records) -> Vec<Json> {
        match records {
            Records::Alarms => self.alarms.iter().take(MOST_RECORDS).map(json).collect(),
            Records::Events => self.events.iter().rev().take(MOST_RECORDS).map(json).collect(),
        }
    }

    /// Returns the quality of a field, and its age in seconds. `None` for a field that the gateway does not measure.
    fn quality_and_age(
        &self,
        (list, place, path): (List, usize, &[&str]),
        (item, value): (&Json, &Value),
    ) -> (Option<Quality>, Option<f64>) {
        let age = |name: &str| item.get(name).and_then(Json::as_f64);
        let of_output = || self.outputs.get(place).map(|output| self.quality_of_output(output));
        match (list, path) {
            (List::Signals, ["value"]) => {
                let code = item.get("quality").and_then(Json::as_str);
                (code.map(Quality::of_code), age("age_s"))
            }
            (List::Axes, ["verified_um"]) => (self.quality_of_verified(place), age("verified_age_s")),
            (List::Outputs, ["value"]) => (of_output(), age("age_s")),
            (List::Outputs, ["applied"] | ["shares", _]) if *value != Value::Null => {
                (of_output(), age("age_s"))
            }
            _ => (None, None),
        }
    }

    fn quality_of_output(&self, output: &OutputStatus) -> Quality {
        let device = self.devices.iter().find(|device| device.name == output.device);
        Quality::of_register(output.value, output.state, device.map_or("ok", |device| device.state))
    }

    /// Returns the quality of the verified Cz of an axis. This is the quality of the output from which the Cz was read:
    /// the first output with a value. `None` if no output of the axis contains Cz.
    fn quality_of_verified(&self, place: usize) -> Option<Quality> {
        let axis = self.axes.get(place)?;
        let is_cz = |output: &&OutputStatus| output.axis == axis.name && CZ_OUTPUTS.contains(&output.writes);
        let is_known = |output: &&OutputStatus| is_cz(output) && output.value.is_some();
        let known = self.outputs.iter().find(is_known);
        known.or_else(|| self.outputs.iter().find(is_cz)).map(|output| self.quality_of_output(output))
    }
}

/// Converts a part of the status to JSON. This cannot fail, because numbers and texts always have a JSON form.
fn json(part: &impl Serialize) -> Json {
    serde_json::to_value(part).unwrap_or_default()
}

impl Sampler {
    /// Takes a sample of all variables. Returns the indices of the variables whose sample has changed.
    pub(super) fn refresh(&mut self, variables: &[Variable], status: Status) -> Vec<usize> {
        let now = time::parse(&status.now).unwrap_or_default();
        let lists = Lists::of(status);
        let records = [lists.records(Records::Alarms), lists.records(Records::Events)];
        let (mut item, mut changed) = (Item::default(), Vec::new());
        for (place, variable) in variables.iter().enumerate() {
            let (value, quality, age) = match &variable.source {
                Source::Nameplate(text) => (Value::Text(text.clone()), None, None),
                Source::Machine(name) => (value(variable.kind, lists.machine.get(*name)), None, None),
                Source::Total(of) => (Value::Count(count(&records[of.place()])), None, None),
                Source::Column(of, name) => (column(&records[of.place()], name), None, None),
                Source::Item(list, of, path) => {
                    if item.of != Some((*list, *of)) {
                        item = Item { of: Some((*list, *of)), json: lists.item(*list, *of) };
                    }
                    let found = path.iter().try_fold(&item.json, |json, name| json.get(*name));
                    let value = value(variable.kind, found);
                    let field = (*list, *of, path.as_slice());
                    let (quality, age) = lists.quality_and_age(field, (&item.json, &value));
                    (value, quality, age)
                }
            };
            let empty = if value == Value::Null { Quality::NoData } else { Quality::Good };
            let quality = quality.unwrap_or(empty);
            let last = self.last.get(place);
            let is_same = |last: &&Sample| last.value == value && last.quality == quality;
            let since = last.filter(is_same).map_or(now, |last| last.at);
            let sample = Sample { at: age.map_or(since, |age| before(now, age)), value, quality };
            if last == Some(&sample) {
                continue;
            }
            changed.push(place);
            match self.last.get_mut(place) {
                Some(last) => *last = sample,
                None => self.last.push(sample),
            }
        }
        changed
    }

    /// Returns the last sample of the variable with the index `place`; `None` before the first sample.
    pub(super) fn sample(&self, place: usize) -> Option<&Sample> {
        self.last.get(place)
    }
}

impl Records {
    fn place(self) -> usize {
        match self {
            Records::Alarms => 0,
            Records::Events => 1,
        }
    }
}

/// Returns the time `age_s` seconds before `now`, rounded to whole milliseconds. Without the rounding, small errors
/// would look like changes.
fn before(now: Moment, age_s: f64) -> Moment {
    const MS: u64 = 1_000_000;
    let at = now.before(Duration::try_from_secs_f64(age_s).unwrap_or_default());
    Moment::from_nanos((at.as_nanos() + MS / 2) / MS * MS)
}

fn value(kind: Kind, json: Option<&Json>) -> Value {
    let Some(json) = json else { return Value::Null };
    let found = match kind {
        Kind::Number => json.as_f64().map(Value::Number),
        Kind::Count => json.as_u64().map(Value::Count),
        Kind::Flag => json.as_bool().map(Value::Flag),
        Kind::Text => json.as_str().map(|text| Value::Text(text.to_owned())),
        Kind::Texts => json.as_array().map(|list| Value::Texts(list.iter().map(text).collect())),
        Kind::Object(_) => None,
    };
    found.unwrap_or(Value::Null)
}

fn column(records: &[Json], name: &str) -> Value {
    Value::Texts(records.iter().map(|record| record.get(name).map(text).unwrap_or_default()).collect())
}

fn count(records: &[Json]) -> u64 {
    u64::try_from(records.len()).unwrap_or(u64::MAX)
}

fn text(json: &Json) -> String {
    json.as_str().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests;
