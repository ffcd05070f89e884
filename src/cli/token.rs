//! `isotherm token`: creates a token for the web page.

use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::new_file::cannot_be_written;
use super::service_user;
use crate::cli::print::{say, say_beside};
use crate::observe::http::new_token;

/// Creates a token for web page and API from the kernel's random numbers: 160 bits, as 40 letters and digits.
///
/// Keys in [web] of the profile name the files with tokens. `token_file` is for operators, who may command, and
/// `viewer_token_file` for viewers. `scrape_token_file` is for Prometheus, which may only read /metrics. A running
/// gateway reads a token file again when it changes.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm token --out /etc/isotherm/operator.token\n  isotherm token > operator.token && chmod 600 operator.token"
)]
pub(super) struct Arguments {
    /// Writes the token to a new file that only its owner may read (0600), instead of to stdout; an existing file is
    /// not overwritten. If root writes it below /etc/isotherm, it belongs to the user of the service
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let token = new_token().context("the kernel has no random numbers")?;
    let Some(path) = &arguments.out else { return Ok(say!("{token}")?) };
    write(path, &token).map_err(|error| cannot_be_written(path, &error))?;
    service_user::give(path)?;
    say_beside!(
        "below [web] of the profile: token_file = \"{0}\" (or viewer_token_file, scrape_token_file)",
        path.display()
    );
    Ok(())
}

fn write(path: &Path, token: &str) -> std::io::Result<()> {
    let mut file = std::fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
    let filled = file.write_all(format!("{token}\n").as_bytes()).and_then(|()| file.sync_all());
    // A part of a token would be a wrong token.
    filled.inspect_err(|_| {
        let _ = std::fs::remove_file(path);
    })
}
