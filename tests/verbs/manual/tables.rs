//! The lists of the manual are complete: verbs, machines, kinds of faults, messages, addresses of the API, and
//! events.

use std::collections::BTreeSet;
use std::path::Path;

use isotherm::observe::status::Command;
use isotherm::virtual_machine::FaultScript;
use isotherm_core::events::EventKind;
use isotherm_profile::parse;

use super::book::{read, root};
use super::process::isotherm;

/// Texts between backticks in the first cell of each row.
fn firsts(text: &str) -> Vec<String> {
    let rows = text.lines().filter(|line| line.starts_with("| "));
    let cells = rows.filter_map(|row| row.split('|').nth(1));
    cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).map(str::to_owned).collect()
}

fn said(command: &mut std::process::Command) -> String {
    let output = command.output().unwrap();
    [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat()
}

#[test]
fn the_kinds_of_faults_are_those_that_a_script_may_have() {
    let profile = parse(Path::new("base.toml"), &read("tests/verbs/manual/base.toml"), &[], &[]);
    let profile = profile.unwrap_or_else(|why| panic!("{why}")).profile;
    let kinds =
        FaultScript::parse("[[fault]]\ndevice = \"module\"\nkind = \"no-such\"\n", &profile).unwrap_err();
    let kinds = kinds.to_string();
    let (_, kinds) = kinds.split_once("allowed: ").unwrap();
    let kinds: BTreeSet<String> = kinds.trim().split(", ").map(str::to_owned).collect();
    // A kind is in the table of each protocol that has it.
    let reported: BTreeSet<String> = firsts(&read("docs/virtual.md")).into_iter().collect();
    assert_eq!(reported, kinds);
}

#[test]
fn the_verbs_are_those_that_the_program_has() {
    let home = tempfile::tempdir().unwrap();
    let help = said(isotherm(home.path()).arg("help"));
    let verbs = help.split("Commands:\n").nth(1).unwrap().split("\n\n").next().unwrap();
    let verbs = verbs.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let verbs: Vec<&str> = verbs.map(|line| line.split_whitespace().next().unwrap()).collect();
    let reported = firsts(&read("docs/verbs.md"));
    let reported: Vec<&str> = reported.iter().map(|cell| cell.split(' ').next().unwrap()).collect();
    assert!(verbs.len() > 20, "{verbs:?}");
    for verb in verbs.iter().filter(|verb| **verb != "help") {
        assert!(reported.contains(verb), "docs/verbs.md does not have {verb}");
    }
    assert!(reported.iter().all(|verb| verbs.contains(verb)), "{reported:?}");
}

#[test]
fn the_machines_are_those_that_are_shipped() {
    let mut shipped: Vec<String> = std::fs::read_dir(root().join("profiles"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter_map(|name| name.strip_suffix(".toml").map(str::to_owned))
        .filter(|name| !name.ends_with(".plant"))
        .collect();
    let mut reported = firsts(&read("docs/machines.md"));
    reported.retain(|name| shipped.contains(name));
    shipped.sort();
    reported.sort();
    reported.dedup();
    assert_eq!(reported, shipped);
}

/// Every message of the chapter occurs in the source.
#[test]
fn a_message_that_troubleshooting_explains_is_one_that_the_program_says() {
    let chapter = read("docs/troubleshooting.md");
    let messages = chapter.split("| message | ").skip(1).flat_map(|table| {
        let rows = table.lines().skip(2).take_while(|line| line.starts_with("| "));
        rows.flat_map(|row| row.split('|').nth(1).unwrap().split('"').skip(1).step_by(2)).collect::<Vec<_>>()
    });
    let mut source = String::new();
    for folder in ["src", "crates"] {
        gather(&root().join(folder), &mut source);
    }
    // A string that continues after a backslash is joined to one line.
    let source = source.split_whitespace().filter(|word| *word != "\\").collect::<Vec<_>>().join(" ");
    let mut count = 0;
    let mut unsaid = Vec::new();
    for message in messages {
        count += 1;
        // "…" stands for a variable part.
        for part in message.split('…').map(str::trim).filter(|part| part.len() > 2) {
            if !source.contains(part) {
                unsaid.push(part);
            }
        }
    }
    assert!(count > 20 && unsaid.is_empty(), "{count} messages; nobody says: {unsaid:#?}");
}

fn gather(folder: &Path, source: &mut String) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            gather(&path, source);
        } else if path.extension().is_some_and(|end| end == "rs") {
            source.push_str(&std::fs::read_to_string(&path).unwrap());
            source.push('\n');
        }
    }
}

#[test]
fn the_api_is_told_with_every_address() {
    let routes = read("src/observe/http/routes.rs");
    let fixed = routes.lines().filter(|line| line.trim_start().starts_with("(Route::"));
    let fixed = fixed.filter_map(|line| line.split('"').nth(1));
    let fixed: Vec<&str> = fixed.filter(|path| !path.starts_with("/page") && *path != "/login").collect();
    let reported = read("docs/api.md");
    assert!(fixed.len() > 8, "{fixed:?}");
    let commands = Command::ALL.map(|(name, _)| format!("/api/{name}"));
    for path in fixed.into_iter().map(|path| path.replace("{axis}", "z")).chain(commands) {
        let is_told = reported.contains(&format!("{path}`")) || reported.contains(&format!("{path}?"));
        assert!(is_told, "docs/api.md lacks {path}");
    }
}

/// Every kind of the catalogue is the name of an event, or is named where its event is described.
#[test]
fn each_kind_of_event_is_reported() {
    let mut source = std::fs::read_to_string(root().join("crates/core/src/output/handshake.rs")).unwrap();
    gather(&root().join("src/observe/events"), &mut source);
    let words: BTreeSet<&str> = source.split(|c: char| !c.is_alphanumeric()).collect();
    let unused: Vec<EventKind> =
        EventKind::ALL.into_iter().filter(|kind| !words.contains(format!("{kind:?}").as_str())).collect();
    assert!(unused.is_empty(), "no event is of these kinds: {unused:?}");
}
