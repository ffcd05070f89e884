//! Values in registers: parts of a register, 24 bits, scales in other registers.

use isotherm_core::codec::{DataType, Part, ScaleMeaning, Whole};

use super::*;

const BED: &str = "register = \"input:0\"\ntype = \"i16\"\nscale = 0.1\nunit = \"degC\"";

/// Returns the text that replaces register and type of the signal `bed`.
fn bed(register: &str, more: &str) -> String {
    format!("register = \"{register}\"\n{more}scale = 0.1\nunit = \"degC\"")
}

#[test]
fn a_part_of_a_register_has_the_sign_and_the_width_of_its_type() {
    for (register, more, first, last, whole) in [
        ("input:0.4-15", "", 4, 15, Whole::U16),
        ("input:0.4-15", "type = \"u16\"\n", 4, 15, Whole::U16),
        ("input:0.4-15", "type = \"i16\"\n", 4, 15, Whole::I16),
        ("30001.0-3", "", 0, 3, Whole::U16),
        ("input:8.8-27", "type = \"u32\"\nword_order = \"msw-first\"\n", 8, 27, Whole::U32),
        ("input:8.8-31", "type = \"i32\"\nword_order = \"lsw-first\"\n", 8, 31, Whole::I32),
    ] {
        let loaded = with(BED, &bed(register, more)).unwrap();
        let signal = &loaded.profile.signals[1];
        let part = Part::new(first, last, whole).unwrap();
        assert_eq!(signal.encoding.data_type, DataType::Part(part), "{register} {more}");
        assert_eq!(signal.unit.0, "degC");
    }
    let loaded = with(BED, &bed("input:0.4-15", "type = \"i16\"\n")).unwrap();
    let reported = isotherm_profile::preview::Preview::of(&loaded.profile).to_string();
    assert!(
        reported.contains("bed: input:0.4-15 (30001.4-15) of module, i16, 0.1 °C per count"),
        "{reported}"
    );
}

#[test]
fn value_and_status_of_one_register_are_two_signals_of_one_request() {
    let status = "[signal.bed_status]\ndevice = \"module\"\nregister = \"input:0.0-3\"\n\n[axis.z]";
    let text = GRINDER.replacen(BED, &bed("input:0.4-15", "type = \"i16\"\n"), 1);
    let text = text.replacen("[axis.z]", status, 1);
    let text = text.replacen("fault_when = \"wheelhead_open == 1\"", "fault_when = \"bed_status != 0\"", 1);
    let profile = parse(&text).unwrap().profile;
    let module = profile.signals[1].device;
    let input = |request: &&isotherm_profile::plan::ReadRequest| {
        request.span().is_some_and(|(from, _)| from.table.name() == "input")
    };
    let requests = profile.requests(module);
    let requests: Vec<_> = requests.iter().filter(input).collect();
    assert_eq!((requests.len(), requests[0].fields.len()), (1, 3));
    assert_eq!(requests[0].span().map(|(from, count)| (from.offset, count)), Some((0, 2)));
}

#[test]
fn a_check_compares_a_part_of_a_register() {
    let check = "every = \"1s\"\nverify = [{ register = \"holding:7.4-7\", equals = 9 }]";
    let profile = with("every = \"1s\"", check).unwrap().profile;
    let expected = &profile.devices[0].verify[0];
    assert_eq!(expected.to_string(), "holding:7.4-7 (40008.4-7)");
    assert_eq!(expected.mismatch(&[0xff9f]), None);
    assert!(expected.mismatch(&[0xff8f]).is_some());
    refused(
        "every = \"1s\"",
        "every = \"1s\"\nverify = [{ register = \"holding:7.4-7\", equals = 16 }]",
        "device.module.verify[0].equals",
        "16",
        &["u16 cannot contain 16", "0 to 15"],
    );
}

