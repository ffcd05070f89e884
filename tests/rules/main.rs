//! Rules for the structure of the project: allowed imports, the location of files, and forbidden words.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::{Path, PathBuf};
use std::process::Command;

mod budget;
mod circles;
mod language;
mod lexer;
mod security;
mod source;

/// Allowed imports between the modules of a crate, which Cargo cannot check. A name after `::` restricts the import to
/// that part of the module. `src/lib.rs` and `crates/core/src/lib.rs` contain the same as a drawing.
const ARROWS: [(&str, &str, &[&str]); 22] = [
    ("crates/core", "border", &[]),
    ("crates/core", "quantity", &[]),
    ("crates/core", "reading", &["quantity"]),
    ("crates/core", "codec", &["quantity", "reading"]),
    ("crates/core", "compensation", &["border", "quantity", "reading"]),
    ("crates/core", "candidate", &["quantity"]),
    ("crates/core", "continuity", &["quantity"]),
    ("crates/core", "events", &[]),
    ("crates/core", "output", &["events", "quantity"]),
    ("crates/core", "display", &["compensation", "output", "quantity"]),
    ("crates/core", "explained", &[]),
    ("crates/core", "namespaces", &[]),
    ("crates/core", "place", &[]),
    ("", "clock", &[]),
    ("", "tls", &[]),
    ("", "net", &["tls"]),
    ("", "fieldbus", &["clock", "net", "tls"]),
    ("", "observe", &["clock", "net", "tls"]),
    ("", "gateway", &["fieldbus", "clock", "observe::requester", "observe::events", "observe::status"]),
    ("", "discovery", &["clock", "fieldbus"]),
    (
        "",
        "virtual_machine",
        &[
            "clock",
            "fieldbus::kinds::can::socket",
            "fieldbus::kinds::can::canopen::abort",
            "fieldbus::kinds::opcua::conversion",
            "fieldbus::error",
        ],
    ),
    (
        "",
        "cli",
        &[
            "clock",
            "fieldbus::explain",
            "fieldbus::kinds::opcua::check",
            "fieldbus::line::LONGEST_GATEWAY_WAIT",
            "fieldbus::tls",
            "gateway",
            "observe",
            "virtual_machine",
            "discovery",
        ],
    ),
];

/// Folders and files of `src/gateway`, and those that each may use. A name only uses names before it.
/// `docs/architecture.md` contains the same.
const GATEWAY: [(&str, &[&str]); 9] = [
    ("line_names", &[]),
    ("state", &[]),
    ("store", &["line_names", "state"]),
    ("shared", &["state", "store"]),
    ("lifecycle", &["shared", "state", "store"]),
    ("output", &["shared", "state", "store"]),
    ("line", &["output", "shared", "state", "store"]),
    ("api", &["lifecycle", "line", "shared", "state", "store"]),
    ("claims", &["api", "line_names"]),
];

const TOP: [&str; 16] = [
    "Cargo.toml",
    "Cargo.lock",
    "CONTRIBUTING.md",
    "rust-toolchain.toml",
    "README.md",
    "SECURITY.md",
    "LICENSE",
    "CHANGELOG.md",
    "crates",
    "src",
    "profiles",
    "tests",
    "benches",
    "docker",
    "docs",
    "packaging",
];

const LONGEST: usize = 600;

/// Parts of file names. These files may use the word for the time between login and logout, of an OPC UA client, of TLS
/// or of a browser at the page, also behind a proxy. MQTT uses it for what a broker keeps of a client.
const LOGINS: [&str; 11] = [
    "opcua",
    "page",
    "observe/http",
    "docs/api.md",
    "docs/proxy.md",
    "docs/threat-model.md",
    "tests/security",
    "fieldbus",
    "mqtt",
    "continuity",
    "rules/budget",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Files of the project: those under version control. Without version control, all files except those in build and dot
/// directories.
fn files() -> Vec<PathBuf> {
    let listed = Command::new("git").args(["ls-files", "-z"]).current_dir(root()).output();
    if let Ok(listed) = listed
        && listed.status.success()
        && !listed.stdout.is_empty()
    {
        let names = String::from_utf8(listed.stdout).unwrap();
        let names = names.split('\0').filter(|name| !name.is_empty()).map(PathBuf::from);
        return names.filter(|name| root().join(name).is_file()).collect();
    }
    let mut found = Vec::new();
    gather(root(), &mut found);
    found.iter().map(|path| path.strip_prefix(root()).unwrap().to_owned()).collect()
}

fn gather(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() && name != "target" && name != ".git" {
            gather(&path, found);
        } else if path.is_file() {
            found.push(path);
        }
    }
}

