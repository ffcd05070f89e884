//! Phrases that are never right, in code, comments, messages and documentation.

use super::Finding;
use crate::{files, root};

const BROKEN: &str = "write the sentence again: a renaming has broken it";
const REGISTER: &str = "write `register value`, `holds` or `is`";

/// Phrases, and the advice for each.
const PHRASES: [(&str, &str); 27] = [
    ("a person says", "write `the operator confirms`"),
    ("access for is", BROKEN),
    ("and told to be", BROKEN),
    ("anew", "write `again`"),
    ("are believed", "write `are accepted` or `are valid`"),
    ("can be reported from", BROKEN),
    ("cannot be reported from", BROKEN),
    ("goes on from there", "write `resumes from the value read`"),
    ("his part", "write `operator offset`"),
    ("is believed", "write `is accepted` or `is valid`"),
    ("is reported its", BROKEN),
    ("is reported so", BROKEN),
    ("is reported the known", BROKEN),
    ("is told", "write `is logged` or `is reported`; for `is told apart`: `is distinguished`"),
    ("lately", "write `recently`"),
    ("not believed", "write `rejected`"),
    ("not reported compensated", BROKEN),
    ("not told compensated", BROKEN),
    ("our share", "write `gateway share`"),
    ("register is before", BROKEN),
    ("reported of for", BROKEN),
    ("stands there", REGISTER),
    ("stood there", REGISTER),
    ("wall's time", "write `wall-clock time`"),
    ("was access", BROKEN),
    ("whose part", "write whose offset it is: `operator offset`, `gateway share`"),
    ("without a word", "write `without a warning`"),
];

/// Files that are not checked: this list, the budgets, and texts that the project did not write.
const SKIPPED: [&str; 4] =
    ["Cargo.lock", "LICENSE", "tests/rules/budget/", "tests/rules/language/phrases.rs"];

/// Findings: every place with one of the phrases.
pub(super) fn findings() -> Vec<Finding> {
    let mut found = Vec::new();
    for file in files() {
        let name = file.to_string_lossy();
        if SKIPPED.iter().any(|skipped| name.starts_with(skipped)) {
            continue;
        }
        let Ok(text) = std::fs::read_to_string(root().join(&file)) else { continue };
        let words = Words::of(&text);
        for (phrase, mend) in PHRASES {
            found.extend(words.lines_with(phrase).into_iter().map(|line| Finding {
                key: format!("{name},{phrase}"),
                complaint: format!("{name}:{line}: \"{phrase}\" is never right: {mend}"),
            }));
        }
    }
    found
}

/// Words of a text in lower case. A name with underscores is one word.
struct Words {
    /// The words, with one space before each and one at the end.
    joined: String,
    /// Position in `joined` at which each line begins.
    lines: Vec<usize>,
}

impl Words {
    fn of(text: &str) -> Words {
        let mut words = Words { joined: String::from(" "), lines: Vec::new() };
        for line in text.to_lowercase().lines() {
            words.lines.push(words.joined.len());
            for word in line.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
            {
                words.joined.push_str(word);
                words.joined.push(' ');
            }
        }
        words
    }

    /// Numbers of the lines on which a phrase begins. A phrase may continue on the next line.
    fn lines_with(&self, phrase: &str) -> Vec<usize> {
        let phrase: String =
            phrase.split(|c: char| !c.is_alphanumeric()).map(|word| format!(" {word}")).collect();
        let found = self.joined.match_indices(&phrase);
        let whole = found.filter(|(at, found)| self.joined[at + found.len()..].starts_with(' '));
        whole.map(|(at, _)| self.lines.partition_point(|begin| *begin <= at + 1)).collect()
    }
}

#[test]
fn a_phrase_is_found_in_whole_words_over_the_end_of_a_line_and_twice_in_a_row() {
    let words =
        Words::of("What stands\n\n/// there: it Stands there stands there.\nThe wall's time, is_told");
    assert_eq!(words.lines_with("stands there"), [1, 3, 3]);
    assert_eq!(words.lines_with("wall's time"), [4]);
    assert_eq!(words.lines_with("is told"), [0; 0]);
    assert_eq!(words.lines_with("tands there"), [0; 0]);
    assert_eq!(words.lines_with("what stands"), [1]);
}
