//! Cards as they stand in the files: keyword, parameters, data lines, each with its place.

use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::Fault;

/// Where something stands.
#[derive(Debug, Clone)]
pub(super) struct Place {
    pub(super) file: Rc<Path>,
    pub(super) line: usize,
    /// The keyword of the card, with its asterisk.
    pub(super) card: Rc<str>,
}

impl Place {
    pub(super) fn fault(&self, message: impl Into<String>) -> Fault {
        Fault {
            file: self.file.to_path_buf(),
            line: Some(self.line),
            card: self.card.to_string(),
            message: message.into(),
        }
    }
}

/// One line of data.
#[derive(Debug)]
pub(super) struct Line {
    pub(super) place: Place,
    pub(super) text: String,
}

/// A card with its data.
#[derive(Debug)]
pub(super) struct Card {
    pub(super) place: Place,
    /// In capitals, without blanks: `HEATTRANSFER`.
    pub(super) key: String,
    /// Names in capitals without blanks; values as written.
    pub(super) parameters: Vec<(String, Option<String>)>,
    pub(super) lines: Vec<Line>,
}

impl Card {
    /// The value of a parameter, in capitals.
    pub(super) fn value(&self, name: &str) -> Option<String> {
        let (_, value) = self.parameters.iter().find(|(known, _)| known == name)?;
        Some(value.as_deref().unwrap_or_default().to_uppercase())
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.parameters.iter().any(|(known, _)| known == name)
    }

    /// Refuses parameters that are not among `known`.
    pub(super) fn only(&self, known: &[&str], faults: &mut Vec<Fault>) {
        for (name, _) in self.parameters.iter().filter(|(name, _)| !known.contains(&name.as_str())) {
            let here = if known.is_empty() {
                "it takes none".to_owned()
            } else {
                format!("known here: {}", known.join(", "))
            };
            faults.push(self.place.fault(format!("the parameter {name} is not understood ({here})")));
        }
    }
}

/// Files that include files that include files …: deeper is a circle.
const DEEPEST: usize = 8;

/// All cards of a deck, in the order in which they count.
pub(super) fn read(path: &Path, faults: &mut Vec<Fault>) -> Vec<Card> {
    let mut cards = Vec::new();
    gather(path, None, 0, &mut cards, faults);
    cards
}

fn gather(path: &Path, from: Option<&Place>, depth: usize, cards: &mut Vec<Card>, faults: &mut Vec<Fault>) {
    let whole = |message: String| match from {
        Some(place) => place.fault(message),
        None => Fault { file: path.to_path_buf(), line: None, card: String::new(), message },
    };
    if depth > DEEPEST {
        faults.push(whole(format!("more than {DEEPEST} files include each other: {}", path.display())));
        return;
    }
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(error) => {
            faults.push(whole(format!("cannot read {}: {error}", path.display())));
            return;
        }
    };
    // Comments may be in any encoding; everything else is plain.
    let text = String::from_utf8_lossy(&bytes);
    let file: Rc<Path> = Rc::from(path);
    let mut lines = text.lines().enumerate().map(|(at, text)| (at + 1, text.trim())).peekable();
    let first = cards.len();
    while let Some((line, text)) = lines.next() {
        if text.is_empty() || text.starts_with("**") {
            continue;
        }
        if !text.starts_with('*') {
            data(text, &file, line, &mut cards[first..], faults);
            continue;
        }
        // A keyword line that ends with a comma goes on.
        let mut whole = text.to_owned();
        while whole.ends_with(',') {
            let Some((_, more)) = lines.next_if(|(_, more)| !more.starts_with('*')) else { break };
            whole.push_str(more);
        }
        let card = keyword(&whole, &file, line);
        if card.key != "INCLUDE" {
            cards.push(card);
            continue;
        }
        card.only(&["INPUT"], faults);
        let input =
            card.parameters.iter().find(|(name, _)| name == "INPUT").and_then(|(_, value)| value.clone());
        match input.filter(|input| !input.is_empty()) {
            Some(input) => {
                gather(&beside(path, &input), Some(&card.place), depth + 1, cards, faults);
                // What follows an include belongs to no card.
                cards.push(Card { key: INCLUDED.to_owned(), parameters: Vec::new(), ..card });
            }
            None => faults.push(card.place.fault("names no file: write *INCLUDE, INPUT=mesh.inp")),
        }
    }
}

/// Stands where an included file ended.
pub(super) const INCLUDED: &str = "INCLUDED";

fn data(text: &str, file: &Rc<Path>, line: usize, cards: &mut [Card], faults: &mut Vec<Fault>) {
    let Some(card) = cards.last_mut() else {
        let place = Place { file: Rc::clone(file), line, card: Rc::from("") };
        faults.push(place.fault("this line stands before any card"));
        return;
    };
    let place = Place { file: Rc::clone(file), line, card: Rc::clone(&card.place.card) };
    if card.key == INCLUDED {
        faults.push(place.fault("this line follows an include: which card it belongs to is not clear"));
        return;
    }
    card.lines.push(Line { place, text: text.to_owned() });
}

fn keyword(text: &str, file: &Rc<Path>, line: usize) -> Card {
    let mut parts = text.split(',').map(str::trim);
    let name = parts.next().unwrap_or_default();
    let card = name.split_whitespace().collect::<Vec<_>>().join(" ").to_uppercase();
    let parameters = parts.filter(|part| !part.is_empty()).map(|part| match part.split_once('=') {
        Some((name, value)) => (plain(name), Some(value.trim().trim_matches('"').to_owned())),
        None => (plain(part), None),
    });
    Card {
        key: plain(name.trim_start_matches('*')),
        parameters: parameters.collect(),
        lines: Vec::new(),
        place: Place { file: Rc::clone(file), line, card: Rc::from(card.as_str()) },
    }
}

fn plain(text: &str) -> String {
    text.split_whitespace().collect::<String>().to_uppercase()
}

fn beside(path: &Path, input: &str) -> PathBuf {
    path.parent().unwrap_or_else(|| Path::new("")).join(input)
}
