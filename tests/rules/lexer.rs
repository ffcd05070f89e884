//! Lexer for the parts of Rust text that are not code: comments, string literals and character literals.

use std::ops::Range;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Comment,
    String,
    RawString,
    Character,
}

pub(super) struct Piece {
    pub(super) kind: Kind,
    /// Byte range in the text, including marks and quotes.
    pub(super) range: Range<usize>,
    /// Number of the line on which the piece begins.
    pub(super) line: usize,
}

/// Pieces of a text, in order.
pub(super) fn pieces(text: &str) -> Vec<Piece> {
    let mut found = Vec::new();
    let (mut at, mut line) = (0, 1);
    while let Some(c) = text[at..].chars().next() {
        let rest = &text[at..];
        let piece = if rest.starts_with("//") {
            Some((Kind::Comment, rest.find('\n').unwrap_or(rest.len())))
        } else if rest.starts_with("/*") {
            Some((Kind::Comment, rest.find("*/").map_or(rest.len(), |end| end + 2)))
        } else if let Some(length) = raw_string(rest) {
            Some((Kind::RawString, length))
        } else if c == '"' {
            Some((Kind::String, quoted(rest)))
        } else if c == '\'' {
            Some((Kind::Character, character(rest))).filter(|(_, length)| *length > 0)
        } else {
            None
        };
        let length = piece.map_or(c.len_utf8(), |(_, length)| length);
        found.extend(piece.map(|(kind, _)| Piece { kind, range: at..at + length, line }));
        line += rest[..length].matches('\n').count();
        at += length;
    }
    found
}

/// Length of `r#"…"#`; `None` if no raw string begins here.
fn raw_string(rest: &str) -> Option<usize> {
    let marks = rest.strip_prefix('r')?;
    let count = marks.bytes().take_while(|byte| *byte == b'#').count();
    marks[count..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(count));
    let begin = 1 + count + 1;
    Some(rest[begin..].find(&end).map_or(rest.len(), |at| begin + at + end.len()))
}

fn quoted(rest: &str) -> usize {
    let mut escaped = false;
    for (at, c) in rest.char_indices().skip(1) {
        match c {
            '"' if !escaped => return at + 1,
            _ => escaped = c == '\\' && !escaped,
        }
    }
    rest.len()
}

/// Length of a character literal; 0 for a lifetime.
fn character(rest: &str) -> usize {
    let mut chars = rest.char_indices().skip(1);
    match chars.next() {
        Some((_, '\\')) => rest[3..].find('\'').map_or(rest.len(), |at| at + 4),
        Some(_) => match chars.next() {
            Some((at, '\'')) => at + 1,
            _ => 0,
        },
        None => 0,
    }
}

#[test]
fn pieces_are_found_with_their_lines() {
    let text = "//! one\nfn f<'a>() { g(\"two \\\" // no\", r#\"thr\"ee\"#, '\\'', '\"') } /* fo\nur */\nh(b\"five\")";
    let found: Vec<(Kind, &str, usize)> =
        pieces(text).iter().map(|piece| (piece.kind, &text[piece.range.clone()], piece.line)).collect();
    let expected = [
        (Kind::Comment, "//! one", 1),
        (Kind::String, "\"two \\\" // no\"", 2),
        (Kind::RawString, "r#\"thr\"ee\"#", 2),
        (Kind::Character, "'\\''", 2),
        (Kind::Character, "'\"'", 2),
        (Kind::Comment, "/* fo\nur */", 2),
        (Kind::String, "\"five\"", 4),
    ];
    assert_eq!(found, expected);
}
