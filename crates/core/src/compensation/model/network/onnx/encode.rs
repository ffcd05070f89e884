//! Encodes parts of an ONNX file with the field numbers of `onnx.proto`: nodes, tensors, and the declaration
//! of an input.

/// Writes a field that contains bytes: a text or a nested message.
pub(super) fn put_bytes(message: &mut Vec<u8>, field: u64, bytes: &[u8]) {
    put_varint(message, field << 3 | 2);
    put_varint(message, bytes.len() as u64);
    message.extend_from_slice(bytes);
}

/// Returns an encoded node with one output. `axis` is the only attribute that a node has here.
pub(super) fn node(operator: &str, inputs: &[&str], output: &str, axis: Option<i64>) -> Vec<u8> {
    let mut node = Vec::new();
    inputs.iter().for_each(|input| put_bytes(&mut node, 1, input.as_bytes()));
    put_bytes(&mut node, 2, output.as_bytes());
    put_bytes(&mut node, 4, operator.as_bytes());
    if let Some(axis) = axis {
        let mut attribute = Vec::new();
        put_bytes(&mut attribute, 1, b"axis");
        put_number(&mut attribute, 3, axis.cast_unsigned());
        put_number(&mut attribute, 20, 2);
        put_bytes(&mut node, 5, &attribute);
    }
    node
}

/// Returns an encoded tensor of numbers in single precision, with this name and shape.
pub(super) fn floats(name: &str, shape: &[usize], values: &[f32]) -> Vec<u8> {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    tensor(name, 1, shape, &bytes)
}

/// Returns an encoded tensor of integers, with this name and one dimension.
pub(super) fn integers(name: &str, values: &[i64]) -> Vec<u8> {
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    tensor(name, 7, &[values.len()], &bytes)
}

fn tensor(name: &str, kind: u64, shape: &[usize], bytes: &[u8]) -> Vec<u8> {
    let mut tensor = Vec::new();
    shape.iter().for_each(|size| put_number(&mut tensor, 1, *size as u64));
    put_number(&mut tensor, 2, kind);
    put_bytes(&mut tensor, 8, name.as_bytes());
    put_bytes(&mut tensor, 9, bytes);
    tensor
}

/// Returns the declaration of an input: one row of numbers in single precision.
pub(super) fn row(name: &str, columns: usize) -> Vec<u8> {
    let mut shape = Vec::new();
    for size in [1, columns as u64] {
        let mut dimension = Vec::new();
        put_number(&mut dimension, 1, size);
        put_bytes(&mut shape, 1, &dimension);
    }
    let mut tensor = Vec::new();
    put_number(&mut tensor, 1, 1);
    put_bytes(&mut tensor, 2, &shape);
    let mut kind = Vec::new();
    put_bytes(&mut kind, 1, &tensor);
    let mut value = Vec::new();
    put_bytes(&mut value, 1, name.as_bytes());
    put_bytes(&mut value, 2, &kind);
    value
}

fn put_number(message: &mut Vec<u8>, field: u64, value: u64) {
    put_varint(message, field << 3);
    put_varint(message, value);
}

fn put_varint(message: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        let [low, ..] = value.to_le_bytes();
        message.push(low | 0x80);
        value >>= 7;
    }
    let [last, ..] = value.to_le_bytes();
    message.push(last);
}
