//! Filters the syntax errors of a TOML file. After a mistake, the parser may report further errors that only result
//! from this mistake. These are left out, so that one mistake is one error.
//!
//! The messages of the parser do not explain characters that only look like TOML characters, or names in other scripts.
//! The function `foreign` detects these characters.

use toml::de::Error;

/// Parser message for a key or table that occurs twice.
const TWICE: &str = "duplicate key";
/// Parser messages for a list or inline table that is not closed. The parser takes the rest of the file as content of
/// this list or table.
const UNCLOSED: [&str; 2] = ["unclosed array", "unclosed inline table"];
/// Parts of the parser messages about the content of a list or inline table.
const IN_BRACKETS: [&str; 4] = ["unclosed array", "array element", "in array", "inline table"];
/// Beginnings of the parser messages about a number such as `.1` or `1.`.
const NO_DIGITS: [&str; 2] = ["invalid mantissa", "invalid fraction"];
/// Beginning of the parser message about a value without quotation marks, such as `10 µm`.
const UNQUOTED: &str = "string values must be quoted";
/// Parser message about a number with further characters, such as `10.0mm`.
const LONGER: &str = "invalid float, expected nothing";
/// Part of another parser message about the content of an inline table.
const PAIRS: &str = "between key-value pairs";

/// Syntax error that does not result from another syntax error.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct SyntaxError<'p> {
    /// Byte position in the file.
    pub(crate) at: usize,
    pub(crate) message: &'p str,
    pub(crate) help: Option<&'static str>,
}

/// Returns the errors that do not result from other errors. These are the first error of each line, and the first error
/// about a duplicate table or an unclosed list or inline table.
pub(crate) fn independent<'p>(text: &str, problems: &'p [Error]) -> Vec<SyntaxError<'p>> {
    let place = |problem: &Error| problem.span().map_or(0, |span| span.start);
    let mut found: Vec<(usize, &str)> =
        problems.iter().map(|problem| (place(problem), problem.message())).collect();
    found.sort_by_key(|(at, _)| *at);
    let end = found.last().map_or(0, |(at, _)| *at);
    let is_unclosed = |message: &str| UNCLOSED.iter().any(|words| is_part(message, words));
    let is_open = found.iter().any(|(at, message)| *at == end && is_unclosed(message));
    let is_inside = |(_, message): &(usize, &str)| {
        message.contains(PAIRS) || IN_BRACKETS.iter().any(|part| is_part(message, part))
    };
    let first_inside = found.iter().position(is_inside).filter(|_| is_open);
    found.truncate(first_inside.map_or(found.len(), |first| first + 1));
    let (mut line_end, mut table_end) = (0, 0);
    let mut errors = Vec::new();
    for (place, (at, message)) in found.into_iter().enumerate() {
        let is_twice = message == TWICE;
        // A line can only be cut between two characters.
        let at = (0..=at).rev().find(|at| text.is_char_boundary(*at)).unwrap_or_default();
        if at < line_end || (is_twice && at < table_end) {
            continue;
        }
        let rest = text.get(at..).unwrap_or_default();
        line_end = at + rest.find('\n').unwrap_or(rest.len()) + 1;
        let line_begin =
            text.get(..at).and_then(|before| before.rfind('\n')).map_or(0, |line_feed| line_feed + 1);
        let line = text.get(line_begin..).and_then(|rest| rest.lines().next()).unwrap_or_default();
        let is_header = text.get(..at).is_some_and(begins_header);
        if let Some((within, mistake)) = foreign(line) {
            if begins_header(line) {
                // The keys below the header then belong to the table above it.
                table_end = at + rest.find("\n[").unwrap_or(rest.len()) + 1;
            }
            let Foreign { message, help } = *mistake;
            errors.push(SyntaxError { at: line_begin + within, message, help: Some(help) });
            continue;
        }
        if is_twice && is_header {
            table_end = at + rest.find("\n[").unwrap_or(rest.len()) + 1;
        }
        let help = match first_inside {
            Some(first) if first == place => {
                Some("close the list or inline table that begins here or above, with `]` or `}`")
            }
            _ if is_twice && is_header => Some("give one of the two tables another name"),
            _ if is_twice => Some("keep one of the two keys"),
            _ if NO_DIGITS.iter().any(|begin| message.starts_with(begin)) => {
                Some("write a digit before and after the point: 0.1")
            }
            _ if is_longer_number(message, rest) => {
                Some("write a number alone, as 10.0, or a duration in quotes, as \"10s\"")
            }
            _ => None,
        };
        errors.push(SyntaxError { at, message, help });
    }
    errors
}

