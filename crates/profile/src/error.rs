//! What is wrong with a profile: every error with its place, what is allowed, and the nearest word.

use std::fmt;

use serde::Serialize;

use crate::unseen::{lines, one_line};

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
    /// The line it stands in.
    #[serde(skip)]
    pub excerpt: Option<String>,
}

/// Everything that is wrong with a profile, in the order of the layers and of their lines.
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
        if let (Some(excerpt), Some(column)) = (&self.excerpt, self.column) {
            let before: String = excerpt.chars().take(column - 1).collect();
            // Tabs stay tabs, so that the caret stands under its character in every terminal.
            let blank: String = lines(&before).chars().map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
            write!(f, "\n    {}\n    {blank}^", lines(excerpt))?;
        }
        if let Some(help) = &self.help {
            write!(f, "\n  help: {}", one_line(help))?;
        }
        Ok(())
    }
}

impl fmt::Display for Errors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for error in &self.0 {
            writeln!(f, "{error}")?;
        }
        let plural = if self.0.len() == 1 { "" } else { "s" };
        write!(f, "{} error{plural} in the profile", self.0.len())
    }
}

impl std::error::Error for Errors {}

/// "did you mean `step`? allowed: …", from the words that are allowed.
pub fn allowed<'a>(word: &str, words: impl IntoIterator<Item = &'a str>) -> String {
    let words: Vec<&str> = words.into_iter().collect();
    let list = if words.is_empty() { "nothing".to_owned() } else { words.join(", ") };
    match nearest(word, &words) {
        Some(near) => format!("did you mean `{near}`? allowed: {list}"),
        None => format!("allowed: {list}"),
    }
}

/// What people write for some of the words.
const ALSO: [(&str, &str); 9] = [
    ("c", "degC"),
    ("°c", "degC"),
    ("celsius", "degC"),
    ("µm", "um"),
    ("micron", "um"),
    ("%", "percent"),
    ("1/min", "rpm"),
    ("min-1", "rpm"),
    ("float", "f32"),
];

/// The word that was probably meant.
pub fn nearest<'a>(word: &str, words: &[&'a str]) -> Option<&'a str> {
    let lower = word.to_lowercase();
    let also = ALSO.iter().find(|(written, _)| *written == lower).map(|(_, meant)| *meant);
    if let Some(meant) = also.and_then(|meant| words.iter().find(|known| **known == meant)) {
        return Some(meant);
    }
    // One slip in a short word, more in a longer one.
    let far = match word.chars().count() {
        // Any other letter is one slip away: that says something only where there is one.
        ..=1 => usize::from(words.len() == 1),
        length => ((length + 1) / 3).max(1),
    };
    let distance = |known: &str| strsim::damerau_levenshtein(&lower, &known.to_lowercase());
    words
        .iter()
        .copied()
        .map(|known| (distance(known), known))
        .filter(|(d, _)| *d <= far)
        .min()
        .map(|(_, known)| known)
}
