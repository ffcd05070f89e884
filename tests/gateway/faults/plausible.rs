//! Temperatures that a sensor cannot have: the numbers that devices send for an open circuit, if no key of the profile
//! describes them.

use std::time::Duration;

use crate::faults::keeping::kept_in;
use crate::faults::law;
use crate::faults::rig::{BENCH, Trace, World, block_on, profile, run};

const MINUTE: Duration = Duration::from_secs(60);

/// Bench whose temperatures have these limits instead of their own.
fn unlimited(keys: &str) -> String {
    let text = BENCH.replace("bad = [-32768, 32767]\n", "");
    let text = text.replace("range = [-10.0, 80.0]\nmax_rate = 2.0\n", keys);
    assert!(text.matches("range = [").count() == 1 && !text.contains("max_rate = 2.0"), "{text}");
    text
}

/// Lets a signal read this value from 60.5 s on.
fn sends(signal: &str, value: &str, more: &str) -> String {
    format!(
        "[[fault]]\ndevice = \"thermocouples\"\nkind = \"value\"\nsignal = \"{signal}\"\nvalue = {value}\n\
         at = \"60500ms\"\n{more}\n"
    )
}

/// Returns the largest change of the written value in the time of the fault, µm.
fn moved(trace: &Trace) -> f64 {
    let (early, late): (Vec<_>, Vec<_>) =
        trace.writes("cnc_z").into_iter().partition(|(at, _)| trace.seconds(*at) < 60.5);
    let before = early.last().unwrap().1;
    let during = late.into_iter().filter(|(at, _)| trace.seconds(*at) < 85.0);
    during.map(|(_, value)| (value - before).abs()).fold(0.0, f64::max)
}

/// Numbers for an open circuit: the ends of i16 in tenths of a degree, and floating-point numbers.
const OPEN: [(&str, &str); 5] = [
    ("bed", "-3276.8"),
    ("bed", "3276.7"),
    ("wheelhead", "1e30"),
    ("wheelhead", "-1e30"),
    ("wheelhead", "1372.0"),
];

#[test]
fn a_number_for_an_open_circuit_is_an_alarm_and_moves_no_axis() {
    for (signal, value) in OPEN {
        let trace = run(&unlimited(""), &sends(signal, value, ""), Duration::from_secs(88));
        law::holds(&trace);
        assert_eq!(trace.qualities(signal, 63, 85), ["out-of-range"], "{value}: {}", trace.lines());
        let bad: Vec<_> = trace.events.iter().filter(|event| event.kind == "signal-bad").collect();
        assert_eq!(bad.len(), 1, "{value}: {}", trace.lines());
        assert!(bad[0].text.starts_with(&format!("signal {signal}: out of range")), "{}", bad[0].text);
        if signal == "bed" {
            assert!(moved(&trace) < 0.7, "{value}: {} µm\n{}", moved(&trace), trace.lines());
        }
    }
}

/// Without limits, the axis follows the same number.
#[test]
fn none_lets_the_axis_follow_the_number() {
    let text = unlimited("range = \"none\"\nmax_rate = \"none\"\n");
    let trace = run(&text, &sends("bed", "-3276.8", ""), Duration::from_secs(88));
    assert_eq!(trace.qualities("bed", 63, 85), ["good"], "{}", trace.lines());
    assert!(moved(&trace) > 5.0, "{} µm\n{}", moved(&trace), trace.lines());
    assert_eq!(trace.reported("at-limit"), 1, "{}", trace.lines());
}

#[test]
fn an_axis_at_its_limit_for_five_minutes_is_an_alarm_with_the_signal_that_moves_it() {
    let text = unlimited("range = \"none\"\nmax_rate = \"none\"\n");
    let faults = sends("wheelhead", "1e30", "for_time = \"400s\"");
    let trace = run(&text, &faults, 9 * MINUTE);
    law::holds(&trace);
    let reported = |kind: &str| {
        let second = |at: &str| {
            let number = |from: usize| at[from..from + 2].parse::<u64>().unwrap();
            60 * (60 * number(11) + number(14)) + number(17)
        };
        let begin = second(&trace.events[0].at);
        let events = trace.events.iter().filter(|event| event.kind == kind);
        events.map(|event| (second(&event.at) - begin, event.text.as_str())).collect::<Vec<_>>()
    };
    let [(reached, _)] = reported("at-limit")[..] else { panic!("{}", trace.lines()) };
    let [(lasts, text)] = reported("limit-lasts")[..] else { panic!("{}", trace.lines()) };
    assert!((300..=310).contains(&(lasts - reached)), "{reached} s, {lasts} s");
    assert!(text.contains("largest contributions: wheelhead -"), "{text}");
    let [(over, _)] = reported("limit-over")[..] else { panic!("{}", trace.lines()) };
    assert!((455..=475).contains(&over), "{over} s");
}

#[test]
fn the_first_start_with_default_limits_names_each_signal_and_the_next_one_does_not() {
    let directory = tempfile::tempdir().unwrap();
    let without = unlimited("range = \"none\"\nmax_rate = \"none\"\n");
    let texts = [unlimited(""), without, unlimited(""), unlimited("")];
    let traces = block_on(async {
        let mut world = World::new(&texts[0], "").await;
        let mut traces = Vec::new();
        for text in &texts {
            let mut changed = profile(text);
            for (bus, before) in changed.buses.iter_mut().zip(&world.profile.buses) {
                bus.address.clone_from(&before.address);
            }
            world.profile = changed;
            let state = Some(directory.path().to_owned());
            traces.push(world.gateway().options(kept_in(state)).run(MINUTE).await);
        }
        traces
    });
    let reported: Vec<usize> = traces.iter().map(|trace| trace.reported("default-limits")).collect();
    assert_eq!(reported, [0, 0, 1, 0], "{}", traces[2].lines());
    let event = traces[2].events.iter().find(|event| event.kind == "default-limits").unwrap();
    let words =
        "signals bed, wheelhead: readings outside -40 to 200 °C or faster than 5 °C per second are rejected";
    assert!(event.text.starts_with(words), "{}", event.text);
}
