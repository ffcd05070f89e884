//! Maps each key of the merged profile to its source position: layer, line and column.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::ops::Range;

use serde_json::Value;

use crate::control_chars::veiled;
use crate::error::ProfileError;
use crate::safe_file::LONGEST_QUOTE;

/// Layer of the profile: a file with its text, an environment variable, or an option `--set`.
#[derive(Clone, Debug)]
struct Layer {
    /// Name of the layer in messages.
    name: String,
    /// Text of a file, and the byte position at which each line begins. The positions are stored because a large
    /// profile may have a warning for every signal.
    text: Option<(String, Vec<usize>)>,
}

impl Layer {
    /// Returns line and column of a byte, counted from 1. Also returns an excerpt of the line, and the position of the
    /// byte in this excerpt. `None` if the layer is not a file.
    fn locate(&self, byte: usize) -> Option<(usize, usize, (String, usize))> {
        let (text, lines) = self.text.as_ref()?;
        let byte = if text.is_char_boundary(byte) { byte } else { text.len() };
        let line = lines.partition_point(|start| *start <= byte);
        let start = lines[line - 1];
        let end = lines.get(line).map_or(text.len(), |next| next - 1);
        let whole = veiled(text[start..end.max(start)].trim_end_matches('\r'));
        Some((line, text[start..byte].chars().count() + 1, around(&whole, byte - start)))
    }
}

/// Returns an excerpt of a line, and the number of characters of the excerpt that precede the byte `byte` of the line.
/// A long line is truncated on both sides.
pub(crate) fn around(line: &str, byte: usize) -> (String, usize) {
    const BEFORE: usize = LONGEST_QUOTE * 3 / 4;
    let byte = if line.is_char_boundary(byte) { byte } else { line.len() };
    let (before, behind) = line.split_at(byte);
    let nearest = before.char_indices().rev().nth(BEFORE - 1).filter(|(from, _)| *from > 0);
    let (mut shown, mut caret) = match nearest {
        Some((from, _)) => (format!("…{}", &before[from..]), BEFORE + 1),
        None => (before.to_owned(), before.chars().count()),
    };
    caret = caret.min(LONGEST_QUOTE);
    match behind.char_indices().nth(LONGEST_QUOTE - caret) {
        Some((end, _)) => shown.extend([&behind[..end], "…"]),
        None => shown.push_str(behind),
    }
    (shown, caret)
}

/// Source position of one key. The numbers have 32 bits to save memory, because a large machine has a hundred thousand
/// keys.
#[derive(Clone, Debug)]
struct Span {
    layer: u32,
    /// Positions of the first byte of the name of the key, and of the first byte after the name.
    key: (u32, u32),
    /// Positions of the first byte of the value, and of the first byte after the value.
    value: (u32, u32),
    /// Layer and byte at which the key first occurred. Tables are sorted by this rank.
    rank: (u32, u32),
    /// Whether the value of this key in the merged profile has the correct type.
    is_right: bool,
}

impl Span {
    /// Returns the layer, and the byte at which the name of the key begins.
    fn begin(&self) -> (usize, usize) {
        (large(self.layer), large(self.key.0))
    }
}

fn small(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}

fn large(number: u32) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

/// Source positions of all keys, by path. If a later layer sets a key again, the position is replaced, but the rank
/// stays.
#[derive(Clone, Debug, Default)]
pub(crate) struct SourceMap {
    layers: Vec<Layer>,
    /// Positions of the keys that are not inside a list. Almost all keys are of this kind.
    keys: HashMap<Box<str>, Span>,
    /// Positions of list entries and of the keys inside them. They are sorted, so that all positions of one list can be
    /// removed.
    in_lists: BTreeMap<Box<str>, Span>,
    /// Valid keys that a template added, and that have no position.
    brought: BTreeSet<String>,
    /// Known keys of which an unknown key is probably a misspelling. These known keys are not reported as missing.
    meant: BTreeSet<String>,
    /// For values that no layer contains: a text about their origin, by the path of the key.
    notes: BTreeMap<String, String>,
}