#[test]
fn every_arrow_points_left() {
    let mut wrong = Vec::new();
    for source in source::all(root()) {
        let Some((_, _, may)) =
            ARROWS.iter().find(|(home, room, _)| *home == source.home() && *room == source.room())
        else {
            continue;
        };
        for path in source.crate_paths() {
            let inside = path.first().is_some_and(|room| room == source.room());
            let path = path.join("::");
            let allowed = |known: &&&str| path == **known || path.starts_with(&format!("{known}::"));
            if !inside && !may.iter().any(|known| allowed(&known)) {
                wrong.push(format!("{}: crate::{path}", source.path));
            }
        }
        let escapes = source.escapes();
        wrong.extend(escapes.iter().map(|line| format!("{}: {line}: say crate::", source.path)));
    }
    assert!(wrong.is_empty(), "these run the wrong way:\n{}", wrong.join("\n"));
}

#[test]
fn the_table_of_arrows_has_no_circle() {
    // Each module may only import modules that can be placed before it.
    let mut placed: Vec<(&str, &str)> = Vec::new();
    while placed.len() < ARROWS.len() {
        let next = ARROWS.iter().find(|(home, room, may)| {
            let known = |other: &&str| placed.contains(&(*home, other.split("::").next().unwrap()));
            !placed.contains(&(*home, *room)) && may.iter().all(known)
        });
        let (home, room, _) =
            next.unwrap_or_else(|| panic!("a circle among the rooms that are not in {placed:?}"));
        placed.push((*home, *room));
    }
}

#[test]
fn the_folders_of_the_gateway_use_only_those_in_their_table() {
    let mut wrong = Vec::new();
    for source in source::all(root()) {
        let Some(inside) = source.path.strip_prefix("src/gateway/") else { continue };
        let folder = inside.split(['/', '.']).next().unwrap();
        let known = GATEWAY.iter().find(|(name, _)| *name == folder);
        let (_, may) = known.unwrap_or_else(|| panic!("{folder} is not in the table GATEWAY"));
        for path in source.crate_paths().iter().filter(|path| path.len() > 1 && path[0] == "gateway") {
            if path[1] != folder && !may.contains(&path[1].as_str()) {
                wrong.push(format!("{}: crate::{}", source.path, path.join("::")));
            }
        }
    }
    assert!(wrong.is_empty(), "these run the wrong way:\n{}", wrong.join("\n"));
    for (place, (folder, may)) in GATEWAY.iter().enumerate() {
        let before = &GATEWAY[..place];
        let is_before = may.iter().all(|used| before.iter().any(|(name, _)| name == used));
        assert!(is_before, "{folder} uses a folder that does not stand before it in the table GATEWAY");
    }
}

/// A new type of bus must not need a change of the gateway.
#[test]
fn the_gateway_compares_no_types_of_bus_and_looks_into_no_request() {
    let words = ["Transport::", "ModbusRequest", "CanRequest", "NodeRequest", "SensorRequest"];
    let wrong: Vec<String> = source::all(root())
        .iter()
        .filter(|source| source.path.starts_with("src/gateway"))
        .filter(|source| words.iter().any(|word| source.code.contains(word)))
        .map(|source| source.path.clone())
        .collect();
    assert!(wrong.is_empty(), "ask crate::fieldbus::kinds::of(…), and make requests by Request: {wrong:?}");
}

