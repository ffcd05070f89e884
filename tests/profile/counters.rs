//! Signals that count.

use super::*;

const SCALE: &str = "type = \"i32\"\nword_order = \"lsw-first\"\nscale = 0.0005";

fn counting(counter: &str) -> (String, String) {
    (SCALE.to_owned(), format!("{SCALE}\ncounter = {counter}"))
}

#[test]
fn a_counter_and_its_capture_command_are_explained() {
    let (from, to) = counting("{ max_speed = 500, capture = { register = \"holding:132\" } }");
    let loaded = with(&from, &to).unwrap();
    assert_eq!(loaded.warnings, []);
    let reported = isotherm_profile::preview::Preview::of(&loaded.profile).to_string();
    for words in [
        "after a step faster than 500 mm per second until the next reading confirms it",
        "holding:132 (40133) = 1 of counter: written before each read of scale_z, also in a dry run",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn what_a_counter_cannot_be_is_refused_with_what_it_can() {
    let cases: [(&str, &str, &str, &[&str]); 5] = [
        ("{}", "signal.scale_z.counter.max_speed", "", &["is missing"]),
        ("{ max_speed = 0 }", "signal.scale_z.counter.max_speed", "0", &["above zero"]),
        ("{ max_speed = 500, capture = {} }", "signal.scale_z.counter.capture.register", "", &["is missing"]),
        (
            "{ max_speed = 500, capture = { register = \"input:3\" } }",
            "signal.scale_z.counter.capture.register",
            "\"input:3\"",
            &["read-only"],
        ),
        (
            "{ max_speed = 500, capture = { register = \"holding:84\" } }",
            "signal.scale_z.counter.capture.register",
            "\"holding:84\"",
            &["overlaps"],
        ),
    ];
    for (counter, key, at, words) in cases {
        let (from, to) = counting(counter);
        refused(&from, &to, key, at, words);
    }
    refused(
        SCALE,
        "type = \"f32\"\nword_order = \"lsw-first\"\ncounter = { max_speed = 500 }",
        "signal.scale_z.counter",
        "counter",
        &["type f32 cannot be a counter", "u16, i16, u24, i24, u32, i32"],
    );
    let (from, to) = counting("{ max_speed = 500 }\nmax_rate = 500");
    refused(&from, &to, "signal.scale_z.counter", "counter", &["max_rate"]);
}

#[test]
fn a_counter_that_goes_round_between_two_readings_is_refused_with_the_times() {
    let short = "type = \"i16\"\nscale = 0.0005\ncounter = { max_speed = 500 }";
    refused(
        SCALE,
        short,
        "signal.scale_z.counter.max_speed",
        "500",
        &["passes half of its range in 32ms", "32-bit"],
    );
}
