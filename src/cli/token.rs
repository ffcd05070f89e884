//! `isotherm token`: a token for the page.

use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::cli::say::{say, say_beside};
use crate::observe::http::new_token;

/// A token for page and API, from the kernel's random numbers: 160 bits, as 40 letters and digits.
///
/// `token_file` below [web] names the file with the operator's, who may command; `viewer_token_file` that of those who look;
/// `scrape_token_file` that of Prometheus, which reads /metrics and nothing else.
/// A running gateway reads a file anew when it changes.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm token --out /etc/isotherm/operator.token\n  isotherm token > operator.token && chmod 600 operator.token"
)]
pub(super) struct Arguments {
    /// Writes it to a file that nobody else may read (0600), instead of to stdout; one that is there already is not touched
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let token = new_token().context("the kernel has no random numbers")?;
    let Some(path) = &arguments.out else { return Ok(say!("{token}")?) };
    write(path, &token).with_context(|| format!("{} cannot be written", path.display()))?;
    say_beside!(
        "below [web] of the profile: token_file = \"{0}\" (or viewer_token_file, scrape_token_file)",
        path.display()
    );
    Ok(())
}

fn write(path: &Path, token: &str) -> std::io::Result<()> {
    let mut file = std::fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
    file.write_all(format!("{token}\n").as_bytes())?;
    file.sync_all()
}
