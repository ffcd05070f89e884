//! Sentences: their ends and their lengths.

use super::comments::doc_comments;
use super::{Finding, literals, markdown};
use crate::{files, lexer, root, source};

/// Maximum number of words in a sentence.
const MOST: usize = 25;

/// Abbreviations with a full stop that does not end a sentence.
const ABBREVIATIONS: [&str; 8] = ["approx.", "ca.", "cf.", "e.g.", "i.e.", "incl.", "resp.", "vs."];

/// Abbreviations that do not end a sentence if a number follows.
const BEFORE_A_NUMBER: [&str; 8] = ["ch.", "fig.", "no.", "nos.", "p.", "pp.", "sec.", "vol."];

const OPENERS: [char; 7] = ['(', '[', '"', '\'', '*', '_', '“'];
const CLOSERS: [char; 7] = [')', ']', '"', '\'', '*', '_', '”'];

/// Lines of a paragraph, a cell, a heading or a message, with their numbers.
pub(super) type Text = Vec<(usize, String)>;

#[derive(Debug, PartialEq, Eq)]
struct Sentence {
    line: usize,
    words: usize,
    begin: String,
}

/// Findings: every sentence with too many words in the Markdown files at the top, in the manual, and in messages.
/// Messages are string literals, and the doc comments in `src/cli`, which `--help` prints.
pub(super) fn findings() -> Vec<Finding> {
    let mut found = Vec::new();
    for file in files() {
        let file = file.to_string_lossy();
        if file.ends_with(".md") && (!file.contains('/') || file.starts_with("docs/")) {
            let document = std::fs::read_to_string(root().join(&*file)).unwrap();
            found.extend(too_long(&file, &markdown::texts(&document)));
        }
    }
    for source in source::all(root()) {
        let product = source.product();
        let pieces = lexer::pieces(&product);
        let mut texts: Vec<Text> = pieces.iter().flat_map(|piece| literals::texts(&product, piece)).collect();
        if source.path.starts_with("src/cli") {
            texts.extend(doc_comments(&product).iter().flat_map(|block| help(block)));
        }
        found.extend(too_long(&source.path, &texts));
    }
    found
}

/// Texts of a doc comment, which is Markdown.
fn help(block: &[(usize, &str)]) -> Vec<Text> {
    let lines: Vec<&str> = block.iter().map(|(_, said)| *said).collect();
    let mut texts = markdown::texts(&lines.join("\n"));
    let before = block.first().map_or(0, |(first, _)| first - 1);
    texts.iter_mut().flatten().for_each(|(line, _)| *line += before);
    texts
}

fn too_long(file: &str, texts: &[Text]) -> Vec<Finding> {
    let long = texts.iter().flat_map(|text| sentences(text)).filter(|sentence| sentence.words > MOST);
    let long = long.map(|Sentence { line, words, begin }| Finding {
        key: file.to_owned(),
        complaint: format!(
            "{file}:{line}: a sentence of {words} words, {MOST} are allowed: write one fact in one sentence (in a \
             generated chapter: where its text comes from): {begin} …"
        ),
    });
    long.collect()
}

fn sentences(text: &[(usize, String)]) -> Vec<Sentence> {
    let tokens = tokens(text);
    let mut found = Vec::new();
    let mut begin = 0;
    for (at, (_, token)) in tokens.iter().enumerate() {
        let next = tokens.get(at + 1).map(|(_, next)| next.as_str());
        if next.is_none() || ends(token, next.unwrap_or_default()) {
            let sentence = &tokens[begin..=at];
            let words = sentence.iter().filter(|(_, token)| is_word(token)).count();
            let first: Vec<&str> = sentence.iter().take(8).map(|(_, token)| token.as_str()).collect();
            found.push(Sentence { line: sentence[0].0, words, begin: first.join(" ") });
            begin = at + 1;
        }
    }
    found.retain(|sentence| sentence.words > 0);
    found
}

/// Words and signs between spaces, with their lines. Code between backticks is one token, also across a line break.
fn tokens(text: &[(usize, String)]) -> Vec<(usize, String)> {
    let is_mark = |token: &str| token.starts_with('`');
    let mut marks_left =
        text.iter().map(|(_, line)| runs(line).filter(|run| is_mark(run)).count()).sum::<usize>();
    let mut found: Vec<(usize, String)> = Vec::new();
    let (mut is_code, mut is_open) = (false, false);
    for (number, line) in text {
        for run in runs(line) {
            if is_mark(run) {
                marks_left -= 1;
                is_code = !is_code && marks_left > 0;
            }
            let is_blank = run.starts_with(char::is_whitespace);
            if is_blank && !is_code {
                is_open = false;
                continue;
            }
            match found.last_mut() {
                Some((_, token)) if is_open => token.push_str(run),
                _ => found.push((*number, run.to_owned())),
            }
            is_open = true;
        }
        is_open &= is_code;
    }
    found
}

