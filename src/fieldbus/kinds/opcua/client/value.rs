//! Conversion of values of the OPC UA library to readings of the gateway.

use std::time::Duration;

use ::opcua::types::{DataValue, DateTime, StatusCode, Variant};
use isotherm_core::codec::{DataType, Node, Scalar, number_in};
use isotherm_core::reading::{Reason, Status};

use crate::fieldbus::kinds::opcua::conversion::scalar;
use crate::fieldbus::wire::{NodeReading, Stamped};

/// Maximum difference between two clocks up to which both count as correct.
const APART: Duration = Duration::from_secs(1);
/// Number of ticks of OPC UA time in a second; one tick is 100 ns.
const TICKS: u64 = 10_000_000;

/// Returns the reading of a node. `answered` is the time of the answer by the server's clock. The server time stamp of
/// the value is not used, because some servers set this stamp when they receive the value.
pub(super) fn reading(node: &Node, value: &DataValue, answered: DateTime) -> NodeReading {
    let status = value.status.unwrap_or_default();
    let stamped = match value.source_timestamp {
        Some(source) if !source.is_null() && !answered.is_null() => since(source.ticks(), answered.ticks()),
        _ => Stamped::Unknown,
    };
    let scalar = match &value.value {
        _ if !Status(status.bits()).is_good() => Err(Reason::Status(status.bits())),
        None | Some(Variant::Empty) => Err(Reason::BadReply),
        Some(value) => element(node, value).and_then(|value| number(node, value)),
    };
    NodeReading { value: scalar.and_then(|scalar| node.registers(scalar)), stamped, asked: None }
}

/// Returns a value in the type of the library that contains only this status, and no number.
pub(super) fn without_value(status: StatusCode) -> DataValue {
    DataValue { status: Some(status), ..DataValue::null() }
}

/// Returns the age of a value: the time from the stamp `source` to the stamp `server`, both in ticks. `source` may be
/// slightly later than `server`, because the two clocks differ.
pub(super) fn since(source: i64, server: i64) -> Stamped {
    let ticks = source.abs_diff(server);
    let apart = Duration::from_secs(ticks / TICKS) + Duration::from_nanos(100 * (ticks % TICKS));
    match source <= server {
        true => Stamped::Ago(apart),
        false if apart <= APART => Stamped::Ago(Duration::ZERO),
        false => Stamped::Ahead,
    }
}

/// Returns the value of a node, or the element of its array. The whole array is read, because not every server can send
/// a part of it.
fn element<'v>(node: &Node, value: &'v Variant) -> Result<&'v Variant, Reason> {
    let Some(element) = &node.element else { return Ok(value) };
    let Variant::Array(array) = value else { return Err(Reason::NoElement) };
    let place = element.place(array.values.len(), array.dimensions.as_deref());
    place.and_then(|place| array.values.get(place)).ok_or(Reason::NoElement)
}

/// Returns the number in the value of a node. A text that contains a number is accepted only if the profile states no
/// type for the node.
fn number(node: &Node, value: &Variant) -> Result<Scalar, Reason> {
    let of_text = |value: &Variant| match value {
        Variant::String(text) => number_in(text.as_ref()),
        _ => None,
    };
    match (scalar(value), node.data_type) {
        (Some(scalar), _) => Ok(scalar),
        (None, Some(_)) => Err(Reason::WrongType),
        (None, None) => {
            let number = of_text(value).ok_or(Reason::NoNumber)?;
            Ok(Scalar { data_type: DataType::F64, bits: number.to_bits() })
        }
    }
}

