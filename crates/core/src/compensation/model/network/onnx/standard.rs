//! Rewrites an ONNX file so that the runtime can compute it. The result has only standard operators and one input
//! tensor, and contains the numbers of all tensors.
//!
//! The operators of the domain `ai.onnx.ml` for linear models and scalers, which skl2onnx writes, become standard
//! operators. Dropout does nothing at inference, and becomes Identity. Names of nodes are removed, because the runtime
//! confuses a node with a tensor of the same name.

use std::collections::{HashMap, HashSet};

use super::encode::{self, put_bytes};
use super::external::{External, is_external};
use super::frame::{Field, Fields, last_text, parts, raw_fields, text};
use super::operators::SUPPORTED;
use crate::compensation::model::network::WIDEST;

/// Domain of the operators for models that are not neural networks.
const CLASSICAL: &str = "ai.onnx.ml";

/// Name of the input tensor that replaces several input tensors of one number each.
const ROW: &str = "isotherm:row";

const FOR_INFERENCE: &str = "export the network for inference, in PyTorch after `model.eval()`";

const SMOOTH: &str = "for example, fit `MLPRegressor` or `Ridge` of scikit-learn, after a `StandardScaler`, to the \
                      same data, and export this pipeline with skl2onnx";

/// ONNX file in a form that the runtime can compute.
pub(super) struct Rewritten {
    pub(super) bytes: Vec<u8>,
    /// Names of the file's input tensors, if it has several input tensors of one number each. One input tensor then
    /// replaces them. Empty if the file has one input tensor.
    pub(super) columns: Vec<String>,
}

/// Encoded nodes and tensors that replace one node of the file.
#[derive(Default)]
struct Replacement {
    nodes: Vec<Vec<u8>>,
    tensors: Vec<Vec<u8>>,
}

impl Replacement {
    fn of(node: Vec<u8>) -> Replacement {
        Replacement { nodes: vec![node], ..Replacement::default() }
    }
}

/// Rewrites the file. The file must be complete ([`super::frame::is_whole`]).
///
/// # Errors
/// Returns a message if an operator has no equivalent of standard operators, or if numbers of a tensor are missing.
pub(super) fn rewrite(bytes: &[u8], external: &mut External<'_>) -> Result<Rewritten, String> {
    let mut rewritten = Rewritten { bytes: Vec::with_capacity(bytes.len()), columns: Vec::new() };
    for (number, value, raw) in raw_fields(bytes) {
        match (number, value) {
            (7, Field::Bytes(graph)) => {
                check_input(graph)?;
                let columns = columns(graph);
                put_bytes(&mut rewritten.bytes, 7, &rewrite_graph(graph, &columns, external)?);
                rewritten.columns.extend(columns.into_iter().map(str::to_owned));
            }
            _ => rewritten.bytes.extend_from_slice(raw),
        }
    }
    Ok(rewritten)
}

fn rewrite_graph(bytes: &[u8], columns: &[&str], external: &mut External<'_>) -> Result<Vec<u8>, String> {
    let truths = truths(bytes);
    let mut graph = Vec::with_capacity(bytes.len());
    if !columns.is_empty() {
        put_bytes(&mut graph, 11, &encode::row(ROW, columns.len()));
    }
    for (place, name) in (0..).zip(columns) {
        let index = format!("isotherm:{name}:column");
        put_bytes(&mut graph, 5, &encode::integers(&index, &[place]));
        put_bytes(&mut graph, 1, &encode::node("Gather", &[ROW, &index], name, Some(1)));
    }
    for (number, value, raw) in raw_fields(bytes) {
        match (number, value) {
            (1, Field::Bytes(message)) => {
                let Replacement { nodes, tensors } = rewrite_node(message, &truths, external)?;
                nodes.iter().for_each(|node| put_bytes(&mut graph, 1, node));
                tensors.iter().for_each(|tensor| put_bytes(&mut graph, 5, tensor));
            }
            (5, Field::Bytes(tensor)) => put_bytes(&mut graph, 5, &external.inlined(tensor)?),
            (11, Field::Bytes(input)) if columns.contains(&last_text(input, 1)) => {}
            _ => graph.extend_from_slice(raw),
        }
    }
    Ok(graph)
}

