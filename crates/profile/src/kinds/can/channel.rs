//! Calculates the keys of each channel of a template group on CAN. Values in frames have consecutive bits, and CANopen
//! objects have consecutive sub-indices.

use serde_json::{Map, Value};

/// Returns the size of one channel: its number of bits in a frame, or 1 for one sub-index. `None` if the group is on
/// another kind of bus.
pub(crate) fn width(group: &Map<String, Value>) -> Option<u16> {
    let length = |key: &str| group.get(key).and_then(|place| place.get("length")).and_then(Value::as_u64);
    let length = ["pdo", "frame"].into_iter().find_map(|key| u16::try_from(length(key)?).ok());
    length.or_else(|| group.contains_key("sdo").then_some(1))
}

/// Returns the value of a key for the channel with the index `place`. `stride` is the distance between two
/// channels. `None` if the key belongs to another kind of bus. `Err` contains the reason why a CANopen object
/// is invalid.
pub(crate) fn moved(key: &str, value: &Value, place: u16, stride: u16) -> Option<Result<Value, String>> {
    match key {
        "pdo" | "frame" => Some(Ok(farther(value.clone(), u64::from(place) * u64::from(stride)))),
        "sdo" => Some(of_member(value.as_str().unwrap_or_default(), place, stride).map(Value::from)),
        _ => None,
    }
}

/// Adds `bits` to the start bit in the value of `pdo` or `frame`, so that the value describes a later channel.
fn farther(mut frame: Value, bits: u64) -> Value {
    if let Some(start) = frame.get("start").and_then(Value::as_u64)
        && let Some(frame) = frame.as_object_mut()
    {
        frame.insert("start".to_owned(), Value::from(start + bits));
    }
    frame
}

/// Returns the CANopen object of the channel with the index `place`. The sub-indices of the channels are
/// `stride` apart. The error is a sentence about an invalid object or sub-index.
pub(crate) fn of_member(object: &str, place: u16, stride: u16) -> Result<String, String> {
    let far = u32::from(place) * u32::from(stride);
    let (index, sub) = object.split_once(':').ok_or_else(|| format!("`{object}` is not a CANopen object"))?;
    let sub = u32::from_str_radix(sub, 16).ok().map(|sub| sub + far).and_then(|sub| u8::try_from(sub).ok());
    let sub =
        sub.ok_or_else(|| format!("the subindex of {object} plus {far} is beyond the last subindex, FF"))?;
    Ok(format!("{index}:{sub:02X}"))
}
