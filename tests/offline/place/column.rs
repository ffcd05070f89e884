//! FE input files of the column, and runs of the verb `place`.

use std::path::Path;
use std::sync::OnceLock;

use isotherm_placement::mesh::Kind;
use isotherm_placement::write;

use crate::place::process::{file, isotherm};

use crate::bodies::Column;
pub(crate) use crate::bodies::Warming;

/// Result of the verb.
pub(crate) struct Answer {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) said: String,
}

/// Runs `isotherm place` with these arguments in this directory.
pub(crate) fn place(home: &Path, arguments: &[&str]) -> Answer {
    place_by("ccx", home, arguments)
}

/// Runs `isotherm place` with this program instead of `ccx`.
pub(crate) fn place_by(ccx: &str, home: &Path, arguments: &[&str]) -> Answer {
    let path = std::env::var("PATH").unwrap_or_default();
    let path = ccx.rsplit_once('/').map_or(path.clone(), |(folder, _)| format!("{folder}:{path}"));
    let mut command = isotherm(home);
    // The program that replaces CalculiX reads this variable.
    if let Ok(anew) = std::env::var("TEST_WRITES_FIGURES") {
        command.env("TEST_WRITES_FIGURES", anew);
    }
    let done = command.env("PATH", path).current_dir(home).arg("place").args(arguments).output().unwrap();
    Answer {
        code: done.status.code(),
        out: String::from_utf8(done.stdout).unwrap(),
        said: String::from_utf8(done.stderr).unwrap(),
    }
}

fn coarse() -> &'static Column {
    static COLUMN: OnceLock<Column> = OnceLock::new();
    COLUMN.get_or_init(|| Column::new(120.0, Kind::Tet4))
}

/// Writes a mesh that FE input files include, and the files of these load cases. Each file ends at the end of its step.
pub(crate) fn write_inputs(home: &Path, cases: &[Warming]) {
    let column = coarse();
    let structure = write::mesh(&column.mesh) + &write::materials(&column.mesh, &column.materials);
    file(home, "structure.inc", &structure);
    for warming in cases {
        let input = write::load(&column.mesh, &column.load(*warming), "");
        file(home, &format!("{}.inp", warming.name()), &format!("*INCLUDE, INPUT=structure.inc\n{input}"));
    }
}

/// Replaces the text of the mesh.
pub(crate) fn changed(home: &Path, change: impl FnOnce(String) -> String) {
    let path = home.join("structure.inc");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(path, change(text)).unwrap();
}

/// Number of guideway nodes.
pub(crate) fn guide() -> usize {
    coarse().mesh.node_sets["GUIDE"].len()
}
