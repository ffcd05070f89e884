//! YAML documents, recognised by their lines.

use super::kind::FileKind;

/// Minimum number of lines with a key. A single line such as `Serial: 7` may belong to any text.
const LEAST: usize = 2;

/// Returns [`FileKind::Yaml`] if every line of the text is a key, a list item, or the continuation of the previous
/// line.
pub(super) fn of(text: &str) -> Option<FileKind> {
    let lines = || text.lines().filter(|line| !line.trim().is_empty() && !line.trim_start().starts_with('#'));
    let is_mark = |line: &str| matches!(line.trim_end(), "---" | "...");
    let is_item = |line: &str| line.trim_start().starts_with("- ");
    let is_inner = |line: &str| line.starts_with([' ', '\t']);
    let keys = lines().filter(|line| is_key(line.trim_start())).count();
    let is_yaml = lines().all(|line| is_mark(line) || is_item(line) || is_inner(line) || is_key(line));
    let begins = lines().find(|line| !is_mark(line)).is_some_and(|line| is_key(line) || is_item(line));
    (keys >= LEAST && is_yaml && begins).then_some(FileKind::Yaml)
}

/// Returns whether a line begins with a name and a colon: `address: 10.0.0.7`.
fn is_key(line: &str) -> bool {
    let Some((name, rest)) = line.split_once(':') else { return false };
    let name = name.trim_matches('"');
    let is_letter = |one: char| one.is_alphanumeric() || "_-.".contains(one);
    !name.is_empty() && name.chars().all(is_letter) && (rest.is_empty() || rest.starts_with(' '))
}