/// Returns the input tensors whose numbers the file does not contain.
fn inputs(graph: &[u8]) -> Vec<&[u8]> {
    // Old files declare the tensors that they contain as inputs too.
    let given: HashSet<&str> = parts(graph, 5).map(|tensor| last_text(tensor, 8)).collect();
    parts(graph, 11).filter(|input| !given.contains(last_text(input, 1))).collect()
}

/// Kinds of floating-point numbers, by their codes in the file: single, half and double precision, and bfloat16.
const FLOATS: [u64; 4] = [1, 10, 11, 16];

/// Rejects a single input tensor of integers or texts.
fn check_input(graph: &[u8]) -> Result<(), String> {
    match inputs(graph)[..] {
        [input] if tensor_kind(input).is_some_and(|kind| !FLOATS.contains(&kind)) => Err(format!(
            "input `{}` of the network does not accept floating-point numbers: export the network with a \
             float input, in skl2onnx with `FloatTensorType`",
            last_text(input, 1)
        )),
        _ => Ok(()),
    }
}

/// Returns the kind of the numbers of an input tensor. `None` if the file does not state it.
fn tensor_kind(input: &[u8]) -> Option<u64> {
    first_number(tensor_type(input)?, 1)
}

/// Returns the description of the type of an input tensor: kind of its numbers, and shape.
fn tensor_type(input: &[u8]) -> Option<&[u8]> {
    parts(input, 2).flat_map(|kind| parts(kind, 1)).last()
}

/// Returns the first number in the field `wanted` of a message.
fn first_number(message: &[u8], wanted: u64) -> Option<u64> {
    Fields(message).flatten().find_map(|(field, value)| match value {
        Field::Number(number) if field == wanted => Some(number),
        _ => None,
    })
}

/// Returns the names of the input tensors if the graph has several input tensors of one number each; else an empty
/// list. Exporters write one input tensor for each column of a table.
fn columns(graph: &[u8]) -> Vec<&str> {
    let inputs = inputs(graph);
    if !(2..=WIDEST).contains(&inputs.len()) || !inputs.iter().all(|input| is_column(input)) {
        return Vec::new();
    }
    inputs.into_iter().map(|input| last_text(input, 1)).collect()
}

/// Returns whether an input tensor has one column of numbers, and one row or any number of rows.
fn is_column(input: &[u8]) -> bool {
    let Some(tensor) = tensor_type(input) else { return false };
    let dimensions = parts(tensor, 2).flat_map(|shape| parts(shape, 1));
    let sizes: Vec<Option<u64>> = dimensions.map(|dimension| first_number(dimension, 1)).collect();
    // Single precision, integers of 32 and 64 bits, and double precision: the gateway can pass each of them.
    matches!(tensor_kind(input), Some(1 | 6 | 7 | 11)) && matches!(sizes[..], [None | Some(1), Some(1)])
}

