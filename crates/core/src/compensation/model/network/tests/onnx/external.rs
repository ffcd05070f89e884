//! Tensors whose numbers are in files next to the ONNX file.

use super::super::{ExternalFiles, Onnx, close};
use super::encode::{model, node, outside};
use super::exported::{Attribute, with};

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn beside(files: &[(&str, Vec<u8>)]) -> ExternalFiles {
    files.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.clone())).collect()
}

/// `y = x·w + b` with both tensors in other files.
fn product(w: &[(&str, &str)], b: &[(&str, &str)]) -> Vec<u8> {
    let nodes = [node("MatMul", &["x", "w"], "h"), node("Add", &["h", "b"], "y")];
    model(&nodes, &[outside("w", &[2, 1], w), outside("b", &[1], b)], Some(2))
}

#[test]
fn numbers_in_other_files_are_those_of_the_tensors() {
    let one = product(
        &[("location", "net.data"), ("offset", "0"), ("length", "8")],
        &[("location", "net.data"), ("offset", "8"), ("length", "4"), ("checksum", "00")],
    );
    assert_eq!(Onnx::external_files(&one).unwrap(), ["net.data"]);
    let files = beside(&[("net.data", bytes(&[2.0, -0.5, 1.25]))]);
    let onnx = Onnx::with_external(&one, &files, 2).unwrap();
    close(onnx.output(&[3.0, 4.0]), 5.25);
    let others = beside(&[("net.data", bytes(&[2.0, -0.5, 1.0]))]);
    assert_ne!(onnx, Onnx::with_external(&one, &others, 2).unwrap(), "another file is another network");
    // Offset and length are optional.
    let each = product(&[("location", "parts/w")], &[("location", "./b")]);
    assert_eq!(Onnx::external_files(&each).unwrap(), ["b", "parts/w"]);
    let files = beside(&[("parts/w", bytes(&[2.0, -0.5])), ("b", bytes(&[1.25]))]);
    close(Onnx::with_external(&each, &files, 2).unwrap().output(&[3.0, 4.0]), 5.25);
}

#[test]
fn a_file_is_read_once_under_any_of_its_names() {
    let twice = product(&[("location", "parts/./net.data")], &[("location", ".//parts//net.data")]);
    assert_eq!(Onnx::external_files(&twice).unwrap(), ["parts/net.data"]);
    let files = beside(&[("parts/net.data", bytes(&[2.0, -0.5]))]);
    let why = Onnx::with_external(&twice, &files, 2).unwrap_err();
    assert!(why.contains("tensor `b` uses bytes of parts/net.data that another tensor uses too"), "{why}");
}

#[test]
fn the_value_of_a_constant_may_be_in_another_file() {
    let value = outside("", &[2, 1], &[("location", "w")]);
    let nodes = [
        with(node("Constant", &[], "w"), &[("value", Attribute::Tensor(value))]),
        node("MatMul", &["x", "w"], "y"),
    ];
    let file = model(&nodes, &[], Some(2));
    assert_eq!(Onnx::external_files(&file).unwrap(), ["w"]);
    let onnx = Onnx::with_external(&file, &beside(&[("w", bytes(&[2.0, -0.5]))]), 2).unwrap();
    close(onnx.output(&[3.0, 4.0]), 4.0);
}

#[test]
fn a_file_without_external_data_names_no_file() {
    let whole = model(&[node("Neg", &["x"], "y")], &[], Some(1));
    assert!(Onnx::external_files(&whole).unwrap().is_empty());
    let why = Onnx::external_files(b"no network").unwrap_err();
    assert!(why.contains("this is not an ONNX file"), "{why}");
}

#[test]
fn external_data_that_is_missing_or_does_not_fit_is_refused() {
    let at = |offset, length| vec![("location", "net.data"), ("offset", offset), ("length", length)];
    let data = || beside(&[("net.data", bytes(&[2.0, -0.5, 1.25]))]);
    for (w, b, files, words) in [
        (
            at("0", "8"),
            at("8", "4"),
            ExternalFiles::new(),
            "tensor `w` is in the file net.data, which was not found",
        ),
        (at("0", "8"), at("12", "4"), data(), "tensor `b` is beyond the end of net.data, which has 12 bytes"),
        (at("0", "8"), at("99", "4"), data(), "tensor `b` is beyond the end of net.data"),
        (at("0", "18446744073709551615"), at("8", "4"), data(), "tensor `w` is beyond the end of net.data"),
        (at("-4", "8"), at("8", "4"), data(), "tensor `w` has external data with an invalid offset"),
        (at("0", "all"), at("8", "4"), data(), "tensor `w` has external data with an invalid length"),
        (
            at("0", "12"),
            at("0", "12"),
            data(),
            "tensor `b` uses bytes of net.data that another tensor uses too",
        ),
        (at("0", "4"), at("8", "4"), data(), "the file cannot be read as an ONNX network"),
    ] {
        let why = Onnx::with_external(&product(&w, &b), &files, 2).unwrap_err();
        assert!(why.contains(words), "{why}");
    }
}

#[test]
fn only_files_in_the_directory_of_the_network_are_named() {
    for name in ["/etc/passwd", "../net.data", "parts/../../net.data", "", ".", "..\\net.data"] {
        let file = product(&[("location", name)], &[("location", "b")]);
        for why in [
            Onnx::external_files(&file).unwrap_err(),
            Onnx::with_external(&file, &beside(&[(name, bytes(&[0.0, 0.0]))]), 2).unwrap_err(),
        ] {
            assert!(
                why.contains(&format!("tensor `w` is in the file `{name}`: only files in the directory")),
                "{why}"
            );
        }
    }
    let tensor = |place: usize| outside("w", &[1], &[("location", format!("w{place}").as_str())]);
    let many: Vec<Vec<u8>> = (0..65).map(tensor).collect();
    let why = Onnx::external_files(&model(&[node("Neg", &["x"], "y")], &many, Some(1))).unwrap_err();
    assert!(
        why.contains("the tensors of the network are in 65 other files; at most 64 are allowed"),
        "{why}"
    );
}