/// Builds the path of a key in a table: `axis.z` from `axis` and `z`. A key with special characters is quoted.
pub(crate) fn child(path: &str, key: &str) -> String {
    let is_plain = !key.is_empty()
        && key.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-'));
    let key = if is_plain { Cow::Borrowed(key) } else { Cow::Owned(format!("{key:?}")) };
    if path.is_empty() { key.into_owned() } else { [path, ".", &key].concat() }
}

/// Returns whether a path leads into a list.
fn is_in_list(path: &str) -> bool {
    path.contains('[')
}

/// Builds the path of an entry of a list: `terms[1]` from `terms` and 1.
pub(crate) fn element(path: &str, index: usize) -> String {
    format!("{path}[{index}]")
}

impl SourceMap {
    /// Adds a layer with its name, and its text if it is a file. Returns its index.
    pub(crate) fn add_layer(&mut self, name: &str, text: Option<&str>) -> usize {
        let lines = |text: &str| {
            let after_breaks = text.match_indices('\n').map(|(at, _)| at + 1);
            (text.to_owned(), std::iter::once(0).chain(after_breaks).collect())
        };
        self.layers.push(Layer { name: name.to_owned(), text: text.map(lines) });
        self.layers.len() - 1
    }

    /// Records that a reported unknown key is probably a misspelling of this known key.
    pub(crate) fn mark_meant(&mut self, path: String) {
        self.meant.insert(path);
    }

    /// Returns whether a reported unknown key is probably a misspelling of this key.
    pub(crate) fn is_meant(&self, path: &str) -> bool {
        self.meant.contains(path)
    }

    pub(crate) fn record(&mut self, layer: usize, path: &str, key: Range<usize>, value: Range<usize>) {
        let layer = small(layer);
        let bytes = |range: Range<usize>| (small(range.start), small(range.end));
        let (key, value) = (bytes(key), bytes(value));
        let rank = self.span(path).map_or((layer, key.0), |known| known.rank);
        self.put(path, Span { layer, key, value, rank, is_right: false });
    }

    fn span(&self, path: &str) -> Option<&Span> {
        if is_in_list(path) { self.in_lists.get(path) } else { self.keys.get(path) }
    }

    fn put(&mut self, path: &str, span: Span) {
        if is_in_list(path) {
            self.in_lists.insert(path.into(), span);
        } else {
            self.keys.insert(path.into(), span);
        }
    }

    /// Records a key that no layer contains. The key gets the position of the key `of`, which caused the addition.
    /// `note` is a text about the origin of the value.
    pub(crate) fn fill_in(&mut self, path: &str, of: &str, note: &str) {
        let Some(span) = self.span(of).cloned() else { return };
        self.put(path, span);
        self.notes.insert(path.to_owned(), note.to_owned());
    }

    /// Removes the positions inside a list, because a later layer replaces the whole list.
    pub(crate) fn forget_inside(&mut self, path: &str) {
        let inside = format!("{path}[");
        let after = self.in_lists.range(Box::from(&*inside)..).map(|(known, _)| known);
        let gone: Vec<Box<str>> = after.take_while(|known| known.starts_with(&inside)).cloned().collect();
        for known in gone {
            self.in_lists.remove(&known);
        }
    }

    /// Marks a value of the merged profile as valid, with all values inside it.
    pub(crate) fn mark_right(&mut self, path: &str, value: &Value) {
        let span = if is_in_list(path) { self.in_lists.get_mut(path) } else { self.keys.get_mut(path) };
        match (span, path) {
            (Some(span), _) => span.is_right = true,
            (None, "") => {}
            (None, path) => drop(self.brought.insert(path.to_owned())),
        }
        match value {
            Value::Object(table) => {
                table.iter().for_each(|(key, value)| self.mark_right(&child(path, key), value))
            }
            Value::Array(items) => {
                items
                    .iter()
                    .enumerate()
                    .for_each(|(place, item)| self.mark_right(&element(path, place), item));
            }
            _ => {}
        }
    }

