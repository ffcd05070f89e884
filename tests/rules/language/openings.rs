//! Openings of doc comments. The first sentence must name its subject.

use super::Finding;
use super::comments::doc_comments;
use crate::{files, root};

const SUBJECT: &str = "name the thing that the comment describes: `Offset register of one output: …`";
const CONDITION: &str = "begin with the subject, and write `if`, `when` or `because`";
const TWO: &str = "begin with the fact; its reason or effect is a second sentence";
const SAME: &str = "say what it does, then from what it differs";

/// Openings that do not name a subject, and the advice for each.
const OPENINGS: [(&str, &str); 17] = [
    ("what", SUBJECT),
    ("whose", SUBJECT),
    ("it", SUBJECT),
    ("that", SUBJECT),
    ("there", "name the subject, and say what it does"),
    ("so", TWO),
    ("where", CONDITION),
    ("of", CONDITION),
    ("the same.", SAME),
    ("the same,", SAME),
    ("the same:", SAME),
    ("the same as", SAME),
    ("the same at", SAME),
    ("the same for", SAME),
    ("the same in", SAME),
    ("the same of", SAME),
    ("the same with", SAME),
];

/// Findings: every doc comment of the project with one of these openings.
pub(super) fn findings() -> Vec<Finding> {
    let mut found = Vec::new();
    for file in files() {
        let key = file.to_string_lossy();
        if !key.ends_with(".rs") {
            continue;
        }
        let text = std::fs::read_to_string(root().join(&file)).unwrap();
        for (line, opening, mend) in doc_comments(&text).iter().filter_map(|block| opening(block)) {
            let complaint = format!("{key}:{line}: a doc comment begins with \"{opening}\": {mend}");
            found.push(Finding { key: key.to_string(), complaint });
        }
    }
    found
}

/// Line, opening and advice; `None` if the comment begins in another way.
fn opening(block: &[(usize, &str)]) -> Option<(usize, &'static str, &'static str)> {
    let (line, said) = block.iter().find(|(_, said)| !said.trim().is_empty())?;
    let said = said.trim().trim_start_matches(['*', '_']).to_lowercase();
    let begins = |opening: &str| {
        let is_longer = |rest: &str| rest.starts_with(|c: char| c.is_alphanumeric() || c == '_');
        said.strip_prefix(opening).is_some_and(|rest| !is_longer(rest))
    };
    let (opening, mend) = OPENINGS.iter().find(|(opening, _)| begins(opening))?;
    Some((*line, *opening, *mend))
}

#[test]
fn an_opening_is_a_whole_word_at_the_begin() {
    let opening_of = |text: &str| {
        let comments = doc_comments(text);
        comments.iter().find_map(|block| opening(block)).map(|(line, opening, _)| (line, opening))
    };
    assert_eq!(opening_of("/// What it holds."), Some((1, "what")));
    assert_eq!(opening_of("/// Offset register.\n/// What it holds."), None);
    assert_eq!(opening_of("//!\n//! **It** may be written."), Some((2, "it")));
    assert_eq!(opening_of("/// Its value."), None);
    assert_eq!(opening_of("/// Software of the device.\n\n/// So many words."), Some((3, "so")));
    assert_eq!(opening_of("/// The same, as JSON."), Some((1, "the same,")));
    assert_eq!(opening_of("/// The same machine twice."), None);
    assert_eq!(opening_of("/// `what` of the event."), None);
    assert_eq!(opening_of("// What is no doc comment."), None);
}