/// Message and hint for a character that TOML allows only inside texts and comments.
#[derive(Clone, Copy)]
struct Foreign {
    message: &'static str,
    help: &'static str,
}

/// Typographic quotation marks, as word processors and some keyboards produce them.
const QUOTATION_MARKS: [char; 10] = ['“', '”', '„', '‟', '‘', '’', '‚', '«', '»', '＂'];
const QUOTED: Foreign = Foreign {
    message: "these are typographic quotation marks",
    help: "write straight quotation marks, as \"press-7\"; a word processor or a chat program has replaced \
           them",
};
/// Characters that look like the minus sign of a number. The output of this program uses the first one.
const MINUS_SIGNS: [char; 6] = ['−', '–', '—', '‐', '‑', '﹣'];
const NO_MINUS: Foreign = Foreign {
    message: "this is a dash or a typographic minus sign, not the minus sign of a number",
    help: "type the minus sign of the keyboard, as -4.0",
};
/// Special blanks and invisible characters that word processors and web pages insert.
const BLANKS: [char; 6] = ['\u{a0}', '\u{2007}', '\u{2009}', '\u{200b}', '\u{202f}', '\u{2060}'];
const NO_BLANK: Foreign = Foreign {
    message: "this is an invisible character of a word processor or a web page, not a blank",
    help: "delete this character, and type a blank",
};
const SEMICOLON: Foreign =
    Foreign { message: "`;` is not allowed here", help: "remove this character; a comment begins with `#`" };
const SLASHES: Foreign =
    Foreign { message: "`//` does not begin a comment", help: "a comment begins with `#`" };
const TOO_WIDE: Foreign = Foreign {
    message: "this is a full-width character",
    help: "switch the keyboard to English, and write digits, = [ ] { } , # and blanks in their usual width",
};
const OTHER_SCRIPT: Foreign = Foreign {
    message: "a name may only have the letters a to z, digits, `_` and `-`",
    help: "write a short name in these letters, and the name in your script as its label: label = \"床温\"",
};

/// Returns whether an error is about a number with a unit or other text after it. `rest` is the text of the file from
/// the position of the error.
fn is_longer_number(message: &str, rest: &str) -> bool {
    let begins_as_number =
        || rest.trim_start_matches(['-', '+']).starts_with(|one: char| one.is_ascii_digit());
    message == LONGER || message.starts_with(UNQUOTED) && begins_as_number()
}

/// Returns whether a character is full-width, as East Asian keyboards produce it.
fn is_wide(one: char) -> bool {
    ('\u{ff01}'..='\u{ff5e}').contains(&one) || one == '\u{3000}'
}

/// Returns the first character of a line that TOML does not allow there, with its position in the line. Quoted texts
/// and comments may contain any character.
fn foreign(line: &str) -> Option<(usize, &'static Foreign)> {
    let (mut quote, mut is_name) = (None, true);
    for (place, one) in line.char_indices() {
        match (quote, one) {
            (Some(open), _) if one == open => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(one),
            (None, '#') => return None,
            (None, '=') => is_name = false,
            (None, _) if QUOTATION_MARKS.contains(&one) => return Some((place, &QUOTED)),
            (None, _) if is_wide(one) => return Some((place, &TOO_WIDE)),
            (None, _) if MINUS_SIGNS.contains(&one) => return Some((place, &NO_MINUS)),
            (None, _) if BLANKS.contains(&one) => return Some((place, &NO_BLANK)),
            (None, ';') => return Some((place, &SEMICOLON)),
            (None, '/') if line.get(place..).is_some_and(|rest| rest.starts_with("//")) => {
                return Some((place, &SLASHES));
            }
            (None, _) if is_name && !one.is_ascii() && one.is_alphabetic() => {
                return Some((place, &OTHER_SCRIPT));
            }
            (None, _) => {}
        }
    }
    // A text with a straight mark before it and a typographic one after it has no end.
    let (place, last) = line.trim_end().char_indices().next_back()?;
    (quote.is_some() && QUOTATION_MARKS.contains(&last)).then_some((place, &QUOTED))
}

/// Returns whether the last line of `before` begins like the header of a table.
fn begins_header(before: &str) -> bool {
    let line = before.rsplit('\n').next().unwrap_or_default();
    line.trim_start().starts_with('[')
}

/// Returns whether a parser message contains these words. "array table" does not count as "array", because it is a
/// header such as `[[axis.z.model]]`.
fn is_part(message: &str, words: &str) -> bool {
    message.contains(words) && !message.contains("array table")
}

#[cfg(test)]
mod tests {
    use super::*;
    use toml::de::DeTable;