/// Rewrites one node. `truths` are the truth values that the file contains.
fn rewrite_node(
    message: &[u8],
    truths: &HashMap<&str, bool>,
    external: &mut External<'_>,
) -> Result<Replacement, String> {
    let node = Node::of(message);
    match (node.domain, node.operator) {
        ("" | "ai.onnx", "Dropout") => dropout(&node, truths),
        ("" | "ai.onnx", "BatchNormalization") if node.trains() => {
            Err(node.refused(&format!("was exported for training: {FOR_INFERENCE}")))
        }
        ("" | "ai.onnx", "Shape" | "ConstantOfShape") => Err(node.refused(
            "computes with the shape of a tensor: export the network with fixed shapes, and \
             `PolynomialFeatures` of scikit-learn with `include_bias=False`",
        )),
        // The runtime reads a constant as a tensor, not as an operator.
        ("" | "ai.onnx", operator) if operator == "Constant" || SUPPORTED.contains(&operator) => {
            without_name(message, external)
        }
        ("" | "ai.onnx", _) => Err(node.refused(&format!(
            "is not supported. Export a linear model or a neural network with usual layers instead: {SMOOTH}"
        ))),
        (CLASSICAL, "LinearRegressor") => linear_regressor(&node),
        (CLASSICAL, "Scaler") => scaler(&node),
        (CLASSICAL, "ArrayFeatureExtractor") => array_feature_extractor(&node),
        (CLASSICAL, "FeatureVectorizer") => {
            let (operator, axis) =
                if node.inputs.len() == 1 { ("Identity", None) } else { ("Concat", Some(1)) };
            Ok(Replacement::of(encode::node(operator, &node.inputs, node.output, axis)))
        }
        (CLASSICAL, "Imputer") => imputer(&node),
        (CLASSICAL, operator) if operator.starts_with("TreeEnsemble") => Err(format!(
            "the file contains a tree ensemble (node {operator}), for example a random forest. Its output jumps at \
             each threshold of a tree, and Cz would jump with it. Export a model without jumps instead: {SMOOTH}"
        )),
        (CLASSICAL, operator) if operator.starts_with("SVM") => Err(format!(
            "the file contains a support vector machine (node {operator}), which is not supported. Export another \
             model instead: {SMOOTH}"
        )),
        (CLASSICAL, operator) if operator.ends_with("Classifier") || operator == "ZipMap" => Err(format!(
            "the file contains a classifier (node {operator}): its output is a class, but Cz is a number. \
             Export a regressor instead: {SMOOTH}"
        )),
        (domain, operator) => Err(format!(
            "node {operator} of the domain {domain} is not supported. Export a linear model or a neural \
             network with standard operators instead: {SMOOTH}"
        )),
    }
}

/// Copies a node without its name. Tensors in its attributes get their numbers from external files.
fn without_name(message: &[u8], external: &mut External<'_>) -> Result<Replacement, String> {
    let mut node = Vec::with_capacity(message.len());
    for (number, value, raw) in raw_fields(message) {
        match (number, value) {
            (3, _) => {}
            (5, Field::Bytes(attribute)) => {
                let mut copied = Vec::with_capacity(attribute.len());
                for (number, value, raw) in raw_fields(attribute) {
                    match (number, value) {
                        (5, Field::Bytes(tensor)) => put_bytes(&mut copied, 5, &external.inlined(tensor)?),
                        _ => copied.extend_from_slice(raw),
                    }
                }
                put_bytes(&mut node, 5, &copied);
            }
            _ => node.extend_from_slice(raw),
        }
    }
    Ok(Replacement::of(node))
}

/// Replaces a Dropout by Identity, because at inference its result is its input.
fn dropout(node: &Node<'_>, truths: &HashMap<&str, bool>) -> Result<Replacement, String> {
    let training = node.inputs.get(2).filter(|name| !name.is_empty());
    if training.is_some_and(|name| truths.get(*name) != Some(&false)) {
        return Err(node.refused(&format!("drops numbers at random: {FOR_INFERENCE}")));
    }
    let input = node.input(0)?;
    Ok(Replacement::of(encode::node("Identity", &[input], node.output, None)))
}

/// Returns the truth values that the file contains, by the names of their tensors.
fn truths(graph: &[u8]) -> HashMap<&str, bool> {
    let constants = parts(graph, 1).map(Node::of).filter(|node| node.operator == "Constant");
    let values = constants.filter_map(|node| Some((node.output, parts(node.attribute("value")?, 5).last()?)));
    let tensors = parts(graph, 5).map(|tensor| (last_text(tensor, 8), tensor));
    tensors.chain(values).filter_map(|(name, tensor)| Some((name, truth(tensor)?))).collect()
}

/// Returns the value of a tensor with one truth value; `None` for any other tensor, and for a value in another file.
fn truth(tensor: &[u8]) -> Option<bool> {
    let fields = || Fields(tensor).flatten();
    if is_external(tensor) {
        return None;
    }
    fields().find(|found| matches!(found, (2, Field::Number(9))))?;
    // The number is in a field of integers, which may be packed, or in the field of raw bytes.
    let is_set = |(field, value): (u64, Field<'_>)| match value {
        Field::Number(number) => field == 5 && number != 0,
        Field::Bytes(bytes) => matches!(field, 5 | 9) && bytes.iter().any(|byte| *byte != 0),
        Field::Fixed => false,
    };
    Some(fields().any(is_set))
}

