//! Errors of a profile. Each error has its position in the profile, a sentence about the mistake, and a hint.
//! A hint lists the words that are allowed at this position, and the one with the most similar spelling (the
//! nearest word). Other hints state the remedy.

use std::fmt;

use serde::Serialize;

use crate::control_chars::{lines, one_line};
use crate::safe_file::LONGEST_QUOTE;
use crate::source_map::SourceMap;
use crate::wording::{allowing_line, counted};

/// Error or warning in a profile: its position, a message and a hint.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ProfileError {
    /// Source of the wrong value: a file name, an environment variable (`environment ISOTHERM__…`), or an option
    /// (`--set key`).
    pub file: String,
    /// Line, counted from 1. `None` if the source is not a file.
    pub line: Option<usize>,
    /// Column, counted from 1, in characters. `None` if the source is not a file.
    pub column: Option<usize>,
    /// Path of the key, for example `axis.z.model[0].terms[1].gain`. Empty for an error about a whole file.
    pub key: String,
    /// Description of the mistake, in one sentence.
    pub message: String,
    /// Hint for the user: the allowed words, the nearest word, or the remedy.
    pub help: Option<String>,
    /// Text of the line with the error. A long line is truncated on both sides of the error.
    #[serde(skip)]
    pub excerpt: Option<String>,
    /// Number of characters in `excerpt` before the position of the error.
    #[serde(skip)]
    pub caret: usize,
    /// Number of further errors that are not listed. Only the last listed error has a number other than 0.
    #[serde(skip_serializing_if = "is_nought")]
    pub more: usize,
    /// Complete list for the profile's key `allow_override` that would permit a layer (local file,
    /// environment or `--set`) to set this key. Empty if no list permits this. `None` if the error has
    /// another reason.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allow_override: Option<Vec<String>>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
fn is_nought(number: &usize) -> bool {
    *number == 0
}

/// Largest number of errors in a report. Further errors are only counted.
const MOST_LISTED: usize = 50;
/// Largest number of errors that are collected and sorted. Further errors are only counted.
const MOST_DESCRIBED: usize = 1000;
/// Largest number of allowed words that a hint lists.
const MOST_WORDS: usize = 200;
/// Largest number of allowed words whose spelling is compared with a wrong word, to find the nearest word.
const MOST_COMPARED: usize = 1000;
/// Largest length of an error message, in characters, because a message may quote a long text of the profile.
const LONGEST_MESSAGE: usize = 800;
/// Largest length of a hint, in characters, because a hint may list many allowed words.
const LONGEST_HELP: usize = 3000;

/// Collected errors or warnings. Their number is limited, because a file may contain millions of wrong keys.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    described: Vec<ProfileError>,
    more: usize,
}

impl Findings {
    pub(crate) fn push(&mut self, error: ProfileError) {
        if self.is_full() { self.more += 1 } else { self.described.push(error) }
    }

    pub(crate) fn append(&mut self, other: Findings) {
        self.more += other.more;
        other.described.into_iter().for_each(|error| self.push(error));
    }

    /// Returns whether the list is full, so that further errors are only counted. The caller can then skip the
    /// description of an error.
    pub(crate) fn is_full(&self) -> bool {
        self.described.len() >= MOST_DESCRIBED
    }

    /// Returns the index that the next stored error will have.
    pub(crate) fn next_index(&self) -> usize {
        self.described.len()
    }

    /// Appends a text to the message of the stored error with this index. Does nothing if no error has this index.
    pub(crate) fn append_to_message(&mut self, index: usize, text: &str) {
        if let Some(error) = self.described.get_mut(index) {
            error.message.push_str(text);
        }
    }

    /// Counts an error without storing a description of it.
    pub(crate) fn count(&mut self) {
        self.more += 1;
    }

