//! Gateway from Modbus TCP to a serial line. It sends a late answer with the transaction of the open request, or keeps
//! it for the next request.

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use isotherm_profile::parse;

use crate::faults::rig::{Trace, World, block_on};

const BED: f64 = 25.1;
const OIL: f64 = 41.2;
const SECONDS_PER_SHIFT: u64 = 5;

/// Profile with these units. Each has a bed and an oil temperature, in reads of the same length.
fn module(units: &[u8], quirks: &str) -> String {
    let mut text = String::from(
        "[machine]\nname = \"cell\"\n[bus.cell]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"\ntimeout = \"60ms\"\n",
    );
    for unit in units {
        write!(text, "[device.m{unit}]\nbus = \"cell\"\nunit = {unit}\nevery = \"1s\"\n{quirks}\n").unwrap();
        for (signal, register) in [("bed", 0), ("oil", 100)] {
            write!(
                text,
                "[signal.{signal}{unit}]\ndevice = \"m{unit}\"\nregister = \"input:{register}\"\ntype = \"i16\"\n\
                 scale = 0.1\nunit = \"degC\"\nmax_age = \"5s\"\n"
            )
            .unwrap();
        }
    }
    text
}

/// Faults with this many late answers of the first unit.
fn shifts(units: &[u8], count: u64, keys: &str) -> String {
    let mut text = String::new();
    for unit in units {
        for (signal, value) in [("bed", BED), ("oil", OIL)] {
            let (device, signal) = (format!("m{unit}"), format!("{signal}{unit}"));
            writeln!(
                text,
                "[[fault]]\ndevice = \"{device}\"\nkind = \"value\"\nsignal = \"{signal}\"\nvalue = {value}"
            )
            .unwrap();
        }
    }
    for shift in 0..count {
        let at = 3 + SECONDS_PER_SHIFT * shift;
        writeln!(text, "[[fault]]\ndevice = \"m1\"\nkind = \"shift\"\nat = \"{at}s\"\nfor = 1\n{keys}")
            .unwrap();
    }
    text
}

