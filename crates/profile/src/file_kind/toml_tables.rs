//! Kinds of TOML files of this project, recognised by the names of their tables. The file need not be valid TOML.

use std::collections::BTreeSet;

use super::kind::FileKind;

/// Names of the keys and tables at the top level of a TOML file.
#[derive(Default)]
struct Names<'t> {
    /// Keys above the first table header. Only keys whose value is a quoted text, a list or a table are included,
    /// because loggers write lines such as `machine=VMC 1`.
    keys: BTreeSet<&'t str>,
    /// First key in the header of each table.
    tables: BTreeSet<&'t str>,
    /// Whether the file has a list of models of an axis: `[[axis.z.model]]`.
    has_model: bool,
}

/// Returns the kind of a TOML file by the names of its tables and first keys.
pub(super) fn of(text: &str) -> Option<FileKind> {
    let names = Names::of(text);
    let has = |name: &str| names.keys.contains(name) || names.tables.contains(name);
    let has_table = |name: &str| names.tables.contains(name);
    if has("machine") || has_table("bus") {
        return Some(FileKind::Profile);
    }
    if has("soak") && has("ambient") || has_table("duty") && has_table("node") {
        return Some(FileKind::Plant);
    }
    if ["channel", "target", "variant"].into_iter().any(has_table) || has("title") && has("source") {
        return Some(FileKind::Template);
    }
    if has_table("fault") {
        return Some(FileKind::FaultScript);
    }
    let is_block = names.has_model && names.keys.is_empty() && names.tables.iter().eq(["axis"].iter());
    is_block.then_some(FileKind::ModelBlock)
}

impl<'t> Names<'t> {
    fn of(text: &'t str) -> Names<'t> {
        let mut names = Names::default();
        for line in text.lines().map(str::trim) {
            if let Some(header) = line.strip_prefix('[') {
                let header = header.trim_start_matches('[');
                let inner = header.split(']').next().unwrap_or_default();
                let mut parts = inner.split('.').map(plain);
                // A row of a list of numbers, such as `[1.0, 2.0],`, is no header.
                if let Some(Some(first)) = parts.next()
                    && !first.starts_with(|one: char| one.is_ascii_digit())
                {
                    names.tables.insert(first);
                    names.has_model |= first == "axis" && parts.nth(1) == Some(Some("model"));
                }
            } else if names.tables.is_empty()
                && let Some((key, value)) = line.split_once('=')
                && value.trim_start().starts_with(['"', '\'', '{', '['])
                && let Some(key) = key.split('.').next().and_then(plain)
            {
                names.keys.insert(key);
            }
        }
        names
    }
}

/// Returns a bare or quoted key without blanks and quotation marks. `None` if the text is not such a key.
fn plain(name: &str) -> Option<&str> {
    let name = name.trim().trim_matches('"');
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-');
    (!name.is_empty() && name.bytes().all(is_plain)).then_some(name)
}
