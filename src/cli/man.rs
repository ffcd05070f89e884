//! `isotherm man`: manual pages of the program and of each verb.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Command;

use super::print::Out;

/// Prints the manual page of the program, or writes all manual pages to a directory
#[derive(clap::Args, Debug)]
#[command(after_help = "Example:\n  isotherm man | man -l -\n  isotherm man --dir /usr/local/share/man/man1")]
pub(super) struct Arguments {
    /// Writes isotherm.1 to this directory, and a page for each verb: isotherm-run.1, …
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
}

/// Prints or writes the manual pages of `program`.
pub(super) fn run(arguments: &Arguments, program: Command) -> anyhow::Result<()> {
    match &arguments.dir {
        Some(directory) => write_all(directory, program),
        None => {
            let mut page = Vec::new();
            clap_mangen::Man::new(program).render(&mut page)?;
            Ok(Out.write_all(&page)?)
        }
    }
}

fn write_all(directory: &Path, program: Command) -> anyhow::Result<()> {
    let shown = directory.display();
    let cannot = || format!("the manual pages cannot be written to {shown}");
    std::fs::create_dir_all(directory).with_context(cannot)?;
    clap_mangen::generate_to(program, directory).with_context(cannot)
}
