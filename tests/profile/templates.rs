//! Device templates in a profile: added keys, overridden keys, and mistakes.

use super::*;

const MACHINE: &str = r#"[machine]
name = "bench"
[bus.cell]
type = "modbus-tcp"
address = "127.0.0.1:1502"
[device.module]
bus = "cell"
unit = 1
template = "icp-das-m7019r"
[device.cnc]
bus = "cell"
unit = 2
template = "plc-block"
base = 100
[signal.bed]
device = "module"
channel = 0
[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
every = "10s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "bed"
kind = "linear"
terms = [ { signal = "bed", gain = -4.0, reference = 20.0 } ]
[output.cnc_z]
axis = "z"
device = "cnc"
channel = "z"
"#;

fn machine(from: &str, to: &str) -> Result<Loaded, Errors> {
    assert!(MACHINE.contains(from), "{from}");
    parse(&MACHINE.replacen(from, to, 1))
}

#[track_caller]
fn wrong(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    assert!(MACHINE.contains(from), "{from}");
    let error = only_error(&MACHINE.replacen(from, to, 1), key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn a_misspelt_key_of_a_template_is_one_error() {
    for (from, to, key) in [
        ("template = \"icp-das-m7019r\"", "templaet = \"icp-das-m7019r\"", "device.module.templaet"),
        ("template = \"plc-block\"", "templaet = \"plc-block\"", "device.cnc.templaet"),
        ("template = \"plc-block\"", "template = 7", "device.cnc.template"),
        ("channel = 0", "channle = 0", "signal.bed.channle"),
        ("device = \"cnc\"", "deviec = \"cnc\"", "output.cnc_z.deviec"),
        ("channel = \"z\"", "channle = \"z\"", "output.cnc_z.channle"),
    ] {
        let found = errors(machine(from, to));
        assert_eq!(found.len(), 1, "{to}: {}", Errors(found.clone()));
        assert_eq!(found[0].key, key);
    }
}

#[test]
fn a_profile_that_names_channels_is_taken_without_a_word() {
    let loaded = parse(MACHINE).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let machine = loaded.profile;
    assert_eq!(machine.signals[0].encoding.bad, [(-32768).into(), 32767.into()]);
    assert_eq!(machine.outputs[0].address.to_string(), "holding:108 (40109)");
    let set = &machine.sets[0];
    assert_eq!(
        (set.name.as_str(), set.sequence.unwrap().offset, set.complement.unwrap().offset),
        ("cnc", 103, 110)
    );
}

#[test]
fn what_the_profile_spells_out_wins_over_the_template() {
    let machine = machine("channel = 0", "channel = 0\nscale = 0.01\nbad = [7]\nregister = \"input:5\"")
        .unwrap()
        .profile;
    let signal = &machine.signals[0];
    assert_eq!(
        (signal.address.to_string().as_str(), signal.encoding.bad.as_slice()),
        ("input:5 (30006)", [7.into()].as_slice())
    );
    assert!((signal.encoding.scale.get() - 0.01).abs() < 1e-12);
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    let words = "channel 0 of icp-das-m7019r; the profile itself sets bad, register, scale";
    assert!(reported.contains(words), "{reported}");
}

#[test]
fn what_a_template_fills_in_leaves_unverified_and_checks_is_explained() {
    let reported = isotherm_profile::preview::Preview::of(&parse(MACHINE).unwrap().profile).to_string();
    for words in [
        "template icp-das-m7019r: ICP DAS I-7019R and M-7019R, 8 thermocouples; source: ICP DAS",
        "not verified: the scale of 0.1 °C per count of the channels",
        "not checked before arming: type code: write expect = { type_code = … } at the device",
        "before arming and every 1m, coil:268 (00269) must read 1: data format: engineering units",
        "bed: input:0 (30001) of module, i16, 0.1 °C per count; rejected at raw -32768 or 32767",
        "when module_range_0 != 0; channel 0 of icp-das-m7019r",
        "module_range_0: discrete:128 (10129) of module",
        "one request: holding:100..110 (40101..40111), 11 registers, function 16",
        "control holding:101 (40102): bit 0 armed, 1 hold, 2 fault, 3 fallback model",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
}

#[test]
fn a_status_bit_that_the_profile_reads_itself_is_not_read_twice() {
    let own = "channel = 0\n[signal.out_of_range]\ndevice = \"module\"\nchannel = \"range_0\"";
    let machine = machine("channel = 0", own).unwrap().profile;
    assert_eq!(machine.signals.len(), 2);
    assert_eq!(machine.signals[0].fault_when.as_ref().unwrap().text, "out_of_range != 0");
}

#[test]
fn an_unknown_template_names_the_nearest_ones() {
    let key = "device.module.template";
    for name in ["icp-das-m-7019r", "icp-das-m7019", "m-7019r"] {
        let to = format!("template = \"{name}\"");
        let words = [
            &*format!("there is no device template `{name}`"),
            "did you mean `icp-das-m7019r`?",
            "devices/NAME.toml",
        ];
        wrong("template = \"icp-das-m7019r\"", &to, key, "\"", &words);
    }
    wrong(
        "template = \"icp-das-m7019r\"",
        "template = \"../secret\"",
        key,
        "\"",
        &["there is no device template"],
    );
}

#[test]
fn channels_variants_bases_and_expectations_must_fit_the_template() {
    let at = "signal.bed.channel";
    wrong("channel = 0", "channel = 8", at, "8", &["has no channel `8`", "range_7", "6, 7"]);
    wrong("channel = 0", "channel = \"cjk\"", at, "\"cjk", &["did you mean `cjc`?"]);
    wrong("channel = 0", "channel = 0.5", at, "0.5", &["expected a whole number or a text in quotes"]);
    wrong(
        "channel = \"z\"",
        "channel = \"echo_z\"",
        "output.cnc_z.channel",
        "\"echo",
        &["read, not written"],
    );
    wrong("base = 100", "base = 100\nvariant = \"T\"", "device.cnc.variant", "\"T\"", &["has no variants"]);
    wrong(
        "template = \"icp-das-m7019r\"",
        "template = \"icp-das-m7019r\"\nbase = 3",
        "device.module.base",
        "3",
        &["have fixed addresses"],
    );
    let adam = "template = \"advantech-adam-6018\"";
    wrong(
        "template = \"icp-das-m7019r\"",
        adam,
        "device.module.template",
        "\"adv",
        &["has variants", "T (-100 to 400 °C)"],
    );
    let other = format!("{adam}\nvariant = \"L\"");
    wrong(
        "template = \"icp-das-m7019r\"",
        &other,
        "device.module.variant",
        "\"L\"",
        &["has no variant `L`", "allowed: B, E"],
    );
    let expect = "template = \"icp-das-m7019r\"\nexpect = { type_cod = 15 }";
    wrong(
        "template = \"icp-das-m7019r\"",
        expect,
        "device.module.expect.type_cod",
        "type_cod",
        &["did you mean `type_code`?"],
    );
    let high = "template = \"icp-das-m7019r\"\nexpect = { open_circuit = 2 }";
    wrong(
        "template = \"icp-das-m7019r\"",
        high,
        "device.module.verify[2].equals",
        "2",
        &["cannot contain 2"],
    );
    wrong("template = \"icp-das-m7019r\"\n", "", "signal.bed.channel", "0", &["has no template"]);
    wrong("base = 100", "base = 65530", "device.cnc.template", "\"plc", &["beyond the last register"]);
}

#[test]
fn what_only_the_user_can_know_is_asked_for() {
    let moxa = "template = \"moxa-iologik-e1262\"";
    let words = [
        "`word_order` is missing: template `moxa-iologik-e1262` does not set it",
        "read a known temperature",
    ];
    wrong("template = \"icp-das-m7019r\"", moxa, "signal.bed.word_order", "bed]", &words);
}

#[test]
fn an_error_in_what_a_template_brought_stands_at_the_channel_and_says_so() {
    let error = only_error(
        &MACHINE.replacen(
            "unit = 1\n",
            "unit = 1\nfunctions = [\"read-discrete\", \"read-holding\", \"read-coils\"]\n",
            1,
        ),
        "signal.bed.register",
        "0",
    );
    assert!(
        error.to_string().contains("this value comes from channel `0` of template `icp-das-m7019r`"),
        "{error}"
    );
}

#[test]
fn a_control_that_follows_only_so_fast_bounds_step_and_period_of_its_axis() {
    let tnc = MACHINE.replacen("plc-block", "heidenhain-tnc-words", 1);
    let taken = parse(&tnc);
    assert!(taken.is_ok(), "{}", taken.unwrap_err());
    let fast =
        tnc.replacen("step = 1.0", "step = 2.0", 1).replacen("every = \"10s\"", "every = \"800ms\"", 1);
    let found = errors(parse(&fast));
    let reported: Vec<(&str, &str)> =
        found.iter().map(|error| (error.key.as_str(), error.message.as_str())).collect();
    assert_eq!(
        reported[0],
        ("axis.z.step", "a step of 2 µm is larger than 1 µm, the largest step that `cnc` can follow"),
        "{reported:?}"
    );
    assert_eq!(
        reported[1],
        ("axis.z.every", "`cnc` can follow one update every 1s, but the axis is updated every 800ms"),
        "{reported:?}"
    );
}

#[test]
fn a_template_of_ones_own_beside_the_profile_wins_and_is_checked_like_a_profile() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    std::fs::create_dir(folder.path().join("devices")).unwrap();
    let own = folder.path().join("devices/icp-das-m7019r.toml");
    std::fs::write(&path, MACHINE).unwrap();
    let text = "title = \"ours\"\nsource = \"measured by ourselves\"\n[channel.t]\nname = \"{n}\"\ncount = 2\n\
                register = \"input:40\"\ntype = \"i16\"\nscale = 0.5\n";
    std::fs::write(&own, text).unwrap();
    let machine = isotherm_profile::load(&path, &[], &[]).unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert_eq!(machine.signals[0].address.to_string(), "input:40 (30041)");
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    assert!(reported.contains("icp-das-m7019r.toml, not from the shipped templates"), "{reported}");
    std::fs::write(&own, text.replace("scale =", "scal =")).unwrap();
    let found = errors(isotherm_profile::load(&path, &[], &[]));
    assert_eq!(found.len(), 1, "{}", Errors(found.clone()));
    assert!(found[0].file.ends_with("icp-das-m7019r.toml"), "{}", found[0]);
    assert_eq!((found[0].line, found[0].key.as_str()), (Some(8), "channel.t.scal"), "{}", found[0]);
    assert!(found[0].to_string().contains("did you mean `scale`?"), "{}", found[0]);
}

#[test]
fn registers_of_a_device_without_a_template_are_checked_before_arming_as_well() {
    let verify =
        "unit = 4\nverify = [ { register = \"holding:90\", equals = 17, what = \"version of the ladder\" } ]";
    let machine = with("unit = 4", verify).unwrap().profile;
    let reported = isotherm_profile::preview::Preview::of(&machine).to_string();
    assert!(
        reported
            .contains("before arming and every 1m, holding:90 (40091) must read 17: version of the ladder"),
        "{reported}"
    );
    let few = "unit = 4\nfunctions = [\"read-holding\", \"read-discrete\", \"read-coils\", \"write-multiple\", \"write-single\"]\n\
               verify = [ { register = \"input:1\", equals = 1 } ]";
    refused("unit = 4", few, "device.cnc.verify[0].register", "\"input:1", &["cannot be read"]);
    refused(
        "unit = 4",
        "unit = 4\nverify = [ { equals = 1 } ]",
        "device.cnc.verify[0].register",
        "{",
        &["`register` is missing"],
    );
    let float = "unit = 4\nverify = [ { register = \"input:1\", type = \"f32\", equals = 1 } ]";
    refused(
        "unit = 4",
        float,
        "device.cnc.verify[0].type",
        "\"f32\"",
        &["cannot compare floating-point values"],
    );
    refused(
        "unit = 4",
        "unit = 4\nvariant = \"T\"",
        "device.cnc.variant",
        "variant",
        &["only for a device template"],
    );
}

#[test]
fn words_beside_a_value_belong_to_a_display_of_a_position() {
    let display = |keys: &str| format!("position = \"scale_z\"\n{keys}");
    let taken = with(
        "position = \"scale_z\"",
        &display(
            "beside = [ { register = \"holding:40\", good = 1, fault = 2 } ]\nstale = { register = \"holding:50\", text = \"----\" }",
        ),
    );
    assert!(taken.is_ok(), "{}", taken.unwrap_err());
    let at = "output.readout_z.beside[0]";
    let none = display("beside = [ { register = \"holding:40\" } ]");
    refused("position = \"scale_z\"", &none, at, "{", &["exactly one way", "decimals = 256"]);
    let same = display("beside = [ { register = \"holding:11\", value = 1 } ]");
    let found = errors(with("position = \"scale_z\"", &same));
    assert!(
        found.iter().any(|error| error.message.contains("writes the same registers")),
        "{}",
        Errors(found)
    );
    let strange = display("stale = { register = \"holding:50\", text = \"—\" }");
    refused("position = \"scale_z\"", &strange, "output.readout_z.stale.text", "\"", &["cannot be shown"]);
}

#[test]
fn a_pinned_template_is_taken_as_it_is_and_another_text_of_it_is_refused() {
    let profile = machine("channel = 0", "channel = 0").unwrap().profile;
    let shown = isotherm_profile::preview::Preview::of(&profile).to_string();
    let pin = shown.lines().find_map(|line| line.trim().strip_prefix("sha256 = ")).unwrap();
    let template = "template = \"icp-das-m7019r\"";
    let pinned = |pin: &str| format!("{template}\nsha256 = {pin}");
    assert!(machine(template, &pinned(pin)).is_ok(), "what `check` prints is what can be written");
    assert!(machine(template, &pinned(&pin.to_uppercase())).is_ok());
    let other = format!("\"{}\"", "0".repeat(64));
    let is_another = ["`icp-das-m7019r`", pin.trim_matches('"'), "since the last run"];
    wrong(template, &pinned(&other), "device.module.sha256", &other, &is_another);
}

#[test]
fn what_changed_in_a_template_is_told_key_by_key() {
    let before = "title = \"a\"\n[channel.tc]\nscale = 0.1\nbad = [1, 2]\nold = 1\n";
    let now = "# a comment\ntitle = \"a\"\n[channel.tc]\nbad = [1]\nscale = 0.1\nnew = true\n";
    let changes = isotherm_profile::template::changes(before, now);
    let said = ["channel.tc.bad: [1, 2] → [1]", "channel.tc.new: true (new)", "channel.tc.old: 1 (removed)"];
    assert_eq!(changes, said);
    assert!(isotherm_profile::template::changes(before, before).is_empty());
}

#[test]
fn changed_texts_of_a_template_are_one_change() {
    let before = "title = \"a\"\nsource = \"b\"\n[check.format]\nwhat = \"c\"\n[channel.tc]\nscale = 0.1\n";
    let changes = |now: &str| isotherm_profile::template::changes(before, now);
    let texts = before.replace("\"a\"", "\"d\"").replace("\"c\"", "\"e\"");
    assert_eq!(changes(&texts), ["its notes changed"]);
    assert_eq!(changes(&before.replace("source = \"b\"\n", "")), ["its notes changed"]);
    assert_eq!(changes(&before.replace("[check", "notes = [\"f\"]\n[check")), ["its notes changed"]);
    let both = texts.replace("0.1", "0.2");
    assert_eq!(changes(&both), ["channel.tc.scale: 0.1 → 0.2", "its notes changed"]);
}
