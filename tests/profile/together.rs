//! Sets of outputs, handshakes and boot counters: valid forms, mistakes, and previews.

use super::*;

const PLC: &str = include_str!("../gateway/faults/plc.toml");
const SHARE: &str = "share = \"whole\"";
const HANDSHAKE: &str =
    "handshake = { strobe = \"coil:20\", acknowledge = \"discrete:20\", timeout = \"800ms\" }";

/// Checks the only error of the grinder with a handshake after a replacement in it.
#[track_caller]
fn shaken_refused(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    assert!(HANDSHAKE.contains(from), "{from}");
    let text = shaken().replacen(HANDSHAKE, &HANDSHAKE.replacen(from, to, 1), 1);
    reported(&text, key, at, words);
}

#[track_caller]
fn plc_refused(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    assert!(PLC.contains(from), "{from}");
    reported(&PLC.replacen(from, to, 1), key, at, words);
}

#[track_caller]
fn reported(text: &str, key: &str, at: &str, words: &[&str]) {
    let error = only_error(text, key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

fn shaken() -> String {
    GRINDER.replacen("refresh = \"2s\"\n", "", 1).replacen(SHARE, &format!("{SHARE}\n{HANDSHAKE}"), 1)
}

#[test]
fn handshakes_sets_and_boot_counters_are_taken_without_a_word() {
    let restart = format!("{SHARE}\nrestart = {{ boot_counter = \"holding:98\" }}");
    for text in [shaken(), PLC.to_owned(), GRINDER.replacen(SHARE, &restart, 1)] {
        match parse(&text) {
            Ok(loaded) => assert_eq!(loaded.warnings, []),
            Err(errors) => panic!("{errors}"),
        }
    }
    let machine = parse(&GRINDER.replacen(SHARE, &restart, 1)).unwrap().profile;
    let counter = machine.outputs[1].boot_counter.unwrap();
    assert_eq!(machine.signal(counter).name, "cnc.boot_counter");
    assert_eq!(machine.machine.signals, machine.signals.len());
}

#[test]
fn a_strobe_must_be_written_and_an_acknowledge_read() {
    let (strobe, acknowledge) = ("output.cnc_z.handshake.strobe", "output.cnc_z.handshake.acknowledge");
    shaken_refused("coil:20", "discrete:20", strobe, "\"discrete", &["cannot be written", "coil:20"]);
    shaken_refused("coil:20", "coil:20.1", strobe, "\"coil:20.1", &["one bit already"]);
    shaken_refused("coil:20", "holding:101.16", strobe, "\"holding", &["0 to 15"]);
    shaken_refused("discrete:20", "coil:20", acknowledge, "\"coil:20", &["the strobe signal itself"]);
    shaken_refused("discrete:20", "bit:20", acknowledge, "\"bit:20", &["register table", "discrete:20"]);
    let beat = HANDSHAKE.replacen("coil:20", "holding:100", 1);
    let text = shaken().replacen(HANDSHAKE, &beat, 1);
    reported(
        &text,
        "heartbeat.register",
        "\"holding",
        &["writes the same registers", "the strobe of output cnc_z"],
    );
    shaken_refused("coil:20", "holding:105", strobe, "\"holding", &["writes the same registers", "cnc_z"]);
    shaken_refused("discrete:20", "holding:104", acknowledge, "\"holding", &["overlaps", "cnc_z"]);
    let few = "unit = 4\nfunctions = [\"read-coils\", \"read-discrete\", \"read-holding\", \"write-single\", \"write-multiple\"]";
    let text = shaken().replacen("unit = 4", few, 1);
    reported(&text, strobe, "\"coil:20", &["write-coil", "`cnc`"]);
    let few = "unit = 4\nfunctions = [\"read-coils\", \"read-holding\", \"read-discrete\", \"write-coil\", \"write-single\", \"write-multiple\"]";
    let text = shaken().replacen("unit = 4", few, 1).replacen("\"discrete:20\"", "\"input:20\"", 1);
    reported(&text, acknowledge, "\"input:20", &["read-input", "`cnc`"]);
}

#[test]
fn a_handshake_needs_time_for_its_waits() {
    let key = "output.cnc_z.handshake.timeout";
    shaken_refused("800ms", "300ms", key, "\"300ms", &["waits 300ms for an answer"]);
    shaken_refused("800ms", "6s", key, "\"6s", &["two waits of 6s", "axis `z`'s period, 10s"]);
    let text = shaken().replacen(SHARE, &format!("refresh = \"1s\"\n{SHARE}"), 1);
    reported(&text, key, "\"800ms", &["`refresh` of output `cnc_z`, 1s"]);
    let missing = shaken().replacen(", timeout = \"800ms\"", "", 1);
    reported(&missing, key, "handshake", &["`timeout` is missing"]);
}

#[test]
fn what_cannot_be_exchanged_is_refused() {
    let echo = shaken().replacen(SHARE, &format!("{SHARE}\nverify = \"echo\""), 1);
    reported(&echo, "output.cnc_z.verify", "\"echo\"", &["read-back"]);
    let readout = "position = \"scale_z\"";
    let text = GRINDER.replacen(readout, &format!("{readout}\n{HANDSHAKE}"), 1);
    let found = errors(parse(&text));
    assert_eq!(found[0].key, "output.readout_z.handshake", "{}", found[0]);
    assert!(found[0].message.contains("each time the position is read"), "{}", found[0]);
    let ledger = errors(parse(&shaken().replacen("\"whole\"", "\"ledger\"", 1)));
    assert!(
        ledger.iter().any(|error| error.message.contains("and handshake exclude each other")),
        "{}",
        Errors(ledger)
    );
}

#[test]
fn a_set_must_be_whole() {
    let (none, at) = (errors(parse(&PLC.replace("set = \"block\"\n", ""))), "set.block");
    assert_eq!((none.len(), none[0].key.as_str()), (1, at), "{}", none[0]);
    assert!(none[0].to_string().contains("no output is in this set"), "{}", none[0]);
    plc_refused("set = \"block\"", "set = \"blok\"", "output.plc_x.set", "\"blok\"", &["`block`"]);
    plc_refused("holding:103", "input:103", "set.block.sequence", "\"input", &["read-only"]);
    plc_refused("holding:103", "coil:103", "set.block.sequence", "\"coil", &["one bit"]);
    plc_refused("holding:110", "holding:109", "output.plc_z.register", "\"holding", &["writes the same"]);
    let apart = PLC.replace("sequence = \"holding:103\"\n", "").replace("\"holding:104\"", "\"holding:94\"");
    reported(&apart, "set.block", "block]", &["2 requests", "a part of the set", "`sequence`"]);
    let side_by_side = PLC.replace("sequence = \"holding:103\"\n", "");
    assert!(parse(&side_by_side).is_ok(), "one request carries all of it");
    let device = "\n[device.other]\nbus = \"control\"\nunit = 2\n\n[signal.bed]";
    let elsewhere = PLC.replacen("\n[signal.bed]", device, 1);
    let at = elsewhere.rfind("device = \"plc\"").unwrap();
    let elsewhere = format!("{}device = \"other\"{}", &elsewhere[..at], &elsewhere[at + 14..]);
    reported(
        &elsewhere,
        "output.plc_z.device",
        "\"other\"",
        &["set `block` is written to `plc`", "two devices"],
    );
    let twice = format!("set = \"block\"\n{}", HANDSHAKE.replace("800ms", "400ms"));
    plc_refused("set = \"block\"", &twice, "output.plc_x.handshake", "handshake", &["at the set"]);
}

#[test]
fn an_acknowledge_answers_one_strobe() {
    let of = |strobe: &str| HANDSHAKE.replace("800ms", "400ms").replace("coil:20", strobe);
    let mut text = PLC
        .replace("set = \"block\"\n", "")
        .replace("[set.block]\nsequence = \"holding:103\"\ncomplement = \"holding:110\"\n", "");
    for (output, strobe) in [("plc_x", "coil:20"), ("plc_y", "coil:21")] {
        text = text.replacen(&format!("[output.{output}]"), &format!("[output.{output}]\n{}", of(strobe)), 1);
    }
    reported(&text, "output.plc_y.handshake.acknowledge", "\"discrete", &["output plc_x uses the same"]);
    let same = text.replace("coil:21", "coil:20").replacen("discrete:20", "discrete:19", 1);
    reported(&same, "output.plc_y.handshake.strobe", "\"coil:20", &["writes the same registers"]);
}

#[test]
fn a_boot_counter_is_one_register_that_can_be_read() {
    let key = "output.cnc_z.restart.boot_counter";
    let restart = |register: &str| format!("{SHARE}\nrestart = {{ boot_counter = \"{register}\" }}");
    refused(SHARE, &restart("discrete:98"), key, "\"discrete", &["one bit", "cannot count"]);
    refused(SHARE, &restart("holding:105"), key, "\"holding", &["overlaps", "cnc_z"]);
    let few = "unit = 4\nfunctions = [\"read-coils\", \"read-discrete\", \"read-holding\", \"write-single\", \"write-multiple\"]";
    let text = GRINDER.replacen("unit = 4", few, 1).replacen(SHARE, &restart("input:98"), 1);
    reported(&text, key, "\"input:98", &["read-input", "`cnc`"]);
    let mut two =
        PLC.replacen("set = \"block\"", "set = \"block\"\nrestart = { boot_counter = \"holding:98\" }", 1);
    let at = two.rfind("set = \"block\"").unwrap();
    two.insert_str(at, "restart = { boot_counter = \"holding:97\" }\n");
    reported(
        &two,
        "output.plc_z.restart.boot_counter",
        "\"holding:97",
        &["`plc` already has its boot counter at holding:98"],
    );
    let corrected = "position = \"scale_z\"";
    let text = GRINDER.replacen(
        corrected,
        &format!("{corrected}\nrestart = {{ boot_counter = \"holding:98\" }}"),
        1,
    );
    reported(
        &text,
        "output.readout_z.restart.boot_counter",
        "boot_counter",
        &["each time the position is read"],
    );
}

#[test]
fn what_lands_together_and_how_it_is_taken_is_explained() {
    let explained = |text: &str| {
        let machine = parse(text).unwrap().profile;
        isotherm_profile::preview::Preview::of(&machine)
    };
    let restart = format!("{SHARE}\nrestart = {{ boot_counter = \"holding:98\" }}");
    let cnc = explained(&shaken().replacen(SHARE, &restart, 1)).to_string();
    for words in [
        "output cnc_z: accepted by cnc with a handshake",
        "one request: holding:104..105 (40105..40106), 2 registers, function 16",
        "then: strobe coil:20 (00021) on (function 05), acknowledge discrete:20 (10021) on within 800ms, \
         strobe off",
        "read again, and Cz resumes from the value read, when holding:98 (40099) changes, or hydraulics rises",
        "cnc.boot_counter",
    ] {
        assert!(cnc.contains(words), "`{words}` is not in:\n{cnc}");
    }
    let plc = explained(PLC);
    let reported = plc.to_string();
    for words in [
        "set block: plc_x, plc_y, plc_z are written together to plc",
        "one request: holding:103..110 (40104..40111), 8 registers, function 16",
        "sequence holding:103 (40104): counts up with every complete set",
        "complement holding:110 (40111): sum of all other words of the set",
    ] {
        assert!(reported.contains(words), "`{words}` is not in:\n{reported}");
    }
    let apart = explained(&PLC.replace("holding:103", "holding:140")).to_string();
    let order = "2 requests, in this order:\n      holding:104..110 (40105..40111), 7 registers, function 16\n      holding:140";
    assert!(apart.contains(order), "{apart}");
    let document = serde_json::to_value(&plc).unwrap();
    assert_eq!(document["sets"][0]["sequence"]["modicon"], "40104");
}
