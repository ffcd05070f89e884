//! Sets: their values are written together, whatever is lost on the way.

use std::collections::HashMap;
use std::time::Duration;

use isotherm::virtual_machine::SeenRequest;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use crate::faults::law;
use crate::faults::rig::{Trace, run};

const MINUTE: Duration = Duration::from_secs(60);
const BLOCK: &str = include_str!("plc.toml");

/// Set whose sequence register is far from the values, and whose values are not adjacent. It needs several requests.
fn apart() -> String {
    BLOCK
        .replace("holding:103", "holding:140")
        .replace("holding:110", "holding:130")
        .replace("\"holding:104\"", "\"holding:120\"")
}

fn shaken(text: &str) -> String {
    let keys = "handshake = { strobe = \"coil:20\", acknowledge = \"input:16.0\", timeout = \"400ms\" }";
    text.replace("[set.block]", &format!("[set.block]\n{keys}"))
}

fn plc(keys: &str) -> String {
    format!("[[fault]]\ndevice = \"plc\"\n{keys}\n")
}

/// Checks every invariant, and that the control always took a whole set: X is −Z, and Y is Z.
fn holds(trace: &Trace) {
    law::holds(trace);
    law::nothing_taken_jumps(trace);
    for taken in &trace.taken {
        let members = trace.profile.sets[0].members(&trace.profile);
        let values: Vec<f64> =
            members.zip(&taken.words).map(|(output, words)| output.encoding.decode(words).unwrap()).collect();
        let [x, y, z] = values[..] else { panic!("{values:?}") };
        assert!((x + z).abs() < 1e-9 && (y - z).abs() < 1e-9, "half a set: {values:?}\n{}", trace.lines());
    }
    assert!(trace.taken.len() > 10, "{}", trace.taken.len());
}

fn writes(trace: &Trace) -> impl Iterator<Item = &SeenRequest> {
    trace.wire.iter().filter(|seen| seen.is_write())
}

#[test]
fn a_set_side_by_side_is_one_request_with_its_sequence_and_its_complement() {
    let trace = run(BLOCK, "", 2 * MINUTE);
    holds(&trace);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    let mut last = 0;
    for seen in writes(&trace) {
        assert_eq!(
            (seen.function, seen.address.register().unwrap().offset, seen.count),
            (16, 103, 8),
            "{seen:?}"
        );
        assert_eq!(seen.wanted[0], last + 1, "the sequence counts up by one: {seen:?}");
        last = seen.wanted[0];
        let sum = seen.wanted[..7].iter().fold(0u16, |sum, word| sum.wrapping_add(*word));
        assert_eq!(seen.wanted[7], !sum, "{seen:?}");
    }
    assert!(last > 15 && trace.outcome.rested, "{last} {:?}", trace.outcome);
}

/// A late set restores an earlier number. A control that accepts only a different number would ignore a number that
/// comes twice.
#[test]
fn an_older_number_that_is_put_back_makes_none_come_twice() {
    for text in [BLOCK.to_owned(), shaken(BLOCK), apart(), shaken(&apart())] {
        let at = if text.contains("holding:140") { 140 } else { 103 };
        let back = |second: u32, number: u32| {
            plc(&format!(
                "kind = \"register\"\nat = \"{second}s\"\nregister = \"holding:{at}\"\nwords = [{number}]"
            ))
        };
        let faults: String = (4..40).map(|second| back(3 * second, second / 4)).collect();
        let trace = run(&text, &faults, 3 * MINUTE);
        law::holds(&trace);
        law::nothing_taken_jumps(&trace);
        let sent = writes(&trace).filter(|seen| seen.address.register().unwrap().offset == at);
        let sent: Vec<u16> = sent.map(|seen| seen.wanted[0]).collect();
        assert!(sent.len() > 20 && sent.windows(2).all(|two| two[1] == two[0] + 1), "{sent:?}");
    }
}

#[test]
fn a_set_that_lies_apart_has_its_sequence_written_last_and_is_never_taken_by_half() {
    let trace = run(&apart(), "", 2 * MINUTE);
    holds(&trace);
    let offsets: Vec<u16> = writes(&trace).map(|seen| seen.address.register().unwrap().offset).collect();
    for set in offsets.chunks(4) {
        assert_eq!(set, [106, 120, 130, 140], "{offsets:?}");
    }
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
}