#[test]
fn what_is_no_part_of_a_register_is_refused_with_what_is() {
    for (register, more, key, at, words) in [
        ("input:0.4-16", "", "register", "\"input:0.4-16\"", ["bit 16 is beyond the 16 bits", "\"u32\""]),
        ("input:0.7-4", "", "register", "\"input:0.7-4\"", ["bit 7 is not below bit 4", "input:50.4-7"]),
        ("input:0.4-x", "", "register", "\"input:0.4-x\"", ["not bits of a register", "input:50.4-7"]),
        ("coil:0.4-7", "", "register", "\"coil:0.4-7\"", ["one bit already", "input:50.4-7"]),
        ("input:0.4-7", "type = \"f32\"\n", "type", "\"f32\"", ["f32 is not possible", "u16 and i16"]),
        ("input:0.4-7", "type = \"u24\"\n", "type", "\"u24\"", ["u24 is not possible", "u16 and i16"]),
    ] {
        refused(BED, &bed(register, more), &format!("signal.bed.{key}"), at, &words);
    }
    let two = "type = \"u32\"\n";
    refused(BED, &bed("input:8.4-19", two), "signal.bed.word_order", "", &["u32 needs 2 registers"]);
    refused(
        BED,
        &format!("{}\nbad = [16]", bed("input:0.4-7", "")),
        "signal.bed.bad",
        "[16]",
        &["u16 cannot contain 16", "0 to 15"],
    );
}

#[test]
fn a_value_of_24_bits_is_read_from_two_registers_and_not_written() {
    let scale = "type = \"i32\"\nword_order = \"lsw-first\"\nscale = 0.0005";
    for (kind, data_type) in [("u24", DataType::unsigned(24)), ("i24", DataType::signed(24))] {
        let to = format!(
            "type = \"{kind}\"\nword_order = \"lsw-first\"\nscale = 0.0005\ncounter = {{ max_speed = 500 }}"
        );
        let loaded = with(scale, &to).unwrap();
        let signal = &loaded.profile.signals[6];
        assert_eq!((signal.encoding.data_type, data_type.registers()), (data_type, 2));
    }
    refused(
        "type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1",
        "type = \"i24\"\nword_order = \"msw-first\"\nscale = 0.1",
        "output.cnc_z.type",
        "\"i24\"",
        &["i24 is only read", "i32"],
    );
}

#[test]
fn decimal_digits_and_sign_and_magnitude_are_only_read_from_registers() {
    for (kind, data_type) in [("bcd16", DataType::Bcd(4)), ("sm16", DataType::SignMagnitude(16))] {
        let loaded = with(BED, &bed("input:0", &format!("type = \"{kind}\"\n"))).unwrap();
        assert_eq!(loaded.profile.signals[1].encoding.data_type, data_type);
    }
    for (kind, data_type) in [("bcd32", DataType::Bcd(8)), ("sm32", DataType::SignMagnitude(32))] {
        let keys = format!("type = \"{kind}\"\nword_order = \"lsw-first\"\n");
        let loaded = with(BED, &bed("input:8", &keys)).unwrap();
        assert_eq!(loaded.profile.signals[1].encoding.data_type, data_type);
        refused(
            "type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1",
            &format!("type = \"{kind}\"\nword_order = \"msw-first\"\nscale = 0.1"),
            "output.cnc_z.type",
            &format!("\"{kind}\""),
            &["is only read from registers"],
        );
    }
}

#[test]
fn a_scale_in_another_register_is_read_with_the_value_and_explained() {
    for (register, keys, meaning, place, words) in [
        (
            "input:0",
            "type = \"i16\"\nscale_from = \"input:40\"\n",
            ScaleMeaning::PowerOfTen,
            "input:40",
            "0.1 °C per count, times ten to the power of input:40 (30041)",
        ),
        (
            "input:0.0-11",
            "type = \"i16\"\ndecimals_from = \"input:0.12-15\"\n",
            ScaleMeaning::Decimals,
            "input:0",
            "0.1 °C per count, with the number of decimals in input:0.12-15 (30001.12-15)",
        ),
    ] {
        let loaded = with(BED, &bed(register, keys)).unwrap();
        assert_eq!(loaded.warnings, []);
        let signal = &loaded.profile.signals[1];
        let from = signal.scale_from.as_ref().unwrap();
        assert_eq!((from.meaning, from.address.to_string().as_str()), (meaning, place));
        let reported = isotherm_profile::preview::Preview::of(&loaded.profile).to_string();
        for words in [words, "after a change of the scale until a reading is plausible again"] {
            assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
        }
        // One request reads the inputs of the module.
        let inputs = loaded.profile.requests(signal.device);
        let inputs = inputs.iter().filter_map(|request| request.span());
        assert_eq!(inputs.filter(|(from, _)| from.table.name() == "input").count(), 1, "{register}");
    }
}

