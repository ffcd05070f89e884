//! Texts in string literals.

use super::sentences::Text;
use crate::lexer::{Kind, Piece};

/// Texts of a string literal. A line break in the source or `\n` ends a text. A line that ends with `\` continues.
pub(super) fn texts(source: &str, piece: &Piece) -> Vec<Text> {
    let literal = &source[piece.range.clone()];
    match piece.kind {
        Kind::String => escaped(inside(literal, 1, 1), piece.line),
        Kind::RawString => {
            let marks = literal.bytes().skip(1).take_while(|byte| *byte == b'#').count();
            let lines = inside(literal, marks + 2, marks + 1).split('\n');
            (piece.line..).zip(lines).map(|(line, said)| vec![(line, said.to_owned())]).collect()
        }
        Kind::Comment | Kind::Character => Vec::new(),
    }
}

/// Content of a literal, without this number of bytes before and after it.
fn inside(literal: &str, before: usize, after: usize) -> &str {
    literal.get(before..literal.len().saturating_sub(after)).unwrap_or_default()
}

fn escaped(content: &str, first: usize) -> Vec<Text> {
    let mut texts: Vec<Text> = Vec::new();
    let mut text: Text = Vec::new();
    let mut said = String::new();
    let mut line = first;
    let mut chars = content.chars().peekable();
    while let Some(c) = chars.next() {
        let escape = if c == '\\' { chars.next() } else { None };
        match (c, escape) {
            (_, Some('\n')) => {
                text.push((line, std::mem::take(&mut said)));
                line += 1;
                while let Some(blank) = chars.next_if(|c| c.is_whitespace()) {
                    line += usize::from(blank == '\n');
                }
            }
            (_, Some('n')) | ('\n', None) => {
                text.push((line, std::mem::take(&mut said)));
                texts.push(std::mem::take(&mut text));
                line += usize::from(c == '\n');
            }
            (_, Some('u')) => {
                said.push('u');
                let _ = chars.find(|c| *c == '}');
            }
            (_, Some('t' | 'r' | '0')) => said.push(' '),
            (_, Some(other)) => said.push(other),
            (other, None) => said.push(other),
        }
    }
    text.push((line, said));
    texts.push(text);
    texts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lexer::pieces;

    fn texts_of(source: &str) -> Vec<Text> {
        pieces(source).iter().flat_map(|piece| texts(source, piece)).collect()
    }

    fn text(lines: &[(usize, &str)]) -> Text {
        lines.iter().map(|(line, said)| (*line, (*said).to_owned())).collect()
    }

    #[test]
    fn escapes_and_continued_lines_are_read_as_the_compiler_reads_them() {
        assert_eq!(texts_of(r#"f("say \"go\" \u{b0}C\tnow")"#), [text(&[(1, "say \"go\" uC now")])]);
        assert_eq!(texts_of(r#"f(b"a\\", '"', "b")"#), [text(&[(1, "a\\")]), text(&[(1, "b")])]);
        let continued = "\nf(\"one \\\n     two\\nthree\nfour\")";
        let expected = [text(&[(2, "one "), (3, "two")]), text(&[(3, "three")]), text(&[(4, "four")])];
        assert_eq!(texts_of(continued), expected);
    }

    #[test]
    fn a_raw_string_has_no_escapes_and_a_comment_has_no_texts() {
        let source = "// \"no\"\nf(r##\"a \\n \"b\"#\nc\"##)";
        assert_eq!(texts_of(source), [text(&[(2, "a \\n \"b\"#")]), text(&[(3, "c")])]);
    }
}
