//! Cards of FE input files. A card is a line with a keyword such as `*NODE` and its parameters, together with the data
//! lines below it. Each card and each data line has its location for error messages.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::position::Position;
use super::{Fault, Faults, foreign};
use crate::mesh::AXES;

/// Location of a card or a data line, for error messages.
#[derive(Debug, Clone)]
pub(super) struct Location {
    file: Rc<Path>,
    pub(super) line: usize,
    /// Keyword of the card at this location, with its asterisk.
    card: Rc<str>,
}

impl Location {
    pub(super) fn fault(&self, message: impl Into<String>) -> Fault {
        Fault {
            file: self.file.to_path_buf(),
            line: Some(self.line),
            card: self.card.to_string(),
            message: message.into(),
        }
    }
}

/// A data line: values separated by commas.
#[derive(Debug)]
pub(super) struct Line {
    pub(super) at: Location,
    /// Text of the data line, without commas at its end and without quotation marks.
    text: String,
}

impl Line {
    pub(super) fn len(&self) -> usize {
        self.values().count()
    }

    pub(super) fn values(&self) -> impl Iterator<Item = &str> {
        let nothing = self.text.is_empty();
        self.text.split(',').map(str::trim).skip(usize::from(nothing))
    }

    pub(super) fn text(&self, place: usize) -> &str {
        self.values().nth(place).unwrap_or_default()
    }

    /// Returns an error if the number of values in the line differs from the number of `names`.
    pub(super) fn exactly(&self, names: &[&str]) -> Result<(), Fault> {
        let (has, wanted) = (self.len(), names.len());
        let counted = if has == 1 { "1 value".to_owned() } else { format!("{has} values") };
        let names = names.join(", ");
        if has < wanted {
            return Err(self.fault(format!("{counted}, but {wanted} are required ({names})")));
        }
        if has > wanted {
            let hint = "a decimal comma divides a number into two values: write 1.5, not 1,5";
            return Err(self.fault(format!("{counted}, but {wanted} are required ({names}); {hint}")));
        }
        Ok(())
    }

    /// Parses a finite number from the value at index `place`. A Fortran exponent (`1.5D3`) is accepted.
    pub(super) fn number(&self, place: usize, name: &str) -> Result<f64, Fault> {
        let text = self.text(place);
        let parsed = text.parse::<f64>().or_else(|_| text.replace(['d', 'D'], "E").parse());
        match parsed {
            Ok(number) if number.is_finite() => Ok(number),
            _ if text.is_empty() => Err(self.fault(format!("the {name} is missing"))),
            _ => Err(self.fault(format!("`{}` is not a number; write the {name} here", quoted(text)))),
        }
    }

    /// Parses x, y and z from the values from index `first` on. An omitted coordinate is 0.
    pub(super) fn coordinates(&self, first: usize) -> Result<[f64; 3], Fault> {
        let mut xyz = [0.0; 3];
        for (axis, (value, name)) in xyz.iter_mut().zip(AXES).enumerate() {
            if !self.text(first + axis).is_empty() {
                *value = self.number(first + axis, name)?;
            }
        }
        Ok(xyz)
    }

    /// Parses the number of a node, an element or a direction from one of the values.
    pub(super) fn id(&self, text: &str, name: &str) -> Result<u32, Fault> {
        let id = text.parse().ok().filter(|id| *id > 0);
        id.ok_or_else(|| {
            let text = quoted(text);
            self.fault(format!("`{text}` is not a whole number above 0; write the {name} here"))
        })
    }

    pub(super) fn fault(&self, message: impl Into<String>) -> Fault {
        self.at.fault(message)
    }

    /// Replaces each value of the data line for which `renamed` returns a new text. `None` leaves the value unchanged.
    fn rename(&mut self, renamed: impl Fn(&str) -> Option<String>) {
        if self.values().any(|value| renamed(value).is_some()) {
            let values: Vec<String> =
                self.values().map(|value| renamed(value).unwrap_or_else(|| value.to_owned())).collect();
            self.text = values.join(",");
        }
    }
}