#[test]
fn what_cannot_be_a_scale_is_refused_with_what_can() {
    let value = |keys: &str| bed("input:0", &format!("type = \"i16\"\n{keys}"));
    for (keys, key, at, words) in [
        (
            "scale_from = \"input:9\"\ndecimals_from = \"input:9\"\n",
            "decimals_from",
            "decimals_from",
            ["exclude each other", "power of ten"],
        ),
        ("scale_from = \"coil:9\"\n", "scale_from", "\"coil:9\"", ["one bit", "holding:12"]),
        ("scale_from = \"input:9.3\"\n", "scale_from", "\"input:9.3\"", ["one bit", "holding:12.8-11"]),
        (
            "scale_from = \"input:9.8-19\"\n",
            "scale_from",
            "\"input:9.8-19\"",
            ["not inside one register", "holding:12"],
        ),
        ("scale_from = \"input:0\"\n", "scale_from", "\"input:0\"", ["the value itself", "holding:12"]),
        ("decimals_from = \"inputt:9\"\n", "decimals_from", "\"inputt:9\"", ["not a register", "input"]),
    ] {
        refused(BED, &value(keys), &format!("signal.bed.{key}"), at, &words);
    }
    let bit = "device = \"module\"\nregister = \"discrete:1\"";
    let scaled = format!("{bit}\nscale_from = \"input:9\"");
    refused(bit, &scaled, "signal.wheelhead_open.scale_from", "\"input:9\"", &["a bit has no scale"]);
    let count = "type = \"i32\"\nword_order = \"lsw-first\"\nscale = 0.0005";
    let scaled = format!("{count}\nscale_from = \"holding:80\"\ncounter = {{ max_speed = 500 }}");
    let found = errors(with(count, &scaled));
    let words = "`scale_from` and `counter` exclude each other";
    assert!(found.iter().any(|error| error.to_string().contains(words)), "{}", Errors(found.clone()));
}

#[test]
fn a_register_of_a_scale_must_not_be_written() {
    let on = "register = \"holding:90\"\ntype = \"u16\"\nunit = \"count\"";
    let scaled = format!("{on}\nmax_rate = 1.0\nscale_from = \"holding:105\"");
    let found = errors(with(on, &scaled));
    let words = "would overwrite the scale of signal `cnc_on` at holding:105";
    assert!(
        found.iter().any(|error| error.key == "output.cnc_z.register" && error.message.contains(words)),
        "{}",
        Errors(found.clone())
    );
    with(on, &scaled.replace("holding:105", "holding:106")).unwrap();
}

#[test]
fn a_value_whose_scale_is_read_needs_a_limit_of_its_rate() {
    let scale = "type = \"i32\"\nword_order = \"lsw-first\"\nscale = 0.0005";
    let scaled = format!("{scale}\nscale_from = \"holding:80\"");
    let words = ["needs a limit of the rate of change", "write `max_rate`, in mm per second"];
    refused(scale, &scaled, "signal.scale_z.scale_from", "scale_from", &words);
    with(scale, &format!("{scaled}\nmax_rate = 500.0")).unwrap();
    // A temperature that a model uses has a limit by default.
    let bed = bed("input:0", "type = \"i16\"\ndecimals_from = \"input:9\"\n");
    with(BED, &bed).unwrap();
    refused(
        BED,
        &format!("{bed}\nmax_rate = \"none\""),
        "signal.bed.decimals_from",
        "decimals_from",
        &["needs a limit of the rate of change"],
    );
}
