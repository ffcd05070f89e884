//! New files of a verb. Existing files are never overwritten. The error of a failed write names the file and a remedy.

use std::fs::File;
use std::io::{Error, ErrorKind, Write};
use std::path::Path;

use crate::fieldbus::explain::system;
use isotherm_profile::safe_file::without_numbers;

/// Creates a file with this text, and returns the open file. If the text cannot be written, removes the file.
pub(super) fn create(path: &Path, text: &str) -> anyhow::Result<File> {
    let mut file = File::create_new(path).map_err(|error| cannot_be_written(path, &error))?;
    file.write_all(text.as_bytes()).map_err(|error| {
        let _ = std::fs::remove_file(path);
        cannot_be_written(path, &error)
    })?;
    Ok(file)
}

/// Returns the error for a file that cannot be written: file, cause and remedy.
pub(super) fn cannot_be_written(path: &Path, error: &Error) -> anyhow::Error {
    let path = path.display();
    match error.kind() {
        ErrorKind::AlreadyExists => {
            anyhow::anyhow!("{path} exists already and is not overwritten: name another file")
        }
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => anyhow::anyhow!(
            "{path} cannot be written: {}; free space on that disk, or name a file on another disk",
            system(error)
        ),
        _ => {
            let why = without_numbers(&error.to_string());
            anyhow::anyhow!("{path} cannot be written: {why}; name another file")
        }
    }
}