/// Requests are lost one after another at every place of an exchange: before, inside and after a set.
#[test]
fn whatever_is_lost_on_the_way_no_half_set_is_taken_and_nothing_jumps() {
    for (text, kind) in [
        (apart(), "close"),
        (apart(), "silent"),
        (apart(), "exception\"\ncode = \"6"),
        (BLOCK.to_owned(), "close"),
        (shaken(&apart()), "close"),
        (shaken(&apart()), "silent"),
        (shaken(BLOCK), "close"),
    ] {
        let kind = kind.replace("code = \"6", "code = 6");
        let quote = if kind.ends_with('6') { "" } else { "\"" };
        let faults: String = (0..24)
            .map(|place| plc(&format!("kind = \"{kind}{quote}\nafter = {}\nfor = 1", 60 + 41 * place)))
            .collect();
        let trace = run(&text, &faults, 8 * MINUTE);
        holds(&trace);
        assert_eq!(
            trace.reported("foreign-change") + trace.reported("disarmed"),
            0,
            "{kind}\n{}",
            trace.lines()
        );
        assert!(trace.outcome.rested, "{kind} {:?}\n{}", trace.outcome, trace.lines());
    }
}

/// Script with a fault every hundred seconds, at any place of an exchange, for one answer or for some time.
fn day(seed: u64, with_handshake: bool) -> String {
    let mut random = Pcg32::seed_from_u64(seed);
    let kinds = [
        "kind = \"silent\"",
        "kind = \"late\"\ndelay = \"90ms\"",
        "kind = \"exception\"\ncode = 6",
        "kind = \"close\"",
        "kind = \"half-open\"",
        "kind = \"garbage\"",
        "kind = \"wrong-unit\"",
        "kind = \"wrong-echo\"",
        "kind = \"short-read\"",
        "kind = \"one-behind-stale\"",
    ];
    let shakes = [
        "kind = \"no-acknowledge\"",
        "kind = \"stuck-acknowledge\"",
        "kind = \"late-acknowledge\"\ndelay = \"350ms\"",
    ];
    let faults = (0..13).map(|slot| {
        let at = 30_000 + slot * 100_000 + random.random_range(0..30_000);
        let lasts = match random.random_range(0..3) {
            0 => format!("for_time = \"{}s\"", random.random_range(1..40)),
            _ => format!("for = {}", random.random_range(1..4)),
        };
        let keys = match random.random_range(0..14) {
            0 => "kind = \"restart\"".to_owned(),
            1 => format!("kind = \"refuse\"\nfor_time = \"{}s\"", random.random_range(1..40)),
            2 | 3 if with_handshake => {
                format!(
                    "{}\nfor_time = \"{}s\"",
                    shakes[random.random_range(0..3)],
                    random.random_range(1..40)
                )
            }
            other => format!("{}\n{lasts}", kinds[other % kinds.len()]),
        };
        plc(&format!("at = \"{at}ms\"\n{keys}"))
    });
    faults.collect()
}

#[test]
fn hours_of_every_fault_and_no_half_set_no_jump_and_no_strobe_left_up() {
    for seed in 0..2 {
        for (text, with_handshake) in
            [(BLOCK.to_owned(), false), (apart(), false), (shaken(BLOCK), true), (shaken(&apart()), true)]
        {
            let trace = run(&text, &day(seed, with_handshake), 25 * MINUTE);
            holds(&trace);
            assert_eq!(
                trace.reported("disarmed") + trace.reported("task-failed"),
                0,
                "{seed}\n{}",
                trace.lines()
            );
            let end: Vec<&str> =
                trace.between(1420, 1500).map(|sample| sample.status.axes[2].state).collect();
            assert!(end.iter().all(|state| *state == "active"), "{seed} {with_handshake}\n{}", trace.lines());
            let strobe = writes(&trace).filter(|seen| seen.address.register().unwrap().offset == 20).last();
            assert!(strobe.is_none_or(|seen| seen.wanted == [0]), "{strobe:?}");
        }
    }
}

#[test]
fn a_set_with_a_handshake_has_one_strobe_for_all_of_it() {
    let trace = run(&shaken(BLOCK), "", 2 * MINUTE);
    holds(&trace);
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
    let mut count: HashMap<u16, usize> = HashMap::new();
    writes(&trace).for_each(|seen| *count.entry(seen.address.register().unwrap().offset).or_default() += 1);
    // The strobe goes up once and down once for each set. It also goes down once before the first.
    assert_eq!(count[&20], 2 * count[&103] + 1, "{count:?}");
}

