//! Files that a verb writes beside its result. One that cannot be written is said after the result, of which nothing is lost.

use std::path::Path;

use anyhow::Context;

use super::say::say;

/// What became of each.
#[derive(Default)]
pub(super) struct Beside(Vec<anyhow::Result<String>>);

impl Beside {
    /// Writes one; `what` is in it.
    pub(super) fn write(&mut self, what: &str, path: &Path, text: impl AsRef<[u8]>) {
        let written = std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()));
        self.0.push(written.map(|()| format!("{what} is in {}", path.display())));
    }

    /// Says this behind the result, too.
    pub(super) fn say(&mut self, line: String) {
        self.0.push(Ok(line));
    }

    /// Fails the verb with this, once its result was said: a file that it must not write.
    pub(super) fn refuse(&mut self, why: String) {
        self.0.push(Err(anyhow::Error::msg(why)));
    }

    /// Says where they are, behind the result, unless a program reads it.
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
