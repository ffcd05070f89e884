//! Recognises kinds of text files by a typical line or XML element.

use std::borrow::Cow;

use super::kind::FileKind;
use super::table;

/// First characters of element names in XML documents, each with the kind of file. They are searched in this order.
const XML: [(&str, FileKind); 5] = [
    ("AUTOSAR", FileKind::Arxml),
    ("NetworkDefinition", FileKind::Kcd),
    ("FIBEX", FileKind::Fibex),
    ("ISO15745Profile", FileKind::Xdd),
    ("html", FileKind::Html),
];

/// First characters of a line, each with the kind of file. They are searched in this order.
const LINES: [(&str, FileKind); 12] = [
    ("BO_ ", FileKind::Dbc),
    ("BU_:", FileKind::Dbc),
    ("BU_ :", FileKind::Dbc),
    ("NS_ :", FileKind::Dbc),
    ("NS_:", FileKind::Dbc),
    ("FormatVersion=", FileKind::Sym),
    ("LIN_description_file", FileKind::Ldf),
    ("ASAP2_VERSION", FileKind::A2l),
    ("/begin PROJECT", FileKind::A2l),
    ("$MeshFormat", FileKind::Mesh),
    ("*HEADING", FileKind::Mesh),
    ("*NODE", FileKind::Mesh),
];

/// Section headers by which an EDS or DCF file is recognised.
const EDS: [&str; 3] = ["[FileInfo]", "[DeviceInfo]", "[MandatoryObjects]"];

/// Decodes a text in UTF-8, in UTF-16 with a byte order mark, or in a single-byte code page. `None` if the bytes are
/// not text.
pub(super) fn decoded(bytes: &[u8]) -> Option<Cow<'_, str>> {
    if let Some(wide) = wide(bytes) {
        return Some(Cow::Owned(wide));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    (!bytes.contains(&0)).then(|| String::from_utf8_lossy(bytes))
}

/// Decodes a text in UTF-16 with a byte order mark. `None` if the bytes do not begin with a byte order mark.
pub(super) fn wide(bytes: &[u8]) -> Option<String> {
    let unit: fn([u8; 2]) -> u16 = match bytes {
        [0xff, 0xfe, ..] => u16::from_le_bytes,
        [0xfe, 0xff, ..] => u16::from_be_bytes,
        _ => return None,
    };
    let units: Vec<u16> = bytes[2..].chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
    Some(String::from_utf16_lossy(&units))
}

/// Returns whether an XML document has an element whose name begins with `name`. The name may have a namespace prefix,
/// as in `AR:AUTOSAR`.
fn has_element(document: &str, name: &str) -> bool {
    let tags = document.split('<').skip(1).map(|tag| tag.split([' ', '\t', '\r', '\n', '>', '/']));
    tags.filter_map(|mut words| words.next()?.rsplit(':').next()).any(|element| element.starts_with(name))
}

/// Returns whether a line is a keyword line of a finite element input file, such as `*STEP`.
fn is_card(line: &str) -> bool {
    line.strip_prefix('*').is_some_and(|rest| rest.starts_with(|first: char| first.is_ascii_alphabetic()))
}

/// Returns the kind of a text file by its typical lines or XML elements. `None` if the kind is unknown.
pub(super) fn of_marks(text: &str) -> Option<FileKind> {
    let begin = text.trim_start();
    if begin.starts_with('<') {
        let is_page = begin.get(..14).is_some_and(|begin| begin.eq_ignore_ascii_case("<!doctype html"));
        let found = XML.iter().find(|(element, _)| has_element(begin, element)).map(|(_, kind)| *kind);
        return Some(if is_page { FileKind::Html } else { found.unwrap_or(FileKind::Xml) });
    }
    if begin.starts_with('{') {
        return Some(FileKind::Json);
    }
    let lines = || text.lines().map(str::trim);
    // A load case without its mesh has rows of numbers, as a log has.
    let first = lines().find(|line| !line.is_empty() && !line.starts_with("**"));
    if first.is_some_and(is_card) {
        return Some(FileKind::Mesh);
    }
    // Some loggers write such a section above the table.
    let is_section = |line: &str| EDS.iter().any(|section| line.eq_ignore_ascii_case(section));
    if lines().any(is_section) && table::of(text).is_none() {
        return Some(FileKind::Eds);
    }
    let begins = |line: &str, with: &str| {
        line.get(..with.len()).is_some_and(|begin| match with.starts_with('*') {
            true => begin.eq_ignore_ascii_case(with),
            false => begin == with,
        })
    };
    let is_first = |line: &str| LINES.iter().find(|(with, _)| begins(line, with)).map(|(_, kind)| *kind);
    lines().find_map(is_first)
}
