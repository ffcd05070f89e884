//! Five hours with every kind of fault.

use std::fmt::Write as _;
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::faults::law;
use crate::faults::rig::{BENCH, World, block_on};

const HOURS: u64 = 5;
/// Time for one fault and the recovery from it, s.
const SLOT: u64 = 400;

/// Script with a fault in each slot of the day except the last.
fn script(seed: u64) -> String {
    let mut random = Pcg32::seed_from_u64(seed);
    let kinds = [
        "kind = \"silent\"",
        "kind = \"late\"\ndelay = \"90ms\"",
        "kind = \"exception\"\ncode = 4",
        "kind = \"exception\"\ncode = 6",
        "kind = \"close\"",
        "kind = \"half-open\"",
        "kind = \"refuse\"",
        "kind = \"garbage\"",
        "kind = \"wrong-unit\"",
        "kind = \"wrong-transaction\"",
        "kind = \"wrong-function\"",
        "kind = \"short-read\"",
        "kind = \"long-read\"",
        "kind = \"wrong-echo\"",
        "kind = \"ignored-write\"",
        "kind = \"one-behind-stale\"",
    ];
    let mut text = String::new();
    for slot in 0..(HOURS * 3600 / SLOT - 2) {
        let at = 60 + slot * SLOT + random.random_range(0..30);
        let span = random.random_range(10..100);
        let device = ["thermocouples", "counter", "readout", "cnc"][random.random_range(0..4)];
        let mut fault = |device: &str, keys: &str, lasts: bool| {
            let lasts = if lasts { format!("for_time = \"{span}s\"") } else { String::new() };
            writeln!(text, "[[fault]]\ndevice = \"{device}\"\nat = \"{at}s\"\n{keys}\n{lasts}").unwrap();
        };
        match random.random_range(0..22) {
            0 => fault("cnc", "kind = \"restart\"", false),
            1 => fault("thermocouples", "kind = \"nan\"\nsignal = \"wheelhead\"", true),
            2 => fault("thermocouples", "kind = \"sentinel\"\nsignal = \"bed\"", true),
            3 => fault("thermocouples", "kind = \"value\"\nsignal = \"bed\"\nvalue = 60.0", true),
            4 => fault("cnc", "kind = \"value\"\nsignal = \"cnc_on\"\nvalue = 0", true),
            5 => fault("counter", "kind = \"value\"\nsignal = \"scale_z\"\nvalue = 499.0", true),
            other => fault(device, kinds[other - 6], true),
        }
    }
    text
}

#[test]
fn five_hours_of_every_fault_and_not_one_bad_write() {
    let text = BENCH.replace("100ms", "60ms");
    let trace = block_on(async {
        let mut world = World::new(&text, &script(7)).await;
        let mut trial = world.gateway();
        for hour in [1, 2, 4] {
            let at = Duration::from_secs(hour * 3600 + 200);
            trial = trial.at(at, |stage| stage.clock.skip(Duration::from_secs(47)));
        }
        trial.run(Duration::from_secs(HOURS * 3600)).await
    });
    println!("{} requests, {} lines told", trace.wire.len(), trace.events.len());
    law::holds(&trace);
    assert_eq!(trace.reported("disarmed") + trace.reported("task-failed"), 0, "{}", trace.lines());
    let end = HOURS * 3600;
    assert_eq!(trace.states_between(end - 300, end), ["active"], "{}", trace.lines());
    assert!(trace.outcome.rested && !trace.outcome.failed, "{:?}", trace.outcome);
    let active = trace.samples.iter().filter(|sample| sample.status.axes[0].state == "active").count();
    assert!(2 * active > trace.samples.len(), "{active} of {} samples active", trace.samples.len());
    assert!(trace.events.len() < 750, "{} lines in five hours", trace.events.len());
}
