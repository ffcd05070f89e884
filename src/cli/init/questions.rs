//! Questions on the terminal, asked one after another.

use std::io::{BufRead, Write};

use anyhow::Context;

/// One question, and the option that answers it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Question<'q> {
    /// Name of the option, without the hyphens.
    pub(super) option: &'static str,
    /// The question in a few words.
    pub(super) text: &'q str,
    /// Default answer (Enter key). `None`: there is no default, because a wrong guess would move an axis.
    pub(super) usual: Option<&'q str>,
    /// Explanation for the answer `?`.
    pub(super) help: &'q str,
}

/// Input for the answers, and output for the questions.
pub(super) struct Questions<'a> {
    input: &'a mut dyn BufRead,
    out: &'a mut dyn Write,
    /// Whether the default of each question is used without asking the question.
    pub(super) takes_defaults: bool,
    /// Accepted answers: for each, its value and the option that gives the same answer.
    taken: Vec<(&'static str, String)>,
}

impl<'a> Questions<'a> {
    pub(super) fn new(input: &'a mut dyn BufRead, out: &'a mut dyn Write, takes_defaults: bool) -> Self {
        Questions { input, out, takes_defaults, taken: Vec::new() }
    }

    /// Returns the value of the option `given`, or asks for it. After an invalid answer, asks again; an invalid option
    /// is an error. The answer `?` shows the explanation.
    pub(super) fn ask<T>(
        &mut self,
        question: Question<'_>,
        given: Option<&str>,
        understand: impl Fn(&str) -> Result<T, String>,
    ) -> anyhow::Result<T> {
        let Question { option, text, usual, help } = question;
        if let Some(given) = given {
            let understood = understand(given.trim());
            let understood = understood.map_err(|why| anyhow::anyhow!("--{option} {given}: {why}"))?;
            self.taken.push((option, given.trim().to_owned()));
            return Ok(understood);
        }
        if self.takes_defaults {
            let Some(usual) = usual else {
                anyhow::bail!(
                    "--{option} is needed with --yes, because a wrong guess would move an axis: {help}"
                );
            };
            let understood = understand(usual);
            let understood = understood.map_err(|why| anyhow::anyhow!("--{option} is needed: {why}"))?;
            self.taken.push((option, usual.to_owned()));
            return Ok(understood);
        }
        loop {
            let shown = usual.map_or(String::new(), |usual| format!(" [{usual}]"));
            let Some(line) = self.line(&format!("{text}{shown}: "))? else {
                anyhow::bail!(
                    "the input ended before the question `{text}` was answered; no profile is written. --yes uses the \
                     defaults"
                );
            };
            let answer = match (line.trim(), usual) {
                ("?", _) => {
                    writeln!(self.out, "  {help}")?;
                    continue;
                }
                ("", Some(usual)) => usual,
                ("", None) => {
                    writeln!(self.out, "  this question has no default; ? explains it")?;
                    continue;
                }
                (typed, _) => typed,
            };
            match understand(answer) {
                Ok(understood) => {
                    self.taken.push((option, answer.to_owned()));
                    return Ok(understood);
                }
                Err(why) => writeln!(self.out, "  {why}")?,
            }
        }
    }

    /// Asks the user whether to do something that takes time. Enter means yes. Returns `false` without a question if
    /// defaults are used, and at the end of the input.
    pub(super) fn agrees(&mut self, text: &str, help: &str) -> anyhow::Result<bool> {
        if self.takes_defaults {
            return Ok(false);
        }
        loop {
            let Some(line) = self.line(&format!("{text} [yes]: "))? else { return Ok(false) };
            match yes_or_no(line.trim()) {
                _ if line.trim() == "?" => writeln!(self.out, "  {help}")?,
                _ if line.trim().is_empty() => return Ok(true),
                Ok(answer) => return Ok(answer),
                Err(why) => writeln!(self.out, "  {why}")?,
            }
        }
    }

    /// Prints a prompt and reads one line; `None` at the end of the input.
    pub(super) fn line(&mut self, prompt: &str) -> anyhow::Result<Option<String>> {
        write!(self.out, "{prompt}")?;
        self.out.flush()?;
        let mut line = String::new();
        let read = self.input.read_line(&mut line).context("the answer cannot be read")?;
        if read == 0 {
            writeln!(self.out)?;
            return Ok(None);
        }
        Ok(Some(line))
    }

    /// Prints a line on the output of the questions.
    pub(super) fn show(&mut self, line: &str) -> std::io::Result<()> {
        writeln!(self.out, "{line}")
    }

    /// Returns the command that gives the same answers without questions.
    pub(super) fn command(&self, file: &str) -> String {
        let options = self.taken.iter().map(|(option, answer)| format!(" --{option}={}", in_a_shell(answer)));
        format!("isotherm init {} --yes{}", in_a_shell(file), options.collect::<String>())
    }
}

/// Returns a word of a command line, with shell quotes if it needs them.
fn in_a_shell(word: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.,:/@".contains(&byte);
    match !word.is_empty() && word.bytes().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

/// Parses an answer to a question that is answered by yes or no.
pub(super) fn yes_or_no(text: &str) -> Result<bool, String> {
    match text.to_ascii_lowercase().as_str() {
        "y" | "yes" => Ok(true),
        "n" | "no" => Ok(false),
        _ => Err("write yes or no".to_owned()),
    }
}
