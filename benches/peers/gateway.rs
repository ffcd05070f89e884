//! The gateway with all its functions: quality, model, guard, and the echo of each write.

use std::path::Path;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options, Pace};

use super::fleet_profile::{REGISTERS, Work, tcp};

/// Runs the gateway without pauses, with a step of the axis in each loop, and up to `pipeline` requests under way.
pub(super) fn closed_loop(port: &str, pipeline: u8) {
    without_pauses(|device| format!("{}pipeline = {pipeline}\n", tcp(device, port)));
}

/// Runs the gateway without pauses on a serial port, with a step of the axis in each loop.
pub(super) fn rtu(port: &str) {
    without_pauses(|_| format!("type = \"modbus-rtu\"\nport = \"{port}\"\nbaud = 115200\n"));
}

pub(super) fn fleet(port: &str, work: &Work) {
    run(work.profile(&REGISTERS, |device| tcp(device, port)), Options::default());
}

fn without_pauses(line: impl Fn(u16) -> String) {
    let work = Work { devices: 1, period: Duration::from_secs(1), reads_only: false };
    let polls = Duration::from_micros(1);
    let pace = Some(Pace { polls, axes: polls });
    run(work.profile(&REGISTERS, line), Options { pace, ..Options::default() });
}

fn run(text: String, options: Options) {
    let loaded = isotherm_profile::parse(Path::new("peers.toml"), &text, &[], &[]);
    // The verb `run` reads the profile from a file, and does not keep its text either.
    drop(text);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let gateway = Gateway::new(profile, &Clock::wall(), options);
        gateway.run(std::future::pending(), std::future::pending()).await;
    });
}
