//! Command line of isotherm: arguments → verb → exit code.

use std::process::ExitCode;

use clap::Parser;
use isotherm::cli::{self, Arguments};

fn main() -> ExitCode {
    match Arguments::try_parse() {
        Ok(arguments) => cli::run(arguments),
        Err(refused) => cli::escaped(refused).exit(),
    }
}
