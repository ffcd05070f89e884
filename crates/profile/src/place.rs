//! Where each key of the merged profile was written: layer, line and column.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::error::ProfileError;

/// One layer: a file with its text, a variable or a flag.
#[derive(Clone, Debug)]
pub(crate) struct Origin {
    /// As errors name it.
    pub(crate) name: String,
    /// The text of a file.
    pub(crate) text: Option<Text>,
}

/// A text whose lines are found at once: a large profile may have a warning for every signal.
#[derive(Clone, Debug)]
pub(crate) struct Text {
    text: String,
    /// Where each line begins.
    lines: Vec<usize>,
}

impl Text {
    pub(crate) fn new(text: &str) -> Text {
        let after_breaks = text.match_indices('\n').map(|(at, _)| at + 1);
        Text { text: text.to_owned(), lines: std::iter::once(0).chain(after_breaks).collect() }
    }

    /// Line and column of a byte, counted from 1, and the line itself.
    fn locate(&self, byte: usize) -> (usize, usize, &str) {
        let byte = if self.text.is_char_boundary(byte) { byte } else { self.text.len() };
        let line = self.lines.partition_point(|start| *start <= byte);
        let start = self.lines[line - 1];
        let end = self.lines.get(line).map_or(self.text.len(), |next| next - 1);
        let shown = self.text[start..end.max(start)].trim_end_matches('\r');
        (line, self.text[start..byte].chars().count() + 1, shown)
    }
}

#[derive(Clone, Debug)]
struct Place {
    origin: usize,
    key: Range<usize>,
    value: Range<usize>,
    rank: (usize, usize),
}

/// The places of all keys. A later layer that sets a key again takes its place over, but not its rank in the order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Places {
    origins: Vec<Origin>,
    by_path: BTreeMap<String, Place>,
    /// Where values come from that nobody wrote into a layer.
    notes: BTreeMap<String, String>,
}

/// The path of a key in a table.
pub(crate) fn child(path: &str, key: &str) -> String {
    let bare = !key.is_empty()
        && key.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-'));
    let key = if bare { key.to_owned() } else { format!("{key:?}") };
    if path.is_empty() { key } else { format!("{path}.{key}") }
}

/// The path of a place in a list.
pub(crate) fn element(path: &str, index: usize) -> String {
    format!("{path}[{index}]")
}

impl Places {
    pub(crate) fn add_origin(&mut self, origin: Origin) -> usize {
        self.origins.push(origin);
        self.origins.len() - 1
    }

    pub(crate) fn record(&mut self, origin: usize, path: &str, key: Range<usize>, value: Range<usize>) {
        let rank = self.by_path.get(path).map_or((origin, key.start), |known| known.rank);
        self.by_path.insert(path.to_owned(), Place { origin, key, value, rank });
    }

    /// A key that nobody wrote stands where `of` stands, which brought it; `note` says so.
    pub(crate) fn fill_in(&mut self, path: &str, of: &str, note: &str) {
        let Some(place) = self.by_path.get(of).cloned() else { return };
        self.by_path.insert(path.to_owned(), place);
        self.notes.insert(path.to_owned(), note.to_owned());
    }

    /// A list is replaced as a whole: what an earlier layer had inside is gone.
    pub(crate) fn forget_inside(&mut self, path: &str) {
        let inside = format!("{path}[");
        self.by_path.retain(|known, _| !known.starts_with(&inside));
    }

    pub(crate) fn contains(&self, path: &str) -> bool {
        self.by_path.contains_key(path)
    }

    /// The order in which things were first written.
    pub(crate) fn rank(&self, path: &str) -> (usize, usize) {
        self.by_path.get(path).map_or((usize::MAX, 0), |place| place.rank)
    }

    /// An error at the name of a key; for a key that is not there, at the table it is missing from.
    pub(crate) fn at_key(
        &self,
        path: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        let place = self.enclosing(path).map(|place| (place.origin, place.key.start));
        self.error(place, path, message.into(), help)
    }

    /// An error at the value of a key; for a key that is not there, at the table it is missing from.
    pub(crate) fn at_value(
        &self,
        path: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        let Some(place) = self.by_path.get(path) else { return self.at_key(path, message, help) };
        self.error(Some((place.origin, place.value.start)), path, message.into(), help)
    }

    /// An error inside a text value, `offset` bytes from its beginning.
    pub(crate) fn inside(
        &self,
        path: &str,
        text: &str,
        offset: usize,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        let Some(place) = self.by_path.get(path) else { return self.at_key(path, message, help) };
        let written = self.text(place.origin).and_then(|all| all.text.get(place.value.clone()));
        // Where the text has escapes, its bytes are not those of the file.
        let verbatim = written.and_then(|written| written.find(text)).map(|quotes| quotes + offset);
        self.error(
            Some((place.origin, place.value.start + verbatim.unwrap_or(0))),
            path,
            message.into(),
            help,
        )
    }

    /// An error at a byte of a layer.
    pub(crate) fn at_byte(
        &self,
        origin: usize,
        byte: usize,
        path: &str,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        self.error(Some((origin, byte)), path, message.into(), help)
    }

    /// `profiles/x.toml:41`, for a message that names a second place.
    pub(crate) fn line_of(&self, path: &str) -> String {
        let Some(place) = self.enclosing(path) else { return path.to_owned() };
        let name = self.origins.get(place.origin).map_or("", |origin| origin.name.as_str());
        match self.text(place.origin) {
            Some(text) => format!("{name}:{}", text.locate(place.key.start).0),
            None => name.to_owned(),
        }
    }

    /// The order of the layers, then of their lines.
    pub(crate) fn sort(&self, errors: &mut [ProfileError]) {
        let layer = |error: &ProfileError| self.origins.iter().position(|origin| origin.name == error.file);
        errors.sort_by_key(|error| (layer(error), error.line, error.column));
    }

    fn text(&self, origin: usize) -> Option<&Text> {
        self.origins.get(origin)?.text.as_ref()
    }

    fn enclosing(&self, path: &str) -> Option<&Place> {
        let mut path = path;
        loop {
            if let Some(place) = self.by_path.get(path) {
                return Some(place);
            }
            path = &path[..path.rfind(['.', '['])?];
        }
    }

    fn error(
        &self,
        place: Option<(usize, usize)>,
        path: &str,
        message: String,
        help: Option<String>,
    ) -> ProfileError {
        let (origin, byte) = place.unwrap_or_default();
        let file = self.origins.get(origin).map(|origin| origin.name.clone()).unwrap_or_default();
        let located = self.text(origin).map(|text| text.locate(byte));
        let help = match (self.notes.get(path), help) {
            (Some(note), Some(help)) => Some(format!("{note}; {help}")),
            (Some(note), None) => Some(note.clone()),
            (None, help) => help,
        };
        ProfileError {
            file,
            line: located.map(|(line, ..)| line),
            column: located.map(|(_, column, _)| column),
            key: path.to_owned(),
            message,
            help,
            excerpt: located.map(|(.., line)| line.to_owned()),
        }
    }
}
