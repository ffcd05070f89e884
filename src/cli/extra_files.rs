//! Files that a verb writes next to its result. A file that cannot be written is reported after the result, so that the
//! result is not lost.

use std::path::Path;

use anyhow::Context;

use super::print::say;

/// Result of writing each file, in order.
#[derive(Default)]
pub(super) struct ExtraFiles(Vec<anyhow::Result<String>>);

impl ExtraFiles {
    /// Writes a file. `what`: its content, for the message.
    pub(super) fn write(&mut self, what: &str, path: &Path, text: impl AsRef<[u8]>) {
        let written = std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()));
        self.0.push(written.map(|()| format!("{what} is in {}", path.display())));
    }

    /// Prints this line after the result, too.
    pub(super) fn say(&mut self, line: String) {
        self.0.push(Ok(line));
    }

    /// Lets the verb fail with this message after its result: a file that it must not write.
    pub(super) fn refuse(&mut self, why: String) {
        self.0.push(Err(anyhow::Error::msg(why)));
    }

    /// Prints after the result where the files are, unless a program reads it. Fails if a file could not be written.
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
