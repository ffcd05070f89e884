//! What is wrong with a profile: every error with its place, what is allowed, and the nearest word.

use std::fmt;

use serde::Serialize;

use crate::regular::LONGEST_QUOTE;
use crate::span::Spans;
use crate::unseen::{lines, one_line};
use crate::wording::{allowing_line, counted};

/// One thing that is wrong, or worth a warning.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ProfileError {
    /// The file, `environment ISOTHERM__…` or `--set key`.
    pub file: String,
    /// Counted from 1; `None` where there is no file.
    pub line: Option<usize>,
    /// Counted from 1, in characters.
    pub column: Option<usize>,
    /// The path of the key: `axis.z.model[0].terms[1].gain`.
    pub key: String,
    /// What is wrong.
    pub message: String,
    /// What is allowed, the nearest word, or the remedy.
    pub help: Option<String>,
    /// The line it stands in; of a long one the part around it.
    #[serde(skip)]
    pub excerpt: Option<String>,
    /// How many characters of that stand before the place.
    #[serde(skip)]
    pub caret: usize,
    /// How many more there are, behind the last one that is listed.
    #[serde(skip_serializing_if = "is_nought")]
    pub more: usize,
    /// A layer above the profile may not set this key: what `allow_override` of the profile would have to be. Empty if
    /// nothing allows it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allow_override: Option<Vec<String>>,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde wants a reference")]
fn is_nought(number: &usize) -> bool {
    *number == 0
}

/// As many errors are listed; the others are counted.
const MOST_LISTED: usize = 50;
/// As many are described while a profile is looked at: the first of them in the order of the lines are listed.
const MOST_DESCRIBED: usize = 1000;
/// Words that are named as allowed.
const MOST_WORDS: usize = 130;
/// Words among which the one is looked for that was meant.
const MOST_COMPARED: usize = 1000;
/// A message in characters: it quotes what a profile says.
const LONGEST_MESSAGE: usize = 800;
/// Its remedy: it names the words that are allowed.
const LONGEST_HELP: usize = 1900;

/// Errors, or warnings, as they are found. Whoever writes two million wrong keys reads fifty.
#[derive(Debug, Default)]
pub(crate) struct Found {
    described: Vec<ProfileError>,
    more: usize,
}

impl Found {
    pub(crate) fn push(&mut self, error: ProfileError) {
        if self.is_full() { self.more += 1 } else { self.described.push(error) }
    }

    pub(crate) fn append(&mut self, other: Found) {
        self.more += other.more;
        other.described.into_iter().for_each(|error| self.push(error));
    }

    /// Whether there is no need to describe another one: it is enough to count it.
    pub(crate) fn is_full(&self) -> bool {
        self.described.len() >= MOST_DESCRIBED
    }

    /// One more that nobody describes.
    pub(crate) fn count(&mut self) {
        self.more += 1;
    }

    pub(crate) fn len(&self) -> usize {
        self.described.len() + self.more
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Those that are listed: first what layers above the profile may not set, then the others, each in the order of the
    /// layers and of their lines.
    pub(crate) fn listed(mut self, spans: &Spans) -> Vec<ProfileError> {
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

/// Everything that is wrong with a profile: first what layers above it may not set, then the others, each in the order of the
/// layers and of their lines.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Errors(pub Vec<ProfileError>);

impl ProfileError {
    /// An error about a whole file.
    pub(crate) fn about(
        file: impl Into<String>,
        message: impl Into<String>,
        help: Option<String>,
    ) -> ProfileError {
        ProfileError {
            file: file.into(),
            line: None,
            column: None,
            key: String::new(),
            message: message.into(),
            help,
            excerpt: None,
            caret: 0,
            more: 0,
            allow_override: None,
        }
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
            // Tabs stay tabs, so that the caret stands under its character in every terminal.
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
                "to allow all of these, write into the profile below [machine]:\n  {}",
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

/// "did you mean `step`? allowed: …", from the words that are allowed.
pub fn allowed<'a>(word: &str, words: impl IntoIterator<Item = &'a str>) -> String {
    let words: Vec<&str> = words.into_iter().collect();
    listed(nearest(word, &words), &words)
}

/// The words that are allowed, after the one that was probably meant.
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

/// What people write for some of the words.
const ALSO: [(&str, &str); 16] = [
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
];

/// The word for what people write instead of it, in small letters.
pub(crate) fn also<'a>(
    lower: &str,
    words: &[&'a str],
    is_meant: impl Fn(&str, &str) -> bool,
) -> Option<&'a str> {
    let meant = ALSO.iter().filter(|(written, _)| is_meant(lower, written)).map(|(_, meant)| *meant);
    meant.filter_map(|meant| words.iter().copied().find(|known| *known == meant)).next()
}

/// The word that was probably meant.
pub fn nearest<'a>(word: &str, words: &[&'a str]) -> Option<&'a str> {
    let lower = word.to_lowercase();
    if let Some(meant) = also(&lower, words, |word, written| word == written) {
        return Some(meant);
    }
    // One slip in a short word, more in a longer one.
    let far = match word.chars().count() {
        // Nothing has such a name.
        LONGEST_QUOTE.. => return None,
        // Any other letter is one slip away: that says something only where there is one.
        ..=1 => usize::from(words.len() == 1),
        length => ((length + 1) / 3).max(1),
    };
    let distance = |known: &str| strsim::damerau_levenshtein(&lower, &known.to_lowercase());
    // Of thousands of names those are looked at that begin alike, and none that differ by their length alone.
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
