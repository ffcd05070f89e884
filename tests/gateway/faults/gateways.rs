//! A gateway from Modbus TCP to a serial line that stamps a late answer with the transaction that is open, or keeps it for the next
//! question.

use std::fmt::Write;
use std::path::Path;
use std::time::Duration;

use isotherm_profile::parse;

use crate::faults::rig::{Trace, World, block_on};

const BED: f64 = 25.1;
const OIL: f64 = 41.2;
const SECONDS_PER_SHIFT: u64 = 5;

/// One unit, or two, with a bed and an oil temperature each, in reads of the same length.
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

/// So many late answers of the first unit.
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

/// Samples in which a signal had a value, those in which it was another one's, and the exceptions and timeouts.
fn counted(trace: &Trace) -> (usize, usize, u64) {
    let (mut good, mut wrong) = (0, 0);
    for sample in &trace.samples {
        for signal in sample.status.signals.iter().filter(|signal| signal.quality == "good") {
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
    let trace = watched(&[1], "quirks = { gateway = false }", 1, REFUSED);
    let last = trace.samples.last().unwrap();
    println!(
        "{:?}",
        last.status.signals.iter().map(|signal| (&signal.name, signal.value)).collect::<Vec<_>>()
    );
    let (_, wrong, missed) = counted(&trace);
    assert!(wrong > 0 && missed == 1, "{wrong} wrong, {missed} missed");
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

/// A gateway that gives up once and is one answer behind for 40 s after that.
fn keeps(device: &str, keys: &str) -> String {
    format!("[[fault]]\ndevice = \"{device}\"\nkind = \"keep\"\nat = \"10s\"\nfor_time = \"40s\"\n{keys}\n")
}

/// The registers behind those of the signals, which the control question asks for.
const HAS_MORE: &str = "[[fault]]\ndevice = \"m1\"\nkind = \"register\"\nregister = \"input:1\"\nwords = [0, 0]\n\
                        [[fault]]\ndevice = \"m1\"\nkind = \"register\"\nregister = \"input:101\"\nwords = [0, 0]\n";

/// Two minutes beside these faults.
fn beside(quirks: &str, faults: &str) -> Trace {
    let loaded = parse(Path::new("cell.toml"), &module(&[1], quirks), &[], &[]);
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let faults = shifts(&[1], 0, "") + faults;
    block_on(async { World::of(profile, &faults).await.gateway().run(Duration::from_secs(120)).await })
}

#[test]
fn without_the_control_question_a_gateway_that_keeps_answers_exchanges_two_signals() {
    for quirks in
        ["gateway = false", "gateway = true, max_gap = 0", "gateway = true, close_after_each = true"]
    {
        let (_, wrong, _) = counted(&beside(&format!("quirks = {{ {quirks} }}"), &keeps("m1", REFUSED)));
        assert!(wrong > 0, "{quirks}");
    }
}

#[test]
fn a_gateway_that_keeps_late_answers_brings_no_wrong_reading_and_is_named() {
    for registers in ["", HAS_MORE] {
        for keys in [REFUSED, SILENT] {
            let trace = beside("quirks = { gateway = true }", &format!("{registers}{}", keeps("m1", keys)));
            let (good, wrong, missed) = counted(&trace);
            assert_eq!(wrong, 0, "{keys}");
            assert!(good > 100 && missed >= 1, "{good} good, {missed} missed");
            let last = trace.samples.last().unwrap();
            assert!(last.status.signals.iter().all(|signal| signal.quality == "good"), "{}", trace.lines());
            assert!(last.status.devices[0].failures["peer"] >= 2, "{:?}", last.status.devices[0].failures);
        }
    }
}

#[test]
fn each_miss_behind_a_gateway_costs_one_question_more_at_most_and_a_start_one() {
    for (quirks, most) in [("gateway = true", 1), ("gateway = true, max_gap = 0", 0), ("gateway = false", 0)]
    {
        for count in [0, 20] {
            let trace = watched(&[1], &format!("quirks = {{ {quirks} }}"), count, REFUSED);
            let (_, _, missed) = counted(&trace);
            let controls = trace.wire.iter().filter(|seen| seen.count == 2).count() as u64;
            assert!(controls <= most * (missed + 1), "{quirks}: {controls} for {missed} missed");
            assert_eq!(controls > 0, most > 0, "{quirks}");
        }
    }
}
