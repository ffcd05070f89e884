//! `isotherm export`: logs and events of a gateway as Parquet files.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context;
use jiff::Timestamp;
use serde::Serialize;

use super::loading::load_quietly;
use super::print::print_json;
use super::running;
use super::values::key_and_value;
use crate::cli::print::{say, say_beside};
use crate::fieldbus::explain::system;
use crate::gateway::{log, make_directory};
use crate::observe::events::file;
use isotherm_profile::counted;

mod columns;
mod decisions;
mod events;
mod exported;
mod table;

use columns::{Column, Columns};

/// Writes the logs of decisions and the events as Parquet, one file for each day. The files are
/// DIR/decisions/NAME-2026-01-31.parquet and DIR/events/…. Each row has the machine's name. Times and days are UTC.
///
/// A day that has not changed since the last export is skipped. The verb may therefore run every night, for many
/// machines with one directory. It never deletes an exported day, even if the gateway has deleted the day's logs
/// ([history] keep). The gateway may run during the export.
///
/// Each exported file has the columns of all days. After a change of the profile, earlier days are exported again with
/// the new columns, which are empty there.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm export my-machine.toml --parquet fleet\n  isotherm export my-machine.toml --parquet /mnt/fleet \
                  --state /var/lib/isotherm"
)]
pub(super) struct Arguments {
    /// The machine's profile, or the name of a shipped one
    #[arg(value_name = "PROFILE")]
    profile: PathBuf,
    /// Overrides one key, may be repeated: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    set: Vec<(String, String)>,
    /// The directory to write to; it is created if it does not exist
    #[arg(long, value_name = "DIR")]
    parquet: PathBuf,
    /// The state directory with which the gateway was started
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

/// One day of a machine, with its logs and its exported file.
struct Day {
    /// Path of the exported file of this day.
    file: PathBuf,
    /// Columns of the exported file; `None` if the day was not exported yet.
    found: Option<anyhow::Result<Vec<Column>>>,
    /// Logs of the day that the gateway has not deleted.
    logs: Vec<PathBuf>,
}

/// Number of exported days, by result. Days of logs and days of events are counted separately.
#[derive(Debug, Default, Serialize)]
struct Days {
    written: u64,
    unchanged: u64,
    /// Days that could not be written. Their errors have been printed.
    failed: u64,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let profile = load_quietly(&arguments.profile, &arguments.set, false)?.profile;
    let (directory, machine) = (running::directory(arguments.state.as_deref(), &profile)?, &profile.name);
    let none = || {
        format!(
            "there are no logs of {machine} in {}. If the gateway ran with another state directory, give that \
             directory with --state, or as `directory` in [history] of the profile",
            directory.display()
        )
    };
    let days = file::days(&directory, machine).map_err(|error| match error.kind() {
        ErrorKind::NotFound => anyhow::anyhow!("{}", none()),
        _ => anyhow::anyhow!("{} cannot be read: {}", directory.display(), system(&error)),
    })?;
    let place = |kind: &str| {
        let place = arguments.parquet.join(kind);
        make_directory(&place).with_context(|| format!("{} cannot be created", place.display()))?;
        anyhow::Ok(place)
    };
    let decided = decided(&directory, machine, &place("decisions")?)?;
    let mut happened = Days::default();
    let to = place("events")?;
    for day in days {
        let log = file::path(&directory, machine, &day);
        let name = to.join(format!("{machine}-{day}.parquet"));
        happened.take(std::slice::from_ref(&log), &name, |to| events::write(machine, &log, to))?;
    }
    let failed = decided.failed + happened.failed;
    if decided.all() + happened.all() == 0 {
        say_beside!("{}", none());
    }
    if arguments.json {
        print_json(&serde_json::json!({ "machine": machine, "decisions": decided, "events": happened }))?;
    } else {
        let (to, decided, happened) = (arguments.parquet.display(), decided.text(), happened.text());
        say!("{to}: decisions of {decided}; events of {happened}")?;
    }
    anyhow::ensure!(failed == 0, "days that were not written: {failed}; their errors are printed above");
    Ok(())
}

/// Exports the logs of decisions from the state directory `directory` to the directory `to`. Returns the
/// numbers of written, unchanged and failed days.
fn decided(directory: &Path, machine: &str, to: &Path) -> anyhow::Result<Days> {
    let days = all_days(directory, machine, to)?;
    let mut columns = Columns::new();
    for Day { found, logs, .. } in days.values() {
        for (name, kind) in found.iter().flatten().flatten() {
            columns.add_exported(name, *kind);
        }
        // If a log cannot be read, the export of its day fails, and prints the reason.
        for (name, kind) in logs.iter().filter_map(|log| decisions::columns(log).ok()).flatten() {
            columns.add(&name, kind);
        }
    }
    let mut counted = Days::default();
    for Day { file, found, logs } in days.values() {
        let newest = newest(logs);
        let from_logs = |to: &mut std::fs::File| decisions::write(machine, logs, &columns, to);
        match (newest, found) {
            (Some(newest), _) if modified(file) != Some(newest) => counted.write(file, newest, from_logs)?,
            (Some(_), Some(Ok(found))) if found == columns.all() => counted.unchanged += 1,
            (None, Some(Ok(found))) if found == columns.all() => {}
            // Rows may be missing in the logs that are still there. The exported file has all of them.
            (_, Some(Ok(_))) => {
                let Some(time) = modified(file) else { continue };
                let widen =
                    |to: &mut std::fs::File| exported::widen(file, columns.all(), to).map(|()| Vec::new());
                counted.write(file, time, widen)?;
            }
            (Some(newest), Some(Err(_))) => counted.write(file, newest, from_logs)?,
            (None, Some(Err(why))) => {
                say_beside!("{why:#}");
                counted.failed += 1;
            }
            // The log was deleted a moment ago.
            (_, None) => {}
        }
    }
    Ok(counted)
}

/// Returns all days of a machine that were exported or still have logs, by date.
fn all_days(directory: &Path, machine: &str, to: &Path) -> anyhow::Result<BTreeMap<String, Day>> {
    let exported = exported::days(to, machine).with_context(|| format!("{} cannot be read", to.display()))?;
    let day = |(day, file): (String, PathBuf)| {
        let found = Some(exported::columns(&file));
        (day, Day { file, found, logs: Vec::new() })
    };
    let mut days: BTreeMap<String, Day> = exported.into_iter().map(day).collect();
    for (day, logs) in log::days(directory, machine) {
        let file = to.join(format!("{machine}-{day}.parquet"));
        days.entry(day).or_insert(Day { file, found: None, logs: Vec::new() }).logs = logs;
    }
    Ok(days)
}

/// Returns the time at which the newest of these logs was last changed. `None` if none of them exists.
fn newest(logs: &[PathBuf]) -> Option<i64> {
    logs.iter().filter_map(|log| modified(log)).max()
}

/// Returns the time at which a file was last changed, in microseconds. A file server may store this time less
/// exactly than the disk of the logs. `None` if the time cannot be read.
fn modified(path: &Path) -> Option<i64> {
    let modified = path.metadata().and_then(|about| about.modified()).ok()?;
    Timestamp::try_from(modified).ok().map(Timestamp::as_microsecond)
}

impl Days {
    /// Writes the exported file of a day if the logs of the day have changed since the last export.
    fn take(
        &mut self,
        logs: &[PathBuf],
        to: &Path,
        write: impl FnOnce(&mut std::fs::File) -> anyhow::Result<Vec<String>>,
    ) -> anyhow::Result<()> {
        match newest(logs) {
            Some(newest) if modified(to) == Some(newest) => {
                self.unchanged += 1;
                Ok(())
            }
            Some(newest) => self.write(to, newest, write),
            // The log was deleted a moment ago.
            None => Ok(()),
        }
    }

