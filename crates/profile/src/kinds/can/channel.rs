//! Keys of a template's channels on CAN: values in frames follow each other by their bits, objects by their sub-index.

use serde_json::{Map, Value};

/// Number of bits of a frame or sub-indices of one channel. `None` for a channel in neither.
pub(crate) fn width(group: &Map<String, Value>) -> Option<u16> {
    let length = |key: &str| group.get(key).and_then(|place| place.get("length")).and_then(Value::as_u64);
    let length = ["pdo", "frame"].into_iter().find_map(|key| u16::try_from(length(key)?).ok());
    length.or_else(|| group.contains_key("sdo").then_some(1))
}

/// Moves the value of a key to the channel with this index. `None` for a key of another kind of bus.
pub(crate) fn moved(key: &str, value: &Value, place: u16, stride: u16) -> Option<Result<Value, String>> {
    match key {
        "pdo" | "frame" => Some(Ok(farther(value.clone(), u64::from(place) * u64::from(stride)))),
        "sdo" => Some(of_member(value.as_str().unwrap_or_default(), place, stride).map(Value::from)),
        _ => None,
    }
}

/// Moves the bits of a frame away from those of the first channel.
fn farther(mut frame: Value, bits: u64) -> Value {
    if let Some(start) = frame.get("start").and_then(Value::as_u64)
        && let Some(frame) = frame.as_object_mut()
    {
        frame.insert("start".to_owned(), Value::from(start + bits));
    }
    frame
}

/// Returns the object of the channel with this index. The sub-indices follow each other.
pub(crate) fn of_member(object: &str, place: u16, stride: u16) -> Result<String, String> {
    let far = u32::from(place) * u32::from(stride);
    let (index, sub) = object.split_once(':').ok_or_else(|| format!("`{object}` is no CANopen object"))?;
    let sub = u32::from_str_radix(sub, 16).ok().map(|sub| sub + far).and_then(|sub| u8::try_from(sub).ok());
    let sub = sub.ok_or_else(|| format!("{object} plus {far} is beyond the last subindex, FF"))?;
    Ok(format!("{index}:{sub:02X}"))
}
