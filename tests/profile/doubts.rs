//! Settings that are allowed but probably wrong: the warnings of `check`, and the value of each model.

use super::*;
use isotherm_profile::preview::Preview;

/// Checks the only warning about the grinder after a replacement in its text.
#[track_caller]
fn doubt(from: &str, to: &str, key: &str, words: &[&str]) {
    assert!(GRINDER.contains(from), "{from}");
    doubted(&GRINDER.replacen(from, to, 1), key, words);
}

#[track_caller]
fn doubted(text: &str, key: &str, words: &[&str]) {
    let loaded = parse(text).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings.len(), 1, "{:?}", loaded.warnings);
    let warning = &loaded.warnings[0];
    assert!(warning.line.is_some() && warning.key == key, "{warning}");
    for word in words {
        assert!(warning.to_string().contains(word), "`{word}` is not in: {warning}");
    }
}

#[test]
fn a_model_that_asks_for_more_than_the_limit_at_20_degrees_all_over_is_doubted() {
    let words = ["all temperatures at 20 °C", "48 µm", "limit of 40 µm", "reference"];
    doubt("gain = 2.4, reference = 20.0", "gain = 2.4, reference = 0.0", "axis.z.model[0]", &words);
    doubt("c = 23.4", "c = 0.0", "axis.z.model[1]", &["`bed only`", "48 µm"]);
    // A datum at zero subtracts the value again.
    let at_datum = GRINDER
        .replacen("gain = 2.4, reference = 20.0", "gain = 2.4, reference = 0.0", 1)
        .replacen("rate = 0.5", "rate = 0.5\ndatum = \"zero\"", 1);
    assert_eq!(parse(&at_datum).unwrap().warnings, []);
}

#[test]
fn a_slope_is_looked_at_where_it_asks_for_most() {
    let slope = "kind = \"linear\"\nslope = { position = \"scale_z\", reference = 0.0, travel = [-350.0, 0.0], \
                 terms = [ { signal = \"bed\", gain = 0.007, reference = 0.0 } ] }";
    let words = ["−49 µm", "scale_z at -350 mm"];
    doubt("kind = \"linear\"", slope, "axis.z.model[0]", &words);
}

#[test]
fn limits_and_gains_of_another_unit_are_doubted() {
    doubt("limit = 40.0", "limit = 501.0", "axis.z.limit", &["501 µm", "half a millimetre"]);
    let at = "axis.z.model[0].terms";
    doubt("gain = 2.4", "gain = -101.0", &format!("{at}[0].gain"), &["−101 µm/°C", "expansion"]);
    let words = ["3450000 µm/°C", "11.5e-6"];
    doubt("expansion = 11.5e-6", "expansion = 11.5", &format!("{at}[1].expansion"), &words);
    // A speed is not a temperature.
    let speed = GRINDER.replacen(
        "unit = \"degC\"\n\n[signal.wheelhead_open]",
        "unit = \"count\"\n\n[signal.wheelhead_open]",
        1,
    );
    let speed = speed.replacen("A = \"bed\"", "A = \"wheelhead\"", 1);
    let speed = speed.replacen("gain = 2.4, reference = 20.0", "gain = 101.0, reference = 0.0", 1);
    assert_eq!(parse(&speed).unwrap().warnings, []);
}

#[test]
fn a_start_that_nothing_tells_is_doubted() {
    let without = GRINDER.replacen("on = \"hydraulics\"\n", "", 1);
    // The formula's `t` is counted from the start too. There is one warning for the whole machine.
    doubted(
        &without,
        "machine",
        &[
            "The model counts from machine start, but no signal shows the start ([machine] on)",
            "on = ",
            "`difference`",
        ],
    );
    let of_t = without.replacen("reference = \"start\"", "reference = 20.0", 1);
    doubted(&of_t, "machine", &["`bed only`", "the reference temperature of its first run"]);
    let fixed = of_t.replacen("b*t + c", "b + c", 1);
    assert_eq!(parse(&fixed).unwrap().warnings, []);
}

#[test]
fn a_block_beside_another_settle_than_it_was_identified_with_is_doubted() {
    let block = |settle: &str| format!("kind = \"linear\"\nidentified_with = {{ settle = \"{settle}\" }}");
    let words = ["identified with `settle = \"30s\"`", "[machine] has \"3m\""];
    doubt("kind = \"linear\"", &block("30s"), "axis.z.model[0].identified_with.settle", &words);
    let same = with("kind = \"linear\"", &block("180s")).unwrap();
    assert_eq!(same.warnings, []);
    let none =
        GRINDER.replacen("settle = \"3min\"\n", "", 1).replacen("kind = \"linear\"", &block("3min"), 1);
    doubted(&none, "axis.z.model[0].identified_with.settle", &["[machine] has none", "settle = \"3m\""]);
}

#[test]
fn check_shows_what_each_model_asks_for_at_15_20_and_25_degrees() {
    let machine = parse(GRINDER).unwrap().profile;
    let preview = Preview::of(&machine);
    let reported = preview.to_string();
    for words in [
        "all temperatures at 15, 20, 25 °C: Cz = −12, 0, +12 µm",
        "all temperatures at 15, 20, 25 °C: Cz = −20.16, −8.16, +3.84 µm",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    let document = serde_json::to_value(&preview).unwrap();
    let all_over = &document["axes"][0]["models"][0]["all_over"];
    assert_eq!(all_over[0], serde_json::json!({ "temperature_c": 15.0, "cz_um": -12.0 }));
    assert_eq!(all_over[2]["cz_um"], 12.0);
}