    pub(crate) fn len(&self) -> usize {
        self.described.len() + self.more
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the errors for a report. Errors about values that only the profile itself may set come first, then all
    /// other errors. Both groups are in the order of layers and lines.
    pub(crate) fn listed(mut self, spans: &SourceMap) -> Vec<ProfileError> {
        spans.sort(&mut self.described);
        self.described.sort_by_key(|error| error.allow_override.is_none());
        self.described.dedup();
        let more = self.more + self.described.len().saturating_sub(MOST_LISTED);
        self.described.truncate(MOST_LISTED);
        for error in &mut self.described {
            cut(&mut error.key, LONGEST_QUOTE);
            cut(&mut error.message, LONGEST_MESSAGE);
            error.help.iter_mut().for_each(|help| cut(help, LONGEST_HELP));
        }
        if let Some(last) = self.described.last_mut() {
            last.more = more;
        }
        self.described
    }
}

fn cut(text: &mut String, longest: usize) {
    if let Some((end, _)) = text.char_indices().nth(longest) {
        text.truncate(end);
        text.push('…');
    }
}

/// Errors of a profile. Errors about values that only the profile itself may set come first, then all other errors.
/// Both groups are in the order of the layers (profile, local file, environment, `--set`) and lines.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Errors(pub Vec<ProfileError>);

impl ProfileError {
    /// Creates an error about a whole file. It has no key and no line.
    pub(crate) fn about(
        file: impl Into<String>,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        ProfileError { file: file.into(), message: message.into(), help, ..ProfileError::default() }
    }
}

impl fmt::Display for ProfileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", one_line(&self.file))?;
        if let (Some(line), Some(column)) = (self.line, self.column) {
            write!(f, "{line}:{column}:")?;
        }
        if !self.key.is_empty() {
            write!(f, " {}:", one_line(&self.key))?;
        }
        write!(f, " {}", one_line(&self.message))?;
        if let Some(excerpt) = &self.excerpt {
            let before: String = excerpt.chars().take(self.caret).collect();
            // Tabs stay tabs, so that the caret is below its character in every terminal.
            let blank: String = lines(&before).chars().map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
            write!(f, "\n    {}\n    {blank}^", lines(excerpt))?;
        }
        if let Some(help) = &self.help {
            write!(f, "\n  help: {}", one_line(help))?;
        }
        if self.more > 0 {
            write!(f, "\n… and {} more", self.more)?;
        }
        Ok(())
    }
}

impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of_layers = || self.0.iter().filter(|error| error.allow_override.is_some());
        for error in of_layers() {
            writeln!(f, "{error}")?;
        }
        let mut keys: Vec<&String> = Vec::new();
        for key in of_layers().flat_map(|error| &error.allow_override).flatten() {
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        if of_layers().count() > 1 && !keys.is_empty() {
            writeln!(
                f,
                "to allow all of these settings, write below [machine] in the profile:\n  {}",
                allowing_line(keys)
            )?;
        }
        for error in self.0.iter().filter(|error| error.allow_override.is_none()) {
            writeln!(f, "{error}")?;
        }
        let count: usize = self.0.iter().map(|error| 1 + error.more).sum();
        write!(f, "{} in the profile", counted(count, "error"))
    }
}

impl std::error::Error for Errors {}

/// Builds a hint from the allowed words: "did you mean `step`? allowed: …".
pub fn allowed<'a>(word: &str, words: impl IntoIterator<Item = &'a str>) -> String {
    let words: Vec<&str> = words.into_iter().collect();
    listed(nearest_or_longer(word, &words), &words)
}

/// Returns the allowed word that was probably meant. This is the word with the most similar spelling, or else
/// the shortest word that contains `word`. For example, `m7018` is a part of the name of a template.
pub fn nearest_or_longer<'a>(word: &str, words: &[&'a str]) -> Option<&'a str> {
    /// Smallest length of `word`, in characters, for which words that contain it are searched. A shorter text is part
    /// of too many words.
    const SHORTEST: usize = 3;
    let lower = word.to_lowercase();
    let contains = |known: &&&str| word.len() >= SHORTEST && known.to_lowercase().contains(&lower);
    let longer = || words.iter().filter(contains).min_by_key(|known| known.len()).copied();
    nearest(word, words).or_else(longer)
}

