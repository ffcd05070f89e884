//! Tests with ONNX files that are encoded here byte by byte. The results are compared with the same network computed in
//! double precision.

use proptest::prelude::*;

use super::*;

#[path = "../../../../../../../tests/support/encode.rs"]
mod encode;
mod exported;
mod external;

fn file(columns: Option<u64>) -> Vec<u8> {
    let [hidden, last] = weights();
    let layers: [encode::Dense<'_>; 2] = [(&hidden.0, &hidden.1, "Tanh"), (&last.0, &last.1, "")];
    encode::network(&[20.0, 100.0], &[4.0, 50.0], &layers, columns)
}

#[test]
fn an_onnx_network_is_its_layers_by_hand() {
    for columns in [Some(2), None] {
        let onnx = Onnx::new(file(columns), 2).unwrap();
        assert_eq!(onnx.takes(), 2);
        for (a, b) in [(20.0, 100.0), (26.0, 80.0), (12.0, 250.0)] {
            close(onnx.output(&[a, b]), by_hand((a - 20.0) / 4.0, (b - 100.0) / 50.0, f64::tanh));
        }
    }
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let onnx = Onnx::new(file(None), 2).unwrap();
    let first = onnx.output(&[23.4, 77.7]).to_bits();
    assert!((0..100).all(|_| onnx.output(&[23.4, 77.7]).to_bits() == first));
    assert_eq!(onnx, Onnx::new(file(None), 2).unwrap());
    assert_ne!(onnx, Onnx::new(file(Some(2)), 2).unwrap());
}

#[test]
fn the_width_of_the_file_counts_not_that_of_the_model() {
    assert_eq!(Onnx::new(file(Some(2)), 7).unwrap().takes(), 2);
    // The declaration leaves the number of inputs open; the weights determine it.
    let why = Onnx::new(file(None), 7).unwrap_err();
    assert!(why.contains("cannot be computed"), "{why}");
}

#[test]
fn too_large_for_single_precision_is_no_number() {
    let onnx = Onnx::new(file(None), 2).unwrap();
    let relu = {
        let [hidden, last] = weights();
        let layers: [encode::Dense<'_>; 2] = [(&hidden.0, &hidden.1, "Relu"), (&last.0, &last.1, "")];
        Onnx::new(encode::network(&[20.0, 100.0], &[4.0, 50.0], &layers, None), 2).unwrap()
    };
    assert!(onnx.output(&[1e300, 0.0]).is_finite(), "tanh has an end");
    assert!(!relu.output(&[1e300, 0.0]).is_finite());
}

#[test]
fn what_is_no_network_of_one_number_is_refused() {
    let two = vec![vec![1.0, 0.0], vec![0.0, 1.0]];
    let layers: [encode::Dense<'_>; 1] = [(&two, &[0.0, 0.0], "")];
    let pair = encode::network(&[0.0, 0.0], &[1.0, 1.0], &layers, Some(2));
    let sine: [encode::Dense<'_>; 1] = [(&two[..1], &[0.0], "Sin")];
    let sine = encode::network(&[0.0, 0.0], &[1.0, 1.0], &sine, Some(2));
    for (bytes, words) in [
        (pair, "the output of the network has 2 numbers"),
        (sine, "Sin"),
        (Vec::new(), "the file is incomplete"),
        (b"no network".to_vec(), "this is not an ONNX file"),
    ] {
        let why = Onnx::new(bytes, 2).unwrap_err();
        assert!(why.contains(words), "{why}");
    }
}

/// Checks that a file of some kilobytes never gets the large memory or time that it requires.
#[test]
fn a_small_file_that_asks_for_much_is_refused_before_it_gets_it() {
    use encode::{model, node, tensor};
    let zeros = [0.0; 10_000];
    let column = tensor("column", &[10_000, 1], &zeros);
    let row = tensor("row", &[1, 10_000], &zeros);
    let sum = |operator: &str| {
        let nodes = [node(operator, &["column", "row"], "large"), node("MatMul", &["x", "large"], "y")];
        model(&nodes, &[column.clone(), row.clone()], Some(1))
    };
    let doubled = |operator: &str| {
        let name = |place: usize| if place == 0 { "x".to_owned() } else { format!("h{place}") };
        let step = |place: usize| node(operator, &[&name(place), &name(place)], &name(place + 1));
        model(&(0..40).map(step).collect::<Vec<_>>(), &[], Some(1))
    };
    let claimed =
        model(&[node("MatMul", &["x", "w"], "y")], &[tensor("w", &[1 << 30, 1 << 30], &[])], Some(1));
    let nothing = model(&[node("MatMul", &["x", "w"], "y")], &[tensor("w", &[0, 1 << 60], &[])], Some(1));
    for (bytes, words) in [
        (sum("Add"), ["node Add with the output `large` makes the network too large: 100000000", "at most"]),
        (
            sum("MatMul"),
            ["node MatMul with the output `large` makes the network too large: 100000000", "at most"],
        ),
        (doubled("Concat"), ["node Concat", "at most"]),
        (claimed, ["tensor `w` has 1152921504606846976 numbers", "the file has"]),
        (nothing, ["tensor `w` has 1152921504606846976 numbers", "the file has"]),
    ] {
        let why = Onnx::new(bytes, 1).unwrap_err();
        assert!(words.iter().all(|word| why.contains(word)), "{why}");
    }
}

#[test]
fn a_node_may_take_one_tensor_twice() {
    let square = encode::model(&[encode::node("Mul", &["x", "x"], "y")], &[], Some(1));
    close(Onnx::new(square, 1).unwrap().output(&[1.5]), 2.25);
}

#[test]
fn a_shape_that_comes_out_of_the_input_is_refused() {
    use encode::{model, node, tensor};
    let moved = [node("Squeeze", &["w", "x"], "s"), node("MatMul", &["s", "w"], "y")];
    let why = Onnx::new(model(&moved, &[tensor("w", &[1, 1], &[1.0])], Some(1)), 1).unwrap_err();
    assert!(
        why.contains("node Squeeze with the output `s` has a shape that depends on the values of the inputs"),
        "{why}"
    );
    // If a result of the input is listed after the node that uses it, the file seems to contain its value.
    let mut nodes = [
        node("Cast", &["x"], "whole"),
        node("Squeeze", &["whole"], "shape"),
        node("Reshape", &["x", "shape"], "moved"),
        node("MatMul", &["moved", "w"], "y"),
    ];
    let weights = [tensor("w", &[2, 1], &[1.0, 1.0])];
    for words in [
        "has a shape that depends on the values of the inputs",
        "uses a tensor that no earlier node computes",
    ] {
        let why = Onnx::new(encode::declaring(&["shape"], &nodes, &weights, Some(2)), 2).unwrap_err();
        assert!(why.contains(&format!("node Reshape with the output `moved` {words}")), "{why}");
        nodes.swap(1, 2);
    }
}

#[test]
fn a_node_that_gives_what_the_file_holds_already_is_refused() {
    use encode::{model, node, tensor};
    let nodes = [node("Identity", &["x"], "w"), node("MatMul", &["x", "w"], "y")];
    let why = Onnx::new(model(&nodes, &[tensor("w", &[1, 1], &[1.0])], Some(1)), 1).unwrap_err();
    assert!(why.contains("`w` has the same output as another node"), "{why}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_file_cut_short_is_refused_without_a_panic(share in 0.0..1.0_f64) {
        let mut bytes = file(Some(2));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        bytes.truncate((share * bytes.len() as f64) as usize);
        let result = Onnx::new(bytes, 2);
        prop_assert!(result.is_err());
    }

    #[test]
    fn random_bytes_are_refused_without_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(Onnx::new(bytes, 2).is_err());
    }

    #[test]
    fn a_file_with_wrong_bytes_gives_a_network_or_a_sentence(
        wrong in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 1..4),
    ) {
        let mut bytes = file(Some(2));
        for (share, byte) in wrong {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let at = (share * bytes.len() as f64) as usize;
            bytes[at] = byte;
        }
        if let Ok(onnx) = Onnx::new(bytes, 2) {
            onnx.output(&[23.0, 90.0][..onnx.takes().min(2)]);
        }
    }
}
