//! Counters: captured before they are read, set to another value, garbled once.

use std::time::Duration;

use isotherm_core::codec::{Address, Register, Table};

use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, run};

const COMMAND: Address = Address::Modbus(Register { table: Table::Holding, offset: 132 });

fn counting(faults: &str) -> Trace {
    let counter = "counter = { max_speed = 50.0, capture = { register = \"holding:132\", value = 1 } }";
    let text = BENCH.replacen("max_rate = 50.0", counter, 1);
    assert_ne!(text, BENCH);
    run(&text, faults, Duration::from_secs(120))
}

fn shown(trace: &Trace, from: u64, to: u64) -> Vec<f64> {
    let of = |sample: &crate::faults::rig::Sample| {
        sample.status.signals.iter().find(|signal| signal.name == "scale_z").and_then(|signal| signal.value)
    };
    trace.between(from, to).filter_map(of).collect()
}

#[test]
fn a_count_is_captured_before_each_read_and_only_then_is_there_something_to_read() {
    let trace = counting("");
    law::holds(&trace);
    assert_eq!(trace.qualities("scale_z", 5, 120), ["good"], "{}", trace.lines());
    let counter = trace.profile.signals.iter().find(|signal| signal.name == "scale_z").unwrap().device;
    let seen: Vec<bool> =
        trace.wire.iter().filter(|seen| seen.device == counter).map(|seen| seen.is_write()).collect();
    assert!(seen.len() > 200, "{}", seen.len());
    assert!(seen.chunks_exact(2).all(|pair| pair == [true, false]), "command, read, command, read: {seen:?}");
    let commands = trace.wire.iter().filter(|seen| seen.device == counter && seen.is_write());
    assert!(commands.clone().all(|seen| seen.address == COMMAND && seen.wanted == [1]));
    assert!(shown(&trace, 5, 120).iter().any(|position| *position != 0.0), "the count stood still at zero");
}

#[test]
fn a_count_that_could_not_be_captured_is_no_reading() {
    let trace = counting(
        "[[fault]]\ndevice = \"counter\"\nat = \"30s\"\nkind = \"exception\"\ncode = 4\nfor_time = \"30s\"\n",
    );
    law::holds(&trace);
    assert_eq!(trace.qualities("scale_z", 10, 55), ["good", "exception"], "{}", trace.lines());
    assert_eq!(trace.qualities("scale_z", 40, 110), ["exception", "good"], "{}", trace.lines());
}

#[test]
fn a_counter_that_is_set_anew_is_reported_as_that_and_is_believed_at_its_new_place() {
    let trace = counting(
        "[[fault]]\ndevice = \"counter\"\nat = \"30s\"\nkind = \"value\"\nsignal = \"scale_z\"\nvalue = 499.0\nfor_time = \"60s\"\n",
    );
    law::holds(&trace);
    assert_eq!(trace.reported("rereferenced"), 2, "there and back\n{}", trace.lines());
    assert_eq!(shown(&trace, 60, 80).first(), Some(&499.0), "{}", trace.lines());
    let states = trace.states_between(20, 120);
    assert_eq!(states, ["active"], "the axis goes on\n{}", trace.lines());
}

/// Runs the bench with a counter of 24 bits that shows 1 for half a minute, and then this count.
fn of_24_bits(kind: &str, count: i64) -> Trace {
    let of_32_bits = "type = \"i32\"\nword_order = \"lsw-first\"\nscale = 0.0001\n";
    let of_24_bits = format!("type = \"{kind}\"\nword_order = \"lsw-first\"\nscale = 0.001\n");
    let text = BENCH.replacen(of_32_bits, &of_24_bits, 1);
    let text = text.replacen("max_rate = 50.0", "counter = { max_speed = 50.0 }", 1);
    assert!(text.contains(&of_24_bits) && text.contains("max_speed"));
    let shows = |raw: i64, keys: &str| {
        format!(
            "[[fault]]\ndevice = \"counter\"\nkind = \"sentinel\"\nsignal = \"scale_z\"\nraw = {raw}\n{keys}\n"
        )
    };
    let faults = shows(1, "for_time = \"30s\"") + &shows(count, "at = \"30s\"");
    run(&text, &faults, Duration::from_secs(60))
}

#[test]
fn an_axis_with_a_counter_of_24_bits_passes_through_zero() {
    for (kind, count) in [("u24", 0x00ff_ffff), ("i24", -1)] {
        let trace = of_24_bits(kind, count);
        assert_eq!(trace.reported("rereferenced"), 0, "{kind}\n{}", trace.lines());
        for (from, to, expected) in [(5, 28, 0.001), (33, 58, -0.001)] {
            let values = shown(&trace, from, to);
            let is_expected = |value: &f64| (value - expected).abs() < 1e-9;
            assert!(values.len() > 10 && values.iter().all(is_expected), "{kind}: {values:?}");
        }
        // The corrected position is the position plus Cz, which is at most 40 µm.
        let corrected = trace.writes("readout_z");
        assert!(corrected.iter().any(|(at, _)| trace.seconds(*at) > 40.0), "{kind}");
        assert!(corrected.iter().all(|(_, position)| position.abs() < 0.05), "{kind}: {corrected:?}");
    }
}
