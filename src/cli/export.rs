//! `isotherm export`: logs and events of a gateway as Parquet files.

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

mod decisions;
mod events;
mod table;

/// Writes the logs of decisions and the events as Parquet, one file for each day. The files are
/// DIR/decisions/NAME-2026-01-31.parquet and DIR/events/…. Each row has the machine's name. Times and days are UTC.
///
/// A day that has not changed since the last export is skipped. The verb may therefore run every night, for many
/// machines with one directory. It never deletes an exported day, even if the gateway has deleted the day's logs
/// ([history] keep). The gateway may run during the export.
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

/// Number of days of logs or of events, by the result of their export.
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
            "there are no logs of {machine} in {}. If the gateway ran with another state directory, name it \
             with --state, or as `directory` in [history] of the profile",
            directory.display()
        )
    };
    let days = file::days(&directory, machine).map_err(|error| match error.kind() {
        ErrorKind::NotFound => anyhow::anyhow!("{}", none()),
        _ => anyhow::anyhow!("{} cannot be read: {}", directory.display(), system(&error)),
    })?;
    let place = |kind: &str| {
        let place = arguments.parquet.join(kind);
        make_directory(&place).with_context(|| format!("{} cannot be made", place.display()))?;
        anyhow::Ok(place)
    };
    let (mut decided, mut happened) = (Days::default(), Days::default());
    let to = place("decisions")?;
    for (day, logs) in log::days(&directory, machine) {
        decided.take(&logs, &to.join(format!("{machine}-{day}.parquet")), |to| {
            decisions::write(machine, &logs, to)
        })?;
    }
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

impl Days {
    /// Writes a day if its logs have changed since the last export. The file gets the modification time of the newest
    /// log. If rows are logged during the export, the day is therefore exported again next time. An error in one day is
    /// printed, and does not stop the export of the others.
    fn take(
        &mut self,
        logs: &[PathBuf],
        to: &Path,
        write: impl FnOnce(&mut std::fs::File) -> anyhow::Result<Vec<String>>,
    ) -> anyhow::Result<()> {
        // Times are compared in microseconds, because a file server may store them less exactly than the disk of the
        // logs.
        let changed = |path: &Path| {
            let modified = path.metadata().and_then(|about| about.modified()).ok()?;
            Timestamp::try_from(modified).ok().map(Timestamp::as_microsecond)
        };
        let newest = logs.iter().filter_map(|log| changed(log)).max();
        // The log was deleted a moment ago.
        let Some(newest) = newest else { return Ok(()) };
        if changed(to) == Some(newest) {
            self.unchanged += 1;
            return Ok(());
        }
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