#[test]
fn every_room_of_the_program_and_of_core_is_in_the_table_and_on_the_map() {
    for home in ["", "crates/core"] {
        let library = std::fs::read_to_string(root().join(home).join("src/lib.rs")).unwrap();
        let rooms = library.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';'));
        for room in rooms.clone() {
            let is_there = ARROWS.iter().any(|(known, name, _)| (*known, *name) == (home, room));
            assert!(is_there, "{room} is not in the table ARROWS");
            assert!(
                library.contains(&format!("//! - [`{room}`]")),
                "{room} is not on the map of {home}/src/lib.rs"
            );
        }
        assert_eq!(rooms.count(), ARROWS.iter().filter(|(known, ..)| *known == home).count());
    }
}

#[test]
fn every_source_file_belongs_to_a_module() {
    let sources: Vec<String> = source::all(root()).iter().map(|source| source.path.to_string()).collect();
    let text_of = |path: &str| std::fs::read_to_string(root().join(path)).unwrap_or_default();
    let orphans = sources.iter().filter(|path| {
        let (folder, file) = path.rsplit_once('/').unwrap();
        let name = file.strip_suffix(".rs").unwrap();
        let is_root = ["lib", "main", "build"].contains(&name);
        let beside = [format!("{folder}/lib.rs"), format!("{folder}/main.rs"), format!("{folder}.rs")];
        let declared = format!("mod {name};");
        !is_root
            && !beside
                .iter()
                .any(|parent| text_of(parent).lines().any(|line| line.trim().ends_with(&declared)))
    });
    let orphans: Vec<&String> = orphans.collect();
    assert!(orphans.is_empty(), "nobody compiles these: {orphans:#?}");
}

#[test]
fn no_more_than_three_files_import_each_other() {
    let circles = circles::larger_than(3, &source::all(root()), circles::ParentImports::Ignored);
    let reported: Vec<String> = circles.iter().map(|circle| circle.join("\n  ")).collect();
    assert!(reported.is_empty(), "circles of imports:\n  {}", reported.join("\nand\n  "));
}

/// Decisions, and the meaning of a profile, do not depend on the program that uses the crates.
#[test]
fn nothing_in_crates_knows_a_runtime_a_connection_or_a_command_line() {
    for entry in std::fs::read_dir(root().join("crates")).unwrap() {
        let manifest = entry.unwrap().path().join("Cargo.toml");
        let text = std::fs::read_to_string(&manifest).unwrap();
        for name in ["tokio", "rustls", "clap", "tracing"] {
            let is_named = text.lines().any(|line| line.starts_with(name));
            assert!(!is_named, "{} names {name}", manifest.display());
        }
    }
}

#[test]
fn only_the_clock_knows_what_time_it_is() {
    let words = ["Instant", "SystemTime"];
    let wrong: Vec<String> = source::all(root())
        .iter()
        .filter(|source| (source.home(), source.room()) != ("", "clock"))
        .filter(|source| words.iter().any(|word| source.code.contains(word)))
        .map(|source| source.path.clone())
        .collect();
    assert!(wrong.is_empty(), "the time comes from crate::clock, not here: {wrong:?}");
}

/// `println!` and similar macros panic if the output is closed.
#[test]
fn what_a_verb_prints_goes_through_one_place() {
    let words = ["println!", "print!(", "stdout().write"];
    let wrong: Vec<String> = source::all(root())
        .iter()
        .filter(|source| source.home().is_empty() && source.path != "src/cli/print.rs")
        .filter(|source| words.iter().any(|word| source.code.contains(word)))
        .map(|source| source.path.clone())
        .collect();
    assert!(wrong.is_empty(), "what is printed is said by crate::cli::print: {wrong:?}");
}

#[test]
fn the_two_pure_steps_touch_nothing_outside_themselves() {
    let outside = ["tokio", "std::fs", "std::net", "std::io", "std::thread", "std::env", "tracing", "rand"];
    let is_pure = |room: &str| ["candidate", "compensation", "continuity", "output"].contains(&room);
    for source in source::all(root()).iter().filter(|source| is_pure(source.room())) {
        for word in outside {
            assert!(!source.code.contains(word), "{} uses {word}", source.path);
        }
    }
}

