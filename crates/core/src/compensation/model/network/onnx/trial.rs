//! Trial computation of an ONNX graph, node by node, before the gateway uses it. A small file may require any amount of
//! memory and time. For example, a row and a column of ten thousand numbers are added, or a tensor is concatenated with
//! itself forty times.
//!
//! Before a node is computed, the size of its result is calculated from the shapes of its inputs, which are
//! known at that time. Later computations have the same shapes, because no shape may depend on the values of
//! the inputs.

use std::collections::{BTreeSet, HashMap, HashSet};

use rten::{Dimension, NodeId, RunOptions, Value, ValueOrView};
use rten_tensor::prelude::*;

use super::frame::{Field, Fields, last_text, parts, text, varint};
use super::{Graph, caught};

/// Numbers that a graph may compute for each byte of its file. A network uses each weight once, and a weight has at
/// least one byte.
const PER_BYTE: u64 = 2;
/// Numbers that a graph may compute in any case, in addition to those that [`PER_BYTE`] allows for the size of its
/// file.
const BESIDE: u64 = 1_000_000;

/// Node of the graph in the file: one operator with its inputs and its output.
#[derive(Default)]
struct Node<'a> {
    operator: &'a str,
    inputs: Vec<&'a str>,
    output: &'a str,
    /// For a matrix multiplication (Gemm): whether its first and its second factor are transposed.
    transposed: [bool; 2],
}

/// Computed tensor, and whether its numbers depend on the inputs of the network.
struct Computed {
    value: Value,
    varies: bool,
}

/// Rejects a file with a tensor whose shape has more numbers than the file has bytes.
///
/// # Errors
/// Returns a message that names the tensor.
pub(super) fn check_tensors(bytes: &[u8]) -> Result<(), String> {
    let attributes =
        operators(bytes).flat_map(|node| parts(node, 5)).flat_map(|attribute| parts(attribute, 5));
    for tensor in graph(bytes).flat_map(|graph| parts(graph, 5)).chain(attributes) {
        let asks = sizes(tensor).into_iter().fold(1, |all: u64, size| all.saturating_mul(size.max(1)));
        if asks > bytes.len() as u64 {
            let name = last_text(tensor, 8);
            return Err(format!(
                "tensor `{name}` has {asks} numbers according to its shape, but the file has only {} bytes: \
                 export the network again",
                bytes.len()
            ));
        }
    }
    Ok(())
}

