//! Language rules for comments, messages and documentation.
//!
//! Each rule counts its findings per file. `tests/rules/budget` contains the allowed number for each file.

use std::collections::BTreeMap;

use super::budget;

mod comments;
mod literals;
mod markdown;
mod openings;
mod phrases;
mod sentences;

/// A place that breaks a rule.
struct Finding {
    /// Key of the budget row that counts the place: the file, or the file and the phrase.
    key: String,
    /// File and line, the rule, and how to correct the text.
    complaint: String,
}

fn hold(rule: &str, key: &str, findings: &[Finding]) {
    let mut counts = BTreeMap::new();
    for finding in findings {
        *counts.entry(finding.key.clone()).or_insert(0) += 1;
    }
    budget::hold(rule, key, &counts, |above| {
        let explained = above.iter().map(|entry| {
            let places = findings.iter().filter(|finding| finding.key == entry.key);
            let places: Vec<&str> = places.map(|finding| finding.complaint.as_str()).collect();
            format!(
                "{}: {}, the budget is {}\n  {}",
                entry.key,
                entry.count,
                entry.allowed,
                places.join("\n  ")
            )
        });
        explained.collect::<Vec<_>>().join("\n")
    });
}

#[test]
fn doc_comments_name_their_subject_first() {
    hold("openings", "file", &openings::findings());
}

#[test]
fn sentences_in_manual_and_messages_are_short() {
    hold("sentences", "file", &sentences::findings());
}

#[test]
fn phrases_that_are_never_right_only_become_fewer() {
    hold("phrases", "file,phrase", &phrases::findings());
}
