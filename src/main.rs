//! The isotherm command line: arguments → verb → exit code.

use std::process::ExitCode;

use clap::Parser;
use isotherm::cli::{self, Arguments};

fn main() -> ExitCode {
    cli::run(Arguments::parse())
}
