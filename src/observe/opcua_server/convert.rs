//! Conversion of samples to values of OPC UA.

use ::opcua::types::{DataTypeId, DataValue, DateTime, StatusCode, UAString, Variant, VariantScalarTypeId};

use super::catalogue::Kind;
use super::sampler::{Quality, Sample, Value};
use isotherm_core::quantity::Moment;

/// Length of one OPC UA time tick, ns.
const TICK: u64 = 100;
/// Number of ticks between 1601, the start of OPC UA time, and 1970.
const TO_1970: i64 = 116_444_736_000_000_000;

/// Returns the OPC UA data type of a variable. A list of texts has the type of its elements.
pub(super) fn data_type(kind: Kind) -> DataTypeId {
    match kind {
        Kind::Number => DataTypeId::Double,
        Kind::Count => DataTypeId::UInt64,
        Kind::Flag => DataTypeId::Boolean,
        Kind::Text | Kind::Texts | Kind::Object(_) => DataTypeId::String,
    }
}

/// Converts a sample to an OPC UA value with status and source time. `now` is the server time.
pub(super) fn data_value(sample: &Sample, now: DateTime) -> DataValue {
    DataValue {
        // Without a value, the library would not send the status.
        value: Some(variant(&sample.value)),
        status: Some(status(sample.quality)),
        source_timestamp: Some(date_time(sample.at)),
        source_picoseconds: None,
        server_timestamp: Some(now),
        server_picoseconds: None,
    }
}

/// Returns a value in the form in which subscriptions receive it.
///
/// For a client without a filter, the library compares only the values. Such a client would not receive a change of the
/// status if the number stays the same. Therefore a number with one of the two uncertain statuses is changed in its
/// last binary digit, upwards for one status, downwards for the other.
pub(super) fn subscribed(mut value: DataValue) -> DataValue {
    let status = value.status;
    if let Some(Variant::Double(number)) = &mut value.value {
        if status == Some(StatusCode::UncertainLastUsableValue) {
            *number = number.next_up();
        } else if status == Some(StatusCode::UncertainNoCommunicationLastUsableValue) {
            *number = number.next_down();
        }
    }
    value
}

/// Converts a time to OPC UA ticks.
pub(super) fn date_time(at: Moment) -> DateTime {
    let ticks = i64::try_from(at.as_nanos() / TICK).unwrap_or(i64::MAX - TO_1970);
    DateTime::from(ticks.saturating_add(TO_1970))
}

fn variant(value: &Value) -> Variant {
    match value {
        Value::Null => Variant::Empty,
        Value::Number(number) => Variant::Double(*number),
        Value::Count(count) => Variant::UInt64(*count),
        Value::Flag(flag) => Variant::Boolean(*flag),
        Value::Text(text) => Variant::String(UAString::from(text)),
        Value::Texts(texts) => {
            let texts: Vec<Variant> =
                texts.iter().map(|text| Variant::String(UAString::from(text))).collect();
            Variant::from((VariantScalarTypeId::String, texts))
        }
    }
}

fn status(quality: Quality) -> StatusCode {
    match quality {
        Quality::Good => StatusCode::Good,
        Quality::LastUsable => StatusCode::UncertainLastUsableValue,
        Quality::LastUsableNoAnswer => StatusCode::UncertainNoCommunicationLastUsableValue,
        Quality::NoData => StatusCode::GoodNoData,
        Quality::Waiting => StatusCode::BadWaitingForInitialData,
        Quality::NoCommunication => StatusCode::BadNoCommunication,
        Quality::SensorFailure => StatusCode::BadSensorFailure,
        Quality::OutOfRange => StatusCode::BadOutOfRange,
        Quality::OutOfService => StatusCode::BadOutOfService,
        Quality::Configuration => StatusCode::BadConfigurationError,
        Quality::DeviceFailure => StatusCode::BadDeviceFailure,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_is_the_same_in_both_counts() {
        let at = Moment::from_nanos(1_900_000_000_123_456_700);
        assert_eq!(date_time(at).to_rfc3339(), "2030-03-17T17:46:40.123Z");
        assert_eq!(date_time(at).ticks() - TO_1970, 19_000_000_001_234_567);
    }

    #[test]
    fn a_value_that_may_not_be_used_is_sent_as_empty_with_its_status() {
        let sample = Sample { value: Value::Null, quality: Quality::SensorFailure, at: Moment::default() };
        let sent = data_value(&sample, DateTime::null());
        assert_eq!((sent.value, sent.status), (Some(Variant::Empty), Some(StatusCode::BadSensorFailure)));
        let texts = Sample {
            value: Value::Texts(vec!["a".to_owned(), "b".to_owned()]),
            quality: Quality::Good,
            at: Moment::default(),
        };
        let Some(Variant::Array(array)) = data_value(&texts, DateTime::null()).value else {
            panic!("a list is an array")
        };
        assert_eq!(array.values.len(), 2);
    }

    #[test]
    fn a_subscribed_number_differs_with_each_status_and_never_by_more_than_its_last_digit() {
        for number in [0.0, 10.0, -2.299, 1e-300] {
            let qualities = [Quality::Good, Quality::LastUsable, Quality::LastUsableNoAnswer];
            let mut seen: Vec<Option<Variant>> = Vec::new();
            for quality in qualities {
                let value = Value::Number(number);
                let kept = data_value(&Sample { value, quality, at: Moment::default() }, DateTime::null());
                let sent = subscribed(kept.clone());
                assert_eq!((sent.status, sent.source_timestamp), (kept.status, kept.source_timestamp));
                let Some(Variant::Double(received)) = sent.value else { panic!("{number} is a number") };
                assert!((received - number).abs() <= number.abs() * f64::EPSILON + f64::from_bits(1));
                assert!(!seen.contains(&sent.value), "{number}, {quality:?}");
                seen.push(sent.value);
            }
            assert_eq!(seen.first(), Some(&Some(Variant::Double(number))));
        }
    }
}
