//! Escapes or masks texts that come from profiles, devices, file names or network clients, before they are displayed.
//! Escaped control characters cannot end a line, control a terminal or change the direction of text. Secret parts of
//! addresses are masked.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Returns whether a character is invisible: a control character, or a mark that changes spacing or the direction of
/// text.
pub(crate) fn is_unseen(one: char) -> bool {
    one.is_control()
        || matches!(one, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

/// Escapes a text into one line. Invisible characters are written as in JSON: `\n`, `\u001b`.
pub fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, is_unseen)
}

/// Escapes the invisible characters of a text, except line feeds and tabs. A JSON text stays valid JSON.
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

/// Masks the user, password and query of each address (`https://…`) with asterisks. The path of a quoted web address
/// may contain a secret, so it is masked too. The text keeps its number of bytes.
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