#[test]
fn a_missing_acknowledge_of_a_set_is_reported_by_the_name_of_the_set() {
    let faults = plc("kind = \"no-acknowledge\"\nat = \"60s\"\nfor_time = \"20s\"");
    let trace = run(&shaken(BLOCK), &faults, 3 * MINUTE);
    holds(&trace);
    let reported: Vec<_> = trace.events.iter().filter(|event| event.kind == "acknowledge-missing").collect();
    assert_eq!(reported.len(), 1, "{}", trace.lines());
    let said = "acknowledge signal of set block did not come within 400 ms (input:16.0)";
    assert_eq!(reported[0].data["cause"], said);
    for axis in 0..3 {
        let held = trace.between(73, 79).all(|sample| sample.status.axes[axis].state == "holding");
        let back = trace.between(150, 180).all(|sample| sample.status.axes[axis].state == "active");
        assert!(held && back, "{}", trace.lines());
    }
}

#[test]
fn a_foreign_change_of_one_output_switches_its_axis_off_and_the_others_go_on() {
    let faults = plc("kind = \"register\"\nregister = \"holding:104\"\nwords = [0, 55]\nat = \"60s\"");
    let trace = run(BLOCK, &faults, 3 * MINUTE);
    law::holds(&trace);
    assert_eq!((trace.reported("foreign-change"), trace.reported("disarmed")), (1, 1), "{}", trace.lines());
    let states = |axis: usize| -> Vec<&str> {
        let mut states: Vec<_> =
            trace.between(80, 180).map(|sample| sample.status.axes[axis].state).collect();
        states.dedup();
        states
    };
    assert_eq!(
        (states(0), states(1), states(2)),
        (vec!["off"], vec!["active"], vec!["active"]),
        "{}",
        trace.lines()
    );
    let after = writes(&trace).filter(|seen| trace.seconds(seen.at) > 80.0);
    let kept: Vec<u16> = after.map(|seen| seen.wanted[2]).collect();
    assert!(kept.len() > 5 && kept.iter().all(|word| *word == 55), "{kept:?}");
}

#[test]
fn a_restarted_plc_gets_its_set_again_from_zero_in_steps() {
    for text in [BLOCK.to_owned(), apart(), shaken(BLOCK)] {
        let trace = run(&text, &plc("kind = \"restart\"\nat = \"60s\""), 3 * MINUTE);
        holds(&trace);
        assert_eq!(trace.reported("cnc-restarted"), 3, "{}", trace.lines());
        assert_eq!(trace.reported("foreign-change") + trace.reported("disarmed"), 0, "{}", trace.lines());
        let z = trace.writes("plc_z");
        let after: Vec<f64> =
            z.iter().filter(|(at, _)| trace.seconds(*at) > 61.0).map(|(_, value)| *value).collect();
        assert!(after[0] <= 1.0 && after.iter().any(|value| *value > 5.0), "{after:?}");
    }
}

/// K0, tanβ and P0 in one set: from the first write on, the control has the reference position of its slope.
#[test]
fn the_three_parts_of_a_line_land_together() {
    let line = include_str!("line.toml");
    let trace = run(line, "", 2 * MINUTE);
    law::holds(&trace);
    law::nothing_taken_jumps(&trace);
    assert_eq!(trace.samples[100].status.axes[0].state, "active", "{}", trace.lines());
    for seen in writes(&trace) {
        assert_eq!(
            (seen.function, seen.address.register().unwrap().offset, seen.count),
            (16, 10, 4),
            "{seen:?}"
        );
        assert_eq!(seen.wanted[2], (-5000i16).cast_unsigned(), "P0 with every set: {seen:?}");
    }
    let slope = trace.writes("tan_beta");
    assert!(slope.iter().any(|(_, value)| value.abs() > 0.004), "{slope:?}");
}

/// A heartbeat twice a second next to the values, and every fortieth or twentieth answer is lost. If the gateway waited
/// `late` after each of them, the set would never be written.
#[test]
fn with_lost_answers_and_a_fast_heartbeat_a_set_still_follows_two_micrometres_a_minute() {
    let text = BLOCK
        .replace("[set.block]", "[set.block]\nheartbeat = \"holding:102\"")
        .replace("refresh = \"10s\"", "refresh = \"500ms\"");
    let minutes = 10;
    let warm: String = (0..2 * minutes)
        .map(|place| {
            let keys = "device = \"thermocouples\"\nkind = \"value\"\nsignal = \"bed\"";
            let value = 21.0 + 0.5 * f64::from(place);
            format!("[[fault]]\n{keys}\nvalue = {value:.1}\nat = \"{}s\"\nfor_time = \"30s\"\n", 30 * place)
        })
        .collect();
    for one_of in [40, 20] {
        let mut random = Pcg32::seed_from_u64(one_of);
        let lost = (200..5000).filter(|_| random.random_range(0..one_of) == 0);
        let lost: String =
            lost.map(|place| plc(&format!("kind = \"close\"\nafter = {place}\nfor = 1"))).collect();
        let trace = run(&text, &(warm.clone() + &lost), u32::try_from(minutes).unwrap() * MINUTE);
        holds(&trace);
        let mut behind: f64 = 0.0;
        for sample in trace.between(60, 595) {
            let wanted = 8.0 + (trace.seconds(sample.at) / 30.0).floor();
            let stands = sample.status.outputs.iter().find(|output| output.name == "plc_z").unwrap();
            behind = behind.max(wanted - stands.value.unwrap());
        }
        println!("one of {one_of} lost: {behind:.1} µm behind at most; {} sets taken", trace.taken.len());
        // The requested value rises by one at once, every half minute.
        assert!(behind <= 3.5, "one of {one_of}: {behind:.1} µm behind\n{}", trace.lines());
        assert_eq!(trace.reported("foreign-change") + trace.reported("disarmed"), 0, "{}", trace.lines());
    }
}

