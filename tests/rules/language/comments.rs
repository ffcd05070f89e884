//! Doc comments of Rust source text.

use crate::lexer;

/// Doc comments of a text. Each is a list of lines with their numbers, without the comment marks.
pub(super) fn doc_comments(text: &str) -> Vec<Vec<(usize, &str)>> {
    let mut blocks: Vec<Vec<(usize, &str)>> = Vec::new();
    let mut last = ("", 0);
    for piece in lexer::pieces(text) {
        let Some((mark, said)) = doc(&text[piece.range.clone()]) else { continue };
        match blocks.last_mut() {
            Some(block) if last == (mark, piece.line - 1) => block.push((piece.line, said)),
            _ => blocks.push(vec![(piece.line, said)]),
        }
        last = (mark, piece.line);
    }
    blocks
}

/// Mark and text of a line of a doc comment; `None` for any other piece.
fn doc(piece: &str) -> Option<(&'static str, &str)> {
    if piece.starts_with("////") {
        return None;
    }
    ["///", "//!"].into_iter().find_map(|mark| piece.strip_prefix(mark).map(|said| (mark, said)))
}

#[test]
fn lines_of_one_comment_are_together() {
    let text = "//! A.\n\n/// B\n/// c.\n// no\nfn f() {} // no\n//// no\nlet s = \"/// no\";\n    /// D.\n";
    let expected: [Vec<(usize, &str)>; 3] = [vec![(1, " A.")], vec![(3, " B"), (4, " c.")], vec![(9, " D.")]];
    assert_eq!(doc_comments(text), expected);
}
