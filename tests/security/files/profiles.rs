//! Profiles, and the files that they name.

use std::fmt::Write;

use super::rig::{Home, isotherm, size};
use crate::encode::{model, node, tensor};

const MACHINE: &str = "[machine]\nname = \"attacked\"\n[bus.cell]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"\n\
                       [device.module]\nbus = \"cell\"\nunit = 1\n[signal.bed]\ndevice = \"module\"\n\
                       register = \"input:0\"\ntype = \"i16\"\nunit = \"degC\"\n[axis.z]\nlimit = 40.0\nstep = 1.0\nrate = 0.5\n\
                       every = \"10s\"\non_fault = { action = \"zero\" }\n[[axis.z.model]]\nname = \"first\"\n";

#[test]
fn two_million_unknown_keys_are_refused_before_they_are_looked_at() {
    let home = Home::new();
    let mut text = String::from(MACHINE);
    (0..2_000_000).for_each(|key| writeln!(text, "k{key}=1").unwrap());
    let path = home.write("keys.toml", text);
    isotherm(&["check"], &path).is_refused(size(&path), &["keys.toml", "larger than 8 MB"]);
}

#[test]
fn as_many_unknown_keys_as_a_profile_can_hold_are_counted_and_fifty_told() {
    let home = Home::new();
    let mut text = String::from(MACHINE);
    let keys = 660_000;
    (0..keys).for_each(|key| writeln!(text, "k{key}=1").unwrap());
    let path = home.write("keys.toml", &text);
    let counted = format!("{} errors in the profile", keys + 1);
    let refused = isotherm(&["check"], &path);
    // A profile may need fifty times its size, any other file ten times.
    let input = 5 * size(&path);
    refused.is_refused(input, &["keys.toml:22:1", "unknown key `k0`", &counted]);
    assert_eq!(refused.said.matches("unknown key").count(), 50, "{}", refused.said.len());
    isotherm(&["check", "--json"], &path).is_refused(input, &["unknown key `k0`"]);
    // All keys in one line.
    let keys: Vec<String> = (0..250_000).map(|key| format!("k{key}=1")).collect();
    let path = home.write("line.toml", format!("{MACHINE}inputs = {{ {} }}\n", keys.join(", ")));
    isotherm(&["check"], &path).is_refused(size(&path), &["line.toml:22:"]);
}

#[test]
fn a_profile_of_syntax_errors_or_of_one_list_needs_no_more_memory_than_other_files() {
    let home = Home::new();
    let errors = |line: &str| line.repeat(2_000_000 / line.len());
    let list = |entry: &str| format!("terms = [{}]\n", entry.repeat(4_000_000));
    for (name, text, words) in [
        ("equals.toml", errors("=\n"), "equals.toml:22:"),
        ("words.toml", errors("x\n"), "words.toml:22:"),
        ("open.toml", errors("[\n"), "open.toml:22:"),
        ("list.toml", list("1,"), "more than 500000 commas"),
        ("wrong_list.toml", list("=,"), "more than 500000 commas"),
    ] {
        let path = home.write(name, format!("{MACHINE}{text}"));
        isotherm(&["check"], &path).is_refused(size(&path), &[name, words]);
    }
}

#[test]
fn a_million_terms_and_unknown_signals_by_the_thousand_are_refused() {
    let home = Home::new();
    let linear = format!("{MACHINE}kind = \"linear\"\nterms = [\n");
    let term = |signal: &str| format!("{{ signal = \"{signal}\", gain = 1.0, reference = 20.0 }},\n");
    let path = home.write("million.toml", format!("{linear}{}]\n", term("bed").repeat(1_000_000)));
    isotherm(&["check"], &path).is_refused(size(&path), &["million.toml", "larger than 8 MB"]);
    let path = home.write("terms.toml", format!("{linear}{}]\n", term("bed").repeat(80_000)));
    isotherm(&["check"], &path).is_refused(size(&path), &["terms.toml:23:", "80000 entries: at most 10000"]);
    // Each term names a signal that does not exist, among many that do.
    let mut text = linear.clone();
    (0..10_000).for_each(|place| text.push_str(&term(&format!("sensor{place:05}x"))));
    text.push_str("]\n");
    for place in 0..20_000 {
        writeln!(
            text,
            "[signal.sensor{place:05}]\ndevice=\"module\"\nregister=\"input:{place}\"\ntype=\"i16\""
        )
        .unwrap();
    }
    let path = home.write("unknown.toml", text);
    isotherm(&["check"], &path)
        .is_refused(size(&path), &["there is no signal named `sensor00000x`", "did you mean"]);
}