#[test]
fn no_source_file_is_longer_than_a_person_reads_at_once() {
    for source in source::all(root()) {
        let lines = source.text.lines().count();
        assert!(lines <= LONGEST, "{} has {lines} lines, {LONGEST} are allowed: split it", source.path);
    }
}

#[test]
fn nothing_lies_at_the_top_that_does_not_belong_there() {
    for file in files() {
        let top = file.iter().next().unwrap().to_str().unwrap().to_owned();
        assert!(TOP.contains(&top.as_str()) || top.starts_with('.'), "{top} does not belong at the top");
    }
}

#[test]
fn the_project_speaks_of_itself_and_leaves_nothing_for_later() {
    // Each word is divided, so that this file does not find itself.
    let words =
        [concat!("ses", "sion"), concat!("ses", "sions"), concat!("ag", "ent"), concat!("ag", "ents")];
    let marks = [
        concat!("/wo", "rk"),
        concat!("/t", "mp/"),
        concat!("../sha", "red"),
        concat!("TO", "DO"),
        concat!("FIX", "ME"),
        concat!("to", "do!"),
        concat!("unimple", "mented!"),
    ];
    let mut wrong = Vec::new();
    for file in files() {
        // The lock file and the licence are not texts of the project.
        if ["Cargo.lock", "LICENSE"].iter().any(|name| file == Path::new(name)) {
            continue;
        }
        let Ok(text) = std::fs::read_to_string(root().join(&file)) else { continue };
        for (number, line) in text.lines().enumerate() {
            let file = file.to_string_lossy();
            // Names of the parts of a workbook (.xlsx), and a part of the addresses of Teams.
            let names = [concat!("/wo", "rkbook"), concat!("/wo", "rksheet"), concat!("/wo", "rkflows/")];
            let line = names.iter().fold(line.to_owned(), |line, name| line.replace(name, ""));
            let may_log_in = LOGINS.iter().any(|part| file.contains(part));
            let name_in_http = concat!("User-Ag", "ent: ");
            let spoken = line.replace(name_in_http, "").replace(concat!("page ses", "sion"), "");
            let mut spoken = spoken.split(|c: char| !c.is_alphanumeric()).map(str::to_lowercase);
            if marks.iter().any(|mark| line.contains(mark))
                || spoken
                    .any(|word| words.contains(&word.as_str()) && !(may_log_in && word.starts_with(words[0])))
            {
                wrong.push(format!("{file}:{}: {}", number + 1, line.trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "these words do not belong here:\n{}", wrong.join("\n"));
}

#[test]
fn every_shipped_profile_is_taken_without_a_word() {
    let mut count = 0;
    for entry in std::fs::read_dir(root().join("profiles")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if !name.ends_with(".toml") || name.ends_with(".plant.toml") {
            continue;
        }
        let loaded = isotherm_profile::load(&path, &[], &[]).unwrap_or_else(|errors| panic!("{errors}"));
        assert_eq!(loaded.warnings, [], "{name}");
        count += 1;
    }
    assert!(count >= 9, "the shipped machines are gone");
}

/// The exit code of a pipe in the shell of an image is that of the last program only.
#[test]
fn no_image_is_built_through_a_pipe_whose_first_program_may_fail() {
    let is_image =
        |file: &PathBuf| file.file_name().is_some_and(|name| name.to_string_lossy().contains("Dockerfile"));
    let images: Vec<PathBuf> = files().into_iter().filter(is_image).collect();
    assert!(!images.is_empty());
    for image in images {
        let text = std::fs::read_to_string(root().join(&image)).unwrap().replace("\\\n", " ");
        let piped =
            text.lines().find(|line| line.starts_with("RUN ") && line.replace("||", "").contains('|'));
        assert_eq!(piped, None, "{}", image.display());
    }
}
