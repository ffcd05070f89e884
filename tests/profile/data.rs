//! Models in files: what fits becomes a model, what does not is refused at the key that names the file.

use isotherm_core::compensation::model::stand_ins::Replaces;
use isotherm_core::compensation::model::{Kind, Outside};
use isotherm_core::quantity::{MicronPerCelsius, Millimetre};
use isotherm_profile::preview::Preview;

use super::*;

#[cfg(feature = "onnx")]
#[path = "../support/encode.rs"]
mod encode;

pub(super) type File<'a> = (&'a str, &'a [u8]);

const MATRIX: &str = r#"{ "format": "isotherm-matrix", "version": 1, "blocks": ["base", "head"], "guide_mm": [0, 400],
  "guide_nodes": [11, 12], "P": [[0, 0], [0, 0], [0.001, 0.002], [0, 0], [0, 0], [0.003, 0.004]] }"#;
const MATRIX_KEYS: &str = "kind = \"matrix\"\nfile = \"c.json\"\ninputs = [\"bed\", { signal = \"wheelhead\", reference = \"start\" }]\n\
    reference = 20\nposition = \"scale_z\"\ncomponent = \"z\"\ncarries = \"tool\"";

pub(super) const NETWORK: &str = r#"{ "format": "isotherm-network", "version": 1, "type": "bp",
  "inputs": { "names": ["a", "b"], "mean": [20, 20], "scale": [4, 4] }, "output": { "mean": 0, "scale": 1 },
  "layers": [{ "weights": [[0.5, -0.5]], "bias": [0], "activation": "tanh" }] }"#;
const RADIAL: &str = r#"{ "format": "isotherm-network", "version": 1, "type": "rbf",
  "inputs": { "mean": [20, 20], "scale": [4, 4] }, "output": { "mean": 0, "scale": 1 },
  "centres": [[0, 0]], "widths": [1], "weights": [3], "bias": 0 }"#;
pub(super) const NETWORK_KEYS: &str =
    "kind = \"network\"\nfile = \"n.json\"\ninputs = [\"bed\", \"wheelhead\"]";

pub(super) const ENVELOPE: &str = r#"{ "format": "isotherm-envelope", "version": 1, "covariance": [[4, 1], [1, 4]],
  "inputs": [{ "signal": "bed", "mean": 24, "min": 20, "max": 30 },
             { "signal": "wheelhead", "reference": "start", "mean": 2, "min": 0, "max": 9 }] }"#;

