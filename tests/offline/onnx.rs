//! ONNX files that skl2onnx and onnx write, computed by isotherm and by onnxruntime.
//!
//! The test needs skl2onnx and onnxruntime below `target/tools`; `tests/run tools` installs them. Without them, it fails
//! with a message.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use isotherm_core::compensation::model::network::{ExternalFiles, Net, Onnx};
use serde::Deserialize;

/// Rows of inputs, and what onnxruntime computes from them.
#[derive(Deserialize)]
struct Answer {
    rows: Vec<Vec<f64>>,
    outputs: Vec<f64>,
}

/// Writes the files, and returns the answers of onnxruntime by the name of the file; `None` for a file whose model is to
/// be rejected.
fn answers(home: &Path) -> BTreeMap<String, Option<Answer>> {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/onnx_models.py");
    let ended = Command::new(&python).args(["-W", "ignore", script]).arg(home).output();
    let ended =
        ended.unwrap_or_else(|error| panic!("{}: {error}: `tests/run tools` makes it", python.display()));
    let reported = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "{reported} (without skl2onnx or onnxruntime: `tests/run tools`)");
    serde_json::from_slice(&ended.stdout).unwrap()
}

fn load(home: &Path, name: &str) -> Result<Onnx, String> {
    let bytes = std::fs::read(home.join(format!("{name}.onnx"))).unwrap();
    let files = Onnx::external_files(&bytes)?;
    let external: ExternalFiles =
        files.into_iter().map(|file| (file.clone(), std::fs::read(home.join(file)).unwrap())).collect();
    Onnx::with_external(&bytes, &external, 3)
}

#[test]
fn models_of_skl2onnx_give_what_onnxruntime_gives_or_are_refused_with_what_to_export() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let answers = answers(home);
    assert!(answers.len() > 30, "{} files", answers.len());
    let mut wrong = Vec::new();
    for (name, answer) in &answers {
        match (load(home, name), answer) {
            (Ok(onnx), Some(answer)) => {
                assert_eq!(answer.rows.len(), answer.outputs.len());
                assert!(!answer.rows.is_empty(), "{name}");
                let net = Net::Onnx(onnx);
                let off = answer.rows.iter().zip(&answer.outputs).map(|(row, output)| {
                    // Both compute in single precision, and may add in another order.
                    (net.output(row) - output).abs() / output.abs().max(10.0)
                });
                let most =
                    off.fold(0.0, |most: f64, off| if off > most || off.is_nan() { off } else { most });
                if most.is_nan() || most > 1e-4 {
                    wrong.push(format!("{name}: differs by {most}"));
                }
            }
            (Err(why), None) => {
                let kind = if name == "svr" { "a support vector machine" } else { "a tree ensemble" };
                if !(why.contains(&format!("the file contains {kind}")) && why.contains("`MLPRegressor`")) {
                    wrong.push(format!("{name}: {why}"));
                }
            }
            (Err(why), Some(_)) => wrong.push(format!("{name}: {why}")),
            (Ok(_), None) => wrong.push(format!("{name}: is accepted")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for name in ["standard_ridge_columns", "mlp_tanh_columns"] {
        assert_eq!(load(home, name).unwrap().columns(), ["bed", "column", "head"]);
    }
    assert_eq!(
        Onnx::external_files(&std::fs::read(home.join("external_one.onnx")).unwrap()).unwrap().len(),
        1
    );
    assert!(
        Onnx::external_files(&std::fs::read(home.join("external_each.onnx")).unwrap()).unwrap().len() > 3
    );
}