    /// Writes the exported file of a day, and sets its modification time to that of the newest log. If rows are logged
    /// during the export, the next export therefore writes the day again. An error in one day is printed, and the other
    /// days are exported.
    fn write(
        &mut self,
        to: &Path,
        newest: i64,
        write: impl FnOnce(&mut std::fs::File) -> anyhow::Result<Vec<String>>,
    ) -> anyhow::Result<()> {
        let part = to.with_extension("parquet.part");
        let shown = || format!("{} cannot be written", part.display());
        // The file may remain from an export that was killed, or may be a link that another user made.
        let _ = std::fs::remove_file(&part);
        let mut file = std::fs::File::create_new(&part).with_context(shown)?;
        let warnings = match write(&mut file) {
            Ok(warnings) => warnings,
            Err(why) => {
                let _ = std::fs::remove_file(&part);
                say_beside!("{}: {why:#}", to.display());
                self.failed += 1;
                return Ok(());
            }
        };
        let newest = Timestamp::from_microsecond(newest)?.into();
        file.set_modified(newest).and_then(|()| file.sync_all()).with_context(shown)?;
        std::fs::rename(&part, to).with_context(|| format!("{} cannot be written", to.display()))?;
        warnings.iter().for_each(|warning| say_beside!("warning: {warning}"));
        self.written += 1;
        Ok(())
    }

    fn all(&self) -> u64 {
        self.written + self.unchanged + self.failed
    }

    fn text(&self) -> String {
        format!("{} written, {} unchanged", counted(self.written, "day"), self.unchanged)
    }
}