    /// Lines and messages of the errors in a text.
    fn lines(text: &str) -> Vec<(usize, String)> {
        let (_, problems) = DeTable::parse_recoverable(text);
        let errors = independent(text, &problems);
        let line = |at: usize| text[..at].matches('\n').count() + 1;
        errors.into_iter().map(|error| (line(error.at), error.message.to_owned())).collect()
    }

    #[test]
    fn one_mistake_is_one_error() {
        for (text, line) in [
            ("a = 1\nb = { c = 1\nd = 2\n[e]\nf = 3\n", 3),
            ("a = [1, 2\nb = 3\n[c]\nd = 4\n", 2),
            ("a = [{ b = 1, c = 2]\nd = 3\n", 1),
            ("a = { b = 1 c = 2 d = 3 }\n", 1),
            ("[a.b]\nc = 1\nd = 2\n[a.b]\nc = 1\nd = 2\n[e]\n", 4),
            ("a = 1\na = 2\n", 2),
            ("a = x\n", 1),
        ] {
            let found = lines(text);
            assert_eq!(found.len(), 1, "{text}: {found:?}");
            assert_eq!(found[0].0, line, "{text}: {found:?}");
        }
    }

    #[test]
    fn characters_that_only_look_right_and_names_in_other_scripts_are_named() {
        for (text, words) in [
            ("name = “press-7”\n", "typographic quotation marks"),
            ("name = „press-7“\n", "typographic quotation marks"),
            ("name = ‘press-7’\n", "typographic quotation marks"),
            ("name = \"press-7”\n", "typographic quotation marks"),
            ("name ＝ \"press-7\"\n", "full-width character"),
            ("name\u{3000}= \"press-7\"\n", "full-width character"),
            ("床温 = 1\n", "a name may only have the letters a to z"),
            ("[signal.床温]\nunit = \"degC\"\n", "a name may only have the letters a to z"),
            ("a = { b = “x” }\n", "typographic quotation marks"),
            ("limit = ５\n", "full-width character"),
            ("ｌｉｍｉｔ = 5\n", "full-width character"),
            ("gain = −4.0\n", "not the minus sign of a number"),
            (
                "terms = [ { signal = \"a−b\", gain = –4.0, reference = 20.0 } ]\n",
                "not the minus sign of a number",
            ),
            ("gain = －4.0\n", "full-width character"),
            ("\u{a0}limit = 5.0\n", "invisible character"),
            ("limit =\u{a0}5.0\n", "invisible character"),
            ("limit = 5.0;\n", "`;` is not allowed here"),
            ("limit = 5.0 ; µm\n", "`;` is not allowed here"),
            ("limit = 5.0 // µm\n", "`//` does not begin a comment"),
        ] {
            let found = lines(text);
            assert!(found.len() == 1 && found[0].0 == 1, "{text}: {found:?}");
            assert!(found[0].1.contains(words), "{text}: {found:?}");
        }
        // Other mistakes, next to texts and comments in any script.
        for text in [
            "label = \"床温 “bed”\" x\n",
            "a = x # 床温 ＝ “bed”\n",
            "a = \"−4; //\u{a0}５\" x\n",
            "a = x # −4; //\u{a0}５\n",
        ] {
            let found = lines(text);
            assert!(found.len() == 1 && !found[0].1.contains("full-width"), "{text}: {found:?}");
            assert!(foreign(text).is_none(), "{text}");
        }
    }

    #[test]
    fn a_number_that_is_written_differently_is_explained() {
        for (text, word) in [
            ("a = .1\n", "0.1"),
            ("a = 1.\n", "0.1"),
            ("a = { b = -.5 }\n", "0.1"),
            ("a = 10 µm\n", "alone"),
            ("a = 10um\n", "alone"),
            ("a = 10.0mm\n", "alone"),
            ("a = 1/10\n", "alone"),
            ("every = 10s\n", "\"10s\""),
        ] {
            let (_, problems) = DeTable::parse_recoverable(text);
            let errors = independent(text, &problems);
            assert!(
                errors.len() == 1 && errors[0].help.is_some_and(|help| help.contains(word)),
                "{text}: {errors:?}"
            );
        }
    }

    #[test]
    fn two_mistakes_are_two_errors() {
        let twice = "[a]\nc = 1\n[a]\nc = 1\n[b]\nd = 1\nd = 2\n";
        for text in ["a = x\nb = y\n", twice, "a = { b = 1 c = 2 }\nd = x\n"] {
            assert_eq!(lines(text).len(), 2, "{text}: {:?}", lines(text));
        }
        assert!(lines("a = 1\n[b]\nc = [1,\n2]\n").is_empty());
    }
}