/// Replaces a LinearRegressor, which computes `y = x·W + b`, by standard operators.
fn linear_regressor(node: &Node<'_>) -> Result<Replacement, String> {
    let (coefficients, intercepts) = (node.floats("coefficients"), node.floats("intercepts"));
    let coefficients = coefficients.as_slice();
    let targets = usize::try_from(node.integer("targets").unwrap_or(1)).unwrap_or_default();
    if targets == 0 || coefficients.is_empty() || !coefficients.len().is_multiple_of(targets) {
        return Err(node.refused(&format!(
            "has {} coefficients for {targets} outputs: export the model again",
            coefficients.len()
        )));
    }
    if !intercepts.is_empty() && intercepts.len() != targets {
        return Err(node.refused(&format!(
            "has {} intercepts for {targets} outputs: export the model again",
            intercepts.len()
        )));
    }
    if !matches!(node.text("post_transform"), "" | "NONE") {
        return Err(node.refused(
            "transforms its output to probabilities: export a regressor without this transformation",
        ));
    }
    let width = coefficients.len() / targets;
    // The file has one row of coefficients for each output, a matrix multiplication one column.
    let weights: Vec<f32> = (0..width)
        .flat_map(|input| (0..targets).map(move |target| coefficients[target * width + input]))
        .collect();
    let [named, product, added] = ["weights", "product", "intercepts"].map(|part| node.part(part));
    let mut replacement = Replacement::default();
    replacement.tensors.push(encode::floats(&named, &[width, targets], &weights));
    let input = node.input(0)?;
    if intercepts.is_empty() {
        replacement.nodes.push(encode::node("MatMul", &[input, &named], node.output, None));
    } else {
        replacement.tensors.push(encode::floats(&added, &[targets], &intercepts));
        replacement.nodes.push(encode::node("MatMul", &[input, &named], &product, None));
        replacement.nodes.push(encode::node("Add", &[&product, &added], node.output, None));
    }
    Ok(replacement)
}

/// Replaces a Scaler, which computes `y = (x − offset) · scale`, by standard operators. `offset` and `scale` have one
/// number for each column, or one number for all columns.
fn scaler(node: &Node<'_>) -> Result<Replacement, String> {
    let (offset, scale) = (node.floats("offset"), node.floats("scale"));
    if offset.is_empty() || offset.len() != scale.len() {
        let (offsets, scales) = (offset.len(), scale.len());
        return Err(
            node.refused(&format!("has {offsets} offsets and {scales} scales: export the scaler again"))
        );
    }
    let [subtracted, difference, factor] = ["offset", "difference", "scale"].map(|part| node.part(part));
    let [shape, row] = ["shape", "row"].map(|part| node.part(part));
    let input = node.input(0)?;
    let mut replacement = Replacement::default();
    let input = if offset.len() == 1 {
        input
    } else {
        // A subtraction alone would repeat a single column for each offset.
        let columns = i64::try_from(offset.len()).unwrap_or(i64::MAX);
        replacement.tensors.push(encode::integers(&shape, &[1, columns]));
        replacement.nodes.push(encode::node("Reshape", &[input, &shape], &row, None));
        row.as_str()
    };
    replacement.tensors.push(encode::floats(&subtracted, &[offset.len()], &offset));
    replacement.tensors.push(encode::floats(&factor, &[scale.len()], &scale));
    replacement.nodes.push(encode::node("Sub", &[input, &subtracted], &difference, None));
    replacement.nodes.push(encode::node("Mul", &[&difference, &factor], node.output, None));
    Ok(replacement)
}