/// Divides a line into runs of backticks, of spaces, and of other characters.
fn runs(line: &str) -> impl Iterator<Item = &str> {
    let kind = |c: char| if c == '`' { 1 } else { u8::from(c.is_whitespace()) * 2 };
    let mut rest = line;
    std::iter::from_fn(move || {
        let first = kind(rest.chars().next()?);
        let end = rest.find(|c: char| kind(c) != first).unwrap_or(rest.len());
        let (run, after) = rest.split_at(end);
        rest = after;
        Some(run)
    })
}

/// Returns whether a token counts as a word. Code and the value in a message count as one word each.
fn is_word(token: &str) -> bool {
    token.contains(|c: char| c.is_alphanumeric() || c == '{' || c == '`')
}

/// Returns whether a sentence ends with this token. `next` is the token after it.
fn ends(token: &str, next: &str) -> bool {
    let bare = token.trim_end_matches(CLOSERS);
    if !bare.ends_with(['.', '!', '?']) || bare.ends_with("..") {
        return false;
    }
    let next = next.trim_start_matches(OPENERS);
    let is_quoted = bare.len() < token.len();
    if is_quoted && next.starts_with(char::is_lowercase) {
        return false;
    }
    let word = bare.trim_start_matches(OPENERS).to_lowercase();
    let is_number = BEFORE_A_NUMBER.contains(&&*word) && next.starts_with(|c: char| c.is_ascii_digit());
    !ABBREVIATIONS.contains(&&*word) && !is_number
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of words in each sentence of a text on one line.
    fn lengths(text: &str) -> Vec<usize> {
        sentences(&[(1, text.to_owned())]).iter().map(|sentence| sentence.words).collect()
    }

    #[test]
    fn a_sentence_ends_at_a_full_stop_that_ends_one() {
        assert_eq!(lengths("The axis waits. It is off! Why?"), [3, 3, 1]);
        assert_eq!(lengths("A bus, e.g. Modbus, i.e. a line. Done."), [7, 1]);
        assert_eq!(lengths("See (cf. No. 5) and fig. 3. The answer is no. Then stop."), [7, 4, 2]);
        assert_eq!(lengths("It moves 0.5 µm in 1.25 s. Version 0.1.0. End"), [7, 2, 1]);
        assert_eq!(lengths("Edit main.rs or docs/page.md. isotherm reads it."), [4, 3]);
        assert_eq!(lengths("It asks \"armed?\" twice. It says \"no.\" Then it ends."), [4, 3, 3]);
        assert_eq!(lengths("**Bold ends.** Next (in brackets.) Last … one"), [2, 3, 2]);
        assert_eq!(lengths("Wait... and go [there](docs/a.md). Go."), [4, 1]);
    }

    #[test]
    fn code_and_values_are_one_word_each() {
        assert_eq!(lengths("Run `cargo test. Then go` now. `a.` b"), [3, 2]);
        assert_eq!(lengths("{} of {name:?} – {a:.1} µm. A ` alone. End"), [5, 3, 1]);
        let text = [(4, "Run `cargo".to_owned()), (5, "test` now. Then".to_owned()), (6, "stop.".to_owned())];
        let found = sentences(&text);
        let expected = [
            Sentence { line: 4, words: 3, begin: "Run `cargotest` now.".to_owned() },
            Sentence { line: 5, words: 2, begin: "Then stop.".to_owned() },
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn only_a_sentence_beyond_the_limit_is_found() {
        let text = |words: usize| vec![vec![(3, "word ".repeat(words))]];
        assert!(too_long("a.md", &text(MOST)).is_empty());
        let found = too_long("a.md", &text(MOST + 1));
        assert_eq!((found.len(), &*found[0].key), (1, "a.md"));
        assert!(found[0].complaint.starts_with("a.md:3: a sentence of 26 words, 25 are allowed: "));
    }

    #[test]
    fn help_keeps_the_lines_of_its_comment() {
        let texts = help(&[(7, " First."), (8, ""), (9, " - Item")]);
        assert_eq!(texts, [vec![(7, "First.".to_owned())], vec![(9, "Item".to_owned())]]);
    }
}