#[test]
fn a_long_line_and_a_long_key_are_quoted_in_part() {
    let home = Home::new();
    let long = "x".repeat(3_000_000);
    for (name, text) in [
        ("key.toml", format!("{MACHINE}{long} = 1\n")),
        ("value.toml", format!("{MACHINE}kind = \"{long}\"\n")),
        ("behind.toml", format!("{MACHINE}kind = \"linear\" # {long}\n")),
        ("before.toml", format!("{MACHINE}inputs = {{ a = \"{long}\", b = 7 }}\n")),
        ("table.toml", format!("{MACHINE}[{long}]\n")),
        ("nothing.toml", long.clone()),
        ("nested.toml", format!("{MACHINE}terms = {}\n", "[".repeat(1_000_000))),
        ("dotted.toml", format!("{MACHINE}{}a = 1\n", "a.".repeat(1_000_000))),
        ("formula.toml", format!("{MACHINE}kind = \"formula\"\nformula = \"{}\"\n", "(".repeat(1_000_000))),
    ] {
        let path = home.write(name, text);
        isotherm(&["check"], &path).is_refused(size(&path), &[name]);
        isotherm(&["check", "--json"], &path).is_refused(size(&path), &[name]);
    }
}

#[test]
fn a_period_below_a_millisecond_is_refused_where_it_stands() {
    let home = Home::new();
    let linear = "kind = \"linear\"\nterms = [ { signal = \"bed\", gain = 1.0, reference = 20.0 } ]\n";
    let good = format!("{MACHINE}{linear}");
    for (name, text) in [
        ("device.toml", good.replace("unit = 1\n", "unit = 1\nevery = \"1us\"\n")),
        ("axis.toml", good.replace("every = \"10s\"", "every = \"999us\"")),
        (
            "heartbeat.toml",
            format!("{good}[heartbeat]\ndevice = \"module\"\nregister = \"holding:1\"\nevery = \"1ns\"\n"),
        ),
    ] {
        let path = home.write(name, text);
        isotherm(&["check"], &path)
            .is_refused(size(&path), &[name, "is too short: the shortest allowed period is 1ms"]);
    }
    let path = home.write("shortest.toml", good.replace("unit = 1\n", "unit = 1\nevery = \"1ms\"\n"));
    assert_eq!(isotherm(&["check"], &path).is_within(size(&path)).code, 0);
}

#[test]
fn the_files_that_a_profile_names_are_refused_when_they_have_no_end() {
    let home = Home::new();
    let long = "9,".repeat(7_000_000);
    home.write("long.json", format!("{{\"format\":\"isotherm-network\",\"version\":1,\"type\":[{long}9]}}"));
    home.write("names.json", {
        let names = "\"\",".repeat(5_000_000);
        format!("{{\"format\":\"isotherm-matrix\",\"version\":1,\"blocks\":[{names}\"\"],\"guide_mm\":[],\"P\":[]}}")
    });
    home.write("deep.json", "[".repeat(10_000_000));
    home.write("format.json", format!("{{\"format\":\"{}\"}}", "x".repeat(15_000_000)));
    home.write("huge.json", vec![b' '; 17 << 20]);
    home.write("long.dbc", format!("VERSION \"{}\"\n", "x".repeat(15_000_000)));
    home.write("line.dbc", "BO_ 256 Top: 8 N\n SG_ ".repeat(600_000));
    home.write("bytes.onnx", vec![0xff; 15_000_000]);
    let network = "kind = \"network\"\ninputs = [\"bed\"]\nfile = ";
    let matrix = "kind = \"matrix\"\ninputs = [\"bed\"]\nreference = \"start\"\nposition = \"bed\"\ncomponent = \"z\"\n\
                  carries = \"tool\"\nfile = ";
    for (kind, file) in [
        (network, "long.json"),
        (matrix, "names.json"),
        (matrix, "deep.json"),
        (network, "format.json"),
        (network, "huge.json"),
        (network, "bytes.onnx"),
        (network, "/dev/zero"),
    ] {
        let path = home.write("machine.toml", format!("{MACHINE}{kind}\"{file}\"\n"));
        let most = 16 << 20;
        isotherm(&["check"], &path).is_refused(most, &["machine.toml", file]);
    }
    for file in ["long.dbc", "line.dbc", "/dev/zero"] {
        let text = format!(
            "[machine]\nname = \"attacked\"\n[bus.can]\ntype = \"can\"\ninterface = \"vcan0\"\n[device.d]\nbus = \"can\"\n\
             dbc = \"{file}\"\n[signal.a]\ndevice = \"d\"\ndbc = \"Top.Temp\"\n"
        );
        let path = home.write("machine.toml", text);
        isotherm(&["check"], &path).is_refused(16 << 20, &["in the profile"]);
    }
}

#[test]
fn a_small_network_that_asks_for_gigabytes_is_refused_before_it_gets_them() {
    let home = Home::new();
    let zeros = [0.0; 50_000];
    let (column, row) = (tensor("column", &[50_000, 1], &zeros), tensor("row", &[1, 50_000], &zeros));
    let nodes = [node("Add", &["column", "row"], "large"), node("MatMul", &["x", "large"], "y")];
    let onnx = home.write("small.onnx", model(&nodes, &[column, row], Some(1)));
    let network = "kind = \"network\"\ninputs = [\"bed\"]\nfile = \"small.onnx\"\n";
    let path = home.write("machine.toml", format!("{MACHINE}{network}"));
    isotherm(&["check"], &path).is_refused(
        size(&onnx),
        &["machine.toml", "node Add with the output `large` makes the network too large: 2500000000"],
    );
}
