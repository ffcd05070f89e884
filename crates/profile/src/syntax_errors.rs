//! Syntax errors of a TOML file. The parser continues after a mistake, and may then report its consequences too. These
//! are left out, so that one mistake is one error.

use toml::de::Error;

/// Message of the parser about a key or table that occurs twice.
const TWICE: &str = "duplicate key";
/// Messages of the parser about a list or inline table that has no end. Everything after it belongs to it.
const UNCLOSED: [&str; 2] = ["unclosed array", "unclosed inline table"];
/// Parts of the messages about the content of a list or inline table.
const IN_BRACKETS: [&str; 4] = ["unclosed array", "array element", "in array", "inline table"];
/// Part of another message about the content of an inline table.
const PAIRS: &str = "between key-value pairs";

/// Syntax error that does not result from another one.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct SyntaxError<'p> {
    /// Byte of the file.
    pub(crate) at: usize,
    pub(crate) message: &'p str,
    pub(crate) help: Option<&'static str>,
}

/// Returns the errors that do not result from others: the first one of each line, of a table that occurs twice, and of a
/// list or inline table that is not closed.
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
        if at < line_end || (is_twice && at < table_end) {
            continue;
        }
        let rest = text.get(at..).unwrap_or_default();
        line_end = at + rest.find('\n').unwrap_or(rest.len()) + 1;
        let is_header = text.get(..at).is_some_and(begins_header);
        if is_twice && is_header {
            table_end = at + rest.find("\n[").unwrap_or(rest.len()) + 1;
        }
        let help = match first_inside {
            Some(first) if first == place => {
                Some("close the list or inline table that begins here or above, with `]` or `}`")
            }
            _ if is_twice && is_header => Some("give one of the two tables another name"),
            _ if is_twice => Some("keep one of the two keys"),
            _ => None,
        };
        errors.push(SyntaxError { at, message, help });
    }
    errors
}

/// Returns whether the line at the end of `before` begins as the header of a table.
fn begins_header(before: &str) -> bool {
    let line = before.rsplit('\n').next().unwrap_or_default();
    line.trim_start().starts_with('[')
}

/// Returns whether a message contains these words. A header such as `[[axis.z.model]]` is an "array table", no list.
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
    fn two_mistakes_are_two_errors() {
        let twice = "[a]\nc = 1\n[a]\nc = 1\n[b]\nd = 1\nd = 2\n";
        for text in ["a = x\nb = y\n", twice, "a = { b = 1 c = 2 }\nd = x\n"] {
            assert_eq!(lines(text).len(), 2, "{text}: {:?}", lines(text));
        }
        assert!(lines("a = 1\n[b]\nc = [1,\n2]\n").is_empty());
    }
}
