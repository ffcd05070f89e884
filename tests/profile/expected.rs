//! `expected` of a model: resolution and mistakes.

use std::time::Duration;

use super::*;

const BOTH: &str = "kind = \"linear\"\nexpected = { since_datum = [0.9, 1.1], since_touch = [0.8, 0.2] }";
const HOUR: Duration = Duration::from_hours(1);

#[test]
fn how_wrong_a_model_was_becomes_what_it_is_expected_to_be() {
    let touched = |expected: &str| {
        let loaded = parse(&GRINDER.replacen("kind = \"linear\"", expected, 1)).unwrap();
        assert_eq!(loaded.warnings, []);
        let axis = &loaded.profile.axes[0];
        assert!(axis.says_how_wrong());
        let expected = axis.settings.models[0].expected.unwrap();
        let preview = isotherm_profile::preview::Preview::of(&loaded.profile).to_string();
        (expected.after(4 * HOUR, None), expected.after(4 * HOUR, Some(HOUR)), preview)
    };
    let root = |square: f64| isotherm_core::quantity::Micron::new(square.sqrt());
    let (datum, touch, preview) = touched(BOTH);
    assert_eq!((datum, touch), (root(0.9 * 4.0 + 1.1), root(0.8 + 0.2)));
    let words = "expected within ±√(0.9·h + 1.1) µm after h hours since the datum, ±√(0.8·h + 0.2) µm since a probing (1 σ)";
    assert!(preview.contains(words), "{preview}");
    let (datum, touch, preview) = touched(&BOTH.replace(", since_touch = [0.8, 0.2]", ""));
    assert_eq!((datum, touch), (root(0.9 * 4.0 + 1.1), datum));
    assert!(preview.contains("hours since the datum (1 σ)"), "{preview}");
    assert!(!parse(GRINDER).unwrap().profile.axes[0].says_how_wrong());
}

#[test]
fn what_is_no_variance_is_refused_at_its_line() {
    for (from, to, key, at, words) in [
        (
            "[0.9, 1.1]",
            "[-0.9, 1.1]",
            "since_datum",
            "[-0.9, 1.1]",
            "[-0.9, 1.1] does not describe a variance: both numbers must be 0 or more",
        ),
        ("[0.8, 0.2]", "[0.8, -0.2]", "since_touch", "[0.8, -0.2]", "a·h + b µm²"),
        ("[0.8, 0.2]", "[0.8]", "since_touch", "[0.8]", ""),
        ("0.9,", "nan,", "since_datum[0]", "nan", ""),
        ("1.1]", "inf]", "since_datum[1]", "inf", ""),
        ("since_touch", "since_tuch", "since_tuch", "since_tuch", "did you mean `since_touch`?"),
    ] {
        assert!(BOTH.contains(from), "{from}");
        let text = GRINDER.replacen("kind = \"linear\"", &BOTH.replacen(from, to, 1), 1);
        let error = only_error(&text, &format!("axis.z.model[0].expected.{key}"), at);
        assert!(error.to_string().contains(words), "`{words}` is not in: {error}");
    }
    let text = GRINDER.replacen("kind = \"linear\"", &BOTH.replace("since_datum = [0.9, 1.1], ", ""), 1);
    let error = only_error(&text, "axis.z.model[0].expected.since_datum", "expected");
    assert!(error.to_string().contains("`since_datum` is missing"), "{error}");
}