/// Longest time between two heartbeats after the first, s.
fn silence(trace: &Trace, register: u16) -> f64 {
    let beats = writes(trace).filter_map(|seen| {
        let first = seen.address.register()?.offset;
        (first..first + seen.count).contains(&register).then(|| trace.seconds(seen.at))
    });
    let beats: Vec<f64> = beats.filter(|at| *at < trace.seconds(trace.stopped.0)).collect();
    assert!(beats.len() > 50, "{beats:?}");
    beats.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
}

/// A write is not answered, and the control restarts. Until the write can no longer arrive, no member may be written.
#[test]
fn heartbeat_and_control_word_continue_while_a_late_write_forbids_the_members() {
    let own = "sequence = \"holding:103\"\ncomplement = \"holding:110\"";
    for (words, register) in [
        ("heartbeat = \"holding:103\"\ncontrol = \"holding:110\"", 103),
        ("heartbeat = \"holding:110\"", 110),
    ] {
        for late in ["8s", "20s"] {
            let text = BLOCK.replace(own, words).replace("refresh = \"10s\"", "refresh = \"500ms\"").replace(
                "address = \"127.0.0.1:1503\"",
                &format!("address = \"127.0.0.1:1503\"\nlate = \"{late}\""),
            );
            let faults = plc("kind = \"wrong-echo\"\nat = \"24s\"\nfor_time = \"900ms\"")
                + &plc("kind = \"restart\"\nat = \"25s\"");
            let trace = run(&text, &faults, MINUTE);
            law::holds(&trace);
            assert_eq!(trace.states_between(27, 31), ["holding"], "{}", trace.lines());
            let longest = silence(&trace, register);
            println!("late {late}, heartbeat at {register}: silent for {longest:.2} s at most");
            assert!(longest < 3.0, "late {late}: silent for {longest:.1} s\n{}", trace.lines());
        }
    }
}

/// A control that accepts only the next number, and acknowledges nothing else. Answers, strobes and acknowledges are
/// lost. Writes are executed but reported as failed.
#[test]
fn a_control_that_takes_nothing_but_the_next_number_is_never_left_behind() {
    let next = plc("kind = \"next-number\"\nat = \"0s\"\nfor_time = \"3600s\"");
    let lost = |kind: &str, count: u32| -> String {
        let quote = if kind.contains("code") { "" } else { "\"" };
        let each = (0..count)
            .map(|place| plc(&format!("kind = \"{kind}{quote}\nafter = {}\nfor = 1", 60 + 41 * place)));
        each.collect()
    };
    for text in [shaken(BLOCK), shaken(&apart())] {
        for faults in [
            lost("silent", 12),
            lost("close", 8),
            lost("exception\"\ncode = 6", 12),
            plc("kind = \"silent\"\nat = \"40s\"\nfor_time = \"65s\""),
            (40..100)
                .map(|second| {
                    plc(&format!("kind = \"silent\"\nat = \"{second}500ms\"\nfor_time = \"600ms\""))
                })
                .collect(),
            plc("kind = \"restart\"\nat = \"60s\""),
        ] {
            let trace = run(&text, &(next.clone() + &faults), 5 * MINUTE);
            law::holds(&trace);
            law::nothing_taken_jumps(&trace);
            assert_eq!(
                trace.states_between(240, 300),
                ["active"],
                "{faults}\n{}",
                trace.reported("acknowledge-missing")
            );
            let taken = trace.taken.iter().filter(|taken| trace.seconds(taken.at) > 240.0).count();
            assert!(taken > 3, "{faults}: {taken} sets are taken in the last minute\n{}", trace.lines());
            assert!(trace.outcome.rested, "{faults} {:?}\n{}", trace.outcome, trace.lines());
        }
    }
}
