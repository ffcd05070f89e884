//! The isotherm command line: arguments → tracing → verb → exit code.

use std::process::ExitCode;

use clap::Parser;
use isotherm::cli::{self, Arguments};

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    cli::start_log(arguments.log_filter());
    cli::run(arguments)
}
