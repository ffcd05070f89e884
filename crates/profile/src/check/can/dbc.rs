//! The DBC files of a profile, each read once.

use std::collections::BTreeMap;
use std::rc::Rc;

use crate::check::Check;
use crate::dbc::{DbcFile, Described, Wrong};
use crate::error::ProfileError;
use crate::place::child;
use crate::template;

/// Files by their names; `None` where one cannot be read, which has been told.
pub(in crate::check) type Dbcs = BTreeMap<String, Option<Rc<DbcFile>>>;

impl Check<'_> {
    /// What the device's DBC file says of a signal.
    pub(super) fn described(&mut self, path: &str, name: &str, device: &str) -> Option<Described> {
        let at = child(path, "dbc");
        let raw = self.raw.device.get(device)?;
        let Some(file) = &raw.dbc else {
            let key = child(&child("device", device), "dbc");
            if !self.places.contains(&key) {
                let help = format!("write dbc = \"….dbc\" at device `{device}`, a file beside the profile");
                self.wrong(&at, format!("device `{device}` has no DBC file"), help);
            }
            return None;
        };
        let dbc = self.dbc(&child(&child("device", device), "dbc"), file)?;
        match dbc.signal(name, raw.source_address) {
            Ok(described) => Some(described),
            Err(Wrong { at: None, message, help }) => {
                self.wrong(&at, message, help);
                None
            }
            Err(wrong) => {
                let excerpt = wrong.at.and_then(|(line, _)| dbc.line(line)).map(str::to_owned);
                self.wrong_in_file(file, wrong, excerpt);
                None
            }
        }
    }

    /// A device's DBC file is read though no signal names it: it may be the only mistake.
    pub(in crate::check) fn dbc(&mut self, key: &str, name: &str) -> Option<Rc<DbcFile>> {
        if let Some(known) = self.dbcs.get(name) {
            return known.clone();
        }
        let read = self.read_dbc(key, name).map(Rc::new);
        self.dbcs.insert(name.to_owned(), read.clone());
        read
    }

    fn read_dbc(&mut self, key: &str, name: &str) -> Option<DbcFile> {
        let bytes = match (self.files.read(name), template::dbc(name)) {
            (Ok(bytes), _) => bytes,
            // The user's own comes before the shipped one.
            (Err(_), Some(shipped)) => shipped.as_bytes().to_vec(),
            (Err(why), None) => {
                self.wrong(key, why, "give the path of a DBC file beside the profile, as \"module.dbc\"");
                return None;
            }
        };
        let lines: Vec<u8> = bytes.clone();
        match DbcFile::read(bytes) {
            Ok(file) => Some(file),
            Err(wrong) => {
                let text = String::from_utf8_lossy(&lines);
                let excerpt = wrong.at.and_then(|(line, _)| text.lines().nth(line.checked_sub(1)?));
                let excerpt = excerpt.map(str::to_owned);
                self.wrong_in_file(name, wrong, excerpt);
                None
            }
        }
    }

    fn wrong_in_file(&mut self, file: &str, wrong: Wrong, excerpt: Option<String>) {
        let (line, column) = wrong.at.unzip();
        let file = self.files.path(file);
        let (key, help) = (String::new(), Some(wrong.help));
        self.errors.push(ProfileError { file, line, column, key, message: wrong.message, help, excerpt });
    }
}