/// Shortens a text from the input file to 200 characters, to quote it in a message.
pub(super) fn quoted(text: &str) -> String {
    const LONGEST: usize = 200;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// Card: a keyword with its parameters and data lines.
#[derive(Debug)]
pub(super) struct Card {
    pub(super) at: Location,
    /// Keyword in capitals, without asterisk and blanks: `HEATTRANSFER`.
    pub(super) key: String,
    /// Parameters of the card: names in capitals without blanks, and values as written.
    parameters: Vec<(String, Option<String>)>,
    pub(super) lines: Vec<Line>,
    /// Position of the instance to which the nodes of the card belong. `None` if the nodes have coordinates
    /// of the model.
    pub(super) position: Option<Rc<Position>>,
}

impl Card {
    /// Returns the value of a parameter, in capitals; `None` if the card does not have the parameter.
    pub(super) fn value(&self, name: &str) -> Option<String> {
        let (_, value) = self.parameters.iter().find(|(known, _)| known == name)?;
        Some(value.as_deref().unwrap_or_default().to_uppercase())
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.parameters.iter().any(|(known, _)| known == name)
    }

    /// Adds an error for each parameter that is not in `known`, a list separated by blanks. `NAME` is allowed on every
    /// card, because it only labels the card.
    pub(super) fn only(&self, known: &str, faults: &mut Faults) {
        let is_known = |name: &str| name == "NAME" || known.split(' ').any(|known| known == name);
        for (name, _) in self.parameters.iter().filter(|(name, _)| !is_known(name)) {
            let here = match known {
                "" => "this card has no parameters".to_owned(),
                known => format!("known here: {}", known.replace(' ', ", ")),
            };
            faults.push(self.fault(format!("the parameter {name} is not understood ({here})")));
        }
    }

    pub(super) fn fault(&self, message: impl Into<String>) -> Fault {
        self.at.fault(message)
    }

    /// Returns the value of a parameter as [`Card::value`] does, and removes the parameter.
    pub(super) fn take(&mut self, name: &str) -> Option<String> {
        let value = self.value(name)?;
        self.parameters.retain(|(known, _)| known != name);
        Some(value)
    }

    /// Replaces the values of the parameters in `names` for which `renamed` returns a new text. `None` leaves the value
    /// unchanged.
    pub(super) fn rename_parameters(&mut self, names: &[&str], renamed: impl Fn(&str) -> Option<String>) {
        for (_, value) in self.parameters.iter_mut().filter(|(name, _)| names.contains(&name.as_str())) {
            if let Some(new) = value.as_deref().and_then(&renamed) {
                *value = Some(new);
            }
        }
    }

    /// Replaces each value of the data lines for which `renamed` returns a new text. `None` leaves the value unchanged.
    pub(super) fn rename_values(&mut self, renamed: impl Fn(&str) -> Option<String>) {
        self.lines.iter_mut().for_each(|line| line.rename(&renamed));
    }
}

/// Maximum depth of included files. A greater depth is treated as a circular include.
const DEEPEST: usize = 8;
/// Maximum number of times that a file is read. Repeated includes could otherwise grow without limit.
const MOST_TIMES: usize = 2;
/// Maximum size of all files of a load case together, in bytes; enough for ten million nodes and their elements.
const LARGEST: u64 = 2_000_000_000;

/// Reads all cards of an FE input file and of the files that it includes, in their order.
pub(super) fn read(path: &Path, faults: &mut Faults) -> Vec<Card> {
    let mut gathering = Gathering { cards: Vec::new(), faults, taken: HashMap::new(), bytes: 0 };
    gathering.file(path, None, 0);
    gathering.cards
}

/// State of the reader of input files: the cards read so far, and the counters for the limits.
struct Gathering<'f> {
    cards: Vec<Card>,
    faults: &'f mut Faults,
    /// Number of times that each file was read. The key is the device number and the inode number of the file.
    taken: HashMap<(u64, u64), usize>,
    bytes: u64,
}

