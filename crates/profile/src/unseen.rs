//! Texts that somebody else wrote (a profile, a device, a file's name, whoever asks over the network), as people see them:
//! nothing in them ends a line, steers a terminal or turns the direction of what stands behind it, and of an address nobody reads
//! what only its server is to know.

use std::borrow::Cow;
use std::fmt::Write as _;

/// What is not seen, and does something.
pub(crate) fn is_unseen(one: char) -> bool {
    one.is_control()
        || matches!(one, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

/// The text in one line. What is not seen stands there as JSON writes it: `\n`, `\u001b`.
pub fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, is_unseen)
}

/// The same of a text of several lines: its line ends and tabs stay. JSON stays what it is.
pub fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |one| is_unseen(one) && !matches!(one, '\n' | '\t'))
}

fn escaped(text: &str, is_unwanted: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.chars().any(&is_unwanted) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for one in text.chars() {
        match one {
            one if !is_unwanted(one) => escaped.push(one),
            '\n' => escaped += "\\n",
            '\r' => escaped += "\\r",
            '\t' => escaped += "\\t",
            one => {
                // Writing to a string never fails.
                let _ = write!(escaped, "\\u{:04x}", u32::from(one));
            }
        }
    }
    Cow::Owned(escaped)
}

/// The text, in which asterisks stand for user, password and query of every address (`https://…`), and where it is a web server's
/// that stands alone between its quotes, for its path: as many bytes as there were.
pub(crate) fn veiled(text: &str) -> Cow<'_, str> {
    const BEGIN: &str = "://";
    if !text.contains(BEGIN) {
        return Cow::Borrowed(text);
    }
    let mut veiled = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, behind)) = rest.split_once(BEGIN) {
        let scheme = before.trim_end_matches(|one: char| one.is_ascii_alphanumeric() || "+.-".contains(one));
        let quote = scheme.chars().next_back().filter(|one| "\"'`".contains(*one));
        let is_end = |one: char| quote.map_or(one.is_whitespace(), |quote| one == quote);
        let (address, after) = behind.split_at(behind.find(is_end).unwrap_or(behind.len()));
        let (user, address) = address.split_at(address.rfind('@').unwrap_or(0));
        let is_web = quote.is_some() && (before.ends_with("http") || before.ends_with("https"));
        let ends = |one: char| one == '?' || (is_web && one == '/');
        let (address, rest_of_it) =
            address.split_at(address.find(ends).map_or(address.len(), |mark| mark + 1));
        veiled.extend([before, BEGIN, &"*".repeat(user.len()), address, &"*".repeat(rest_of_it.len())]);
        rest = after;
    }
    veiled.push_str(rest);
    Cow::Owned(veiled)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_an_address_nobody_reads_who_asks_and_what_for() {
        for (text, shown) in [
            ("address = \"10.0.0.7:502\"", "address = \"10.0.0.7:502\""),
            ("url = \"https://a:8443/b\"", "url = \"https://a:8443/*\""),
            ("node = \"nsu=http://a/b;s=C\"", "node = \"nsu=http://a/b;s=C\""),
            (
                "{ url = \"https://me:pä ss@a/b?key=1\", on = [] }",
                "{ url = \"https://*********@a/*******\", on = [] }",
            ),
            ("see http://a/b?k=v and 'x://u@b/c'", "see http://a/b?*** and 'x://*@b/c'"),
            ("`https://a/b@c?d`", "`https://***@c?*`"),
            ("no end: https://u:p@", "no end: https://***@"),
        ] {
            assert_eq!(veiled(text), shown);
            assert_eq!(veiled(text).len(), text.len());
        }
    }

    #[test]
    fn nothing_that_is_not_seen_is_left_and_everything_else_stays() {
        let hostile = "bed\u{1b}[2J\r\naxis z: armed\t\u{9b}31m\u{202e}\u{7f}";
        assert_eq!(one_line(hostile), "bed\\u001b[2J\\r\\naxis z: armed\\t\\u009b31m\\u202e\\u007f");
        assert_eq!(lines("a\u{1b}\n\tb\r\n"), "a\\u001b\n\tb\\r\n");
        for plain in ["", "床温 23.5 °C → Ä", "a\\nb"] {
            assert!(matches!(one_line(plain), Cow::Borrowed(same) if same == plain));
        }
    }

    #[test]
    fn json_says_the_same_after_it() {
        let hostile = "a\u{1b}\u{9b}\u{202e}\n";
        let json = serde_json::to_string_pretty(&[hostile]).unwrap();
        let back: Vec<String> = serde_json::from_str(&lines(&json)).unwrap();
        assert_eq!(back, [hostile]);
    }
}
