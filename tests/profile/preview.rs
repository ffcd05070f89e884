//! Output for operators and programs: the preview, the schema, errors as documents.

use super::*;

#[test]
fn the_schema_describes_every_key_and_forbids_the_others() {
    let schema = isotherm_profile::schema();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    assert_eq!(schema["required"], serde_json::json!(["machine"]));
    let mut tables = 0;
    let definitions = schema["$defs"].as_object().unwrap();
    for (name, table) in definitions.iter().filter(|(_, table)| table["type"] == "object") {
        tables += 1;
        assert_eq!(table["additionalProperties"], false, "{name}");
        for (key, property) in table["properties"].as_object().unwrap() {
            let described = property["description"].as_str().is_some_and(|text| text.len() > 5);
            assert!(described, "{name}.{key}: {property}");
        }
    }
    assert!(tables > 15, "{tables}");
    assert!(!schema.to_string().contains("null"), "TOML has no null");
    assert_eq!(definitions["Duration"]["type"], "string");
    assert_eq!(definitions["Signal"]["properties"]["unit"]["enum"][0], "degC");
}

#[test]
fn a_label_stands_beside_its_name_and_nowhere_in_its_place() {
    let text = GRINDER
        .replacen("[machine]\n", "[machine]\nlabel = \"研削盤 3号\"\n", 1)
        .replacen("[device.module]\n", "[device.module]\nlabel = \"Klemmkasten Süd\"\n", 1)
        .replacen("[signal.bed]\n", "[signal.bed]\nlabel = \" 床温 \"\n", 1)
        .replacen("[axis.z]\n", "[axis.z]\nlabel = \"Spindelkopf\"\n", 1);
    let profile = parse(&text).unwrap().profile;
    assert_eq!((profile.label.as_str(), profile.axes[0].label.as_str()), ("研削盤 3号", "Spindelkopf"));
    let preview = isotherm_profile::preview::Preview::of(&profile);
    let shown = preview.to_string();
    for words in [
        " (研削盤 3号)",
        "  module (Klemmkasten Süd): unit 1",
        "  bed (床温): input:0",
        "axis z (Spindelkopf)",
    ] {
        assert!(shown.contains(words), "`{words}` is not in:\n{shown}");
    }
    let document = serde_json::to_value(preview).unwrap();
    let bed = document["signals"].as_array().unwrap().iter().find(|signal| signal["name"] == "bed").unwrap();
    assert_eq!((&bed["label"], &document["axes"][0]["label"]), (&"床温".into(), &"Spindelkopf".into()));
    let schema = isotherm_profile::schema();
    for table in ["Axis", "Signal", "Device"] {
        assert_eq!(schema["$defs"][table]["properties"]["label"]["type"], "string", "{table}");
    }
    assert_eq!(schema["properties"]["machine"]["properties"]["label"]["type"], "string");
}

#[test]
fn a_label_that_is_none_and_a_language_that_the_page_does_not_speak_are_refused() {
    let refuse = |label: &str, words: &[&str]| {
        refused("limit = 40.0", &format!("limit = 40.0\nlabel = {label}"), "axis.z.label", label, words);
    };
    refuse("\"  \"", &["empty", "remove `label`"]);
    refuse(&format!("\"{}\"", "床".repeat(61)), &["61 characters", "up to 60"]);
    for unseen in ["\\n", "\\u202E", "\\u0007"] {
        refuse(&format!("\"a{unseen}b\""), &["invisible"]);
    }
    let listen = "listen = \"127.0.0.1:0\"";
    let web = |language: &str| with(listen, &format!("{listen}\nlanguage = \"{language}\""));
    let german = web("de").unwrap().profile.web.unwrap().language;
    assert_eq!(german, Some(isotherm_profile::Language::De));
    let wrong = Errors(errors(web("fr"))).to_string();
    assert!(wrong.contains("web.language") && wrong.contains("en, de, ja, zh"), "{wrong}");
}

#[test]
fn an_error_is_a_document_for_programs_too() {
    let found = errors(with("limit = 40.0", "limt = 40.0"));
    let document = serde_json::to_value(Errors(found)).unwrap();
    assert_eq!(document.as_array().map(Vec::len), Some(1), "{document}");
    assert_eq!(document[0]["key"], "axis.z.limt");
    assert_eq!(document[0]["help"].as_str().unwrap().split('?').next(), Some("did you mean `limit`"));
    assert_eq!((&document[0]["file"], &document[0]["column"]), (&"machine.toml".into(), &1.into()));
}