    /// Returns whether the path has a value of the correct type.
    pub(crate) fn is_right(&self, path: &str) -> bool {
        self.span(path).is_some_and(|span| span.is_right) || self.brought.contains(path)
    }

    pub(crate) fn contains(&self, path: &str) -> bool {
        self.span(path).is_some()
    }

    /// Returns layer and byte at which a key first occurred. For a key without a position, returns a rank after all
    /// others.
    pub(crate) fn rank(&self, path: &str) -> (usize, usize) {
        let rank = self.span(path).map(|span| (large(span.rank.0), large(span.rank.1)));
        rank.unwrap_or((usize::MAX, 0))
    }

    /// Creates an error at the name of a key. If the key is missing, the error is at its table.
    pub(crate) fn at_key(
        &self,
        path: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        let (layer, byte) = self.enclosing(path).map(Span::begin).unwrap_or_default();
        self.at_byte(layer, byte, path, message, help)
    }

    /// Creates an error at the value of a key. If the key is missing, the error is at its table.
    pub(crate) fn at_value(
        &self,
        path: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        let Some(span) = self.span(path) else { return self.at_key(path, message, help) };
        self.at_byte(large(span.layer), large(span.value.0), path, message, help)
    }

    /// Creates an error inside a text value, `offset` bytes after its beginning.
    pub(crate) fn inside(
        &self,
        path: &str,
        text: &str,
        offset: usize,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        let Some(span) = self.span(path) else { return self.at_key(path, message, help) };
        let file = self.layers.get(large(span.layer)).and_then(|layer| layer.text.as_ref());
        let (from, to) = (large(span.value.0), large(span.value.1));
        let written = file.and_then(|(file, _)| file.get(from..to));
        // If the text contains escapes, its bytes differ from those of the file.
        let verbatim = written.and_then(|written| written.find(text)).map(|quotes| quotes + offset);
        self.at_byte(large(span.layer), from + verbatim.unwrap_or(0), path, message, help)
    }

    /// Creates an error whose position is a byte of a layer.
    pub(crate) fn at_byte(
        &self,
        layer: usize,
        byte: usize,
        path: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        let layer = self.layers.get(layer);
        let located = layer.and_then(|layer| layer.locate(byte));
        let (place, excerpt) = located.map(|(line, column, excerpt)| ((line, column), excerpt)).unzip();
        let ((line, column), (excerpt, caret)) = (place.unzip(), excerpt.unzip());
        let help = match (self.notes.get(path), help) {
            (Some(note), Some(help)) => Some(format!("{note}; {help}")),
            (note, help) => help.or(note.cloned()),
        };
        let file = layer.map(|layer| layer.name.clone()).unwrap_or_default();
        let about = ProfileError::about(file, veiled(&message.into()), help);
        ProfileError {
            line,
            column,
            key: path.to_owned(),
            excerpt,
            caret: caret.unwrap_or_default(),
            ..about
        }
    }

    /// Formats the position of a key for a message about another key: `profiles/x.toml:41`.
    pub(crate) fn line_of(&self, path: &str) -> String {
        let found = self.enclosing(path).map(Span::begin);
        let found = found.and_then(|(layer, byte)| Some((self.layers.get(layer)?, byte)));
        match found.map(|(layer, byte)| (&layer.name, layer.locate(byte))) {
            None => path.to_owned(),
            Some((name, None)) => name.clone(),
            Some((name, Some((line, ..)))) => format!("{name}:{line}"),
        }
    }

    /// Sorts errors by layer, line and column.
    pub(crate) fn sort(&self, errors: &mut [ProfileError]) {
        let layer = |error: &ProfileError| self.layers.iter().position(|layer| layer.name == error.file);
        errors.sort_by_key(|error| (layer(error), error.line, error.column));
    }

    fn enclosing(&self, path: &str) -> Option<&Span> {
        let mut path = path;
        loop {
            if let Some(span) = self.span(path) {
                return Some(span);
            }
            path = &path[..path.rfind(['.', '['])?];
        }
    }
}
