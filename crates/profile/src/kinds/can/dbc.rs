//! DBC files of a profile, which describe CAN frames. Each file is read once.

use std::rc::Rc;

use crate::dbc::{self, DbcFile, Described, Wrong};
use crate::error::ProfileError;
use crate::file_kind::FileKind;
use crate::source_map::around;
use crate::tables::{Check, KeyContext};
use crate::template;

/// Returns the description of a signal in the DBC file of its device. If the file or the signal has an error,
/// reports the error and returns `None`.
pub(super) fn described(
    check: &Check<'_>,
    at: &KeyContext<'_>,
    name: &str,
    device: &str,
) -> Option<Described> {
    let key = at.top("device").key(device).key("dbc");
    let raw = check.raw.device.get(device)?;
    let Some(file) = &raw.dbc else {
        // Reported at the device, so that several signals give one error.
        let message =
            format!("device `{device}` has no DBC file, but signals of this device have the key `dbc`");
        key.missing(message, "write dbc = \"….dbc\" at this device: the name of a file next to the profile");
        return None;
    };
    let dbc = read(check, &key, file)?;
    match dbc.signal(name, raw.source_address) {
        Ok(described) => return Some(described),
        Err(Wrong { at: None, message, help }) => at.invalid(message, help),
        Err(wrong) => {
            let excerpt = wrong.at.and_then(|(line, _)| dbc.line(line)).map(str::to_owned);
            wrong_in_file(at, file, wrong, excerpt);
        }
    }
    None
}

/// Reads a DBC file, only once even if several devices use it. Returns `None` if the file has an error, which is
/// reported at the first use. The loader also reads a file that no signal uses, so that its errors are reported.
pub(super) fn read(check: &Check<'_>, at: &KeyContext<'_>, name: &str) -> Option<Rc<DbcFile>> {
    if let Some(known) = check.dbcs.borrow().get(name) {
        return known.clone();
    }
    let read = parse(at, name).map(Rc::new);
    check.dbcs.borrow_mut().insert(name.to_owned(), read.clone());
    read
}

fn parse(at: &KeyContext<'_>, name: &str) -> Option<DbcFile> {
    // The user's file takes precedence over the shipped one.
    let bytes = match (at.report.files.read(name), template::dbc(name)) {
        (Ok(bytes), _) => bytes,
        (Err(_), Some(shipped)) => shipped.as_bytes().to_vec(),
        (Err(why), None) => {
            // An ARXML file is often larger than the limit.
            let other = at.report.files.kind(name).and_then(|kind| kind.instead_of(FileKind::Dbc));
            if let Some(other) = other {
                at.error(other.error(at.report.files.path(name)));
                return None;
            }
            return at.reject(why, "give the path of a DBC file next to the profile, as \"module.dbc\"");
        }
    };
    let report = |wrong: Wrong| {
        let text = String::from_utf8_lossy(&bytes);
        let excerpt = wrong.at.and_then(|(line, _)| dbc::shown(&text, line)).map(str::to_owned);
        wrong_in_file(at, name, wrong, excerpt);
    };
    DbcFile::read(bytes.clone()).map_err(report).ok()
}

fn wrong_in_file(at: &KeyContext<'_>, file: &str, wrong: Wrong, excerpt: Option<String>) {
    let (line, column) = wrong.at.unzip();
    let in_line = |text: String| {
        let byte = text.char_indices().nth(column.unwrap_or(1) - 1).map_or(text.len(), |(byte, _)| byte);
        around(&text, byte)
    };
    let (excerpt, caret) = excerpt.map(in_line).unzip();
    let whole = ProfileError::about(at.report.files.path(file), wrong.message, Some(wrong.help));
    at.error(ProfileError { line, column, excerpt, caret: caret.unwrap_or_default(), ..whole });
}
