//! Phrases that no text of the project should contain: in code, comments, messages and documentation.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Phrases that are never right: most were left behind by renames that replaced words inside prose.
const NEVER: [&str; 14] = [
    "access for is",
    "and told to be",
    "can be reported from",
    "cannot be reported from",
    "goes on from there",
    "is reported its",
    "is reported so",
    "is reported the known",
    "not reported compensated",
    "not told compensated",
    "register is before",
    "reported of for",
    "was access",
    "whose part",
];

/// Phrases of the old wording, and how often each may still occur. A number here may only become smaller.
const AT_MOST: [(&str, usize); 4] =
    [("anew", 155), ("is believed", 51), ("is told", 129), ("stands there", 107)];

/// The phrase list itself, and texts that the project did not write.
const SKIPPED: [&str; 3] = ["Cargo.lock", "LICENSE", "tests/rules/prose.rs"];

/// The words of a text in lower case, with their line numbers. A name with underscores is one word.
fn words(text: &str) -> Vec<(usize, String)> {
    let lines = text.lines().enumerate();
    let words = lines.flat_map(|(number, line)| {
        let words = line.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty());
        words.map(move |word| (number + 1, word.to_lowercase()))
    });
    words.collect()
}

/// Every place where one of these phrases occurs, by phrase. A phrase may cross the end of a line.
fn places<'a>(root: &Path, files: &[PathBuf], phrases: &[&'a str]) -> BTreeMap<&'a str, Vec<String>> {
    let mut found: BTreeMap<&str, Vec<String>> = phrases.iter().map(|phrase| (*phrase, Vec::new())).collect();
    for file in files.iter().filter(|file| !SKIPPED.iter().any(|name| *file == Path::new(name))) {
        let Ok(text) = std::fs::read_to_string(root.join(file)) else { continue };
        let words = words(&text);
        for phrase in phrases {
            let wanted: Vec<&str> = phrase.split(' ').collect();
            let here =
                words.windows(wanted.len()).filter(|words| words.iter().map(|(_, word)| word).eq(&wanted));
            let here = here.map(|words| format!("{}:{}", file.display(), words[0].0));
            found.entry(phrase).or_default().extend(here);
        }
    }
    found
}

#[test]
fn phrases_that_are_never_right_do_not_occur() {
    let found = places(super::root(), &super::files(), &NEVER);
    let wrong: Vec<_> = found.iter().filter(|(_, places)| !places.is_empty()).collect();
    assert!(wrong.is_empty(), "write these sentences again:\n{wrong:#?}");
}

#[test]
fn old_phrases_only_become_fewer() {
    let found = places(super::root(), &super::files(), &AT_MOST.map(|(phrase, _)| phrase));
    for (phrase, most) in AT_MOST {
        let places = &found[phrase];
        assert!(
            places.len() <= most,
            "\"{phrase}\" occurs {} times, {most} are allowed: use other words in what is new, in one of\n{}",
            places.len(),
            places.join("\n")
        );
    }
}
