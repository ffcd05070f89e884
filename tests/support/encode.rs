//! Writes a small ONNX file by hand: `x → (x − mean) / scale → f(x·W + b) → … → y`, as exporters write it.

/// One layer: a row of weights and a bias for each neuron, and the operator that follows (empty for none).
pub(crate) type Dense<'a> = (&'a [Vec<f64>], &'a [f64], &'a str);

/// Bytes of the file. `columns` is the width of the input in the file; `None` leaves it open.
pub(crate) fn network(mean: &[f64], scale: &[f64], layers: &[Dense<'_>], columns: Option<u64>) -> Vec<u8> {
    let mut tensors = vec![tensor("mean", &[mean.len()], mean), tensor("scale", &[scale.len()], scale)];
    let mut nodes = vec![node("Sub", &["x", "mean"], "centred"), node("Div", &["centred", "scale"], "h0")];
    for (place, (weights, bias, operator)) in layers.iter().enumerate() {
        let [w, b, product, sum] = ["w", "b", "p", "s"].map(|letter| format!("{letter}{place}"));
        let last = place + 1 == layers.len();
        let out = if last { "y".to_owned() } else { format!("h{}", place + 1) };
        let columns: Vec<f64> =
            (0..weights[0].len()).flat_map(|from| weights.iter().map(move |row| row[from])).collect();
        tensors.push(tensor(&w, &[weights[0].len(), weights.len()], &columns));
        tensors.push(tensor(&b, &[bias.len()], bias));
        nodes.push(node("MatMul", &[&format!("h{place}"), &w], &product));
        if operator.is_empty() {
            nodes.push(node("Add", &[&product, &b], &out));
        } else {
            nodes.push(node("Add", &[&product, &b], &sum));
            nodes.push(node(operator, &[&sum], &out));
        }
    }
    model(&nodes, &tensors, columns)
}

/// Bytes of a file with these nodes and tensors, from one row `x` to `y`.
pub(crate) fn model(nodes: &[Vec<u8>], tensors: &[Vec<u8>], columns: Option<u64>) -> Vec<u8> {
    declaring(&[], nodes, tensors, columns)
}

/// Bytes of a file that also declares the tensors with these names as a row of two integers.
pub(crate) fn declaring(
    names: &[&str],
    nodes: &[Vec<u8>],
    tensors: &[Vec<u8>],
    columns: Option<u64>,
) -> Vec<u8> {
    let mut graph = Vec::new();
    nodes.iter().for_each(|node| field(&mut graph, 1, node));
    field(&mut graph, 2, b"net");
    tensors.iter().for_each(|tensor| field(&mut graph, 5, tensor));
    field(&mut graph, 11, &value("x", 1, columns));
    field(&mut graph, 12, &value("y", 1, Some(1)));
    names.iter().for_each(|name| field(&mut graph, 13, &value(name, 7, Some(2))));
    let mut opset = Vec::new();
    number(&mut opset, 2, 17);
    let mut model = Vec::new();
    number(&mut model, 1, 8);
    field(&mut model, 7, &graph);
    field(&mut model, 8, &opset);
    model
}

pub(crate) fn node(operator: &str, inputs: &[&str], output: &str) -> Vec<u8> {
    let mut node = Vec::new();
    inputs.iter().for_each(|input| field(&mut node, 1, input.as_bytes()));
    field(&mut node, 2, output.as_bytes());
    field(&mut node, 3, format!("{operator}_{output}").as_bytes());
    field(&mut node, 4, operator.as_bytes());
    // The second dimension, and integers.
    let attributes: [(&str, &[u8], u64); 2] = [("Concat", b"axis", 1), ("Cast", b"to", 7)];
    for (_, name, value) in attributes.iter().filter(|(of, ..)| *of == operator) {
        let mut attribute = Vec::new();
        field(&mut attribute, 1, name);
        number(&mut attribute, 3, *value);
        number(&mut attribute, 20, 2);
        field(&mut node, 5, &attribute);
    }
    node
}

pub(crate) fn tensor(name: &str, shape: &[usize], values: &[f64]) -> Vec<u8> {
    let mut tensor = Vec::new();
    shape.iter().for_each(|size| number(&mut tensor, 1, *size as u64));
    number(&mut tensor, 2, 1);
    field(&mut tensor, 8, name.as_bytes());
    #[allow(clippy::cast_possible_truncation, reason = "the file holds single precision")]
    let bytes: Vec<u8> = values.iter().flat_map(|value| (*value as f32).to_le_bytes()).collect();
    field(&mut tensor, 9, &bytes);
    tensor
}

/// Tensor in single precision whose numbers are in another file. Each entry is a key and its value.
#[allow(dead_code, reason = "each program uses its part")]
pub(crate) fn outside(name: &str, shape: &[usize], entries: &[(&str, &str)]) -> Vec<u8> {
    let mut tensor = Vec::new();
    shape.iter().for_each(|size| number(&mut tensor, 1, *size as u64));
    number(&mut tensor, 2, 1);
    field(&mut tensor, 8, name.as_bytes());
    for (key, value) in entries {
        let mut entry = Vec::new();
        field(&mut entry, 1, key.as_bytes());
        field(&mut entry, 2, value.as_bytes());
        field(&mut tensor, 13, &entry);
    }
    number(&mut tensor, 14, 1);
    tensor
}

/// Declares a tensor with one row. `kind`: 1 for single precision, 7 for integers.
pub(crate) fn value(name: &str, kind: u64, columns: Option<u64>) -> Vec<u8> {
    let (mut rows, mut width) = (Vec::new(), Vec::new());
    number(&mut rows, 1, 1);
    match columns {
        Some(columns) => number(&mut width, 1, columns),
        None => field(&mut width, 2, b"n"),
    }
    let mut shape = Vec::new();
    field(&mut shape, 1, &rows);
    field(&mut shape, 1, &width);
    let mut tensor = Vec::new();
    number(&mut tensor, 1, kind);
    field(&mut tensor, 2, &shape);
    let mut of_tensor = Vec::new();
    field(&mut of_tensor, 1, &tensor);
    let mut value = Vec::new();
    field(&mut value, 1, name.as_bytes());
    field(&mut value, 2, &of_tensor);
    value
}

pub(crate) fn number(message: &mut Vec<u8>, tag: u64, value: u64) {
    varint(message, tag << 3);
    varint(message, value);
}

pub(crate) fn field(message: &mut Vec<u8>, tag: u64, bytes: &[u8]) {
    varint(message, tag << 3 | 2);
    varint(message, bytes.len() as u64);
    message.extend_from_slice(bytes);
}

fn varint(message: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        message.push(u8::try_from(value & 0x7f | 0x80).unwrap_or_default());
        value >>= 7;
    }
    message.push(u8::try_from(value).unwrap_or_default());
}