/// Formats a value as text for users.
pub(super) fn for_people(value: &Variant) -> String {
    match value {
        Variant::LocalizedText(text) => text.to_string(),
        Variant::QualifiedName(name) => name.to_string(),
        Variant::ByteString(bytes) => format!("{} bytes", bytes.as_ref().len()),
        value => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_that_is_no_number_contradicts_the_profile_only_if_the_profile_states_a_type() {
        let read = |data_type, value| {
            let node = Node::new("ns=2;s=bed".parse().unwrap(), data_type);
            let value = DataValue { value, ..DataValue::null() };
            reading(&node, &value, DateTime::null()).value.err()
        };
        let text = || Some(Variant::from("warm"));
        let cases = [
            (None, text(), Some(Reason::NoNumber)),
            (Some(DataType::F64), text(), Some(Reason::WrongType)),
            (None, Some(Variant::from("27.5")), None),
            (Some(DataType::F64), Some(Variant::from("27.5")), Some(Reason::WrongType)),
            (None, Some(Variant::from(vec![1.0, 2.0])), Some(Reason::NoNumber)),
            (Some(DataType::F64), Some(Variant::from(7_i32)), Some(Reason::WrongType)),
            (None, Some(Variant::from(7_i32)), None),
            (None, None, Some(Reason::BadReply)),
            (None, Some(Variant::Empty), Some(Reason::BadReply)),
            (Some(DataType::F64), Some(Variant::Empty), Some(Reason::BadReply)),
        ];
        for (data_type, value, expected) in cases {
            assert_eq!(read(data_type, value.clone()), expected, "{data_type:?} {value:?}");
        }
    }

    #[test]
    fn an_element_of_an_array_is_read_alone() {
        use ::opcua::types::{Array, VariantScalarTypeId};
        use isotherm_core::codec::Element;
        let list = Variant::from(vec![20.5, 21.5, 22.5]);
        let values: Vec<Variant> = (0..6).map(|number| Variant::from(f64::from(number))).collect();
        let matrix = Array::new_multi(VariantScalarTypeId::Double, values, vec![2u32, 3]).unwrap();
        let matrix = Variant::Array(Box::new(matrix));
        let texts = Variant::from(vec![String::from("20.5"), String::from("warm")]);
        let read = |value: &Variant, indices: &[u32], data_type| {
            let node = Node::new("ns=2;s=bed".parse().unwrap(), data_type);
            let node = Node { element: Element::new(indices.to_vec()), ..node };
            let value = DataValue { value: Some(value.clone()), ..DataValue::null() };
            reading(&node, &value, DateTime::null()).value.map(|value| f64::from_bits(value.bits()))
        };
        assert_eq!(read(&list, &[2], None), Ok(22.5));
        assert_eq!(read(&list, &[2], Some(DataType::F64)), Ok(22.5));
        assert_eq!(read(&list, &[2], Some(DataType::F32)), Err(Reason::WrongType));
        assert_eq!(read(&list, &[3], None), Err(Reason::NoElement));
        assert_eq!(read(&list, &[0, 1], None), Err(Reason::NoElement));
        assert_eq!(read(&matrix, &[1, 2], None), Ok(5.0));
        assert_eq!(read(&matrix, &[1], None), Err(Reason::NoElement));
        assert_eq!(read(&texts, &[0], None), Ok(20.5));
        assert_eq!(read(&texts, &[1], None), Err(Reason::NoNumber));
        assert_eq!(read(&Variant::from(7_i32), &[0], None), Err(Reason::NoElement));
    }

    #[test]
    fn a_text_is_shown_as_people_write_it() {
        use ::opcua::types::{LocalizedText, QualifiedName};
        assert_eq!(for_people(&Variant::from(LocalizedText::new("de", "Spindel"))), "Spindel");
        assert_eq!(for_people(&Variant::from(QualifiedName::new(2, "Nck"))), "2:Nck");
        assert_eq!(for_people(&Variant::from(27.5)), "27.5");
    }

    #[test]
    fn a_stamp_is_as_old_as_the_server_s_clock_says_and_one_ahead_of_it_is_told() {
        const HOUR: i64 = 3600 * 10_000_000;
        assert_eq!(since(0, HOUR), Stamped::Ago(Duration::from_hours(1)));
        assert_eq!(since(5_000_000, 0), Stamped::Ago(Duration::ZERO));
        assert_eq!(since(HOUR, 0), Stamped::Ahead);
    }
}