/// Replaces an ArrayFeatureExtractor, which picks columns. The list of columns may have any shape.
fn array_feature_extractor(node: &Node<'_>) -> Result<Replacement, String> {
    let [shape, list] = ["shape", "columns"].map(|part| node.part(part));
    let (input, columns) = (node.input(0)?, node.input(1)?);
    Ok(Replacement {
        nodes: vec![
            encode::node("Reshape", &[columns, &shape], &list, None),
            encode::node("Gather", &[input, &list], node.output, Some(-1)),
        ],
        tensors: vec![encode::integers(&shape, &[-1])],
    })
}

/// Replaces an Imputer of missing values (NaN) by Identity, because the gateway never passes a missing value
/// to a model. Rejects an Imputer that replaces another number.
fn imputer(node: &Node<'_>) -> Result<Replacement, String> {
    if node.float("replaced_value_float").is_some_and(f32::is_nan) {
        let input = node.input(0)?;
        return Ok(Replacement::of(encode::node("Identity", &[input], node.output, None)));
    }
    Err(node.refused(
        "replaces a number that stands for a missing value: export the model without this step, because the \
         gateway itself rejects invalid readings",
    ))
}

/// Node of the graph in the file: its encoded message, its operator, and the names of its inputs and its output.
struct Node<'a> {
    message: &'a [u8],
    domain: &'a str,
    operator: &'a str,
    inputs: Vec<&'a str>,
    output: &'a str,
}

impl<'a> Node<'a> {
    fn of(message: &'a [u8]) -> Node<'a> {
        Node {
            message,
            domain: last_text(message, 7),
            operator: last_text(message, 4),
            inputs: parts(message, 1).map(text).collect(),
            output: parts(message, 2).next().map(text).unwrap_or_default(),
        }
    }

    fn input(&self, place: usize) -> Result<&'a str, String> {
        self.inputs
            .get(place)
            .copied()
            .ok_or_else(|| self.refused("has too few inputs: export the network again"))
    }

    /// Returns a unique name for a tensor of the replacement of this node. `part` distinguishes the tensors of one
    /// node.
    fn part(&self, part: &str) -> String {
        format!("isotherm:{}:{part}", self.output)
    }

    fn refused(&self, why: &str) -> String {
        format!("node {} with the output `{}` {why}", self.operator, self.output)
    }

    /// Returns whether a BatchNormalization node computes mean and variance itself, as in training. In old files, such
    /// a node has outputs for mean and variance.
    fn trains(&self) -> bool {
        self.integer("training_mode").is_some_and(|on| on != 0)
            || parts(self.message, 2).skip(1).any(|output| !output.is_empty())
    }

    fn attribute(&self, name: &str) -> Option<&'a [u8]> {
        parts(self.message, 5).filter(|attribute| last_text(attribute, 1) == name).last()
    }

    fn text(&self, name: &str) -> &'a str {
        self.attribute(name).map(|attribute| last_text(attribute, 4)).unwrap_or_default()
    }

    fn integer(&self, name: &str) -> Option<u64> {
        Fields(self.attribute(name)?).flatten().find_map(|found| match found {
            (3, Field::Number(number)) => Some(number),
            _ => None,
        })
    }

    fn float(&self, name: &str) -> Option<f32> {
        let found = raw_fields(self.attribute(name)?).filter(|(field, ..)| *field == 2).last();
        found.and_then(|(.., raw)| float(raw))
    }

    /// Returns the numbers of the attribute `name`; empty without this attribute. The file stores them one by one, or
    /// packed in one field.
    fn floats(&self, name: &str) -> Vec<f32> {
        let mut floats = Vec::new();
        for (field, value, raw) in self.attribute(name).into_iter().flat_map(raw_fields) {
            match (field, value) {
                (7, Field::Fixed) => floats.extend(float(raw)),
                (7, Field::Bytes(packed)) => floats.extend(packed.chunks_exact(4).filter_map(float)),
                _ => {}
            }
        }
        floats
    }
}

/// Returns the number in single precision at the end of these bytes.
fn float(bytes: &[u8]) -> Option<f32> {
    bytes.last_chunk::<4>().map(|number| f32::from_le_bytes(*number))
}