fn watched(units: &[u8], quirks: &str, count: u64, keys: &str) -> Trace {
    let loaded = parse(Path::new("cell.toml"), &module(units, quirks), &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let faults = shifts(units, count, keys);
    let span = Duration::from_secs(5 + SECONDS_PER_SHIFT * count);
    block_on(async { World::of(profile, &faults).await.gateway().run(span).await })
}

/// Counts of a run: samples in which a signal had its own value, samples with the value of another signal, and
/// exceptions and timeouts.
fn counted(trace: &Trace) -> (usize, usize, u64) {
    let (mut good, mut wrong) = (0, 0);
    for sample in &trace.samples {
        for signal in
            sample.status.signals.iter().filter(|signal| signal.quality == "good" && signal.name != "counter")
        {
            let right = if signal.name.starts_with("bed") { BED } else { OIL };
            let is_right = signal.value.is_some_and(|value| (value - right).abs() < 0.05);
            good += usize::from(is_right);
            wrong += usize::from(!is_right);
        }
    }
    let failures = &trace.samples.last().unwrap().status.devices[0].failures;
    let missed = ["exception", "timeout"].map(|blame| failures.get(blame).copied().unwrap_or_default());
    println!("{good} good samples, {wrong} wrong, {missed:?} exceptions and timeouts");
    (good, wrong, missed.iter().sum())
}

const REFUSED: &str = "delay = \"40ms\"\ncode = 11";
const SILENT: &str = "delay = \"110ms\"";

#[test]
fn without_the_wait_two_signals_of_one_unit_are_exchanged_for_as_long_as_one_watches() {
    // A run is void if the late answer arrives before the next request: the busy computer has sent that request late.
    for _ in 0..5 {
        let trace = watched(&[1], "quirks = { gateway = false }", 1, REFUSED);
        let last = trace.samples.last().unwrap();
        println!(
            "{:?}",
            last.status.signals.iter().map(|signal| (&signal.name, signal.value)).collect::<Vec<_>>()
        );
        let (_, wrong, missed) = counted(&trace);
        assert_eq!(missed, 1);
        if wrong > 0 {
            return;
        }
    }
    panic!("the signals were exchanged in none of five runs");
}

#[test]
fn a_hundred_late_answers_that_a_gateway_stamps_bring_no_wrong_reading() {
    let (good, wrong, missed) = counted(&watched(&[1], "quirks = { gateway = true }", 100, REFUSED));
    assert_eq!(wrong, 0);
    assert!(missed >= 100 && good > 900, "{good} good, {missed} missed");
}

#[test]
fn a_line_with_two_units_is_taken_for_one_behind_a_gateway() {
    let (good, wrong, missed) = counted(&watched(&[1, 2], "", 20, REFUSED));
    assert_eq!(wrong, 0);
    assert!(missed >= 20 && good > 400, "{good} good, {missed} missed");
}

#[test]
fn a_gateway_that_gives_up_silently_brings_no_wrong_reading_either() {
    let (good, wrong, missed) = counted(&watched(&[1], "quirks = { gateway = true }", 20, SILENT));
    assert_eq!(wrong, 0);
    assert!(missed >= 20 && good > 180, "{good} good, {missed} missed");
}

/// Seconds from the start to such a fault, and its duration in seconds. Later, the unit is known to be prompt.
const SOON: (u64, u64) = (10, 40);
const LATER: (u64, u64) = (60, 20);

/// Fault of a gateway that gives up once, and is one answer behind for as long as the fault lasts.
fn keeps((at, span): (u64, u64), keys: &str) -> String {
    format!("[[fault]]\ndevice = \"m1\"\nkind = \"keep\"\nat = \"{at}s\"\nfor_time = \"{span}s\"\n{keys}\n")
}

/// A value of two registers on the same unit.
const COUNTER: &str = "[signal.counter]\ndevice = \"m1\"\nregister = \"input:200\"\ntype = \"u32\"\nword_order = \"msw-first\"\n";

/// Runs one unit with these signals and faults for two minutes.
fn beside(quirks: &str, signals: &str, faults: &str) -> Trace {
    let text = module(&[1], &format!("quirks = {{ {quirks} }}")) + signals;
    let loaded = parse(Path::new("cell.toml"), &text, &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let faults = shifts(&[1], 0, "") + faults;
    block_on(async { World::of(profile, &faults).await.gateway().run(Duration::from_secs(120)).await })
}

#[test]
fn without_a_control_question_a_gateway_that_keeps_answers_exchanges_two_signals() {
    for (quirks, signals) in [
        ("gateway = false", COUNTER),
        ("gateway = true, close_after_each = true", COUNTER),
        ("gateway = true", ""),
    ] {
        let (_, wrong, _) = counted(&beside(quirks, signals, &keeps(SOON, REFUSED)));
        assert!(wrong > 0, "{quirks} {signals}");
    }
}

#[test]
fn a_gateway_that_keeps_late_answers_brings_no_wrong_reading_and_is_named() {
    for (fault, keys) in [(SOON, REFUSED), (SOON, SILENT), (LATER, REFUSED), (LATER, SILENT)] {
        let trace = beside("gateway = true", COUNTER, &keeps(fault, keys));
        let (good, wrong, missed) = counted(&trace);
        assert_eq!(wrong, 0, "{fault:?} {keys}");
        assert!(good > 100 && missed >= 1, "{good} good, {missed} missed");
        let last = &trace.samples.last().unwrap().status;
        assert!(last.signals.iter().all(|signal| signal.quality == "good"), "{}", trace.lines());
        assert!(last.devices[0].failures["peer"] >= 2, "{:?}", last.devices[0].failures);
        assert!(trace.lines().contains("out of order"), "{}", trace.lines());
        assert!(!trace.lines().contains("wrong number of registers"), "{}", trace.lines());
    }
}

#[test]
fn a_miss_behind_a_gateway_costs_one_question_more_at_most_and_a_start_costs_none() {
    for (quirks, count) in [("gateway = true", 0), ("gateway = true", 20), ("gateway = false", 20)] {
        let trace = beside(quirks, COUNTER, &shifts(&[1], count, REFUSED));
        let (_, _, missed) = counted(&trace);
        let (reads, polls) = (trace.wire.len() as u64, 3 * 121);
        assert!(reads <= polls + missed, "{quirks}: {reads} reads in {polls} polls, {missed} missed");
    }
}
