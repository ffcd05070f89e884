//! Conversion of the content of a node to a value of the OPC UA library.

use ::opcua::types::{Array, DataValue, StatusCode, UAString, Variant};

use super::nodes::ServerNode;
use crate::fieldbus::kinds::opcua::conversion::variant;
use crate::virtual_machine::hardware::nodes::NodeValue;
use isotherm_core::codec::Scalar;
use isotherm_core::reading::Status;

/// Returns the content of a node from the contents of its parts (array elements). The library adds the time.
pub(super) fn data_value(node: &ServerNode, parts: &[NodeValue]) -> DataValue {
    let status = parts.iter().find_map(|part| match part {
        NodeValue::Status(status) => Some(*status),
        _ => None,
    });
    if let Some(status) = status {
        return without_value(status);
    }
    let whole = match node.dimensions() {
        None => parts.first().and_then(single),
        Some(lengths) => array(node, parts, &lengths),
    };
    DataValue::new_now(whole.unwrap_or(Variant::Empty))
}

/// Returns a node content with this status and without a value.
pub(super) fn without_value(status: Status) -> DataValue {
    DataValue::new_now_status(Variant::Empty, StatusCode::from(status.0))
}

fn single(part: &NodeValue) -> Option<Variant> {
    match part {
        NodeValue::Number(number) => variant(*number),
        NodeValue::Text(text) => Some(Variant::String(UAString::from(text))),
        NodeValue::Status(_) => None,
    }
}

/// Returns an array with these elements. The elements that the profile does not name are zero. If one element
/// is a text, all elements become texts. Returns `None` if an element has no value, or if the array is too
/// large.
fn array(node: &ServerNode, parts: &[NodeValue], lengths: &[u32]) -> Option<Variant> {
    let is_text = parts.iter().any(|part| matches!(part, NodeValue::Text(_)));
    let converted = |part: &NodeValue| match part {
        NodeValue::Number(number) if is_text => single(&NodeValue::Text(number.value().to_string())),
        part => single(part),
    };
    let zero = converted(&NodeValue::Number(Scalar { data_type: node.data_type(), bits: 0 }))?;
    let kind = zero.scalar_type_id()?;
    let mut values = vec![zero; node.size()?];
    let several = (lengths.len() > 1).then_some(lengths);
    for (part, value) in node.parts.iter().zip(parts) {
        let place = part.element.as_ref()?.place(values.len(), several)?;
        *values.get_mut(place)? = converted(value)?;
    }
    let array = match several {
        Some(lengths) => Array::new_multi(kind, values, lengths.to_vec()),
        None => Array::new(kind, values),
    };
    Some(Variant::Array(Box::new(array.ok()?)))
}
