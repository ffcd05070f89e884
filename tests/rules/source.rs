//! Rust source text without comments, strings and tests, and the paths in it.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::lexer;

/// A source file, with and without comments, strings and test modules.
pub(super) struct Source {
    /// Path from the root of the repository: `src/gateway/apply.rs`.
    pub(super) path: String,
    /// Text on disk.
    pub(super) text: String,
    /// Code in which comments, strings and test modules are replaced by spaces. Byte positions are those of `text`.
    pub(super) code: String,
    /// Byte ranges of the items that only exist in tests.
    pub(super) tests: Vec<Range<usize>>,
}

impl Source {
    /// Text in which only test modules are replaced by spaces.
    pub(super) fn product(&self) -> String {
        blank(&self.text, self.tests.iter().cloned())
    }

    /// Crate by its directory: `crates/core`; empty for the program.
    pub(super) fn home(&self) -> &str {
        self.path.split_once("src/").map_or("", |(home, _)| home.trim_end_matches('/'))
    }

    /// Top-level module of the crate: `gateway`.
    pub(super) fn room(&self) -> &str {
        let rest = self.path.split_once("src/").map_or(self.path.as_str(), |(_, rest)| rest);
        rest.split('/').next().unwrap_or(rest).trim_end_matches(".rs")
    }

    /// Paths that begin with `crate`, as lists of segments. Trees of `use` are expanded.
    pub(super) fn crate_paths(&self) -> Vec<Vec<String>> {
        let mut found = Vec::new();
        for (at, begin) in self.code.match_indices("crate::") {
            let before = self.code[..at].chars().next_back();
            if !before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
                tree(&self.code[at + begin.len()..], &[], &mut found);
            }
        }
        found
    }

    /// Paths in the code, with imports expanded. They begin with the crate, with this module or a parent, or may begin
    /// with a child module.
    pub(super) fn paths(&self) -> Vec<Vec<String>> {
        let mut found = self.imports(|_| true);
        for begin in ["crate::", "super::", "self::"] {
            for (at, _) in self.code.match_indices(begin) {
                if is_a_beginning(&self.code, at) {
                    tree(&self.code[at..], &[], &mut found);
                }
            }
        }
        for line in self.code.lines().filter_map(|line| line.trim_start().split_once("mod ")) {
            let name = line.1.trim_end_matches(';');
            for (at, _) in self.code.match_indices(&format!("{name}::")) {
                if is_a_beginning(&self.code, at) {
                    tree(&self.code[at..], &[], &mut found);
                }
            }
        }
        found
    }

    /// Paths of the names that it re-exports.
    pub(super) fn hands_on(&self) -> Vec<Vec<String>> {
        self.imports(ends_with_visibility)
    }

    /// Paths of the `use` statements for which the code before them fulfils a condition.
    fn imports(&self, is_meant: impl Fn(&str) -> bool) -> Vec<Vec<String>> {
        let mut found = Vec::new();
        for (at, begin) in self.code.match_indices("use ") {
            let before = &self.code[..at];
            if before.chars().next_back().is_none_or(char::is_whitespace) && is_meant(before) {
                tree(&self.code[at + begin.len()..], &[], &mut found);
            }
        }
        found
    }

    /// Chains of `super::` that leave the top-level module, and would hide an import from this test.
    pub(super) fn escapes(&self) -> Vec<String> {
        let depth = self.path.split_once("src/").map_or("", |(_, rest)| rest).split('/').count();
        let chains = self.code.match_indices("super::").filter(|(at, _)| !self.code[..*at].ends_with("::"));
        let length = |at: usize| self.code[at..].split("::").take_while(|part| *part == "super").count();
        chains.filter(|(at, _)| length(*at) >= depth).map(|(at, _)| line_of(&self.code, at)).collect()
    }
}

/// Returns whether a code ends with a visibility: `pub`, `pub(super)`, `pub(in crate::gateway)`.
fn ends_with_visibility(code: &str) -> bool {
    let code = code.trim_end();
    let restricted = code.rfind("pub(").map(|at| &code[at..]);
    code.ends_with("pub") || restricted.is_some_and(|vis| vis.find(')') == Some(vis.len() - 1))
}

/// Returns whether a path begins here. The path of `pub(in …)` imports nothing.
fn is_a_beginning(code: &str, at: usize) -> bool {
    let before = &code[..at];
    !before.ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':') && !before.ends_with("pub(in ")
}

fn line_of(code: &str, at: usize) -> String {
    let begin = code[..at].rfind('\n').map_or(0, |end| end + 1);
    code[begin..].lines().next().unwrap_or_default().trim().to_owned()
}

/// Expands `a::{b, c::{d, e}}`. Returns the text after the tree.
fn tree<'a>(text: &'a str, before: &[String], found: &mut Vec<Vec<String>>) -> &'a str {
    let mut path = before.to_vec();
    let mut rest = text.trim_start();
    loop {
        if let Some(mut inner) = rest.strip_prefix('{') {
            loop {
                inner = inner.trim_start().trim_start_matches(',').trim_start();
                match inner.strip_prefix('}') {
                    Some(after) => return after,
                    None if inner.is_empty() => return inner,
                    None => inner = tree(inner, &path, found),
                }
            }
        }
        let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        // For `*`, or a character outside a path, it advances by one character, so that an incomplete tree cannot cause
        // an endless loop.
        let end = if end == 0 { rest.chars().next().map_or(0, char::len_utf8) } else { end };
        path.push(rest[..end].to_owned());
        rest = rest[end..].trim_start();
        match rest.strip_prefix("::") {
            Some(after) => rest = after.trim_start(),
            None => break,
        }
    }
    found.push(path);
    match rest.strip_prefix("as ") {
        Some(renamed) => renamed.trim_start().trim_start_matches(|c: char| c.is_alphanumeric() || c == '_'),
        None => rest,
    }
}

