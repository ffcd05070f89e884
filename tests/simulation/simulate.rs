//! Whole gateways on simulated machines, by seed: `cargo run --release --example simulate -- --seeds 1..1000 --for 8h`.

#![allow(clippy::print_stdout, reason = "this is a program")]

mod day;
mod disk;
mod laws;
mod link;
mod machine;
mod many;
mod nodes;
mod people;
mod script;
mod stream;
mod time;

use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use day::Without;
use many::Many;

/// Runs whole gateways on simulated machines, and holds what they do to the laws of the offset. A seed repeats its day bit
/// for bit; with SIMULATION_TRACE=1 everything is printed as it happens.
#[derive(Debug, Parser)]
struct Arguments {
    /// The first and the last seed.
    #[arg(long, default_value = "1..100", value_parser = seeds)]
    seeds: (u64, u64),
    /// The time that each machine runs.
    #[arg(long = "for", default_value = "8h", value_parser = humantime::parse_duration)]
    span: Duration,
    /// Seeds at the same time.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Sensors and control are servers of OPC UA.
    #[arg(long, conflicts_with = "unchecked")]
    nodes: bool,
    /// The module with the thermocouples has no checks, so that another one in its place is not noticed.
    #[arg(long)]
    unchecked: bool,
}

fn seeds(text: &str) -> Result<(u64, u64), String> {
    let number =
        |text: &str| text.trim().parse::<u64>().map_err(|_| format!("`{text}` is no seed; as in 1..1000"));
    match text.split_once("..") {
        Some((first, last)) => match (number(first)?, number(last)?) {
            (first, last) if first > last => Err(format!("{first} comes after {last}; as in 1..1000")),
            both => Ok(both),
        },
        None => number(text).map(|only| (only, only)),
    }
}

fn main() -> ExitCode {
    let Arguments { seeds: (first, last), span, threads, nodes, unchecked } = Arguments::parse();
    let profile = match (nodes, unchecked) {
        (true, _) => day::profile_of_nodes(),
        (_, true) => day::profile_without_checks(),
        _ => day::profile(),
    };
    let seeds: Vec<u64> = (first..=last).collect();
    let many = Many::run(&profile, &seeds, span, threads, Without::Nothing);
    println!("{many}");
    if many.broken.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
