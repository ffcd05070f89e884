//! Cost of a unit that does not answer, for the other units on its line.

use std::time::Duration;

use crate::faults::law;
use crate::faults::rig::{BENCH, run};

const MINUTE: Duration = Duration::from_secs(60);

/// Bench with all its devices at one address.
fn one_line() -> String {
    let mut text = BENCH.to_owned();
    for (device, bus, unit) in [("counter", "scale", 2), ("readout", "display", 3), ("cnc", "control", 4)] {
        text = text.replace(
            &format!("[device.{device}]\nbus = \"{bus}\"\nunit = 1"),
            &format!("[device.{device}]\nbus = \"sensors\"\nunit = {unit}"),
        );
        let from = text.find(&format!("[bus.{bus}]")).unwrap();
        let to = from + text[from..].find("timeout = \"100ms\"\n").unwrap() + "timeout = \"100ms\"\n".len();
        text.replace_range(from..to, "");
    }
    text
}

#[test]
fn a_dead_unit_costs_the_live_ones_on_its_line_one_timeout_per_breaker_window() {
    let faults = "[[fault]]\ndevice = \"thermocouples\"\nkind = \"silent\"\nat = \"60s\"";
    let trace = run(&one_line(), faults, 11 * MINUTE);
    law::holds(&trace);
    let asked = |offset: u16| -> Vec<f64> {
        let of = trace
            .wire
            .iter()
            .filter(|seen| !seen.is_write() && seen.address.register().unwrap().offset == offset);
        of.map(|seen| trace.seconds(seen.at)).filter(|at| (61.0..=660.0).contains(at)).collect()
    };
    let (dead, live) = (asked(0), asked(84));
    let pauses: Vec<f64> = dead.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let lost = 599usize.saturating_sub(live.len());
    println!(
        "ten minutes: {} timeouts, {} polls of the live unit, pauses {pauses:?}",
        dead.len(),
        live.len()
    );
    // A serial line may lose three answers of a unit that answered before. Four units at one address count as units
    // behind a gateway to a serial line.
    let spared = 3;
    for (pause, full) in pauses
        .iter()
        .skip(spared)
        .zip([1.0f64, 2.0, 4.0, 8.0, 16.0].into_iter().chain(std::iter::repeat(30.0)))
    {
        assert!(*pause >= 0.75 * full - 1.0, "{pauses:?}");
    }
    assert!(dead.len() <= 32, "{} timeouts in ten minutes: {pauses:?}", dead.len());
    assert!(lost <= dead.len(), "{lost} polls lost for {} timeouts", dead.len());
    assert_eq!(trace.qualities("scale_z", 5, 660), ["good"], "{}", trace.lines());
    assert_eq!((trace.reported("device-lost"), trace.reported("link-down")), (1, 0), "{}", trace.lines());
    // The connection that an unanswered request closes is opened again for the other units at once.
    assert!(trace.beats().len() > 600, "{}", trace.beats().len());
}
