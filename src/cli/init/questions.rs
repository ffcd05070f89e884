//! Questions on the terminal, asked one after another.

use std::io::{BufRead, Write};

use anyhow::Context;

/// Input for the answers, and output for the questions.
pub(super) struct Questions<'a> {
    pub(super) input: &'a mut dyn BufRead,
    pub(super) out: &'a mut dyn Write,
    /// Whether each question gets its default without being asked.
    pub(super) takes_defaults: bool,
}

impl Questions<'_> {
    /// Returns the value of the option with this name, or asks for it. After an invalid answer, asks again; an invalid
    /// option is an error.
    pub(super) fn ask<T>(
        &mut self,
        option: &str,
        given: Option<String>,
        (question, usual): (&str, &str),
        understand: impl Fn(&str) -> Result<T, String>,
    ) -> anyhow::Result<T> {
        if let Some(given) = given {
            return understand(given.trim()).map_err(|why| anyhow::anyhow!("--{option} {given}: {why}"));
        }
        if self.takes_defaults {
            return understand(usual).map_err(|why| anyhow::anyhow!("--{option} is needed: {why}"));
        }
        loop {
            write!(self.out, "{question} [{usual}]: ")?;
            self.out.flush()?;
            let mut line = String::new();
            let read = self.input.read_line(&mut line).context("the answer cannot be read")?;
            if read == 0 {
                writeln!(self.out)?;
                anyhow::bail!(
                    "the answers ended before `{question}`; no profile is written. --yes uses the defaults"
                );
            }
            let answer = if line.trim().is_empty() { usual } else { line.trim() };
            match understand(answer) {
                Ok(understood) => return Ok(understood),
                Err(why) => writeln!(self.out, "  {why}")?,
            }
        }
    }

    /// Prints a line on the output of the questions.
    pub(super) fn show(&mut self, line: &str) -> std::io::Result<()> {
        writeln!(self.out, "{line}")
    }
}
