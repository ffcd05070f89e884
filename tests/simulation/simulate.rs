//! Simulation of whole gateways on simulated machines, by seed:
//! `cargo run --release --example simulate -- --seeds 1..1000 --for 8h`.

#![allow(clippy::print_stdout, reason = "this is a program")]

mod day;
mod disk;
mod framing;
mod laws;
mod link;
mod machine;
mod many;
mod nodes;
mod panel;
mod people;
mod scene;
mod script;
mod second_master;
mod serial_side;
mod stream;
mod time;

use std::process::ExitCode;
use std::time::Duration;

use clap::{Args, Parser};
use day::Without;
use many::Many;
use scene::Scene;

/// Simulates whole gateways on simulated machines, and checks the laws of the offset. A seed repeats its day bit for
/// bit. With SIMULATION_TRACE=1, all events are printed.
#[derive(Debug, Parser)]
struct Arguments {
    /// First and last seed.
    #[arg(long, default_value = "1..100", value_parser = seeds)]
    seeds: (u64, u64),
    /// Simulated time of each machine.
    #[arg(long = "for", default_value = "8h", value_parser = humantime::parse_duration)]
    span: Duration,
    /// Number of seeds that run in parallel.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    #[command(flatten)]
    machine: Machine,
    /// The module is on an RTU line with another master, which reads other registers of the same form.
    #[arg(long, conflicts_with_all = ["nodes", "panel", "gateway"])]
    second_master: bool,
    /// Removes a rule of the gateway, so that a law is broken. The thermocouple module has no checks: neither another
    /// module nor other settings are detected. With --gateway, late replies are not waited for. With --second-master,
    /// the rate of the readings is not limited.
    #[arg(long, conflicts_with = "nodes")]
    unchecked: bool,
}

/// Machine other than the usual one.
#[derive(Debug, Args)]
#[group(multiple = false)]
struct Machine {
    /// Sensors and control are OPC UA servers.
    #[arg(long)]
    nodes: bool,
    /// The settings of the thermocouple module are changed at its panel.
    #[arg(long)]
    panel: bool,
    /// The module is behind a Modbus gateway of a serial line, which uses a late reply for the request that is open
    /// then.
    #[arg(long)]
    gateway: bool,
}

impl Machine {
    fn scene(&self, is_unchecked: bool) -> Scene {
        match (self, is_unchecked) {
            (Machine { nodes: true, .. }, _) => Scene::usual(day::profile_of_nodes()),
            (Machine { panel: true, .. }, true) => Scene::panel(&day::text_without_checks()),
            (Machine { panel: true, .. }, false) => Scene::panel(day::TEXT),
            (Machine { gateway: true, .. }, _) => Scene::gateway(!is_unchecked),
            (_, true) => Scene::usual(day::profile_without_checks()),
            (_, false) => Scene::usual(day::profile()),
        }
    }
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
    let arguments = Arguments::parse();
    let Arguments { seeds: (first, last), span, threads, machine, second_master, unchecked } = arguments;
    let scene = match second_master {
        true => Scene::second_master("modbus-rtu-over-tcp", !unchecked),
        false => machine.scene(unchecked),
    };
    let seeds: Vec<u64> = (first..=last).collect();
    let many = Many::run(&scene, &seeds, span, threads, Without::Nothing);
    println!("{many}");
    if many.broken.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
