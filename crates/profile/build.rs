//! Embeds the shipped device templates: the TOML and DBC files in `profiles/devices`.

use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("../../profiles/devices").canonicalize()?;
    println!("cargo::rerun-if-changed={}", folder.display());
    let mut files: Vec<PathBuf> =
        fs::read_dir(&folder)?.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>()?;
    files.sort();
    let mut code = String::new();
    for (list, ending) in [("TEMPLATES", "toml"), ("DBC_FILES", "dbc")] {
        writeln!(code, "const {list}: &[(&str, &str)] = &[")?;
        let wanted = files.iter().filter(|path| path.extension().is_some_and(|found| found == ending));
        for path in wanted {
            let name = path.file_stem().ok_or("a file without a name")?;
            writeln!(code, "    ({name:?}, include_str!({path:?})),")?;
        }
        writeln!(code, "];")?;
    }
    fs::write(Path::new(&env::var("OUT_DIR")?).join("shipped.rs"), code)?;
    Ok(())
}