/// Builds a hint from the nearest word, if any, and the allowed words.
pub(crate) fn listed(near: Option<&str>, words: &[&str]) -> String {
    let mut list = if words.is_empty() { "nothing".to_owned() } else { shown(words).join(", ") };
    if words.len() > MOST_WORDS {
        list.push_str(&format!(" and {} more", words.len() - MOST_WORDS));
    }
    match near {
        Some(near) => format!("did you mean `{near}`? allowed: {list}"),
        None => format!("allowed: {list}"),
    }
}

fn shown<'w, 'a>(words: &'w [&'a str]) -> &'w [&'a str] {
    &words[..words.len().min(MOST_WORDS)]
}

/// Spellings that a profile does not accept, each with the accepted word of the same meaning.
const ALSO: [(&str, &str); 28] = [
    ("c", "degC"),
    ("°c", "degC"),
    ("℃", "degC"),
    ("degcelsius", "degC"),
    ("celsius", "degC"),
    ("centigrade", "degC"),
    ("kelvin", "K"),
    ("°k", "K"),
    ("degk", "K"),
    ("degkelvin", "K"),
    ("µm", "um"),
    ("micron", "um"),
    ("%", "percent"),
    ("1/min", "rpm"),
    ("min-1", "rpm"),
    ("float", "f32"),
    // Types of a PLC (IEC 61131-3), and the order of the bytes of 32 bits.
    ("int", "i16"),
    ("uint", "u16"),
    ("word", "u16"),
    ("dint", "i32"),
    ("udint", "u32"),
    ("dword", "u32"),
    ("real", "f32"),
    ("lreal", "f64"),
    ("abcd", "msw-first"),
    ("big-endian", "msw-first"),
    ("cdab", "lsw-first"),
    ("word-swapped", "lsw-first"),
];

/// Returns the allowed word for a common spelling, for example `degC` for `celsius`. `lower` is the written word in
/// lower case. `is_meant` decides whether `lower` matches a spelling of the list.
pub(crate) fn also<'a>(
    lower: &str,
    words: &[&'a str],
    is_meant: impl Fn(&str, &str) -> bool,
) -> Option<&'a str> {
    let meant = ALSO.iter().filter(|(written, _)| is_meant(lower, written)).map(|(_, meant)| *meant);
    meant.filter_map(|meant| words.iter().copied().find(|known| *known == meant)).next()
}

/// Returns the allowed word whose spelling is most similar to `word`, which was probably meant. `None` if no
/// word is similar.
pub fn nearest<'a>(word: &str, words: &[&'a str]) -> Option<&'a str> {
    let lower = word.to_lowercase();
    if let Some(meant) = also(&lower, words, |word, written| word == written) {
        return Some(meant);
    }
    // Allows one mistake in a short word, and more in a longer one.
    let far = match word.chars().count() {
        // No name is that long.
        LONGEST_QUOTE.. => return None,
        // Any other letter is one mistake away. Therefore the result is used only if there is a single word.
        ..=1 => usize::from(words.len() == 1),
        length => ((length + 1) / 3).max(1),
    };
    let distance = |known: &str| strsim::damerau_levenshtein(&lower, &known.to_lowercase());
    // Among thousands of names, only those with the same first letter and a similar length are compared.
    let begins_alike =
        |known: &str| words.len() <= MOST_COMPARED || known.chars().next() == word.chars().next();
    words
        .iter()
        .copied()
        .filter(|known| known.len().abs_diff(word.len()) <= 4 * far && begins_alike(known))
        .take(MOST_COMPARED)
        .map(|known| (distance(known), known))
        .filter(|(d, _)| *d <= far)
        .min()
        .map(|(_, known)| known)
}
