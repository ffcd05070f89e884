//! Files as skl2onnx and PyTorch export them: linear models, scalers, choices of columns, Dropout and BatchNormalization
//! at inference. Files with other models are rejected with what to export instead.

use proptest::prelude::*;

use super::super::{Onnx, close};
use super::encode::{field, model, node, number, tensor, value};

/// Value of an attribute of an ONNX node, in the form in which an exporter stores it.
pub(super) enum Attribute<'a> {
    Floats(&'a [f32]),
    /// Floats in one field, as some exporters write them.
    Packed(&'a [f32]),
    Float(f32),
    Integer(u64),
    Text(&'a str),
    Tensor(Vec<u8>),
}

use Attribute::{Float, Floats, Integer, Packed, Text};

/// Adds attributes to a node.
pub(super) fn with(mut node: Vec<u8>, attributes: &[(&str, Attribute<'_>)]) -> Vec<u8> {
    let fixed = |message: &mut Vec<u8>, tag: u8, value: f32| {
        message.push(tag << 3 | 5);
        message.extend_from_slice(&value.to_le_bytes());
    };
    for (name, value) in attributes {
        let mut attribute = Vec::new();
        field(&mut attribute, 1, name.as_bytes());
        match value {
            Floats(values) => values.iter().for_each(|value| fixed(&mut attribute, 7, *value)),
            Packed(values) => {
                let packed: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
                field(&mut attribute, 7, &packed);
            }
            Float(value) => fixed(&mut attribute, 2, *value),
            Integer(value) => number(&mut attribute, 3, *value),
            Text(text) => field(&mut attribute, 4, text.as_bytes()),
            Attribute::Tensor(tensor) => field(&mut attribute, 5, tensor),
        }
        field(&mut node, 5, &attribute);
    }
    node
}

/// Returns a node of the ONNX domain for models that are not neural networks.
fn classical(operator: &str, inputs: &[&str], output: &str, attributes: &[(&str, Attribute<'_>)]) -> Vec<u8> {
    let mut node = with(node(operator, inputs, output), attributes);
    field(&mut node, 7, b"ai.onnx.ml");
    node
}

fn linear(input: &str, coefficients: &[f32], intercepts: &[f32]) -> Vec<u8> {
    let attributes = [("coefficients", Floats(coefficients)), ("intercepts", Floats(intercepts))];
    classical("LinearRegressor", &[input], "y", &attributes)
}

fn integers(name: &str, shape: &[usize], values: &[i64]) -> Vec<u8> {
    typed(name, 7, shape, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
}

fn truth(name: &str, value: bool) -> Vec<u8> {
    typed(name, 9, &[], &[u8::from(value)])
}

fn typed(name: &str, kind: u64, shape: &[usize], bytes: &[u8]) -> Vec<u8> {
    let mut tensor = Vec::new();
    shape.iter().for_each(|size| number(&mut tensor, 1, *size as u64));
    number(&mut tensor, 2, kind);
    field(&mut tensor, 8, name.as_bytes());
    field(&mut tensor, 9, bytes);
    tensor
}

#[track_caller]
fn computes(nodes: &[Vec<u8>], tensors: &[Vec<u8>], inputs: &[f64], expected: f64) {
    for columns in [Some(inputs.len() as u64), None] {
        let onnx = Onnx::new(model(nodes, tensors, columns), inputs.len()).unwrap();
        close(onnx.output(inputs), expected);
    }
}

#[track_caller]
fn refused(nodes: &[Vec<u8>], tensors: &[Vec<u8>], words: &[&str]) {
    let why = Onnx::new(model(nodes, tensors, Some(2)), 2).unwrap_err();
    assert!(words.iter().all(|word| why.contains(word)), "{why}");
}

#[test]
fn a_linear_regressor_is_its_coefficients_and_its_intercept() {
    computes(&[linear("x", &[2.0, -0.5, 0.25], &[1.5])], &[], &[3.0, 4.0, 8.0], 7.5);
    computes(&[linear("x", &[2.0, -0.5], &[])], &[], &[3.0, 4.0], 4.0);
    let attributes = [
        ("coefficients", Packed(&[2.0, -0.5])),
        ("intercepts", Packed(&[1.0])),
        ("targets", Integer(1)),
        ("post_transform", Text("NONE")),
    ];
    computes(&[classical("LinearRegressor", &["x"], "y", &attributes)], &[], &[3.0, 4.0], 5.0);
}

#[test]
fn each_output_of_a_linear_regressor_has_a_row_of_coefficients() {
    let attributes = [
        ("coefficients", Floats(&[1.0, 2.0, 10.0, 20.0])),
        ("intercepts", Floats(&[0.5, 5.0])),
        ("targets", Integer(2)),
    ];
    let both = classical("LinearRegressor", &["x"], "both", &attributes);
    refused(
        &[classical("LinearRegressor", &["x"], "y", &attributes)],
        &[],
        &["the output of the network has 2 numbers"],
    );
    let second = node("MatMul", &["both", "second"], "y");
    computes(&[both, second], &[tensor("second", &[2, 1], &[0.0, 1.0])], &[3.0, 4.0], 115.0);
}

#[test]
fn a_scaler_subtracts_and_multiplies() {
    let scaler = |offset: &[f32], scale: &[f32]| {
        let attributes = [("offset", Floats(offset)), ("scale", Floats(scale))];
        [classical("Scaler", &["x"], "scaled", &attributes), linear("scaled", &[1.0, -1.0], &[0.25])]
    };
    // (26 − 20)·0.25 − (80 − 100)·0.02 + 0.25
    computes(&scaler(&[20.0, 100.0], &[0.25, 0.02]), &[], &[26.0, 80.0], 2.15);
    computes(&scaler(&[20.0], &[0.5]), &[], &[26.0, 80.0], -26.75);
    refused(
        &scaler(&[20.0, 1.0], &[0.5]),
        &[],
        &["node Scaler with the output `scaled` has 2 offsets and 1 scales"],
    );
    refused(&scaler(&[], &[]), &[], &["node Scaler", "has 0 offsets"]);
    // One column does not stand for both, also if the file leaves the number of columns open.
    let one = Onnx::new(model(&scaler(&[20.0, 100.0], &[0.25, 0.02]), &[], None), 1).unwrap_err();
    assert!(one.contains("cannot be computed"), "{one}");
}

#[test]
fn a_choice_of_columns_keeps_its_order() {
    let attributes = [("coefficients", Floats(&[1.0, 10.0])), ("intercepts", Floats(&[0.0]))];
    let nodes = [
        classical("ArrayFeatureExtractor", &["x", "columns"], "some", &[]),
        classical("LinearRegressor", &["some"], "y", &attributes),
    ];
    for shape in [&[2][..], &[1, 2]] {
        computes(&nodes, &[integers("columns", shape, &[2, 0])], &[3.0, 5.0, 7.0], 37.0);
    }
    let vector = [
        classical("FeatureVectorizer", &["x"], "all", &[("inputdimensions", Integer(2))]),
        linear("all", &[1.0, 2.0], &[0.0]),
    ];
    computes(&vector, &[], &[3.0, 4.0], 11.0);
}

/// Returns an ONNX file with one input tensor for each name. `kind` is the type of its numbers; 1 is single precision.
fn columns(names: &[&str], kind: u64, nodes: &[Vec<u8>]) -> Vec<u8> {
    let mut graph = Vec::new();
    nodes.iter().for_each(|node| field(&mut graph, 1, node));
    names.iter().for_each(|name| field(&mut graph, 11, &value(name, kind, Some(1))));
    field(&mut graph, 12, &value("y", 1, Some(1)));
    let mut opset = Vec::new();
    number(&mut opset, 2, 17);
    let mut model = Vec::new();
    number(&mut model, 1, 8);
    field(&mut model, 7, &graph);
    field(&mut model, 8, &opset);
    model
}

#[test]
fn one_input_tensor_for_each_input_is_a_row_of_them_in_their_order() {
    let nodes = [
        classical("FeatureVectorizer", &["bed", "column", "head"], "all", &[]),
        linear("all", &[1.0, 10.0, 100.0], &[0.5]),
    ];
    let names = ["bed", "column", "head"];
    let onnx = Onnx::new(columns(&names, 1, &nodes), 3).unwrap();
    assert_eq!(onnx.columns(), names);
    assert_eq!(onnx.takes(), 3);
    close(onnx.output(&[3.0, 5.0, 7.0]), 753.5);
    // The inputs have the order of the file, whatever order the nodes use.
    let turned = Onnx::new(columns(&["head", "column", "bed"], 1, &nodes), 3).unwrap();
    close(turned.output(&[3.0, 5.0, 7.0]), 357.5);
    let texts = Onnx::new(columns(&names, 8, &nodes), 3).unwrap_err();
    assert!(texts.contains("the network has 3 input tensors"), "{texts}");
    for kind in [6, 7, 8] {
        let why = Onnx::new(columns(&["x"], kind, &[linear("x", &[1.0], &[0.0])]), 1).unwrap_err();
        assert!(why.contains("input `x` of the network does not accept floating-point numbers"), "{why}");
    }
    let one = Onnx::new(model(&[linear("x", &[1.0], &[0.0])], &[], Some(1)), 1).unwrap();
    assert!(one.columns().is_empty(), "one input tensor is no list of names");
}

#[test]
fn an_imputer_of_missing_values_does_nothing_and_one_of_numbers_is_refused() {
    let imputer = |replaced: f32| {
        let attributes =
            [("imputed_value_floats", Floats(&[1.0, 1.0])), ("replaced_value_float", Float(replaced))];
        [classical("Imputer", &["x"], "whole", &attributes), linear("whole", &[1.0, 2.0], &[0.0])]
    };
    computes(&imputer(f32::NAN), &[], &[3.0, 4.0], 11.0);
    let words = ["node Imputer with the output `whole` replaces a number that stands for a missing value"];
    refused(&imputer(-9999.0), &[], &words);
    refused(
        &[classical("Imputer", &["x"], "y", &[])],
        &[],
        &words.map(|words| words.split('`').next().unwrap()),
    );
}

#[test]
fn dropout_at_inference_does_nothing_and_in_training_is_refused() {
    let nodes = |inputs: &[&str]| [node("Dropout", inputs, "kept"), node("MatMul", &["kept", "w"], "y")];
    let tensors = |training: Option<bool>| {
        let mut tensors = vec![tensor("w", &[2, 1], &[1.0, 2.0]), tensor("ratio", &[], &[0.5])];
        tensors.extend(training.map(|value| truth("training", value)));
        tensors
    };
    for inputs in [&["x"][..], &["x", "ratio"], &["x", "ratio", ""], &["x", "ratio", "training"]] {
        computes(&nodes(inputs), &tensors(Some(false)), &[3.0, 4.0], 11.0);
    }
    // The truth value may also be the result of a node.
    let constant = |value: bool| {
        let value = [("value", Attribute::Tensor(typed("", 9, &[], &[u8::from(value)])))];
        let [dropped, summed] = nodes(&["x", "ratio", "training"]);
        [with(node("Constant", &[], "training"), &value), dropped, summed]
    };
    computes(&constant(false), &tensors(None), &[3.0, 4.0], 11.0);
    let words = ["node Dropout with the output `kept` drops numbers at random", "model.eval()"];
    refused(&nodes(&["x", "ratio", "training"]), &tensors(Some(true)), &words);
    refused(&nodes(&["x", "ratio", "x"]), &tensors(None), &words);
    refused(&constant(true), &tensors(None), &words);
    // A value in another file is not read.
    let mut outside = tensors(None);
    let mut training = truth("training", false);
    number(&mut training, 14, 1);
    outside.push(training);
    refused(&nodes(&["x", "ratio", "training"]), &outside, &words);
}

#[test]
fn batch_normalization_at_inference_uses_the_figures_of_the_file() {
    let nodes = |attributes: &[(&str, Attribute<'_>)]| {
        let normal = node("BatchNormalization", &["x", "gain", "shift", "mean", "variance"], "normal");
        [with(normal, attributes), node("MatMul", &["normal", "w"], "y")]
    };
    let tensors = [
        tensor("gain", &[2], &[2.0, 3.0]),
        tensor("shift", &[2], &[0.5, -0.5]),
        tensor("mean", &[2], &[20.0, 100.0]),
        tensor("variance", &[2], &[4.0 - 1e-5, 0.25 - 1e-5]),
        tensor("w", &[2, 1], &[1.0, 1.0]),
    ];
    // (26 − 20)/2·2 + 0.5 + (101 − 100)/0.5·3 − 0.5
    let (inputs, expected) = ([26.0, 101.0], 12.0);
    let set = [("epsilon", Float(1e-5)), ("momentum", Float(0.9)), ("training_mode", Integer(0))];
    for attributes in [&[][..], &set] {
        let onnx = Onnx::new(model(&nodes(attributes), &tensors, Some(2)), 2).unwrap();
        let found = onnx.output(&inputs);
        assert!((found - expected).abs() < 1e-4, "{found}");
    }
    let words =
        ["node BatchNormalization with the output `normal` was exported for training", "model.eval()"];
    refused(&nodes(&[("training_mode", Integer(1))]), &tensors, &words);
    // Before version 14, the mean and the variance of training are further outputs.
    let [mut normal, last] = nodes(&[]);
    ["mean_now", "variance_now"].into_iter().for_each(|name| field(&mut normal, 2, name.as_bytes()));
    refused(&[normal, last], &tensors, &words);
}

#[test]
fn usual_activations_are_their_formulas() {
    /// Operator, its attributes, and its results for 0.75 and -1.25.
    type Case<'a> = (&'a str, &'a [(&'a str, Attribute<'a>)], [f64; 2]);
    let cases: [Case<'_>; 5] = [
        ("HardSigmoid", &[], [0.65, 0.25]),
        ("HardSigmoid", &[("alpha", Float(0.25)), ("beta", Float(0.5))], [0.6875, 0.1875]),
        ("HardSwish", &[], [0.46875, -0.364_583_333]),
        ("Softsign", &[], [0.428_571_429, -0.555_555_556]),
        ("Erf", &[], [0.711_155_634, -0.922_900_128]),
    ];
    for (operator, attributes, values) in cases {
        let activation = with(node(operator, &["x"], "a"), attributes);
        let nodes = [activation, node("MatMul", &["a", "w"], "y")];
        let onnx = Onnx::new(model(&nodes, &[tensor("w", &[2, 1], &[1.0, 10.0])], Some(2)), 2).unwrap();
        let (found, expected) = (onnx.output(&[0.75, -1.25]), values[0] + 10.0 * values[1]);
        assert!((found - expected).abs() < 1e-5, "{operator}: {found} is not {expected}");
    }
    let nodes = [node("PRelu", &["x", "slope"], "a"), node("MatMul", &["a", "w"], "y")];
    let tensors = [tensor("slope", &[2], &[0.5, 0.25]), tensor("w", &[2, 1], &[1.0, 10.0])];
    computes(&nodes, &tensors, &[0.75, -1.25], -2.375);
}

#[test]
fn several_models_may_be_joined_by_their_sum_or_their_mean() {
    let tensors = [tensor("v", &[2, 1], &[1.0, 2.0]), tensor("w", &[2, 1], &[3.0, 1.0])];
    for (operator, expected) in [("Sum", 24.0), ("Mean", 12.0)] {
        let nodes = [
            node("MatMul", &["x", "v"], "p"),
            node("MatMul", &["x", "w"], "q"),
            node(operator, &["p", "q"], "y"),
        ];
        computes(&nodes, &tensors, &[3.0, 4.0], expected);
    }
    let axis = integers("axis", &[1], &[1]);
    let nodes = [node("ReduceMean", &["x", "axis"], "y")];
    for inputs in [[3.0, 4.0], [-1.0, 8.0]] {
        computes(&nodes, std::slice::from_ref(&axis), &inputs, 3.5);
    }
}

#[test]
fn a_node_may_have_the_name_of_a_tensor() {
    // Each node of `encode::node` is named after its operator and its output.
    let nodes =
        [node("MatMul", &["x", "w"], "h"), node("Tanh", &["h"], "MatMul_h"), node("Neg", &["MatMul_h"], "y")];
    computes(&nodes, &[tensor("w", &[2, 1], &[0.25, 0.5])], &[1.0, 2.0], -(1.25_f64.tanh()));
}

#[test]
fn other_models_are_refused_with_what_to_export_instead() {
    for (operator, words) in [
        (
            "TreeEnsembleRegressor",
            ["the file contains a tree ensemble (node TreeEnsembleRegressor)", "`MLPRegressor`"],
        ),
        ("TreeEnsemble", ["output jumps at each threshold of a tree", "`Ridge`"]),
        ("TreeEnsembleClassifier", ["the file contains a tree ensemble", "skl2onnx"]),
        ("SVMRegressor", ["the file contains a support vector machine", "`MLPRegressor`"]),
        ("LinearClassifier", ["its output is a class, but Cz is a number", "`MLPRegressor`"]),
        ("ZipMap", ["its output is a class, but Cz is a number", "`Ridge`"]),
        ("Normalizer", ["node Normalizer of the domain ai.onnx.ml is not supported", "`MLPRegressor`"]),
    ] {
        refused(&[classical(operator, &["x"], "y", &[])], &[], &words);
    }
    let mut distance = node("CDist", &["x", "w"], "y");
    field(&mut distance, 7, b"com.microsoft");
    refused(&[distance], &[], &["node CDist of the domain com.microsoft is not supported"]);
    refused(&[node("Shape", &["x"], "y")], &[], &["node Shape", "`include_bias=False`"]);
    for operator in ["Scan", "LSTM", "Conv", "NoSuchOperator"] {
        let words =
            [format!("node {operator} with the output `y` is not supported"), "`MLPRegressor`".to_owned()];
        refused(&[node(operator, &["x"], "y")], &[], &words.each_ref().map(String::as_str));
    }
}

#[test]
fn figures_that_do_not_fit_each_other_are_refused() {
    let attributes = |targets: u64, post: &'static str| {
        [
            ("coefficients", Floats(&[1.0, 2.0, 3.0])),
            ("intercepts", Floats(&[1.0])),
            ("targets", Integer(targets)),
            ("post_transform", Text(post)),
        ]
    };
    for (targets, post, words) in [
        (0, "", "has 3 coefficients for 0 outputs"),
        (2, "", "has 3 coefficients for 2 outputs"),
        (3, "", "has 1 intercepts for 3 outputs"),
        (u64::MAX, "", "coefficients for"),
        (1, "LOGISTIC", "transforms its output to probabilities"),
    ] {
        refused(&[classical("LinearRegressor", &["x"], "y", &attributes(targets, post))], &[], &[words]);
    }
    refused(&[classical("LinearRegressor", &["x"], "y", &[])], &[], &["has 0 coefficients"]);
    refused(&[linear("x", &[1.0, 2.0, 3.0], &[0.0])], &[], &["cannot be computed"]);
    refused(&[classical("ArrayFeatureExtractor", &["x"], "y", &[])], &[], &["has too few inputs"]);
    refused(&[node("Dropout", &[], "y")], &[], &["node Dropout with the output `y` has too few inputs"]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_pipeline_with_wrong_bytes_gives_a_model_or_a_sentence(
        wrong in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 1..4),
    ) {
        let attributes = [("offset", Floats(&[20.0, 100.0])), ("scale", Floats(&[0.25, 0.02]))];
        let nodes = [classical("Scaler", &["x"], "scaled", &attributes), linear("scaled", &[1.0, -1.0], &[0.25])];
        let mut bytes = model(&nodes, &[], Some(2));
        for (share, byte) in wrong {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let at = (share * bytes.len() as f64) as usize;
            bytes[at] = byte;
        }
        match Onnx::new(bytes, 2) {
            Ok(onnx) => {
                onnx.output(&[23.0, 90.0][..onnx.takes().min(2)]);
            }
            Err(why) => prop_assert!(!why.is_empty()),
        }
    }
}
