//! Lags, slopes, levels and datums: valid combinations, and hints for invalid ones.

use isotherm_core::compensation::model::{Kind, Reference};
use isotherm_core::compensation::settings::Datum;
use isotherm_core::quantity::Celsius;

use super::*;

const SLOPE: &str = "kind = \"linear\"\nslope = { position = \"scale_z\", reference = -50.0, travel = [-350.0, 0.0], \
                     terms = [ { signal = \"bed\", gain = 0.007, reference = 20.0, lag = \"2h\" } ] }";

#[test]
fn a_lag_a_slope_levels_and_a_datum_are_taken() {
    let text = GRINDER
        .replacen("reference = 20.0 }", "reference = 20.0, lag = \"30min\" }", 1)
        .replacen("kind = \"linear\"", SLOPE, 1)
        .replacen("rate = 0.5", "rate = 0.5\nwarn = 30.0\nerror = 60.0\ndatum = \"zero\"", 1);
    let loaded = parse(&text).unwrap();
    assert_eq!(loaded.warnings, []);
    let axis = &loaded.profile.axes[0].settings;
    assert_eq!(axis.levels.warn.zip(axis.levels.error).map(|(w, e)| (w.get(), e.get())), Some((30.0, 60.0)));
    assert_eq!(axis.datum, Datum::Zero);
    let Kind::Linear(linear) = &axis.models[0].kind else { panic!("linear") };
    assert_eq!(linear.terms[0].input.time_constant().map(|span| span.as_secs()), Some(1800));
    assert_eq!(linear.terms[0].input.reference, Reference::Fixed(Celsius::new(20.0).unwrap()));
    let slope = linear.slope.as_ref().unwrap();
    assert_eq!(
        (slope.position.0, slope.terms[0].input.time_constant().map(|span| span.as_secs())),
        (6, Some(7200))
    );
    assert!((slope.reference.get() - -50.0).abs() < 1e-12);

    let reported = isotherm_profile::preview::Preview::of(&loaded.profile).to_string();
    for words in [
        "Cz = 2.4·(bed − 20) lagged by 30m + 3.45·(wheelhead − its value at machine start) + 0 µm \
         + (0.007·(bed − 20) lagged by 2h) µm/mm·(scale_z − -50 mm)",
        "when bed rises by 1 °C (63 % of the effect is reached 30m after bed has risen), Cz changes by +2.4 µm",
        "when bed rises by 1 °C and scale_z is 100 mm above -50 mm (63 % of the effect is reached 2h after bed has risen), \
         Cz changes by +0.7 µm",
        "beyond ±30 µm the gateway warns",
        "a model value beyond ±60 µm switches the axis off until it is armed",
        "Cz is the change of the model's value since the last zero command",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn a_lag_is_a_duration_above_zero_with_a_reference() {
    let at = "axis.z.model[0].terms[0].lag";
    refused("gain = 2.4", "gain = 2.4, lag = 30", at, "30", &["a duration"]);
    refused("gain = 2.4", "gain = 2.4, lag = \"0s\"", at, "\"0s\"", &["zero is not allowed"]);
    refused("gain = 2.4", "gain = 2.4, lag = \"30d\"", at, "\"30d\"", &["longer than a week"]);
}

#[test]
fn what_a_rise_is_measured_from_is_always_written() {
    for lag in ["", ", lag = \"30min\""] {
        let found = errors(with("gain = 2.4, reference = 20.0", &format!("gain = 2.4{lag}")));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert_eq!(found[0].key, "axis.z.model[0].terms[0].reference");
        let told = found[0].to_string();
        for words in ["`reference` is missing", "gain = 2.4", "20.0", "\"start\"", "\"zero\"", "0.0"] {
            assert!(told.contains(words), "`{words}` is not in: {told}");
        }
    }
    let of_slope = SLOPE.replacen("gain = 0.007, reference = 20.0, lag = \"2h\"", "gain = 0.007", 1);
    let found = errors(with("kind = \"linear\"", &of_slope));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert_eq!(found[0].key, "axis.z.model[0].slope.terms[0].reference");
    let schema = isotherm_profile::schema();
    assert!(schema["$defs"]["Term"]["required"].to_string().contains("reference"));
    assert!(with("gain = 2.4, reference = 20.0", "gain = 0.1, reference = 0.0").is_ok());
}

#[test]
fn a_slope_has_a_position_in_mm_a_reference_and_terms_in_um_per_mm() {
    let slope = |from: &str, to: &str| {
        assert!(SLOPE.contains(from), "{from}");
        with("kind = \"linear\"", &SLOPE.replacen(from, to, 1))
    };
    for (from, to, key, words) in [
        ("\"scale_z\"", "\"bed\"", "slope.position", "a position must be in mm"),
        ("\"scale_z\"", "\"scale_y\"", "slope.position", "there is no signal named `scale_y`"),
        ("reference = -50.0, ", "", "slope.reference", "missing"),
        ("[-350.0, 0.0]", "[0.0, -350.0]", "slope.travel", "smaller end first"),
        (
            "gain = 0.007",
            "expansion = 11.5e-6, length = 300",
            "slope.terms[0].expansion",
            "`expansion` and `length` are not allowed",
        ),
    ] {
        let found = errors(slope(from, to));
        assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
        assert_eq!(found[0].key, format!("axis.z.model[0].{key}"));
        assert!(found[0].to_string().contains(words), "{}", found[0]);
    }
    let found = errors(with("kind = \"formula\"", &SLOPE.replacen("linear", "formula", 1)));
    assert!(found[0].to_string().contains("`slope` is only for a linear model"), "{}", found[0]);
}

#[test]
fn warn_limit_and_error_stand_in_this_order() {
    refused("rate = 0.5", "rate = 0.5\nwarn = 50.0", "axis.z.warn", "50.0", &["more than the limit of 40"]);
    refused("rate = 0.5", "rate = 0.5\nerror = 30.0", "axis.z.error", "30.0", &["less than the limit of 40"]);
    refused("rate = 0.5", "rate = 0.5\nwarn = -1.0", "axis.z.warn", "-1.0", &["not above zero"]);
}

#[test]
fn what_is_taken_at_zero_is_not_taken_twice() {
    let text = GRINDER.replacen("reference = \"start\"", "reference = \"zero\"", 1);
    let text = text.replacen("rate = 0.5", "rate = 0.5\ndatum = \"zero\"", 1);
    only_error(&text, "axis.z.datum", "\"zero\"");
}

/// Returns the grinder with its offset output replaced by the three parts of a line.
#[allow(clippy::unwrap_used, reason = "the blocks are there")]
fn line_of(from: &str, to: &str) -> String {
    let block = &GRINDER[GRINDER.find("[output.cnc_z]").unwrap()..];
    let block = &block[..block.find("\n[").map_or(block.len(), |end| end + 1)];
    let part = |name: &str, writes: &str, register: u32, scale: &str| {
        format!(
            "[output.{name}]\naxis = \"z\"\ndevice = \"cnc\"\nwrites = \"{writes}\"\n\
             register = \"holding:{register}\"\ntype = \"i32\"\nword_order = \"msw-first\"\nscale = {scale}\n\n"
        )
    };
    let parts = part("k0", "intercept", 104, "0.1")
        + &part("slope_z", "slope", 106, "0.0001")
        + &part("p0", "reference", 108, "0.001");
    assert!(parts.contains(from) || GRINDER.contains(from) || SLOPE.contains(from), "{from}");
    let readout =
        &GRINDER[GRINDER.find("[output.readout_z]").unwrap()..GRINDER.find("[output.cnc_z]").unwrap()];
    GRINDER
        .replacen(block, &parts, 1)
        .replacen(readout, "", 1)
        .replacen("kind = \"linear\"", SLOPE, 1)
        .replacen(from, to, 1)
}

#[test]
fn a_control_that_applies_the_line_itself_is_given_its_parts() {
    let loaded = parse(&line_of("scale = 0.0001", "scale = 0.0001")).unwrap();
    let line = loaded.profile.axes[0].settings.intercept_slope.unwrap();
    assert!((line.reach.get() - 300.0).abs() < 1e-12 && (line.reference.get() - -50.0).abs() < 1e-12);
    assert!((line.count.unwrap().get() - 0.03).abs() < 1e-12);
    let reported = isotherm_profile::preview::Preview::of(&loaded.profile).to_string();
    for words in [
        "K0, Cz at the reference position: +1 µm is +10 counts",
        "tanβ, which the control multiplies by the distance from the reference position. +0.001 µm/mm is +10 \
         counts",
        "which is ±40 µm at 300 mm",
        "P0, the reference position: always -50 mm",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn a_line_that_cannot_be_applied_is_refused() {
    for (from, to, key, words) in [
        (
            "travel = [-350.0, 0.0], ",
            "",
            "axis.z.model[0].slope.travel",
            "the travel limits the effect of the written slope",
        ),
        ("writes = \"reference\"", "writes = \"offset\"", "output.p0.writes", "act twice"),
        ("writes = \"intercept\"", "writes = \"slope\"", "axis.z", "writes the intercept (K0)"),
        ("rate = 0.5", "rate = 0.5\ndiameter = true", "axis.z.diameter", "to the radius"),
        (
            "scale = 0.0001\n\n[output.p0]",
            "scale = 0.01\n\n[output.p0]",
            "output.slope_z.scale",
            "one count is 3 µm",
        ),
    ] {
        let found = errors(parse(&line_of(from, to)));
        let there = found.iter().any(|error| error.key == key && error.to_string().contains(words));
        assert!(there, "{}", Errors(found.clone()));
    }
    let text = line_of("kind = \"linear\"", "kind = \"linear\"").replacen(SLOPE, "kind = \"linear\"", 1);
    assert!(errors(parse(&text))[0].to_string().contains("no model of `z` has a slope"));
}

#[test]
fn an_axis_without_a_model_yet_is_taken_with_one_word_about_it() {
    let begin = GRINDER.find("[[axis.z.model]]").unwrap();
    let end = begin + GRINDER[begin..].find("[output.").unwrap();
    let text = format!("{}{}", &GRINDER[..begin], &GRINDER[end..]);
    let loaded = parse(&text).unwrap_or_else(|errors| panic!("{errors}"));
    assert!(loaded.profile.axes[0].settings.models.is_empty());
    let reported: Vec<String> = loaded.warnings.iter().map(ToString::to_string).collect();
    assert_eq!(reported.len(), 1, "{reported:?}");
    assert!(
        reported[0].contains("`z` has no model yet") && reported[0].contains("isotherm identify"),
        "{reported:?}"
    );
    let explained = isotherm_profile::preview::Preview::of(&loaded.profile).to_string();
    assert!(explained.contains("no model yet"), "{explained}");
    assert!(!isotherm_profile::schema()["$defs"]["Axis"]["required"].to_string().contains("model"));
}

#[test]
fn a_term_may_take_the_square_of_its_signal_and_no_other_power() {
    let squared =
        with("gain = 2.4, reference = 20.0", "gain = 2e-3, reference = 20.0, power = 2, lag = \"25min\"")
            .unwrap();
    let Kind::Linear(linear) = &squared.profile.axes[0].settings.models[0].kind else { panic!("linear") };
    assert!(linear.terms[0].input.squared && !linear.terms[1].input.squared);
    let reported = isotherm_profile::preview::Preview::of(&squared.profile).to_string();
    for words in [
        "0.002·(bed² − 400) lagged by 25m",
        "when bed goes from 0 to 1000 °C",
        "its square changes Cz by +2000 µm",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    let plain = with("gain = 2.4", "gain = 2.4, power = 1").unwrap();
    assert_eq!(plain.profile.axes, with("gain = 2.4", "gain = 2.4").unwrap().profile.axes);
    let at = "axis.z.model[0].terms[0].power";
    refused("gain = 2.4", "gain = 2.4, power = 3", at, "3", &["the power 3", "power = 2"]);
    refused("gain = 2.4", "gain = 2.4, power = 0", at, "0", &["the power 0"]);
    refused("gain = 2.4", "gain = 2.4, power = 1.5", at, "1.5", &["number"]);
}