impl Gathering<'_> {
    /// Reads the content of a file, or returns the reason for its rejection.
    fn bytes(&mut self, path: &Path) -> Result<Vec<u8>, String> {
        let unreadable = |why: std::io::Error| format!("cannot read {}: {why}", path.display());
        let found = std::fs::metadata(path).map_err(unreadable)?;
        // A pipe may have no writer, and a device has no end.
        if !found.is_file() {
            return Err(format!("{} is not a regular file: write the path of a file", path.display()));
        }
        let times = self.taken.entry((found.dev(), found.ino())).or_default();
        *times += 1;
        if *times > MOST_TIMES {
            let why = "does it include itself?";
            return Err(format!("{} is included more than {MOST_TIMES} times: {why}", path.display()));
        }
        self.bytes += found.len();
        if self.bytes > LARGEST {
            let limit = LARGEST / 1_000_000_000;
            return Err(format!("with {}, the files of the load case exceed {limit} GB", path.display()));
        }
        let mut bytes = Vec::new();
        let read = File::open(path).and_then(|file| file.take(LARGEST).read_to_end(&mut bytes));
        read.map_err(unreadable)?;
        foreign::refusal(path, &bytes).map_or(Ok(bytes), Err)
    }

    fn file(&mut self, path: &Path, from: Option<&Card>, depth: usize) {
        let refused = |message: String| match from {
            Some(include) => include.fault(message),
            None => Fault::of_file(path, message),
        };
        if depth > DEEPEST {
            let message = format!("includes are nested more than {DEEPEST} levels deep: {}", path.display());
            return self.faults.push(refused(message));
        }
        match self.bytes(path) {
            Ok(bytes) => self.cards(path, &bytes, depth),
            Err(why) => self.faults.push(refused(why)),
        }
    }

    fn cards(&mut self, path: &Path, bytes: &[u8], depth: usize) {
        // Comments may have any encoding; everything else is ASCII.
        let text = String::from_utf8_lossy(bytes);
        let text = text.trim_start_matches('\u{feff}');
        let is_card = |line: &str| line.trim_start().starts_with('*');
        if !text.trim().is_empty() && !text.lines().any(is_card) {
            return self.faults.push(Fault::of_file(path, WITHOUT_CARDS));
        }
        let file: Rc<Path> = Rc::from(path);
        let mut lines = text.lines().enumerate().map(|(at, text)| (at + 1, text.trim())).peekable();
        let first = self.cards.len();
        while let Some((line, text)) = lines.next() {
            if text.is_empty() || text.starts_with("**") {
                continue;
            }
            if !text.starts_with('*') {
                let at = Location { file: Rc::clone(&file), line, card: Rc::from("") };
                self.faults.extend(data(text, at, &mut self.cards[first..]).err());
                continue;
            }
            // A keyword line that ends with a comma continues on the next line.
            let mut whole = text.to_owned();
            while whole.ends_with(',') {
                let Some((_, more)) = lines.next_if(|(_, more)| !more.starts_with('*')) else { break };
                whole.push_str(more);
            }
            let card = keyword(&whole, &file, line);
            if card.key != "INCLUDE" {
                self.cards.push(card);
                continue;
            }
            card.only("INPUT", self.faults);
            let input = card.parameters.iter().find(|(name, _)| name == "INPUT");
            match input.and_then(|(_, value)| value.as_ref()).filter(|input| !input.is_empty()) {
                Some(input) => {
                    // Programs on Windows write backslashes.
                    let input = input.replace('\\', "/");
                    let beside: PathBuf = path.parent().unwrap_or(Path::new("")).join(input);
                    self.file(&beside, Some(&card), depth + 1);
                    // A line after an include belongs to no card.
                    self.cards.push(Card { key: INCLUDED.to_owned(), parameters: Vec::new(), ..card });
                }
                None => {
                    self.faults.push(card.fault("the card names no file: write *INCLUDE, INPUT=mesh.inp"))
                }
            }
        }
    }
}

/// Message about a file that is not an FE input file, because it contains no cards.
pub(super) const WITHOUT_CARDS: &str = "no line begins with a card such as *NODE, so this is not an FE input file. Export the mesh \
                                        as Abaqus input (.inp) from the program that made it";

/// Keyword of a card that the reader adds at the end of each included file. A data line after this card is an error.
pub(super) const INCLUDED: &str = "INCLUDED";

/// Adds a data line to the last card, without quotation marks.
fn data(text: &str, mut at: Location, cards: &mut [Card]) -> Result<(), Fault> {
    let card = cards
        .last_mut()
        .ok_or_else(|| at.fault("this line is before the first card: write the card above this line"))?;
    at.card = Rc::clone(&card.at.card);
    if card.key == INCLUDED {
        return Err(
            at.fault("this data line follows an *INCLUDE: write the card of this line again above the line")
        );
    }
    // Abaqus writes names with blanks in quotation marks.
    let text = text.trim_end_matches(|last: char| last == ',' || last.is_whitespace()).replace('"', "");
    card.lines.push(Line { at, text });
    Ok(())
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
        position: None,
        at: Location { file: Rc::clone(file), line, card: Rc::from(card) },
    }
}

/// Returns the text in capitals, without blanks, so that keywords can be compared.
pub(super) fn plain(text: &str) -> String {
    text.split_whitespace().collect::<String>().to_uppercase()
}
