//! Meshes of meshio and Gmsh: each file of another format is named with a command, and the result of this command is
//! read.
//!
//! The test needs Gmsh, and meshio below `target/tools`; `tests/run tools` installs them. Without them, it fails with a
//! message.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use isotherm_placement::fe_input::{self, FeInput};

use crate::place::process::file;

/// Points of the nodes of each tetrahedron, mm.
type Solids = Vec<Vec<[f64; 3]>>;

/// Directory of the Python programs that the tests use.
fn programs() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap().join("tools/venv/bin")
}

/// Writes the meshes with meshio. Returns the tetrahedra in each file.
fn write_meshes(home: &Path) -> BTreeMap<String, Solids> {
    let python = programs().join("python");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/meshes.py");
    let answers = home.join("answers.json");
    let ended = Command::new(&python).arg(script).arg(home).arg(&answers).output();
    let ended =
        ended.unwrap_or_else(|error| panic!("{}: {error}: `tests/run tools` makes it", python.display()));
    let reported = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "{reported} (without meshio: `tests/run tools`)");
    serde_json::from_slice(&std::fs::read(answers).unwrap()).unwrap()
}

/// Runs the command that the message names. Returns the name of its result.
fn converted(home: &Path, name: &str) -> String {
    let message = fe_input::read(&home.join(name)).expect_err("the file has another format").to_string();
    let command = message.split('`').nth(1).unwrap_or_else(|| panic!("no command: {message}"));
    let path = format!("{}:{}", programs().display(), std::env::var("PATH").unwrap_or_default());
    let mut shell = Command::new("sh");
    shell.args(["-c", command]).env("PATH", path).current_dir(home).stdin(Stdio::null());
    let ended = shell.output().unwrap();
    let printed = String::from_utf8_lossy(&ended.stdout) + String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "{command}: {printed} (without gmsh or meshio: `tests/run tools`)");
    let (_, result) = message.rsplit_once("*INCLUDE, INPUT=").unwrap_or_else(|| panic!("{message}"));
    result.to_owned()
}

/// Numbers of the solid elements in the text of a mesh.
fn solid_numbers(text: &str) -> Vec<&str> {
    let mut is_solid = false;
    let mut numbers = Vec::new();
    for line in text.lines().filter(|line| !line.is_empty()) {
        if line.starts_with('*') {
            is_solid = line.starts_with("*ELEMENT") && line.to_uppercase().contains("TYPE=C3D");
        } else if is_solid {
            numbers.push(line.split(',').next().unwrap().trim());
        }
    }
    numbers
}

/// Reads a load case that includes the mesh.
fn read_with(home: &Path, mesh: &str) -> FeInput {
    let text = std::fs::read_to_string(home.join(mesh)).unwrap();
    let members: String = solid_numbers(&text).into_iter().map(|number| format!("{number},\n")).collect();
    let case = format!(
        "*INCLUDE, INPUT={mesh}\n*ELSET, ELSET=ISO\n{members}*MATERIAL, NAME=IRON\n*ELASTIC\n110000, 0.26\n*EXPANSION\n\
         1.1e-5\n*CONDUCTIVITY\n50\n*SOLID SECTION, ELSET=ISO, MATERIAL=IRON\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\n\
         ISO, 20\n*STEP\n*HEAT TRANSFER, STEADY STATE\n*END STEP\n"
    );
    file(home, "case.inp", &case);
    fe_input::read(&home.join("case.inp")).unwrap_or_else(|faults| panic!("{mesh}: {faults}"))
}

fn solids(input: &FeInput) -> Solids {
    input.mesh.elements.iter().map(|element| input.mesh.corners(element)).collect()
}

#[test]
fn a_mesh_of_meshio_is_read_with_its_points_directly_or_by_the_command_that_is_named() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    let meshes = write_meshes(home);
    assert!(meshes.len() > 10, "{} files", meshes.len());
    for (name, wanted) in &meshes {
        let result = if name.ends_with("_abaqus.inp") { name.clone() } else { converted(home, name) };
        let found = solids(&read_with(home, &result));
        assert_eq!(found.len(), wanted.len(), "{name}");
        for (found, wanted) in found.iter().zip(wanted) {
            assert_eq!(found.len(), wanted.len(), "{name}");
            let off = found.iter().flatten().zip(wanted.iter().flatten()).map(|(one, other)| one - other);
            let most = off.fold(0.0, |most: f64, off| most.max(off.abs()));
            assert!(most < 1e-6, "{name}: {found:?}, not {wanted:?}");
        }
    }
}

#[test]
fn a_geometry_is_meshed_by_the_command_that_is_named() {
    let home = tempfile::tempdir().unwrap();
    let home = home.path();
    file(home, "box.geo", "SetFactory(\"OpenCASCADE\");\nBox(1) = {0, 0, 0, 100, 50, 20};\n");
    let input = read_with(home, &converted(home, "box.geo"));
    let volume = |solid: &Vec<[f64; 3]>| {
        let edge = |corner: usize| [0, 1, 2].map(|axis| solid[corner][axis] - solid[0][axis]);
        let [a, b, c] = [edge(1), edge(2), edge(3)];
        let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
        (a[0] * cross[0] + a[1] * cross[1] + a[2] * cross[2]) / 6.0
    };
    let volume: f64 = solids(&input).iter().map(volume).sum();
    assert!((volume - 100_000.0).abs() < 1e-3, "{volume}");
}
