//! Typing mistakes: unknown keys, wrong types, unknown words, missing keys, broken text.

use super::*;

#[test]
fn a_wrong_profile_shows_all_its_errors_at_their_places() {
    let text = GRINDER
        .replacen("max_rate = 2.0", "max_rat = 2.0", 1)
        .replacen("word_order = \"lsw-first\"\n", "", 1)
        .replacen(
            "register = \"input:0\"\ntype = \"i16\"",
            "register = \"input:0\"\ntype = \"f32\"\nword_order = \"msw-first\"",
            1,
        )
        .replacen("unit = \"degC\"", "unit = \"degc\"", 1);
    let found = errors(parse(&text));
    let places: Vec<(usize, usize, &str)> =
        found.iter().map(|error| (error.line.unwrap(), error.column.unwrap(), error.key.as_str())).collect();
    let line_of = |what: &str| text.lines().position(|line| line == what).unwrap() + 1;
    let expected = [
        (line_of("unit = \"degc\""), 8, "signal.wheelhead.unit"),
        (line_of("max_rat = 2.0"), 1, "signal.wheelhead.max_rat"),
        (line_of("register = \"input:0\""), 12, "signal.bed.register"),
        (line_of("[signal.scale_z]"), 9, "signal.scale_z.word_order"),
    ];
    assert_eq!(places, expected, "{}", Errors(found.clone()));
    let reported = Errors(found).to_string();
    for words in [
        "did you mean `degC`?",
        "did you mean `max_rate`?",
        "overlaps",
        "signal `wheelhead`",
        "\"lsw-first\"",
        "\n    unit = \"degc\"\n           ^\n",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    assert!(reported.ends_with("4 errors in the profile"), "{reported}");
}

#[test]
fn nothing_is_coerced() {
    refused(
        "limit = 40.0",
        "limit = \"40\"",
        "axis.z.limit",
        "\"40\"",
        &["expected a number", "the text \"40\""],
    );
    refused("unit = 3", "unit = 3.7", "device.readout.unit", "3.7", &["a whole number", "3.7"]);
    refused("unit = 3", "unit = true", "device.readout.unit", "true", &["a whole number", "found true"]);
    refused("unit = 3", "unit = 300", "device.readout.unit", "300", &["0 to 255"]);
    refused("timeout = \"300ms\"", "timeout = 300", "bus.cell.timeout", "300", &["a duration in quotes"]);
    refused(
        "timeout = \"300ms\"",
        "timeout = \"300\"",
        "bus.cell.timeout",
        "\"300\"",
        &["is not a duration"],
    );
    refused("gain = 2.4", "gain = true", "axis.z.model[0].terms[0].gain", "true", &["expected a number"]);
    refused("range = [-10.0, 80.0]", "range = [-10.0]", "signal.wheelhead.range", "[-10.0]", &["2 values"]);
}

#[test]
fn a_wrong_duration_is_reported_wherever_it_stands() {
    refused("every = \"10s\"", "every = \"10\"", "axis.z.every", "\"10\"", &["is not a duration"]);
    refused("every = \"500ms\"", "every = 500", "heartbeat.every", "500", &["a duration in quotes"]);
    refused(
        "after = \"60s\"",
        "after = \"soon\"",
        "axis.z.on_fault.after",
        "\"soon\"",
        &["is not a duration"],
    );
}

#[test]
fn a_profile_without_one_of_its_lines_is_taken_or_refused_with_a_place() {
    for left_out in 0..GRINDER.lines().count() {
        let lines = GRINDER.lines().enumerate().filter(|(index, _)| *index != left_out);
        let text: Vec<&str> = lines.map(|(_, line)| line).collect();
        if let Err(Errors(found)) = parse(&text.join("\n")) {
            assert!(!found.is_empty());
            for error in found {
                assert!(error.line.is_some() && error.excerpt.is_some(), "{error}");
            }
        }
    }
}

#[test]
fn nan_and_infinity_are_no_numbers() {
    refused("rate = 0.5", "rate = nan", "axis.z.rate", "nan", &["finite"]);
    refused("gain = 2.4", "gain = -inf", "axis.z.model[0].terms[0].gain", "-inf", &["finite"]);
    refused("Kz = 2.4", "Kz = inf", "axis.z.model[1].constants.Kz", "inf", &["finite"]);
}

#[test]
fn a_key_that_is_missing_is_reported_at_its_table() {
    refused("limit = 40.0\n", "", "axis.z.limit", "z]", &["`limit` is missing", "µm"]);
    refused("unit = 3\n", "", "device.readout.unit", "readout]", &["`unit` is missing"]);
    refused("name = \"grinder-1\"\n", "", "machine.name", "machine]", &["`name` is missing"]);
    refused(", after = \"60s\"", "", "axis.z.on_fault.after", "on_fault", &["`after` is missing"]);
    refused("scale = 0.0001\n", "", "output.readout_z.scale", "readout_z]", &["`scale` is missing"]);
    refused(
        "register = \"input:0\"\ntype = \"i16\"",
        "register = \"input:0\"",
        "signal.bed.type",
        "bed]",
        &["`type` is missing"],
    );
    refused("gain = 2.4, ", "", "axis.z.model[0].terms[0].gain", "{ signal", &["`gain` is missing"]);
    refused("address = \"127.0.0.1:1502\"\n", "", "bus.cell.address", "cell]", &["502"]);
}

#[test]
fn a_misspelt_key_is_one_error_also_if_it_is_required() {
    refused("limit = 40.0", "limt = 40.0", "axis.z.limt", "limt", &["did you mean `limit`?"]);
    refused("unit = 3\n", "unti = 3\n", "device.readout.unti", "unti", &["did you mean `unit`?"]);
    refused("[device.module]", "[devices.module]", "devices", "devices", &["did you mean `device`?"]);
    refused("[signal.bed]", "[signals.bed]", "signals", "signals", &["did you mean `signal`?"]);
    // The models below this table still belong to axis `z`, whose other keys are then not missing.
    refused("[axis.z]", "[axes.z]", "axes", "axes", &["did you mean `axis`?"]);
    // A condition uses this signal.
    refused("[signal.cnc_on]", "[singal.cnc_on]", "singal", "singal", &["did you mean `signal`?"]);
    // The names in the formula are those of the misspelt table.
    refused("inputs = { A", "inptus = { A", "axis.z.model[1].inptus", "inptus", &["did you mean `inputs`?"]);
}

#[test]
fn a_table_that_several_keys_name_is_one_error_if_it_does_not_exist() {
    let found = errors(with("[device.module]", "[device.modul]"));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    let keys = GRINDER.matches("device = \"module\"").count();
    let message = format!("there is no device named `module` ({keys} keys name it)");
    assert!(found[0].message == message && keys > 1, "{}", found[0]);
    assert!(found[0].help.as_ref().unwrap().contains("did you mean `modul`?"), "{}", found[0]);
}

#[test]
fn a_table_that_occurs_twice_or_a_bracket_without_an_end_is_one_error() {
    let bed = GRINDER.find("[signal.bed]").unwrap();
    let twice = format!("{GRINDER}\n{}", GRINDER[bed..].split("\n\n").next().unwrap());
    let found = errors(parse(&twice));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert_eq!(found[0].line, Some(GRINDER.lines().count() + 2), "{}", found[0]);
    assert!(found[0].to_string().contains("give one of the two tables another name"), "{}", found[0]);
    let found = errors(with("{ action = \"ramp\", after = \"60s\" }", "{ action = \"ramp\""));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert!(found[0].to_string().contains("close the list or inline table"), "{}", found[0]);
}

#[test]
fn a_name_that_nobody_has_is_reported_with_the_nearest_one() {
    refused("bus = \"cell\"", "bus = \"cel\"", "device.module.bus", "\"cel\"", &["`cell`"]);
    refused(
        "device = \"module\"",
        "device = \"modul\"",
        "signal.wheelhead.device",
        "\"modul\"",
        &["`module`"],
    );
    refused("signal = \"bed\"", "signal = \"bad\"", "axis.z.model[0].terms[0].signal", "\"bad\"", &["`bed`"]);
    refused("axis = \"z\"", "axis = \"y\"", "output.readout_z.axis", "\"y\"", &["did you mean `z`"]);
    refused("kind = \"linear\"", "kind = \"liner\"", "axis.z.model[0].kind", "\"liner\"", &["`linear`"]);
    refused(
        "\"write-multiple\"",
        "\"write-multipel\"",
        "device.readout.functions[1]",
        "\"write-",
        &["`write-multiple`"],
    );
    refused(
        "register = \"holding:84\"",
        "register = \"holdin:84\"",
        "signal.scale_z.register",
        "\"holdin",
        &["`holding`"],
    );
}

#[test]
fn an_error_in_a_condition_or_a_formula_points_into_its_text() {
    let condition = "when = \"cnc_on == 1\"";
    refused(
        condition,
        "when = \"cnc_on == 1 and cnc_of == 0\"",
        "output.cnc_z.when",
        "cnc_of",
        &["`cnc_on`"],
    );
    refused(condition, "when = \"cnc_on = 1\"", "output.cnc_z.when", "= 1", &["=="]);
    refused("(b*t + c)", "(b*t + d)", "axis.z.model[1].formula", "d)", &["`d` is not known"]);
    refused("(b*t + c)", "(b*t + c", "axis.z.model[1].formula", "\"", &["`)` was expected"]);
    refused("(b*t + c)", "b*t", "axis.z.model[1].constants.c", "c =", &["does not use `c`"]);
    refused("A = \"bed\"", "A = \"bad\"", "axis.z.model[1].inputs.A", "\"bad\"", &["`bed`"]);
    refused("b = 2e-5", "b = 2e-5, t = 1.0", "axis.z.model[1].constants.t", "t =", &["`t` is a reserved"]);
    refused(
        "fault_when = \"wheelhead_open == 1\"",
        "fault_when = \"wheelhead > 1\"",
        "signal.wheelhead.fault_when",
        "\"wheelhead > 1",
        &["in its own condition"],
    );
}

#[test]
fn text_that_is_no_toml_is_reported_with_line_and_column() {
    let found = errors(parse("[machine]\nname = \"a\nsecond = = 3\n"));
    assert_eq!((found[0].line, found[0].file.as_str()), (Some(2), "machine.toml"));
    let twice = errors(parse("[machine]\nname = \"a\"\nname = \"b\"\n"));
    assert_eq!((twice[0].line, twice[0].column), (Some(3), Some(1)));
}

#[test]
fn what_is_no_table_is_answered_with_one_to_copy() {
    let on_fault = "on_fault = { action = \"ramp\", after = \"60s\" }";
    for (written, wanted) in [
        ("on_fault = \"hold\"", "write on_fault = { action = \"hold\" }"),
        ("on_fault = 5", "write on_fault = { action = "),
    ] {
        let error = only_error(
            &GRINDER.replacen(on_fault, written, 1),
            "axis.z.on_fault",
            written.split("= ").nth(1).unwrap(),
        );
        assert!(error.help.as_ref().is_some_and(|help| help.starts_with(wanted)), "{error}");
    }
}

#[test]
fn a_decimal_comma_is_answered_with_a_point() {
    let found = errors(with("limit = 40.0", "limit = 40,0  # µm"));
    let helped = found.iter().any(|error| error.help.as_deref() == Some("write a decimal point: 40.0"));
    assert!(helped, "{found:?}");
}

#[test]
fn a_wrong_register_hides_no_missing_word_order() {
    let text =
        GRINDER.replacen("word_order = \"lsw-first\"\n", "", 1).replacen("holding:84", "holding:70000", 1);
    let mut keys: Vec<String> = errors(parse(&text)).into_iter().map(|error| error.key).collect();
    keys.sort();
    assert_eq!(keys, ["signal.scale_z.register", "signal.scale_z.word_order"]);
}

#[test]
fn what_people_write_for_a_unit_is_answered_with_its_word() {
    for (written, meant) in
        [("C", "`degC`"), ("°C", "`degC`"), ("%", "`percent`"), ("µm", "`um`"), ("k", "`K`")]
    {
        let error = only_error(
            &GRINDER.replacen("unit = \"degC\"", &format!("unit = \"{written}\""), 1),
            "signal.wheelhead.unit",
            &format!("\"{written}\""),
        );
        assert!(
            error.help.as_ref().is_some_and(|help| help.contains(&format!("did you mean {meant}"))),
            "{error}"
        );
    }
}

#[test]
fn a_machines_name_is_no_longer_than_its_files_may_be() {
    let named = |length: usize| with("name = \"grinder-1\"", &format!("name = \"{}\"", "a".repeat(length)));
    assert!(named(64).is_ok());
    let found = errors(named(300));
    assert!(found.len() == 1 && found[0].message.contains("300 characters"), "{found:?}");
}

#[test]
fn texts_and_names_that_end_a_line_or_steer_a_terminal_are_refused_at_their_place() {
    let words = &["invisible characters, or a line break"];
    refused("\"Surface grinder\"", "\"a\\u001b[2J\"", "machine.description", "\"a", words);
    refused("\"Surface grinder\"", "\"a\\nb\"", "machine.description", "\"a", words);
    refused("name = \"bed only\"", "name = \"bed\\u202eonly\"", "axis.z.model[1].name", "\"bed", words);
    refused("\"Kz * (A", "\"\\u009bKz * (A", "axis.z.model[1].formula", "\"", words);
    let key = "axis.z.model[1].constants.\"x\\u{7}\"";
    refused("Kz = 2.4, b", "Kz = 2.4, \"x\\u0007\" = 1, b", key, "\"x", words);
}
