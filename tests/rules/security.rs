//! Security promises: each one must have a test. SECURITY.md must say where to report a weakness, and how it is
//! handled.

use std::os::unix::fs::PermissionsExt;

use super::{files, root};

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap()
}

/// Cells of each row in the tables of the threat model that name tests, without the heads.
fn rows(text: &str) -> Vec<Vec<&str>> {
    let mut rows = Vec::new();
    let mut names_tests = false;
    let mut before = "";
    for line in text.lines() {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        if line.starts_with("|---") {
            names_tests = before.rsplit('|').nth(1).is_some_and(|head| head.trim().starts_with("test"));
        } else if line.starts_with('|') && before.starts_with('|') && names_tests {
            rows.push(cells);
        }
        before = line;
    }
    rows
}

/// Tests that a cell names. A word in backticks is the name of a test, a path below `tests` is a script.
fn tests(cell: &str) -> Vec<&str> {
    let quoted = cell.split('`').skip(1).step_by(2);
    let is_word = |name: &str| !name.contains(|c: char| !c.is_alphanumeric() && c != '_');
    quoted
        .filter(|name| (is_word(name) && name.matches('_').count() > 3) || name.starts_with("tests/"))
        .collect()
}

fn without_a_test(text: &str) -> Vec<String> {
    let bare = rows(text).into_iter().filter(|row| row.last().is_none_or(|last| tests(last).is_empty()));
    bare.map(|row| row.join(" | ")).collect()
}

/// Chapters with tables that name tests, each with the least number of rows.
const CHAPTERS: [(&str, usize); 2] = [("docs/threat-model.md", 25), ("docs/mqtt.md", 15)];

#[test]
fn every_row_of_the_threat_model_names_a_test() {
    for (chapter, least) in CHAPTERS {
        let text = read(chapter);
        assert!(rows(&text).len() > least, "{chapter}: {}", rows(&text).len());
        assert_eq!(without_a_test(&text), [""; 0], "{chapter}: these name none");
    }
    let reviewed =
        "| what | how | test |\n|---|---|---|\n| a | b | by review: [c](c.md), `packaging/dist` |\n";
    assert_eq!(without_a_test(reviewed).len(), 1);
    assert_eq!(without_a_test(&reviewed.replace("packaging/dist", "tests/dist/run")).len(), 0);
}

#[test]
fn every_test_that_the_threat_model_names_is_there() {
    let text: String = CHAPTERS.iter().map(|(chapter, _)| read(chapter)).collect();
    let is_source = |file: &std::path::PathBuf| file.extension().is_some_and(|end| end == "rs");
    let sources = files()
        .into_iter()
        .filter(is_source)
        .filter_map(|file| std::fs::read_to_string(root().join(file)).ok());
    let sources: String = sources.collect();
    let run = read("tests/run");
    // A script counts as a test if it is executable, and `tests/run` starts it.
    let is_script = |name: &str| {
        let mode = std::fs::metadata(root().join(name)).map(|found| found.permissions().mode());
        mode.is_ok_and(|mode| mode & 0o111 != 0) && run.lines().any(|line| line.trim().starts_with(name))
    };
    let is_there = |name: &str| match name.strip_prefix("tests/") {
        Some(_) => is_script(name),
        None => sources.contains(&format!("fn {name}(")),
    };
    let named: Vec<&str> = rows(&text).iter().flat_map(|row| tests(row[row.len() - 1])).collect();
    let missing: Vec<&&str> = named.iter().filter(|name| !is_there(name)).collect();
    assert!(named.len() > 50 && missing.is_empty(), "{} named, {missing:?}", named.len());
    assert!(!is_there("tests/dist/no-such-script") && !is_there("a_test_that_nobody_has_ever_written"));
}

/// Text below a heading, up to the next heading of its level.
fn below<'a>(text: &'a str, heading: &str) -> &'a str {
    let level = heading.split(' ').next().unwrap();
    let begin =
        text.split_once(&format!("\n{heading}\n")).unwrap_or_else(|| panic!("there is no `{heading}`")).1;
    begin.split(&format!("\n{level} ")).next().unwrap()
}

#[test]
fn whoever_finds_a_weakness_reads_where_to_report_it_and_what_becomes_of_it_by_when() {
    let security = read("SECURITY.md");
    let words = |heading: &str| {
        below(&security, heading).split_whitespace().collect::<Vec<_>>().join(" ").to_lowercase()
    };
    let expected = [
        ("## Reporting", "in private"),
        ("## Reporting", "not in a public issue"),
        ("## Reporting", "an answer within fourteen days"),
        ("## Reporting", "within ninety days there is a fix"),
        ("## Reporting", "`### security` in `changelog.md`"),
        ("## What is supported", "the newest release"),
        ("## What is supported", "gets no fixes"),
        ("## What is promised, and what is not", "not a safety function"),
    ];
    for (heading, said) in expected {
        assert!(words(heading).contains(said), "SECURITY.md, {heading}: {said}");
    }
    for file in ["README.md", "docs/threat-model.md"] {
        assert!(read(file).contains("SECURITY.md)"), "{file} does not lead there");
    }
}

#[test]
fn the_newest_entry_of_the_changelog_is_the_version_that_is_built_and_speaks_of_security() {
    let changelog = read("CHANGELOG.md");
    let version = env!("CARGO_PKG_VERSION");
    let newest = changelog.lines().find(|line| line.starts_with("## ")).unwrap();
    let entry = below(&changelog, newest);
    let is_told = match newest {
        "## [Unreleased]" => entry.contains(&format!("\nBecomes {version}.\n")),
        newest => newest.starts_with(&format!("## [{version}]")),
    };
    assert!(is_told, "{newest} is not {version}");
    let reported = below(entry, "### Security");
    assert!(
        reported.lines().any(|line| line.starts_with("- ")),
        "nothing stands below `### Security` of {newest}"
    );
}