/// Computes every node once, with the inputs of the network in `input`.
///
/// # Errors
/// Returns a message if a node cannot be computed, or requires more computed numbers than allowed for a file of this
/// size.
pub(super) fn run(bytes: &[u8], graph: &Graph, input: Value, options: &RunOptions) -> Result<(), String> {
    let Graph { model, .. } = graph;
    let may = (bytes.len() as u64).saturating_mul(PER_BYTE).saturating_add(BESIDE);
    let named = |id: NodeId| model.node_info(id).and_then(|node| node.name()).unwrap_or_default();
    let ids = [(named(graph.input), graph.input), (named(graph.output), graph.output)];
    // An operator may have the name of the output.
    let id = |name: &str| {
        ids.iter().find(|(known, _)| *known == name).map(|(_, id)| *id).or_else(|| model.find_node(name))
    };
    let fixed: HashSet<&str> = given(bytes).collect();
    let mut computed = HashMap::from([(ids[0].0, Computed { value: input, varies: true })]);
    let mut all = 0u64;
    for node in operators(bytes).map(node).filter(|node| node.operator != "Constant") {
        let Node { operator, output, .. } = node;
        let refused = |why: &str| Err(format!("node {operator} with the output `{output}` {why}"));
        let varies = |name: &&str| computed.get(*name).is_some_and(|known| known.varies);
        if SHAPED.contains(&operator) && node.inputs.iter().skip(1).any(&varies) {
            return refused(
                "has a shape that depends on the values of the inputs: export the network with fixed shapes",
            );
        }
        let shape = |name: &&str| match computed.get(*name) {
            Some(known) => Some(known.value.shape().to_vec()),
            // The runtime knows every tensor from the beginning, also the results of later nodes.
            None if fixed.contains(name) => sizes_of(model.node_info(id(name)?)?.shape()?),
            None => None,
        };
        let taken: Vec<&str> = node.inputs.iter().copied().filter(|name| !name.is_empty()).collect();
        let Some(shapes) = taken.iter().map(shape).collect::<Option<Vec<_>>>() else {
            return refused("uses a tensor that no earlier node computes");
        };
        all = all.saturating_add(asks(&node, &shapes));
        if all > may {
            return refused(&format!(
                "makes the network too large: {all} computed numbers, but at most {may} are allowed for a \
                 file of {} bytes",
                bytes.len()
            ));
        }
        let known = |name: &str| Some((id(name)?, ValueOrView::from(computed.get(name)?.value.as_view())));
        let each: BTreeSet<&str> = taken.iter().copied().collect();
        let inputs: Vec<(NodeId, ValueOrView<'_>)> = each.into_iter().filter_map(known).collect();
        let Some(wanted) = id(output) else { return refused("has no output with a name") };
        let [value] = caught(|| model.run_n(inputs, [wanted], Some(options.clone())))?
            .map_err(|why| format!("the network cannot be computed: {why}"))?;
        let varies = taken.iter().any(varies);
        if computed.insert(output, Computed { value, varies }).is_some() || fixed.contains(output) {
            return refused("has the same output as another node");
        }
    }
    Ok(())
}

/// Operators whose result has a shape that depends on an input other than the first.
const SHAPED: [&str; 6] = ["Reshape", "Squeeze", "Unsqueeze", "ReduceMean", "ReduceProd", "ReduceSum"];

/// Returns the maximum number of values that a node computes, or multiplies to compute its result. `shapes`: shapes of
/// its inputs.
fn asks(node: &Node<'_>, shapes: &[Vec<usize>]) -> u64 {
    let product = |shape: &[usize]| shape.iter().fold(1, |all: u64, size| all.saturating_mul(*size as u64));
    match (node.operator, shapes) {
        ("MatMul" | "Gemm", [first, second, ..]) => {
            let (first, rows, shared) = matrix(first, node.transposed[0], [1, 0]);
            let (second, _, columns) = matrix(second, node.transposed[1], [0, 1]);
            product(&broadcast([first, second].into_iter())).saturating_mul(product(&[rows, shared, columns]))
        }
        ("Concat", shapes) => shapes.iter().fold(0, |all, shape| all.saturating_add(product(shape))),
        ("Gather", shapes) => shapes.iter().fold(1, |all, shape| all.saturating_mul(product(shape).max(1))),
        (_, shapes) => product(&broadcast(shapes.iter().map(Vec::as_slice))),
    }
}

/// Returns how a matrix multiplication uses a tensor of this shape: all dimensions except the last two, then the
/// numbers of rows and columns. A tensor of one dimension is a single row if `vector` is `[1, 0]`, else a single
/// column.
fn matrix(shape: &[usize], transposed: bool, vector: [usize; 2]) -> (&[usize], usize, usize) {
    let (rows, columns) = match shape {
        [] => (1, 1),
        [only] if vector == [1, 0] => (1, *only),
        [only] => (*only, 1),
        [.., rows, columns] if transposed => (*columns, *rows),
        [.., rows, columns] => (*rows, *columns),
    };
    (&shape[..shape.len().saturating_sub(2)], rows, columns)
}

/// Returns the shape of the result of an element-wise operation on tensors of these shapes.
fn broadcast<'s>(shapes: impl Iterator<Item = &'s [usize]>) -> Vec<usize> {
    shapes.fold(Vec::new(), |mut all, shape| {
        let missing = shape.len().saturating_sub(all.len());
        all.splice(0..0, std::iter::repeat_n(1, missing));
        all.iter_mut().rev().zip(shape.iter().rev()).for_each(|(size, other)| *size = (*size).max(*other));
        all
    })
}

fn sizes_of(shape: Vec<Dimension>) -> Option<Vec<usize>> {
    let size = |dimension| match dimension {
        Dimension::Fixed(size) => Some(size),
        Dimension::Symbolic(_) => None,
    };
    shape.into_iter().map(size).collect()
}

// ---- content of the file, by the field numbers of `onnx.proto` -----------------------------------------------------

fn graph(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    parts(bytes, 7)
}

fn operators(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    graph(bytes).flat_map(|graph| parts(graph, 1))
}

/// Returns the names of the tensors whose values the file itself contains.
fn given(bytes: &[u8]) -> impl Iterator<Item = &str> {
    let tensors = graph(bytes).flat_map(|graph| parts(graph, 5)).filter_map(|tensor| parts(tensor, 8).last());
    let constants = operators(bytes).filter(|message| node(message).operator == "Constant");
    tensors.map(text).chain(constants.map(|message| node(message).output))
}

fn node(message: &[u8]) -> Node<'_> {
    let is_set = |name: &str| {
        let of_name = |attribute: &&[u8]| parts(attribute, 1).last().is_some_and(|own| text(own) == name);
        parts(message, 5).filter(of_name).any(|attribute| {
            Fields(attribute)
                .flatten()
                .any(|found| matches!(found, (3, Field::Number(number)) if number != 0))
        })
    };
    Node {
        operator: last_text(message, 4),
        inputs: parts(message, 1).map(text).collect(),
        output: parts(message, 2).next().map(text).unwrap_or_default(),
        transposed: [is_set("transA"), is_set("transB")],
    }
}

/// Returns the sizes of a tensor's dimensions. The file stores them one by one, or packed in one field.
fn sizes(tensor: &[u8]) -> Vec<u64> {
    let mut sizes = Vec::new();
    for (_, value) in Fields(tensor).flatten().filter(|(field, _)| *field == 1) {
        match value {
            Field::Number(size) => sizes.push(size),
            Field::Bytes(mut packed) => {
                while let Some((size, rest)) = varint(packed) {
                    sizes.push(size);
                    packed = rest;
                }
            }
            Field::Fixed => {}
        }
    }
    sizes
}
