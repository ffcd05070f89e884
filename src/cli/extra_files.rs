//! Additional output files of a verb, for example a report page. An error in writing such a file is reported only after
//! the result was printed, so that the result is not lost.

use std::path::Path;

use anyhow::Context;

use super::print::say;

/// Results of writing the files, in order: a line to print, or the error.
#[derive(Default)]
pub(super) struct ExtraFiles(Vec<anyhow::Result<String>>);

impl ExtraFiles {
    /// Writes a file. `what` describes the content in the message about it.
    pub(super) fn write(&mut self, what: &str, path: &Path, text: impl AsRef<[u8]>) {
        let written = std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()));
        self.0.push(written.map(|()| format!("{what} is in {}", path.display())));
    }

    /// Adds a line that is printed after the result.
    pub(super) fn say(&mut self, line: String) {
        self.0.push(Ok(line));
    }

    /// Makes the verb fail with this message after its result was printed, because a file must not be written.
    pub(super) fn refuse(&mut self, why: String) {
        self.0.push(Err(anyhow::Error::msg(why)));
    }

    /// Prints which files were written, unless a program reads the output. Returns an error if a file could not be
    /// written.
    pub(super) fn end(self, is_for_a_program: bool) -> anyhow::Result<()> {
        let (mut wrong, mut lines) = (Vec::new(), Vec::new());
        for written in self.0 {
            match written {
                Ok(line) => lines.push(line),
                Err(why) => wrong.push(format!("{why:#}")),
            }
        }
        if !is_for_a_program {
            lines.iter().filter(|line| !line.is_empty()).try_for_each(|line| say!("{line}"))?;
        }
        anyhow::ensure!(wrong.is_empty(), "{}", wrong.join("\n"));
        Ok(())
    }
}
