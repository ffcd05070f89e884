//! Scales in registers of the device: changed together with the value, changed alone, and invalid.

use std::time::Duration;

use crate::faults::rig::{BENCH, Sample, Trace, run};

/// Runs the bench with the scale of `bed` in this register. At power-on it is a tenth.
fn scaled(register: &str, faults: &str) -> Trace {
    let from = "type = \"i16\"\nscale = 0.1\nbad";
    let to = format!("type = \"i16\"\nscale_from = \"{register}\"\nbad");
    assert!(BENCH.contains(from));
    run(&BENCH.replacen(from, &to, 1), faults, Duration::from_secs(70))
}

/// Sets the register of the scale after 30 s.
fn set(register: &str, word: u16) -> String {
    format!(
        "[[fault]]\ndevice = \"thermocouples\"\nkind = \"register\"\nregister = \"{register}\"\nwords = [{word}]\nat \
         = \"30s\"\n"
    )
}

fn shown(trace: &Trace, from: u64, to: u64) -> Vec<f64> {
    let of = |sample: &Sample| sample.status.signals.iter().find(|signal| signal.name == "bed")?.value;
    trace.between(from, to).filter_map(of).collect()
}

/// Asserts that no offset moved by more than one step.
fn moves_by_steps(trace: &Trace) {
    let writes = trace.writes("cnc_z");
    assert!(writes.len() > 2, "{}", trace.lines());
    for pair in writes.windows(2) {
        assert!((pair[1].1 - pair[0].1).abs() < 1.001, "{pair:?}\n{}", trace.lines());
    }
}

#[test]
fn a_device_that_gets_another_resolution_is_followed_without_a_jump() {
    // The scale is in the request of the value, or in one of its own.
    for register in ["input:6", "holding:40"] {
        let trace = scaled(register, &set(register, 0xfffe));
        moves_by_steps(&trace);
        assert_eq!(trace.reported("scale-changed"), 1, "{register}\n{}", trace.lines());
        let event = trace.events.iter().find(|event| event.kind == "scale-changed").unwrap();
        assert!(
            event.text.contains("one count of the raw value was 0.1 °C, and is now 0.01 °C"),
            "{}",
            event.text
        );
        for (from, to) in [(8, 28), (40, 68)] {
            assert_eq!(trace.qualities("bed", from, to), ["good"], "{register}\n{}", trace.lines());
        }
        let values = shown(&trace, 8, 68);
        let (low, high) = values
            .iter()
            .fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(*value), high.max(*value)));
        assert!(high - low < 1.0, "{register}: {low} to {high}");
        assert_eq!(trace.states_between(45, 68), ["active"], "{register}\n{}", trace.lines());
    }
}

#[test]
fn a_scale_that_changes_without_its_value_makes_the_reading_bad_until_it_is_plausible_again() {
    for register in ["input:6", "holding:40"] {
        let stands = "[[fault]]\ndevice = \"thermocouples\"\nkind = \"sentinel\"\nsignal = \"bed\"\nraw = 220\nat = \
                      \"30s\"\nfor_time = \"20s\"\n";
        let trace = scaled(register, &(set(register, 0xfffe) + stands));
        moves_by_steps(&trace);
        assert_eq!(trace.qualities("bed", 34, 48), ["scale-changed"], "{register}\n{}", trace.lines());
        let writes = trace.writes("cnc_z");
        let meanwhile = writes.iter().filter(|(at, _)| (36.0..48.0).contains(&trace.seconds(*at)));
        let mut meanwhile: Vec<f64> = meanwhile.map(|(_, value)| *value).collect();
        meanwhile.dedup();
        assert!(meanwhile.len() <= 1, "{register}: {meanwhile:?}");
        let bad = trace.events.iter().find(|event| event.kind == "signal-bad").unwrap();
        for words in ["its scale in the device has changed", "isotherm confirm"] {
            assert!(bad.text.contains(words), "`{words}` is not in: {}", bad.text);
        }
        assert_eq!(trace.qualities("bed", 54, 68), ["good"], "{register}\n{}", trace.lines());
    }
}

#[test]
fn a_register_without_a_power_of_ten_gives_no_reading_and_is_no_change() {
    for register in ["input:6", "holding:40"] {
        let trace = scaled(register, &set(register, 0x8000));
        moves_by_steps(&trace);
        assert_eq!(trace.qualities("bed", 8, 28), ["good"], "{register}\n{}", trace.lines());
        assert_eq!(trace.qualities("bed", 34, 68), ["no-scale"], "{register}\n{}", trace.lines());
        assert_eq!(trace.reported("scale-changed"), 0, "{register}\n{}", trace.lines());
    }
}
