//! Logs that pandas, polars and pyarrow write are understood as they are meant.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::support::process::isotherm;

/// Writes the logs to this directory. Returns what they contain.
fn written(home: &Path) -> Value {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    let writes = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/logs.py");
    let ended = Command::new(&python).arg(writes).arg(home).output();
    let ended =
        ended.unwrap_or_else(|error| panic!("{}: {error}: `tests/run tools` makes it", python.display()));
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "{said} (without pandas: `tests/run tools`)");
    serde_json::from_slice(&ended.stdout).unwrap()
}

#[test]
fn logs_of_pandas_polars_and_pyarrow_have_the_same_rows() {
    let home = tempfile::tempdir().unwrap();
    let expected = written(home.path());
    let logs = expected["logs"].as_object().unwrap();
    assert!(logs.len() > 14, "{logs:?}");
    for (name, options) in logs {
        let options = options.as_array().unwrap().iter().map(|option| option.as_str().unwrap());
        let mut command = isotherm(home.path());
        command.current_dir(home.path()).args(["logs", "explain", name, "--json", "--zone", "Europe/Berlin"]);
        let ended = command.args(options).output().unwrap();
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(0), "{name}: {said}");
        let found: Value = serde_json::from_slice(&ended.stdout).unwrap();
        let rows = found["rows"].as_array().unwrap();
        assert_eq!(rows.len(), 3, "{name}: {found}");
        for (place, row) in rows.iter().enumerate() {
            assert_eq!(row["time"], expected["time"][place], "{name}: {found}");
            for (column, value) in
                found["columns"].as_array().unwrap().iter().zip(row["values"].as_array().unwrap())
            {
                let column = column["name"].as_str().unwrap();
                assert_eq!(*value, expected[column][place], "{name}, {column}: {found}");
            }
        }
        assert_eq!(found["columns"].as_array().unwrap().len(), 2, "{name}: {found}");
    }
}
