//! Events of one day as a table with the columns `time`, `machine`, `kind`, `level`, `text`, and `data` as JSON.

use std::fs::File;
use std::path::Path;

use anyhow::Context;

use super::table::{Kind, Table};
use crate::observe::events::file::{self, FileItem};
use isotherm_core::quantity::time;

const COLUMNS: [(&str, Kind); 6] = [
    ("time", Kind::Moment),
    ("machine", Kind::Text),
    ("kind", Kind::Text),
    ("level", Kind::Text),
    ("text", Kind::Text),
    ("data", Kind::Text),
];

/// Writes the events as a Parquet file. Returns warnings about damaged lines of the event log.
pub(super) fn write(machine: &str, log: &Path, to: &mut File) -> anyhow::Result<Vec<String>> {
    let mut table = Table::new(to, &COLUMNS.map(|(name, kind)| (name.to_owned(), kind)))?;
    let (mut warnings, mut written) = (Vec::new(), Ok(()));
    file::read(log, |found| match found {
        FileItem::Damage(what) => warnings.push(what),
        FileItem::Event(entry) => {
            let Ok(at) = time::parse(&entry.at) else {
                warnings.push(format!("{}: an event has no valid time, and is left out", log.display()));
                return;
            };
            let data = (!entry.data.is_null()).then(|| entry.data.to_string());
            table.moment(0, at);
            let texts = [
                Some(machine),
                Some(&*entry.kind),
                Some(entry.level.name()),
                Some(&*entry.text),
                data.as_deref(),
            ];
            texts.into_iter().enumerate().for_each(|(place, text)| table.text(place + 1, text));
            if written.is_ok() {
                written = table.end_row();
            }
        }
    })
    .with_context(|| format!("{} cannot be read", log.display()))?;
    written?;
    table.finish()?;
    Ok(warnings)
}
