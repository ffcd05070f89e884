//! Tests of the scale of the temperatures: °C or kelvin.

use super::*;

/// [`FILE`] with these temperatures: initial, sink, and prescribed.
fn at(initial: &str, sink: &str, held: &str) -> String {
    let text = FILE.replacen("ALL, 20\n", &format!("ALL, {initial}\n"), 1);
    let text = text.replacen("1, F1, 25, 0.008", &format!("1, F1, {sink}, 0.008"), 1);
    text.replacen("2, 11, 11, 21.5", &format!("2, 11, 11, {held}"), 1)
}

#[test]
fn a_file_in_kelvin_is_read_as_the_same_file_in_celsius() {
    let celsius = read_text(&at("20", "25", "21.5")).unwrap();
    let kelvin = read_text(&at("293.15", "298.15", "294.65")).unwrap_or_else(|faults| panic!("{faults}"));
    let near = |one: f64, other: f64| (one - other).abs() < 1e-9;
    assert!(kelvin.load.initial.iter().zip(&celsius.load.initial).all(|(one, other)| near(*one, *other)));
    assert!(near(kelvin.load.films[0].sink, celsius.load.films[0].sink));
    assert!(near(kelvin.load.held[0].1, celsius.load.held[0].1));
}

#[test]
fn temperatures_of_two_scales_in_one_file_are_refused() {
    for (initial, sink, held, wanted) in [
        (
            "20",
            "293",
            "21.5",
            "case.inp:29: *FILM: the sink temperature is 293, which is plausible in kelvin only",
        ),
        ("20", "293.15", "21.5", "The initial temperatures of the file are in °C: write all"),
        ("0", "273.15", "1", "*FILM: the sink temperature is 273.15"),
        ("150", "293", "21.5", "*FILM: the sink temperature is 293"),
        ("293", "20", "294", "*FILM: the sink temperature is 20, which is plausible in °C only"),
        ("293", "298", "21.5", "*BOUNDARY: the given temperature is 21.5, which is plausible in °C only"),
        ("20", "25", "294", "*BOUNDARY: the given temperature is 294, which is plausible in kelvin only"),
        (
            "20\n4, 293",
            "25",
            "21.5",
            "*INITIAL CONDITIONS: the temperature is 293, which is plausible in kelvin only",
        ),
        (
            "20",
            "900",
            "21.5",
            "*FILM: the sink temperature is 900, which no machine has in °C (-40 to 200 °C)",
        ),
        ("20", "-273.15", "21.5", "*FILM: the sink temperature is -273.15, which no machine has"),
        ("1000", "25", "21.5", "*INITIAL CONDITIONS: the temperature is 1000, which no machine has"),
    ] {
        let said = said(&at(initial, sink, held));
        assert!(said.contains(wanted), "{initial}, {sink}, {held}: wanted: {wanted}\nsaid: {said}");
    }
    let said = said(&at("20", "293", "21.5"));
    assert_eq!(said.lines().count(), 1, "one mistake is one error: {said}");
}

#[test]
fn plausible_temperatures_are_accepted_to_the_ends_of_their_ranges() {
    for (initial, sink, held) in [("20", "-40", "200"), ("-40", "200", "0"), ("470", "235", "273.15")] {
        read_text(&at(initial, sink, held))
            .unwrap_or_else(|faults| panic!("{initial}, {sink}, {held}: {faults}"));
    }
}
