//! Profiles: what is wrong is told at its place, all at once; what is right becomes final types.

use std::path::Path;

use isotherm::profile::{self, Errors, Loaded, ProfileError};

/// A machine in which everything that is built is used.
const GRINDER: &str = r#"[machine]
name = "grinder-1"
description = "Surface grinder"
on = "hydraulics"
zero = "zero_button"
settle = "3min"

[bus.cell]
type = "modbus-tcp"
address = "127.0.0.1:1502"
timeout = "300ms"
quirks = { pause_between_requests = "5ms", max_gap = 4 }

[device.module]
bus = "cell"
unit = 1
every = "1s"

[device.readout]
bus = "cell"
unit = 3
functions = ["read-holding", "write-multiple"]

[device.counter]
bus = "cell"
unit = 2
every = "400ms"
quirks = { max_gap = 0 }

[device.cnc]
bus = "cell"
unit = 4

[signal.wheelhead]
device = "module"
register = "30002"
type = "i16"
scale = 0.1
bad = [-32768, 32767]
unit = "degC"
range = [-10.0, 80.0]
max_rate = 2.0
max_age = "5s"
fault_when = "wheelhead_open == 1"

[signal.bed]
device = "module"
register = "input:0"
type = "i16"
scale = 0.1
unit = "degC"

[signal.wheelhead_open]
device = "module"
register = "discrete:1"

[signal.hydraulics]
device = "cnc"
register = "coil:0"

[signal.zero_button]
device = "cnc"
register = "coil:1"

[signal.cnc_on]
device = "cnc"
register = "holding:90"
type = "u16"
unit = "count"

[signal.scale_z]
device = "counter"
register = "holding:84"
type = "i32"
word_order = "lsw-first"
scale = 0.0005
unit = "mm"
range = [-50.0, 500.0]

[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
deadband = 0.1
every = "10s"
on_fault = { action = "ramp", after = "60s" }

[[axis.z.model]]
name = "difference"
kind = "linear"
terms = [
  { signal = "bed", gain = 2.4 },
  { signal = "wheelhead", expansion = 11.5e-6, length = 300, reference = "start" },
]

[[axis.z.model]]
name = "bed only"
kind = "formula"
formula = "Kz * (A - (b*t + c))"
inputs = { A = "bed" }
constants = { Kz = 2.4, b = 2e-5, c = 23.4 }

[output.readout_z]
axis = "z"
device = "readout"
writes = "corrected"
position = "scale_z"
register = "holding:10"
type = "i32"
word_order = "msw-first"
scale = 0.0001

[output.cnc_z]
axis = "z"
device = "cnc"
writes = "offset"
register = "holding:104"
type = "i32"
word_order = "msw-first"
scale = 0.1
refresh = "2s"
when = "cnc_on == 1"
share = "whole"

[heartbeat]
device = "cnc"
register = "holding:100"
every = "500ms"

[web]
listen = "127.0.0.1:0"

[history]
keep = "30d"
"#;

fn parse(text: &str) -> Result<Loaded, Errors> {
    profile::parse(Path::new("machine.toml"), text, &[], &[])
}

/// The grinder with one piece of text replaced.
fn with(from: &str, to: &str) -> Result<Loaded, Errors> {
    assert!(GRINDER.contains(from), "{from}");
    parse(&GRINDER.replacen(from, to, 1))
}

fn errors(result: Result<Loaded, Errors>) -> Vec<ProfileError> {
    match result {
        Ok(_) => panic!("the profile was taken"),
        Err(Errors(errors)) => errors,
    }
}

/// The only error, whose place must point at `at`.
#[track_caller]
fn only_error(text: &str, key: &str, at: &str) -> ProfileError {
    let found = errors(parse(text));
    assert_eq!(found.len(), 1, "{}", Errors(found));
    let error = found[0].clone();
    assert_eq!(error.key, key, "{error}");
    let (line, column) = (error.line.unwrap(), error.column.unwrap());
    let written = text.lines().nth(line - 1).unwrap();
    let rest: String = written.chars().skip(column - 1).collect();
    assert!(rest.starts_with(at), "{error}");
    error
}

#[track_caller]
fn refused(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    assert!(GRINDER.contains(from), "{from}");
    let error = only_error(&GRINDER.replacen(from, to, 1), key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn a_good_profile_is_taken_without_a_word() {
    match parse(GRINDER) {
        Ok(loaded) => assert_eq!(loaded.warnings, []),
        Err(errors) => panic!("{errors}"),
    }
}