/// The grinder whose first model has these keys instead of its own.
pub(super) fn machine(keys: &str, files: &[File<'_>]) -> Result<Loaded, Errors> {
    isotherm_profile::parse_with(Path::new("machine.toml"), &grinder(keys), files, &[], &[])
}

fn grinder(keys: &str) -> String {
    let (before, rest) = GRINDER.split_once("kind = \"linear\"").unwrap_or_default();
    let (_, after) = rest.split_once("\n[[").unwrap_or_default();
    format!("{before}{keys}\n[[{after}")
}

#[track_caller]
pub(super) fn refused_at(keys: &str, files: &[File<'_>], key: &str, words: &[&str]) {
    let found = errors(machine(keys, files));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert_eq!(found[0].key, format!("axis.z.model[0]{key}"), "{}", found[0]);
    assert!(found[0].line.is_some(), "{}", found[0]);
    for word in words {
        assert!(found[0].to_string().contains(word), "`{word}` is not in: {}", found[0]);
    }
}

fn reported(loaded: &Loaded) -> String {
    Preview::of(&loaded.profile).to_string()
}

#[test]
fn a_matrix_becomes_gains_of_cz_along_the_guideway() {
    let loaded = machine(MATRIX_KEYS, &[("c.json", MATRIX.as_bytes())]).unwrap();
    let Kind::Matrix(matrix) = &loaded.profile.axes[0].settings.models[0].kind else { panic!("a matrix") };
    let at = Millimetre::new(100.0).unwrap();
    let gains: Vec<f64> = matrix.gains_at(at).map(MicronPerCelsius::get).collect();
    for (gain, expected) in gains.iter().zip([-1.5, -2.5]) {
        assert!((gain - expected).abs() < 1e-9, "{gains:?}");
    }
    let reported = reported(&loaded);
    for words in [
        "Cz = P·ΔT µm at scale_z, P of c.json from 0 to 400 mm (beyond an end, the value at this end)",
        "over (bed − 20), (wheelhead − its value at machine start)",
        "when bed rises by 1 °C (at scale_z = 200 mm), Cz changes by −2 µm",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    for (from, to) in [("\"z\"\n", "\"-z\"\n"), ("\"tool\"", "\"work\"")] {
        let other = machine(&MATRIX_KEYS.replace(from, to), &[("c.json", MATRIX.as_bytes())]).unwrap();
        assert!(self::reported(&other).contains("(at scale_z = 200 mm), Cz changes by +2 µm"), "{to}");
    }
}

#[test]
fn a_matrix_that_does_not_fit_is_refused_with_the_names_of_both() {
    let with = |from: &str, to: &str| MATRIX.replace(from, to);
    for (file, words) in [
        (with("\"head\"]", "\"head\", \"top\"]"), &["row 1 of P has 2 columns; there are 3 blocks"][..]),
        (
            r#"{ "format": "isotherm-matrix", "version": 1, "blocks": ["base"], "guide_mm": [0], "P": [[0], [0], [0]] }"#.into(),
            &["1 blocks (base)", "names 2: bed, wheelhead"],
        ),
        (with("[\"base\", \"head\"]", "[\"wheelhead\", \"bed\"]"), &["in another order: bed, wheelhead"]),
        (with("[0, 400]", "[400, 0]"), &["must ascend"]),
        (with("[0, 400]", "[0, 400, 800]"), &["P has 6 rows; 3 points in guide_mm need 9 rows"]),
        (with("\"guide_nodes\"", "\"guide_node\""), &["unknown field `guide_node`"]),
        (with("\"version\": 1", "\"version\": 2"), &["the version of the file is 2"]),
        (with("isotherm-matrix", "isotherm-network"), &["the format is \"isotherm-network\""]),
        (MATRIX[..100].to_owned(), &["not JSON in a format of isotherm"]),
        (
            "time,bed\n0,20.0\n60,20.1\n".to_owned(),
            &["this is a log, not a JSON document", "\"isotherm-matrix\" is required"],
        ),
        (with("0.001", "1e999"), &["out of range"]),
    ] {
        refused_at(MATRIX_KEYS, &[("c.json", file.as_bytes())], ".file", &[&["c.json: "], words].concat());
    }
    refused_at(MATRIX_KEYS, &[], ".file", &["c.json is not among the files of this profile"]);
}

#[test]
fn what_a_matrix_needs_has_no_default() {
    let file: &[File<'_>] = &[("c.json", MATRIX.as_bytes())];
    let without = |line: &str| MATRIX_KEYS.replace(line, "");
    for (line, key) in [
        ("reference = 20\n", ".reference"),
        ("position = \"scale_z\"\n", ".position"),
        ("component = \"z\"\n", ".component"),
        ("carries = \"tool\"", ".carries"),
    ] {
        let found = errors(machine(&without(line), file));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert_eq!(found[0].key, format!("axis.z.model[0]{key}"));
        assert!(found[0].message.contains("is missing"), "{}", found[0]);
    }
    refused_at(&MATRIX_KEYS.replace("scale_z", "bed"), file, ".position", &["in \"degC\"", "in mm"]);
    refused_at(&MATRIX_KEYS.replace("\"bed\"", "\"bad\""), file, ".inputs[0]", &["did you mean `bed`?"]);
}

#[test]
fn a_datum_taken_at_zero_wants_no_input_taken_at_zero() {
    let files: [File<'_>; 2] = [("c.json", MATRIX.as_bytes()), ("n.json", NETWORK.as_bytes())];
    let zeroed = "{ signal = \"wheelhead\", reference = \"zero\" }";
    for (keys, twice) in [
        (MATRIX_KEYS.to_owned(), false),
        (MATRIX_KEYS.replace("reference = 20", "reference = \"zero\""), true),
        (NETWORK_KEYS.to_owned(), false),
        (NETWORK_KEYS.replace("\"wheelhead\"", zeroed), true),
    ] {
        let text = grinder(&keys).replacen("rate = 0.5", "rate = 0.5\ndatum = \"zero\"", 1);
        let found = isotherm_profile::parse_with(Path::new("machine.toml"), &text, &files, &[], &[]);
        if twice {
            let found = errors(found);
            assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
            assert_eq!(found[0].key, "axis.z.datum");
            assert!(found[0].message.contains("an input already has the reference \"zero\""), "{}", found[0]);
        } else {
            assert!(found.is_ok(), "{keys}");
        }
    }
}

#[test]
fn networks_of_our_own_format_are_taken_and_explained() {
    for (file, words) in [
        (NETWORK, "Cz = back-propagation network 2-1 of n.json µm, over bed, wheelhead"),
        (RADIAL, "Cz = radial-basis network of 1 nodes of n.json µm, over bed, wheelhead"),
    ] {
        let reported = reported(&machine(NETWORK_KEYS, &[("n.json", file.as_bytes())]).unwrap());
        assert!(
            reported.contains(words) && reported.contains("when bed rises by 1 °C (from 20)"),
            "{reported}"
        );
    }
}

#[test]
fn a_network_that_does_not_fit_is_refused_with_the_names_of_both() {
    let three = NETWORK_KEYS.replace("\"wheelhead\"]", "\"wheelhead\", \"scale_z\"]");
    let n = |text: &'static str| [("n.json", text.as_bytes())];
    refused_at(
        &three,
        &n(NETWORK),
        ".file",
        &["n.json: the file has 2 inputs (a, b)", "names 3: bed, wheelhead, scale_z"],
    );
    refused_at(
        &three,
        &n(RADIAL),
        ".file",
        &["n.json: the network has 2 inputs, but the model names 3: bed, wheelhead, scale_z"],
    );
    for (from, to, words) in [
        ("\"bp\"", "\"cnn\"", "the type of the network is \"cnn\""),
        ("\"tanh\"", "\"tan\"", "unknown variant `tan`"),
        ("[[0.5, -0.5]]", "[[0.5]]", "layer 1, neuron 1: 1 weights"),
        ("\"scale\": [4, 4]", "\"scale\": [4, 0]", "the scale not zero"),
        ("\"bias\": [0]", "\"bias\": [0], \"dropout\": 0.5", "unknown field `dropout`"),
    ] {
        let file = NETWORK.replace(from, to);
        refused_at(NETWORK_KEYS, &[("n.json", file.as_bytes())], ".file", &[words]);
    }
}

#[test]
fn an_input_may_lag_behind_its_signal_and_begins_at_rest_on_its_reference() {
    let n: &[File<'_>] = &[("n.json", NETWORK.as_bytes())];
    let lagged =
        |rest: &str| NETWORK_KEYS.replace("\"wheelhead\"", &format!("{{ signal = \"wheelhead\", {rest} }}"));
    let loaded = machine(&lagged("reference = \"start\", lag = \"12min\""), n).unwrap();
    let Kind::Network(network) = &loaded.profile.axes[0].settings.models[0].kind else { panic!("a network") };
    let lags: Vec<_> =
        network.reads().iter().map(|input| input.time_constant().map(|span| span.as_secs())).collect();
    assert_eq!(lags, [None, Some(720)]);
    let reported = reported(&loaded);
    for words in [
        "over bed, (wheelhead − its value at machine start) lagged by 12m",
        "when wheelhead rises by 1 °C (from 35) (63 % of the effect is reached 12m after wheelhead has risen), Cz changes \
         by",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    let later = MATRIX_KEYS.replace("\"bed\"", "{ signal = \"bed\", lag = \"2h\" }");
    let words = "over (bed − 20) lagged by 2h, (wheelhead";
    let loaded = machine(&later, &[("c.json", MATRIX.as_bytes())]).unwrap();
    assert!(self::reported(&loaded).contains(words), "{}", self::reported(&loaded));
    for (rest, key, words) in [
        ("lag = \"12min\"", ".inputs[1].reference", "begins at its reference"),
        ("reference = 20, lag = \"30d\"", ".inputs[1].lag", "longer than a week"),
        ("reference = 20, lag = \"0s\"", ".inputs[1].lag", "zero is not allowed"),
    ] {
        refused_at(&lagged(rest), n, key, &[words]);
    }
    let bare = later.replace("reference = 20\n", "");
    refused_at(
        &bare,
        &[("c.json", MATRIX.as_bytes())],
        ".reference",
        &["a matrix needs the reference of each rise"],
    );
}

#[test]
fn a_file_of_a_training_program_is_refused_with_what_to_export() {
    let files: [File<'_>; 5] = [
        ("net.pkl", b"\x80\x04\x95\x0b"),
        ("net.pt", b"PK\x03\x04\x00\x00"),
        ("net.h5", b"\x89HDF\r\n\x1a\n"),
        ("net.pmml", b"<?xml version=\"1.0\"?>\n<PMML/>\n"),
        ("net", b"\x1c\x00\x00\x00TFL3"),
    ];
    for (name, bytes) in files {
        let words = ["A network is an .onnx file", "export the model as ONNX"];
        let keys = NETWORK_KEYS.replace("n.json", name);
        refused_at(&keys, &[(name, bytes)], ".file", &words);
    }
}

#[cfg(feature = "onnx")]
#[test]
fn an_onnx_file_is_found_beside_its_profile_and_must_fit_it() {
    let directory = tempfile::tempdir().unwrap();
    let weights = vec![vec![0.5, -0.25]];
    let layers: [encode::Dense<'_>; 1] = [(&weights, &[0.0], "Tanh")];
    let file = encode::network(&[20.0, 20.0], &[4.0, 4.0], &layers, Some(2));
    let keys = NETWORK_KEYS.replace("n.json", "nets/n.onnx");
    let path = directory.path().join("machine.toml");
    let load = |keys: &str| {
        std::fs::write(&path, grinder(keys)).unwrap();
        isotherm_profile::load(&path, &[], &[])
    };
    let missing = errors(load(&keys)).remove(0).to_string();
    assert!(missing.contains("n.onnx cannot be read: No such file"), "{missing}");
    std::fs::create_dir(directory.path().join("nets")).unwrap();
    std::fs::write(directory.path().join("nets/n.onnx"), &file).unwrap();
    let loaded = load(&keys).unwrap();
    assert_eq!(loaded, load(&keys).unwrap(), "the same files are the same profile");
    assert!(reported(&loaded).contains("Cz = ONNX network of nets/n.onnx µm, over bed, wheelhead"));
    let one = errors(load(&keys.replace(", \"wheelhead\"", ""))).remove(0).to_string();
    assert!(one.contains("nets/n.onnx: the network has 2 inputs, but the model names 1: bed"), "{one}");
    std::fs::write(directory.path().join("nets/n.onnx"), &file[..file.len() / 2]).unwrap();
    let cut = errors(load(&keys)).remove(0).to_string();
    assert!(cut.contains("nets/n.onnx: this is not an ONNX file, or the file is incomplete"), "{cut}");
}

/// File with the network `0.5·bed − 0.25·wheelhead`, whose numbers are in `w.data`, and the bytes of that file.
#[cfg(feature = "onnx")]
fn in_two_files() -> (Vec<u8>, Vec<u8>) {
    use encode::{model, node, outside};
    let tensor = outside("w", &[2, 1], &[("location", "w.data")]);
    let data = [0.5_f32, -0.25].iter().flat_map(|number| number.to_le_bytes()).collect();
    (model(&[node("MatMul", &["x", "w"], "y")], &[tensor], Some(2)), data)
}

#[cfg(feature = "onnx")]
#[test]
fn external_data_of_an_onnx_file_is_read_from_its_directory() {
    let (network, data) = in_two_files();
    let keys = NETWORK_KEYS.replace("n.json", "nets/n.onnx");
    let files: [File<'_>; 2] = [("nets/n.onnx", network.as_slice()), ("nets/w.data", data.as_slice())];
    let loaded = machine(&keys, &files).unwrap();
    let Kind::Network(found) = &loaded.profile.axes[0].settings.models[0].kind else { panic!("a network") };
    assert!((found.net().output(&[4.0, 2.0]) - 1.5).abs() < 1e-6);
    refused_at(&keys, &files[..1], ".file", &["nets/w.data is not among the files of this profile"]);
    let short: [File<'_>; 2] = [files[0], ("nets/w.data", &data[..4])];
    refused_at(&keys, &short, ".file", &["nets/n.onnx: "]);
    // From the disk, the file is found too, and a change of it is a change of the profile.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("machine.toml");
    std::fs::create_dir(directory.path().join("nets")).unwrap();
    std::fs::write(&path, grinder(&keys)).unwrap();
    for (name, bytes) in files {
        std::fs::write(directory.path().join(name), bytes).unwrap();
    }
    let load = || isotherm_profile::load(&path, &[], &[]).unwrap();
    let loaded = load();
    assert_eq!(loaded, load());
    std::fs::write(directory.path().join("nets/w.data"), [0_u8; 8]).unwrap();
    assert_ne!(loaded, load());
}

#[cfg(feature = "onnx")]
#[test]
fn a_seal_of_an_onnx_file_with_external_data_is_refused() {
    let (network, data) = in_two_files();
    let keys = NETWORK_KEYS.replace("n.json", "n.onnx");
    let keys = format!("{keys}\nsha256.file = \"{}\"", isotherm_profile::sha256(&network));
    let files: [File<'_>; 2] = [("n.onnx", network.as_slice()), ("w.data", data.as_slice())];
    let words = "n.onnx: `sha256.file` does not include w.data, which contains numbers of this network";
    refused_at(&keys, &files, ".file", &[words]);
}

#[cfg(feature = "onnx")]
#[test]
fn names_of_the_input_tensors_are_compared_with_the_model() {
    use encode::{field, node, number, value};
    // The sum of both inputs.
    let nodes = [node("Concat", &["wheelhead", "bed"], "all"), node("ReduceSum", &["all"], "y")];
    let mut graph = Vec::new();
    nodes.iter().for_each(|node| field(&mut graph, 1, node));
    ["wheelhead", "bed"].into_iter().for_each(|name| field(&mut graph, 11, &value(name, 1, Some(1))));
    field(&mut graph, 12, &value("y", 1, Some(1)));
    let mut opset = Vec::new();
    number(&mut opset, 2, 17);
    let mut file = Vec::new();
    number(&mut file, 1, 8);
    field(&mut file, 7, &graph);
    field(&mut file, 8, &opset);
    let keys = NETWORK_KEYS.replace("n.json", "n.onnx");
    let files: [File<'_>; 1] = [("n.onnx", file.as_slice())];
    let words = "the inputs of the file are wheelhead, bed, but the model names them in another order: bed, wheelhead";
    refused_at(&keys, &files, ".file", &[words]);
    let turned = keys.replace("[\"bed\", \"wheelhead\"]", "[\"wheelhead\", \"bed\"]");
    assert_ne!(turned, keys);
    assert!(machine(&turned, &files).is_ok());
    refused_at(
        &keys.replace(", \"wheelhead\"", ""),
        &files,
        ".file",
        &["the file has 2 inputs (wheelhead, bed), but the model names 1: bed"],
    );
}

#[test]
fn an_envelope_belongs_to_any_model_and_says_what_happens_outside() {
    let linear = "kind = \"linear\"\nterms = [ { signal = \"bed\", gain = 2.4, reference = 0.0 }, { signal = \"wheelhead\", gain = 1, reference = 0.0 } ]\n\
        envelope = \"e.json\"\noutside = \"shrink\"";
    let e = |text: &str| machine(linear, &[("e.json", text.as_bytes())]);
    let loaded = e(ENVELOPE).unwrap();
    let envelope = loaded.profile.axes[0].settings.models[0].envelope.as_ref().unwrap();
    assert_eq!((envelope.outside(), envelope.inputs().len()), (Outside::Shrink, 2));
    let reported = reported(&loaded);
    let words = "identified on bed 20 … 30 °C, (wheelhead − its value at machine start) 0 … 9 °C, up to a \
                 Mahalanobis distance of 3.0";
    assert!(reported.contains(words) && reported.contains("the gateway reduces Cz"), "{reported}");
    let exact =
        e(&ENVELOPE.replace("\"min\": 20, \"max\": 30", "\"min\": 20.123456789, \"max\": 30.98765432"))
            .unwrap();
    assert!(self::reported(&exact).contains("bed 20.123 … 30.988 °C"), "{}", self::reported(&exact));
    for (from, to, words) in [
        ("[[4, 1], [1, 4]]", "[[4, 4], [4, 4]]", "not positive definite: input wheelhead"),
        ("[[4, 1], [1, 4]]", "[[4]]", "1 rows of 1 columns; 2 inputs need as many rows and columns"),
        ("[[4, 1], [1, 4]]", "[[4, 1], [2, 4]]", "not symmetric: the number for (bed, wheelhead)"),
        ("\"mean\": 24", "\"mean\": 34", "bed: `mean` must be between"),
        ("\"bed\"", "\"scale_z\"", "input `scale_z` of this file is not a signal of the model"),
        ("\"mean\": 24", "\"median\": 24", "unknown field `median`"),
    ] {
        let file = ENVELOPE.replace(from, to);
        refused_at(linear, &[("e.json", file.as_bytes())], ".envelope", &["e.json: ", words]);
    }
    let file: &[File<'_>] = &[("e.json", ENVELOPE.as_bytes())];
    refused_at(&linear.replace("envelope = \"e.json\"", ""), file, ".outside", &["needs `envelope`"]);
    refused_at(&linear.replace("shrink", "stop"), file, ".outside", &["allowed: agree, warn, hold, shrink"]);
}

pub(super) const HALVES: &str = r#"{ "format": "isotherm-halves", "version": 1, "terms": [
  { "signal": "bed", "lag_s": 360, "ridge": 2, "net": 2.8 }, { "signal": "wheelhead", "lag_s": 0, "ridge": 1, "net": 1 } ] }"#;
pub(super) const HALVED: &str = "kind = \"linear\"\nterms = [ { signal = \"bed\", gain = 2.4, reference = 0.0, lag = \"6min\" }, \
    { signal = \"wheelhead\", gain = 1, reference = 0.0 } ]\nenvelope = \"e.json\"\nhalves = \"h.json\"";

#[test]
fn outside_its_envelope_a_model_with_halves_agrees_with_itself_and_one_without_only_warns() {
    let files: [File<'_>; 2] = [("e.json", ENVELOPE.as_bytes()), ("h.json", HALVES.as_bytes())];
    let outside = |keys: &str| {
        let loaded = machine(keys, &files).unwrap();
        let envelope = loaded.profile.axes[0].settings.models[0].envelope.as_ref().unwrap();
        (envelope.outside(), envelope.apart().len(), reported(&loaded))
    };
    let (found, apart, reported) = outside(HALVED);
    assert_eq!((found, apart), (Outside::Agree, 2));
    assert!(reported.contains("outside, Cz follows the model as far as its two halves agree"), "{reported}");
    assert_eq!(outside(&format!("{HALVED}\noutside = \"agree\"")).0, Outside::Agree);
    assert_eq!(outside(&format!("{HALVED}\noutside = \"hold\"")).0, Outside::Hold);
    let without = HALVED.replace("halves = \"h.json\"", "");
    assert_eq!((outside(&without).0, outside(&without).1), (Outside::Warn, 0));
    assert_eq!(outside(&format!("{without}\noutside = \"agree\"")).0, Outside::Warn);
}

#[test]
fn halves_of_another_model_are_refused_with_the_term() {
    for (from, to, words) in [
        (
            "2.8",
            "2.9",
            "another model: term 1 of the model is bed with a gain of 2.4, but the mean of the gains in the \
             two halves is 2.45",
        ),
        ("360", "0", "term 1 of the model is bed with a lag of 6m, but the file has bed with a lag of 0 s"),
        (
            "wheelhead",
            "scale_z",
            "term 2 of the model is wheelhead with a lag of 0s, but the file has scale_z with a lag of 0 s",
        ),
        (
            ", { \"signal\": \"wheelhead\", \"lag_s\": 0, \"ridge\": 1, \"net\": 1 }",
            "",
            "it has 1 terms, but the model has 2",
        ),
        ("\"version\": 1", "\"version\": 2", "this program reads version 1"),
        ("isotherm-halves", "isotherm-envelope", "\"isotherm-halves\" is required"),
        ("\"net\": 1", "\"net\": 1, \"other\": 1", "unknown field `other`"),
    ] {
        assert!(HALVES.contains(from), "{from}");
        let file = HALVES.replace(from, to);
        let files: [File<'_>; 2] = [("e.json", ENVELOPE.as_bytes()), ("h.json", file.as_bytes())];
        refused_at(HALVED, &files, ".halves", &["h.json: ", words]);
    }
    let files: [File<'_>; 2] = [("e.json", ENVELOPE.as_bytes()), ("h.json", HALVES.as_bytes())];
    refused_at(&HALVED.replace("envelope = \"e.json\"", ""), &files, ".halves", &["needs `envelope`"]);
    let slope = "slope = { position = \"scale_z\", reference = 0.0, terms = [ { signal = \"bed\", gain = 0.01, reference = 0.0 } ] }";
    refused_at(&format!("{HALVED}\n{slope}"), &files, ".halves", &["only a linear model without a slope"]);
}

pub(super) const STAND_INS: &str = r#"{ "format": "isotherm-stand-ins", "version": 1, "sensors": [
  { "signal": "bed", "threshold": 0.31, "stands_in": true, "terms": [
    { "signal": "wheelhead", "lag_s": 360, "gain": 0.4 }, { "signal": "scale_z", "lag_s": 0, "gain": 0.001 }] },
  { "signal": "wheelhead", "threshold": 0.2, "stands_in": false, "terms": [{ "signal": "bed", "lag_s": 0, "gain": 1.1 }] } ] }"#;
const WATCHED: &str = "kind = \"linear\"\nterms = [ { signal = \"bed\", gain = 2.4, reference = 0.0 } ]\nstand_ins = \"s.json\"";

#[test]
fn stand_ins_say_who_is_watched_and_for_whom_others_stand_in() {
    let watched = |text: &str| machine(WATCHED, &[("s.json", text.as_bytes())]).unwrap();
    let loaded = watched(STAND_INS);
    let of = |loaded: &Loaded| loaded.profile.axes[0].settings.models[0].stand_ins.clone().unwrap();
    assert_eq!(
        of(&loaded).watched().map(|(_, replaces)| replaces).collect::<Vec<_>>(),
        [Replaces::FrozenOrLost, Replaces::Nothing]
    );
    let words = "2 sensors are checked for frozen readings; replaced by other sensors if frozen or \
                 lost: bed; not replaced by other sensors: wheelhead";
    assert!(reported(&loaded).contains(words), "{}", reported(&loaded));
    let one = watched(&STAND_INS.replace(", { \"signal\": \"scale_z\", \"lag_s\": 0, \"gain\": 0.001 }", ""));
    let one = of(&one);
    assert!(one.watched().all(|(_, replaces)| replaces == Replaces::Nothing), "one other is too few");
    let unfit = watched(&STAND_INS.replace("\"stands_in\": true", "\"stands_in\": false"));
    assert_eq!(of(&unfit).watched().next().unwrap().1, Replaces::Frozen);
    let words = "replaced by other sensors if frozen, but not if lost: bed";
    assert!(reported(&unfit).contains(words), "{}", reported(&unfit));
    assert_eq!(of(&loaded), of(&watched(STAND_INS)), "the same file is the same");
    let other = of(&watched(&STAND_INS.replace("0.31", "0.32")));
    assert_ne!(of(&loaded).fingerprint(), other.fingerprint());
    for (from, to, words) in [
        (
            "\"wheelhead\", \"lag_s\": 360",
            "\"wheelhed\", \"lag_s\": 360",
            "no signal `wheelhed`; did you mean `wheelhead`?",
        ),
        ("\"wheelhead\", \"lag_s\": 360", "\"bed\", \"lag_s\": 360", "bed: a sensor cannot replace itself"),
        ("\"wheelhead\", \"threshold\"", "\"bed\", \"threshold\"", "bed is listed twice"),
        ("0.31", "0", "bed: the threshold must be above 0 °C"),
        ("360", "-1", "bed: a lag of -1 s is not between 0 and a week"),
        ("360", "1e9", "is not between 0 and a week"),
        (
            "[{ \"signal\": \"bed\", \"lag_s\": 0, \"gain\": 1.1 }]",
            "[]",
            "wheelhead: this sensor has 0 terms",
        ),
        ("\"gain\": 1.1", "\"gain\": \"1.1\"", "invalid type"),
        ("isotherm-stand-ins", "isotherm-halves", "\"isotherm-stand-ins\" is required"),
        ("\"version\": 1", "\"version\": 2", "this program reads version 1"),
    ] {
        assert!(STAND_INS.contains(from), "{from}");
        let file = STAND_INS.replace(from, to);
        refused_at(WATCHED, &[("s.json", file.as_bytes())], ".stand_ins", &["s.json: ", words]);
    }
    refused_at(WATCHED, &[], ".stand_ins", &["s.json"]);
}

#[test]
fn what_says_of_others_what_they_read_is_used_and_is_a_temperature() {
    let watched = |text: &str| machine(WATCHED, &[("s.json", text.as_bytes())]).unwrap();
    let loaded = watched(STAND_INS);
    assert!(
        !reported(&loaded)
            .contains("only recorded (no model, condition, output or machine state uses them): wheelhead")
    );
    let doubts = |loaded: &Loaded| {
        loaded.warnings.iter().filter(|warning| warning.message.contains("not a temperature")).count()
    };
    assert_eq!(doubts(&loaded), 0);
    let position = STAND_INS.replace("\"wheelhead\", \"threshold\"", "\"scale_z\", \"threshold\"");
    let loaded = watched(&position);
    assert_eq!(doubts(&loaded), 1, "{:?}", loaded.warnings);
}

#[test]
fn to_agree_without_halves_is_warned_of_where_it_is_asked_for() {
    let doubts = |outside: &str| {
        let model = HALVED.replace("halves = \"h.json\"", outside);
        let loaded = machine(&model, &[("e.json", ENVELOPE.as_bytes())]).unwrap();
        loaded
            .warnings
            .iter()
            .filter(|warning| warning.message.contains("= \"agree\" needs `halves`"))
            .count()
    };
    assert!(HALVED.contains("halves = \"h.json\""), "{HALVED}");
    assert_eq!((doubts(""), doubts("outside = \"agree\""), doubts("outside = \"warn\"")), (0, 1, 0));
}
