//! Metrics of a birth message: every name that later data may use, with its alias and type.

use std::collections::HashMap;

use isotherm_core::quantity::Moment;

use super::datum::{DataType, Datum};
use super::payload::{Metric, Property, PropertySet};
use crate::interface::{self, Snapshot, Subject, Value};

/// Name of the metric by which hosts request a birth message.
pub(super) const REBIRTH: &str = "Node Control/Rebirth";

/// Name of the metric with the death number, which is the same in a birth and in its death message.
pub(super) const BD_SEQ: &str = "bdSeq";

/// Name of the metric that publishes events.
pub(super) const EVENT: &str = "gateway/event";

/// Last part of the name of the metric by which hosts send the measured error of an axis: `axis/z/measured_error_um`.
const MEASURED: &str = "measured_error_um";

/// Codes of the property `Quality`: `BAD` if the value is unknown, and `GOOD` when the value is valid again.
pub(super) const BAD: i64 = 0;
pub(super) const GOOD: i64 = 192;

/// Metrics of a birth message, each with its alias, which later data messages use instead of the name.
#[derive(Debug, Default)]
pub(super) struct BirthMetrics {
    names: HashMap<String, MetricAlias>,
    /// Metric names; the first has the alias 1.
    aliases: Vec<String>,
}

#[derive(Clone, Copy, Debug)]
struct MetricAlias {
    alias: u64,
    kind: DataType,
}

impl BirthMetrics {
    /// Makes the metrics of a birth message from a snapshot. Returns the names with their aliases, and the metrics. The
    /// caller adds the death number.
    pub(super) fn of(snapshot: &Snapshot, now: Moment, takes_measured: bool) -> (BirthMetrics, Vec<Metric>) {
        let mut born = BirthMetrics::default();
        let mut metrics = vec![null(REBIRTH, DataType::Boolean, now)];
        if let Some(rebirth) = metrics.first_mut() {
            rebirth.is_null = None;
            rebirth.value = DataType::Boolean.write(&Datum::Flag(false));
        }
        for metric in &snapshot.metrics {
            let mut published = named(metric, now);
            if !metric.unit.is_empty() {
                add_property(
                    &mut published,
                    "engUnit",
                    DataType::String,
                    &Datum::Text(metric.unit.to_owned()),
                );
            }
            metrics.push(published);
        }
        metrics.push(null(EVENT, DataType::String, now));
        if takes_measured {
            let axes = axes(snapshot);
            metrics.extend(axes.iter().map(|axis| null(&measured(axis), DataType::Double, now)));
        }
        // The first metric requests a birth. It has no alias, because a host must be able to use it before it knows an
        // alias.
        for metric in metrics.iter_mut().skip(1) {
            metric.alias = born.promise(metric);
        }
        (born, metrics)
    }

    fn promise(&mut self, metric: &Metric) -> Option<u64> {
        let (name, kind) = (metric.name.clone()?, DataType::from_number(metric.datatype?)?);
        self.aliases.push(name.clone());
        let alias = u64::try_from(self.aliases.len()).ok()?;
        self.names.insert(name, MetricAlias { alias, kind });
        Some(alias)
    }

    /// Replaces the name of a metric by its alias, for data messages. Returns `None` if the birth does not contain the
    /// metric, or contains it with another type.
    pub(super) fn as_data(&self, mut metric: Metric) -> Option<Metric> {
        let promised = self.names.get(metric.name.as_deref()?)?;
        let is_of_this_type = metric.datatype.take() == Some(promised.kind.number());
        metric.name = None;
        metric.alias = Some(promised.alias);
        is_of_this_type.then_some(metric)
    }

    /// Returns the name of a received metric. The metric contains the name itself or an alias. `None` if the alias is
    /// unknown.
    pub(super) fn name_of<'a>(&'a self, metric: &'a Metric) -> Option<&'a str> {
        match (&metric.name, metric.alias) {
            (Some(name), _) => Some(name),
            (None, Some(alias)) => {
                let place = usize::try_from(alias).ok()?.checked_sub(1)?;
                self.aliases.get(place).map(String::as_str)
            }
            (None, None) => None,
        }
    }
}

/// Returns the axis in the name of a metric for measured errors; `None` if the metric has another purpose.
pub(super) fn measured_axis(name: &str) -> Option<&str> {
    name.strip_prefix("axis/")?.strip_suffix(MEASURED)?.strip_suffix('/')
}

/// Returns the names of the axes in a snapshot, without duplicates.
pub(super) fn axes(snapshot: &Snapshot) -> Vec<&str> {
    let mut axes: Vec<&str> = Vec::new();
    for metric in &snapshot.metrics {
        if let Subject::Axis(name) = &metric.subject
            && !axes.contains(&name.as_str())
        {
            axes.push(name);
        }
    }
    axes
}

/// Returns the name of the metric by which hosts send the measured error of an axis.
pub(super) fn measured(axis: &str) -> String {
    format!("axis/{axis}/{MEASURED}")
}

/// Returns the data type in which values of this kind are published.
pub(super) fn kind_of(value: &Value) -> DataType {
    match value {
        Value::Real(_) => DataType::Double,
        Value::Count(_) => DataType::UInt64,
        Value::Flag(_) => DataType::Boolean,
        Value::Text(_) => DataType::String,
    }
}

fn datum(value: &Value) -> Option<Datum> {
    Some(match value {
        Value::Real(value) if !value.is_finite() => return None,
        Value::Real(value) => Datum::Real(*value),
        Value::Count(value) => Datum::Unsigned(*value),
        Value::Flag(value) => Datum::Flag(*value),
        Value::Text(value) => Datum::Text(value.clone()),
    })
}

/// Returns whether metrics of this subject have the property `Quality`. Only signals have it, because isotherm may
/// reject their values.
pub(super) fn has_quality(subject: &Subject) -> bool {
    matches!(subject, Subject::Signal(_))
}

/// Converts a metric of the gateway to a Sparkplug metric with name and type. If it has no value, the metric is null.
pub(super) fn named(metric: &interface::Metric, now: Moment) -> Metric {
    let kind = kind_of(&metric.kind);
    let value = metric.value.as_ref().and_then(datum).and_then(|datum| kind.write(&datum));
    // A value that was never known has no time. The metric (null) then has the current time.
    let at = if metric.at == Moment::default() { now } else { metric.at };
    let mut published = null(&format!("{}/{}", metric.subject, metric.name), kind, at);
    match value {
        Some(value) => (published.is_null, published.value) = (None, Some(value)),
        None if has_quality(&metric.subject) => add_quality(&mut published, BAD),
        None => {}
    }
    published
}

/// Makes a metric that has no value (null).
pub(super) fn null(name: &str, kind: DataType, at: Moment) -> Metric {
    Metric {
        name: Some(name.to_owned()),
        datatype: Some(kind.number()),
        timestamp: Some(milliseconds(at)),
        is_null: Some(true),
        ..Metric::default()
    }
}

pub(super) fn add_quality(metric: &mut Metric, code: i64) {
    add_property(metric, "Quality", DataType::Int32, &Datum::Signed(code));
}

pub(super) fn add_property(metric: &mut Metric, key: &str, kind: DataType, datum: &Datum) {
    let Some(value) = kind.write(datum).and_then(super::payload::Raw::into_property) else { return };
    let properties = metric.properties.get_or_insert_with(PropertySet::default);
    properties.keys.push(key.to_owned());
    properties.values.push(Property { datatype: Some(kind.number()), is_null: None, value: Some(value) });
}

pub(super) fn milliseconds(at: Moment) -> u64 {
    at.as_nanos() / 1_000_000
}
