//! Benchmark of planning and checking.
//!
//! - Planning the reads of a device: 120 signals in four tables, some adjacent, some far apart.
//! - Checking a profile of 5,000 devices, each with eight signals, an axis and its own line. Limits: 1 s, and five times
//!   the time for a quarter of it.

#![allow(clippy::unwrap_used, reason = "a bench may stop where it stands")]

use std::fmt::Write;
use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use isotherm::clock::Clock;
use isotherm_core::reading::SignalId;
use isotherm_profile::Profile;
use isotherm_profile::plan::plan;
use isotherm_profile::preview::Preview;

/// Profile with one device of many signals, and an axis that uses one of them.
fn profile() -> Profile {
    let mut text = String::from(
        r#"
[machine]
name = "bench"
[bus.cell]
type = "modbus-tcp"
address = "127.0.0.1:1502"
[device.module]
bus = "cell"
unit = 1
[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
every = "10s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "first"
kind = "linear"
terms = [ { signal = "input0", gain = 1.0, reference = 0.0 } ]
"#,
    );
    for place in 0..30 {
        for (table, stride, kind) in
            [("input", 1, "i16"), ("holding", 7, "i32"), ("coil", 3, ""), ("discrete", 90, "")]
        {
            writeln!(
                text,
                "[signal.{table}{place}]\ndevice = \"module\"\nregister = \"{table}:{}\"",
                place * stride
            )
            .unwrap();
            if !kind.is_empty() {
                writeln!(text, "type = \"{kind}\"\nword_order = \"msw-first\"").unwrap();
            }
        }
    }
    isotherm_profile::parse(Path::new("bench.toml"), &text, &[], &[])
        .unwrap_or_else(|errors| panic!("{errors}"))
        .profile
}

fn plan_reads(criterion: &mut Criterion) {
    let profile = profile();
    let signals = || profile.signals.iter().enumerate().map(|(place, signal)| (SignalId(place), signal));
    let requests = plan(&profile.devices[0], signals()).len();
    criterion.bench_function(&format!("plan 120 signals into {requests} requests"), |bencher| {
        bencher.iter(|| plan(black_box(&profile.devices[0]), signals()));
    });
}

/// Profile with this number of devices, each with its own line, axis and output, and with eight signals.
fn large(devices: usize) -> String {
    let mut text = String::from("[machine]\nname = \"large\"\n");
    for device in 0..devices {
        let address = format!("127.0.{}.{}:502", device / 250, device % 250 + 1);
        write!(
            text,
            "[bus.b{device}]\ntype = \"modbus-tcp\"\naddress = \"{address}\"\n\
             [device.d{device}]\nbus = \"b{device}\"\nunit = 1\nevery = \"1s\"\n\
             [axis.z{device}]\nlimit = 40.0\nstep = 1.0\nrate = 0.5\nevery = \"1s\"\n\
             on_fault = {{ action = \"hold\" }}\n[[axis.z{device}.model]]\nname = \"bed\"\nkind = \"linear\"\n\
             terms = [ {{ signal = \"s{device}_0\", gain = 1.0, reference = 27.5 }} ]\n\
             [output.o{device}]\naxis = \"z{device}\"\ndevice = \"d{device}\"\nregister = \"holding:10\"\n\
             writes = \"offset\"\ntype = \"i16\"\nscale = 0.1\n"
        )
        .unwrap();
        for place in 0..8 {
            write!(
                text,
                "[signal.s{device}_{place}]\ndevice = \"d{device}\"\nregister = \"input:{place}\"\n\
                 type = \"i16\"\nscale = 0.1\nunit = \"degC\"\nmax_age = \"5s\"\n"
            )
            .unwrap();
        }
    }
    text
}

/// Does the work of `isotherm check`, with the printed text and the warnings.
fn check(text: &str) -> usize {
    let loaded = isotherm_profile::parse(Path::new("large.toml"), text, &[], &[])
        .unwrap_or_else(|errors| panic!("{errors}"));
    let warnings: usize = loaded.warnings.iter().map(|warning| warning.to_string().len()).sum();
    warnings + Preview::of(&loaded.profile).to_string().len()
}

fn check_large(criterion: &mut Criterion) {
    let clock = Clock::wall();
    let took = [1_250, 5_000].map(|devices| {
        let text = large(devices);
        let begun = clock.now();
        black_box(check(black_box(&text)));
        clock.now().since(begun).as_secs_f64()
    });
    let growth = took[1] / took[0];
    for (words, is_reached) in [
        (format!("5,000 devices checked in {:.2} s, limit 1", took[1]), took[1] <= 1.0),
        (format!("{growth:.1} times what 1,250 take, limit 5"), growth <= 5.0),
    ] {
        println!("{words}: {}", if is_reached { "reached" } else { "MISSED" });
    }
    let text = large(500);
    criterion.bench_function("check a profile of 500 devices", |bencher| bencher.iter(|| check(&text)));
}

criterion_group!(benches, plan_reads, check_large);
criterion_main!(benches);
