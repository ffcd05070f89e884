//! Texts of a log column: labels that divide the log into runs, and words that stand for a missing value.

use std::collections::HashMap;

/// Maximum number of different texts in one column.
pub(super) const MOST_WORDS: usize = 100_000;

/// Trimmed texts of a column; each different text is stored once.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Words {
    places: Vec<u32>,
    words: Vec<String>,
    known: HashMap<String, u32>,
}

impl Words {
    /// Returns the texts in the order of the rows.
    pub(super) fn iter(&self) -> impl Iterator<Item = &str> {
        self.places.iter().map(|place| self.words[*place as usize].as_str())
    }

    /// Returns the text of the row with the index `place`. `None` if there is no such row.
    fn at(&self, place: usize) -> Option<&str> {
        self.words.get(*self.places.get(place)? as usize).map(String::as_str)
    }

    /// Adds one more row with the text of the first row. Returns `false` if no row has a text yet.
    fn repeat_first(&mut self) -> bool {
        let has_words = !self.words.is_empty();
        if has_words {
            self.places.push(0);
        }
        has_words
    }

    /// Adds the text of a row. Returns `false` if there are too many different texts.
    pub(super) fn push(&mut self, text: &str) -> bool {
        let place = match self.known.get(text) {
            Some(place) => *place,
            None if self.words.len() == MOST_WORDS => return false,
            None => {
                let place = u32::try_from(self.words.len()).unwrap_or(u32::MAX);
                self.words.push(text.to_owned());
                self.known.insert(text.to_owned(), place);
                place
            }
        };
        self.places.push(place);
        true
    }
}

/// Rows of a column with a word, such as `OL`, `---` or `n/a`, instead of a value. `OL` means overload.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Messages {
    /// Rows in ascending order.
    rows: Vec<u32>,
    /// Word in each of these rows, in the same order.
    words: Words,
}

impl Messages {
    /// Adds the word of a row. The rows must be added in ascending order.
    pub(super) fn push(&mut self, row: usize, text: &str) {
        // The number of rows is limited to that of a table. Further words are as the first one.
        if let Ok(row) = u32::try_from(row)
            && (self.words.push(text) || self.words.repeat_first())
        {
            self.rows.push(row);
        }
    }

    /// Returns the rows that contain a word.
    pub(super) fn rows(&self) -> impl Iterator<Item = usize> {
        self.rows.iter().map(|row| *row as usize)
    }

    /// Returns the word in this row; `None` if the row has a value.
    pub(super) fn of(&self, row: usize) -> Option<&str> {
        let place = self.rows.binary_search(&u32::try_from(row).ok()?).ok()?;
        self.words.at(place)
    }
}
