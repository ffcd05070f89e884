//! What it costs to plan the reads of a device: 120 signals in four tables, some neighbours, some far apart.

#![allow(clippy::unwrap_used, reason = "a bench may stop where it stands")]

use std::fmt::Write;
use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use isotherm_core::reading::SignalId;
use isotherm_profile::Profile;
use isotherm_profile::plan::plan;

/// A device with many signals, one axis that uses one of them.
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
terms = [ { signal = "input0", gain = 1.0 } ]
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

criterion_group!(benches, plan_reads);
criterion_main!(benches);