#[test]
fn a_good_profile_is_explained_in_words_and_figures() {
    let machine = parse(GRINDER).unwrap().profile;
    let explanation = isotherm_profile::preview::Preview::of(&machine);
    let reported = explanation.to_string();
    for words in [
        "read input:0..1 (30001..30002), 2 registers, function 04: bed, wheelhead",
        "module: unit 1, every 1s: 2 requests touching 2 registers and 1 bit for 3 signals",
        "scale_z: holding:84 (40085) of counter, i32 lsw-first",
        "Cz = 2.4·(bed − 20) + 3.45·(wheelhead − its value at machine start) + 0 µm",
        "when bed rises by 1 °C, Cz changes by +2.4 µm",
        "Cz = Kz * (A - (b*t + c)) µm, over bed",
        "a positive Cz makes the commanded or displayed position larger",
        "±40 µm",
        "keeps the last Cz for 1m, then moves Cz to zero at 0.5 µm/s",
        "cnc_z: holding:104 (40105) of cnc, i32 msw-first, 0.1 µm per count; function 16, 2 registers",
        "counts -400 to 400",
        "only when cnc_on == 1",
        "heartbeat: holding:100 (40101) of cnc, u16, counts every 500ms; function 06",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    let document = serde_json::to_value(&explanation).unwrap();
    assert_eq!(document["writes"][1]["register"]["modicon"], "40105");
}

/// Numbers of an identified model have up to seventeen digits in the profile.
#[test]
fn numbers_of_a_model_have_as_many_digits_as_matter() {
    let terms = "{ signal = \"bed\", gain = 2.123456789, reference = 20.123456789 },\n\
                 { signal = \"bed\", gain = 0.00123456789, reference = 20.123456789, lag = \"1h\" },";
    let text = GRINDER.replacen("{ signal = \"bed\", gain = 2.4, reference = 20.0 },", terms, 1).replacen(
        "kind = \"linear\"\n",
        "kind = \"linear\"\noffset = -7.98765432109\nexpected = { since_datum = [0.91234567891, 4.41234567891] }\n",
        1,
    );
    let reported = isotherm_profile::preview::Preview::of(&parse(&text).unwrap().profile).to_string();
    for words in [
        "Cz = 2.123·(bed − 20.123) + 0.001235·(bed − 20.123) lagged by 1h",
        "− 7.988 µm",
        "Cz changes by +2.123 µm",
        "Cz changes by +0.001235 µm",
        "expected within ±√(0.9123·h + 4.412) µm",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn an_operators_register_is_explained_as_his() {
    let machine = with("share = \"whole\"", "share = \"ledger\"").unwrap().profile;
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    for words in [
        "the operator offset in the register stays; the gateway share is added to it",
        "counts -400 to 400, plus the operator offset",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn of_a_sum_too_long_to_be_read_each_signal_is_told_at_once_and_in_the_steady_state() {
    let term = "{ signal = \"bed\", gain = 2.4, reference = 20.0 },";
    let lagged: Vec<String> = (1..=12)
        .map(|hours| format!("{{ signal = \"bed\", gain = 0.1, reference = 20.0, lag = \"{hours}h\" }},"))
        .collect();
    let machine = with(term, &format!("{term}\n{}", lagged.join("\n"))).unwrap().profile;
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    for words in [
        "Cz = the sum of 14 terms",
        "bed: +2.4 µm/°C at once, +3.6 µm/°C in the steady state",
        "wheelhead: +3.45 µm/°C at once, +3.45 µm/°C in the steady state",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    assert!(!reported.contains("63 % of the effect"), "{reported}");
}

#[test]
fn of_several_lags_of_one_signal_the_sum_is_reported_because_one_may_point_the_other_way() {
    let term = "{ signal = \"bed\", gain = 2.4, reference = 20.0 },";
    let slow = "{ signal = \"bed\", gain = 3.5, reference = 20.0 }, { signal = \"bed\", gain = -1.1, reference = 20.0, lag = \"1h\" },";
    let machine = with(term, slow).unwrap().profile;
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    for words in [
        "when bed rises by 1 °C, Cz changes by +3.5 µm",
        "when bed rises by 1 °C (63 % of the effect is reached 1h after bed has risen), Cz changes by −1.1 µm",
        "when bed rises by 1 °C permanently (its 2 terms added up), Cz changes by +2.4 µm",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    assert!(!reported.contains("wheelhead rises by 1 °C permanently"), "{reported}");
}
