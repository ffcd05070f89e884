//! Profiles: all mistakes are reported at once with their places, and valid profiles become final types.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;

use isotherm_profile::{Errors, Loaded, ProfileError};

mod arrives;
mod can;
mod can_line;
mod cantools;
mod contradictions;
mod counters;
mod data;
mod dbc_files;
mod devices;
mod doubts;
mod expected;
mod hints;
mod kept;
mod late;
mod layers;
mod limits;
mod load;
mod misplaced;
mod mistakes;
mod models;
mod mqtt;
mod notify;
mod opcua;
mod opcua_server;
mod preview;
mod probe;
mod registers;
mod seals;
mod serial;
mod serial_ascii;
mod shipped;
mod stop;
mod sysfs;
mod templates;
mod together;

/// Machine that uses every implemented feature.
const GRINDER: &str = include_str!("grinder.toml");

fn parse(text: &str) -> Result<Loaded, Errors> {
    isotherm_profile::parse(Path::new("machine.toml"), text, &[], &[])
}

/// Loads the grinder after a replacement in its text.
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

/// Returns the only error, whose place must be at the text `at`.
#[track_caller]
fn only_error(text: &str, key: &str, at: &str) -> ProfileError {
    let found = errors(parse(text));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    let error = found[0].clone();
    assert_eq!(error.key, key, "{error}");
    let (Some(line), Some(column)) = (error.line, error.column) else { panic!("{error} has no place") };
    let written = text.lines().nth(line - 1).unwrap_or_default();
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

#[test]
fn the_first_profile_of_a_process_is_read_as_the_next_ones_are() {
    let unknown = GRINDER.replacen("name = ", "nam = ", 1);
    let [first, second] = [parse(GRINDER), parse(GRINDER)];
    assert_eq!(first, second);
    let [first, second] = [parse(&unknown), parse(&unknown)];
    assert!(first.is_err());
    assert_eq!(first, second);
}

#[test]
fn what_is_read_becomes_final_types_in_the_order_of_the_file() {
    use isotherm_core::compensation::model::{Kind, Reference};
    use isotherm_profile::{Arm, Verify, Writes};
    let machine = parse(GRINDER).unwrap().profile;
    let names: Vec<&str> = machine.signals.iter().map(|signal| signal.name.as_str()).collect();
    let order = ["wheelhead", "bed", "wheelhead_open", "hydraulics", "zero_button", "cnc_on", "scale_z"];
    assert_eq!(names, order);
    assert_eq!((machine.name.as_str(), machine.arm), ("grinder-1", Arm::Auto));
    assert_eq!(machine.machine.on.map(|id| id.0), Some(3));
    assert_eq!(machine.signals[0].address.to_string(), "input:1 (30002)");
    assert_eq!(machine.signals[1].max_age.as_secs(), 5);
    assert_eq!((machine.buses[0].quirks.max_gap, machine.devices[2].quirks.max_gap), (4, 0));
    assert_eq!(machine.devices[2].quirks.pause_between_requests.as_millis(), 5);
    assert!(!machine.devices[1].functions.write_single);
    let Kind::Linear(linear) = &machine.axes[0].settings.models[0].kind else { panic!("linear") };
    assert!((linear.terms[1].gain.get() - 3.45).abs() < 1e-12);
    assert_eq!(linear.terms[1].input.reference, Reference::Start);
    assert!(matches!(machine.outputs[0].writes, Writes::Corrected { position } if position.0 == 6));
    assert_eq!((machine.outputs[1].writes, machine.outputs[1].verify), (Writes::Offset, Verify::ReadBack));
    assert_eq!(
        machine.axes[0].settings.guard.count.map(|count| count.get().to_string()),
        Some("0.1".to_owned())
    );
}
