//! Benchmark of a gateway that has little to do: processor time, wake-ups and memory.
//!
//! `isotherm run` is a separate process here, as on a machine, with its web page, state and logs. A wake-up is a
//! voluntary context switch of one of its threads. The limits:
//!
//! - One device that is polled and written once per second costs 0.03 % of a core, 3 wake-ups per second and 6 MB.
//! - Twenty more lines with a device each, polled once a minute, cause no wake-ups beyond their polls. A poll has two:
//!   its timer and its answer.
//!
//! Twenty more lines whose devices never answer have no limit. Their figures are printed for comparison.
//!
//! Run it with `cargo bench --features full --bench idle`, because packages have all features. An argument sets the
//! seconds of a measurement.

#![allow(clippy::unwrap_used, clippy::cast_precision_loss, reason = "a bench may stop where it stands")]

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::net::TcpListener;
use std::time::Duration;

use isotherm::clock::Clock;

#[path = "devices/mod.rs"]
mod devices;
#[path = "fleet_profile/mod.rs"]
mod fleet_profile;
#[path = "process/mod.rs"]
mod process;
#[path = "program/mod.rs"]
mod program;

use devices::{Devices, server};
use fleet_profile::{REGISTERS, Work, tcp};
use program::Running;

/// Time before the measurement. It excludes connections, the first decisions, and the first saves of the state.
const WARM_UP: Duration = Duration::from_secs(15);
const SILENT: u16 = 20;

const MOST_OF_A_CORE: f64 = 0.03;
const MOST_WAKES: f64 = 3.0;
const MOST_WAKES_OF_A_POLL: f64 = 2.0;
const MOST_MEMORY_MB: f64 = 6.0;

/// Figures of a gateway; those of time are per second.
struct Idle {
    percent: f64,
    wakes: BTreeMap<String, f64>,
    /// Requests to the devices of the silent lines.
    requests: f64,
    memory_mb: f64,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["devices", delay_ms] => server::serve(Duration::from_millis(delay_ms.parse().unwrap())),
        [] => compare(Duration::from_secs(60)),
        [seconds] => compare(Duration::from_secs(seconds.parse().unwrap())),
        _ => panic!("idle [SECONDS]"),
    }
}

fn compare(span: Duration) {
    let mut devices = Devices::start(&["devices", "5"]);
    let work = Work { devices: 1, period: Duration::from_secs(1), reads_only: false };
    let profile = work.profile(&REGISTERS, |device| tcp(device, &devices.port));
    let one = measure("one device, 1 Hz", &profile, &mut devices, span);
    for (words, is_reached) in [
        (format!("{:.3} % of a core, limit {MOST_OF_A_CORE}", one.percent), one.percent <= MOST_OF_A_CORE),
        (format!("{:.2} wake-ups a second, limit {MOST_WAKES}", one.all()), one.all() <= MOST_WAKES),
        (format!("{:.1} MB, limit {MOST_MEMORY_MB}", one.memory_mb), one.memory_mb <= MOST_MEMORY_MB),
    ] {
        print_verdict(&words, is_reached);
    }
    let lines = profile.clone() + &silent(&devices.port, "60s");
    let silent_lines = measure("and twenty lines, a poll a minute", &lines, &mut devices, span);
    let most = MOST_WAKES + MOST_WAKES_OF_A_POLL * silent_lines.requests;
    print_verdict(
        &format!("{:.2} wake-ups a second, limit {most:.2}", silent_lines.all()),
        silent_lines.all() <= most,
    );
    // The kernel accepts the connections of this socket, and no program answers on them.
    let deaf = TcpListener::bind("0.0.0.0:0").unwrap();
    let lines = profile + &silent(&deaf.local_addr().unwrap().port().to_string(), "1s");
    measure("and twenty lines without an answer", &lines, &mut devices, span);
}

/// Returns tables of the silent lines, each with a device that is polled in this period.
fn silent(port: &str, every: &str) -> String {
    let mut text = String::new();
    for line in 0..SILENT {
        write!(
            text,
            "[bus.silent{line}]\n{}[device.silent{line}]\nbus = \"silent{line}\"\nunit = 1\nevery = \"{every}\"\n\
             [signal.silent{line}]\ndevice = \"silent{line}\"\nregister = \"input:0\"\ntype = \"i16\"\nscale = 0.1\n\
             unit = \"degC\"\nmax_age = \"5min\"\n",
            // The first address is that of the other device.
            tcp(line + 1, port)
        )
        .unwrap();
    }
    text
}

impl Idle {
    /// Returns the number of wake-ups of all threads.
    fn all(&self) -> f64 {
        self.wakes.values().sum()
    }
}

fn measure(name: &str, profile: &str, devices: &mut Devices, span: Duration) -> Idle {
    let gateway = Running::start(profile);
    let clock = Clock::wall();
    std::thread::sleep(WARM_UP);
    let memory_mb = gateway.process.memory_mb();
    let requests_before = requests(&gateway.status());
    // The answer to that request is then sent, and its connection closed.
    std::thread::sleep(Duration::from_secs(2));
    let reads = devices.counts().reads;
    let (begun, busy, wakes) = (clock.now(), gateway.process.busy(), gateway.process.wakes_by_thread());
    std::thread::sleep(span);
    let passed = clock.now().since(begun).as_secs_f64();
    let busy = gateway.process.busy() - busy;
    let after = gateway.process.wakes_by_thread();
    let reads = (devices.counts().reads - reads) as f64;
    assert!(reads > 0.9 * passed, "the device is not polled once a second: {}", gateway.log());
    let requests = (requests(&gateway.status()) - requests_before) / (passed + 2.0);
    let since = |(name, count): (String, u64)| {
        let before = wakes.get(&name).copied().unwrap_or_default();
        (name, count.saturating_sub(before) as f64 / passed)
    };
    let idle = Idle {
        percent: 100.0 * busy / passed,
        wakes: after.into_iter().map(since).filter(|(_, wakes)| *wakes > 0.0).collect(),
        requests,
        memory_mb,
    };
    let threads: Vec<String> =
        idle.wakes.iter().map(|(thread, wakes)| format!("{thread} {wakes:.2}")).collect();
    println!(
        "{name:<38}{:.3} % of a core, {:.1} MB, {:.2} wake-ups a second ({}), {requests:.2} requests a second on \
         silent lines",
        idle.percent,
        idle.memory_mb,
        idle.all(),
        threads.join(", ")
    );
    idle
}

/// Number of requests to the devices of the silent lines since the start.
fn requests(status: &serde_json::Value) -> f64 {
    let devices = status["devices"].as_array().unwrap();
    let silent = devices.iter().filter(|device| device["name"].as_str().unwrap().starts_with("silent"));
    silent.map(|device| device["requests"].as_f64().unwrap()).sum()
}

fn print_verdict(words: &str, is_reached: bool) {
    println!("    {words}: {}", if is_reached { "reached" } else { "MISSED" });
}