/// All source files of every crate, except modules that only exist in tests.
pub(super) fn all(root: &Path) -> Vec<Source> {
    let mut files = Vec::new();
    walk(&root.join("src"), &mut files);
    for entry in std::fs::read_dir(root.join("crates")).unwrap() {
        walk(&entry.unwrap().path().join("src"), &mut files);
    }
    files.sort();
    let mut sources = Vec::new();
    let mut tests: Vec<String> = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        let path = file.strip_prefix(root).unwrap().to_str().unwrap().to_owned();
        let bare = bare(&text);
        let (ranges, mut declared) = test_items(&bare, &path);
        tests.append(&mut declared);
        let code = blank(&bare, ranges.iter().cloned());
        sources.push(Source { path, text, code, tests: ranges });
    }
    let is_test = |path: &str| {
        tests.iter().any(|test| path == format!("{test}.rs") || path.starts_with(&format!("{test}/")))
    };
    sources.retain(|source| !is_test(&source.path));
    sources
}

fn walk(directory: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            walk(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// Text in which comments, strings and characters are replaced by spaces.
fn bare(text: &str) -> String {
    blank(text, lexer::pieces(text).into_iter().map(|piece| piece.range))
}

/// Text in which these byte ranges are replaced by spaces. Lines and byte positions do not change.
fn blank(text: &str, ranges: impl IntoIterator<Item = Range<usize>>) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for range in ranges {
        for byte in &mut bytes[range] {
            if *byte != b'\n' {
                *byte = b' ';
            }
        }
    }
    String::from_utf8(bytes).unwrap()
}

/// Byte ranges of the items that only exist in tests, and the test modules with their own files.
fn test_items(code: &str, path: &str) -> (Vec<Range<usize>>, Vec<String>) {
    let mark = "#[cfg(test)]";
    let mut ranges = Vec::new();
    let mut declared = Vec::new();
    let mut at = 0;
    while let Some(begin) = code[at..].find(mark).map(|found| at + found) {
        let item = begin + mark.len();
        let head = code[item..].find([';', '{']).map_or(code.len(), |found| item + found);
        let name = code[item..head].split_whitespace().skip_while(|word| *word != "mod").nth(1);
        at = if code[head..].starts_with(';') {
            let of = path.trim_end_matches(".rs").trim_end_matches("/mod");
            declared.extend(name.map(|name| format!("{of}/{name}")));
            head + 1
        } else {
            head + block(&code[head..])
        };
        ranges.push(begin..at);
    }
    (ranges, declared)
}

/// Length of a block that begins here.
fn block(text: &str) -> usize {
    let mut depth = 0usize;
    for (at, c) in text.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth <= 1 => return at + 1,
            '}' => depth -= 1,
            _ => {}
        }
    }
    text.len()
}

#[test]
fn a_tree_of_uses_is_spread_out_and_what_is_no_code_is_not_seen() {
    let text = "//! crate::comment\nuse crate::{a::B, c::{self, d as e,\n  *}};\nlet s = \"crate::text\"; let c = '\"';\n\
                fn f<'a>(x: &'a crate::g::H<'a>) {}\n#[cfg(test)]\nmod tests {\n fn t() { crate::hidden::x() } }\n\
                #[cfg(test)]\nmod elsewhere;\n";
    let (tests, declared) = test_items(&bare(text), "src/room/file.rs");
    let code = blank(&bare(text), tests.iter().cloned());
    let source = Source { path: "src/room/file.rs".to_owned(), text: text.to_owned(), code, tests };
    assert_eq!(source.code.len(), text.len());
    let product = source.product();
    assert!(product.contains("crate::text") && product.contains("crate::comment"));
    assert!(!product.contains("crate::hidden") && product.lines().count() == text.lines().count());
    let paths: Vec<String> = source.crate_paths().iter().map(|path| path.join("::")).collect();
    assert_eq!(paths, ["a::B", "c::self", "c::d", "c::*", "g::H"]);
    assert_eq!(declared, ["src/room/file/elsewhere"]);
    assert_eq!(source.room(), "room");
}

#[test]
fn a_name_is_handed_on_with_every_visibility() {
    let code = "pub use a::A;\npub(super) use b::B;\npub(in crate::room) use c::{C, D};\nfn f(x: u8) {}\nuse e::E;\n\
                pub(crate) fn g() {}\nuse h::H;\n";
    let source = Source {
        path: "src/room.rs".to_owned(),
        text: String::new(),
        code: code.to_owned(),
        tests: Vec::new(),
    };
    let handed_on: Vec<String> = source.hands_on().iter().map(|path| path.join("::")).collect();
    assert_eq!(handed_on, ["a::A", "b::B", "c::C", "c::D"]);
    assert_eq!(source.imports(|_| true).len(), 6);
}

#[test]
fn a_way_out_of_the_room_is_seen() {
    let at = |path: &str, code: &str| {
        let source =
            Source { path: path.to_owned(), text: String::new(), code: code.to_owned(), tests: Vec::new() };
        source.escapes()
    };
    assert_eq!(at("src/room/file.rs", "use super::shared::Shared;"), Vec::<String>::new());
    assert_eq!(at("src/room/file.rs", "use super::super::cli::X;"), ["use super::super::cli::X;"]);
    assert_eq!(at("src/room.rs", "use super::cli::X;"), ["use super::cli::X;"]);
}
