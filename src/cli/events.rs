//! `isotherm events`: shows events from the state directory. The gateway need not run.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::hints::{Hints, cause};
use super::loading::load_with;
use super::run::known_directory;
use super::running;
use super::values::key_and_value;
use crate::cli::print::{Out, say_beside};
use crate::clock::Clock;
use crate::observe::events::Entry;
use crate::observe::events::file::{self, FileItem, begin};
use isotherm_profile::one_line;

/// Indentation of a hint below its event, in characters: the width of the columns with time and level.
const UNDER: usize = 30;

/// Shows the events that are stored in the state directory, oldest first. The gateway need not run. Times are UTC.
///
/// Lines of the event log that were changed, cut or removed are reported on stderr.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm events my-machine.toml --since 12h\n  isotherm events --since 2026-01-31T18:00:00Z \
                  --state /var/lib/isotherm --json"
)]
pub(super) struct Arguments {
    /// The machine's profile, or the name of a shipped one [default: the only machine in the state directory]
    #[arg(value_name = "PROFILE")]
    profile: Option<PathBuf>,
    /// Overrides one key, may be repeated: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value, requires = "profile")]
    set: Vec<(String, String)>,
    /// First time to show: a time span before now, such as 12h, or a time in RFC 3339
    #[arg(long, value_name = "SPAN", default_value = "12h")]
    since: String,
    /// The state directory with which the gateway was started
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Prints each event as one JSON document on a line
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let since = begin(&arguments.since, Clock::wall().time_of_day()).map_err(anyhow::Error::msg)?;
    let (directory, machine) = match &arguments.profile {
        Some(path) => {
            let profile = load_with(path, &arguments.set, false)?;
            (running::directory(arguments.state.as_deref(), &profile)?, profile.name)
        }
        None => {
            let directory = known_directory(arguments.state.as_deref());
            let machine = only_machine(&directory)?;
            (directory, machine)
        }
    };
    let (mut out, mut written, mut count) = (Out, Ok(()), 0_u64);
    let mut hints = Hints::default();
    file::since(&directory, &machine, since, |found| {
        match found {
            FileItem::Damage(what) => say_beside!("warning: {what}"),
            FileItem::Event(entry) => {
                count += 1;
                let text = if arguments.json { json(&entry) + "\n" } else { lines(&entry, &mut hints) };
                written = out.write_all(text.as_bytes());
            }
        }
        written.is_ok()
    })
    .map_err(|error| anyhow::anyhow!("the events in {} cannot be read: {error}", directory.display()))?;
    written?;
    if count == 0 && !arguments.json {
        say_beside!("no event of {machine} since {since} is recorded in {}", directory.display());
    }
    Ok(())
}

/// Returns the name of the only machine with events in this directory. Returns an error if the directory contains
/// events of no machine or of several machines.
fn only_machine(directory: &Path) -> anyhow::Result<String> {
    let shown = directory.display();
    let machines = file::machines(directory).map_err(|error| {
        anyhow::anyhow!(
            "{shown} cannot be read ({error}); give the state directory with --state, or a profile"
        )
    })?;
    match machines.as_slice() {
        [] => anyhow::bail!(
            "there are no events in {shown}; give the state directory with --state, or a profile"
        ),
        [one] => Ok(one.clone()),
        several => anyhow::bail!(
            "there are events of several machines in {shown}: {}; give the profile of one machine",
            several.join(", ")
        ),
    }
}

fn json(entry: &Entry) -> String {
    // Numbers and texts always have a JSON form.
    serde_json::to_string(entry).unwrap_or_default()
}

/// Returns the line of an event. If the hint of the event was not printed yet, it follows on the next line.
fn lines(entry: &Entry, hints: &mut Hints) -> String {
    let level = format!("{:?}", entry.level).to_lowercase();
    let at = entry.at.get(..19).unwrap_or(&entry.at).replace('T', " ");
    let hint = entry.data["hint"].as_str();
    let line = format!("{at}  {level:<7}  {}\n", one_line(cause(&entry.text, hint)));
    line + &hints.line(UNDER, hint.map(one_line).as_deref())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observe::events::Level;
    use serde_json::json;

    #[test]
    fn the_hint_of_events_is_printed_once() {
        let entry = |minute: u32| Entry {
            at: format!("2026-01-05T12:{minute:02}:00Z"),
            kind: "device-lost".into(),
            level: Level::Warning,
            text: "device module: refused: is the port right?".to_owned(),
            data: json!({ "hint": "is the port right?" }),
        };
        let mut hints = Hints::default();
        let text: String = (0..3).map(|minute| lines(&entry(minute), &mut hints)).collect();
        assert_eq!(text.lines().count(), 4, "{text}");
        let begin = "2026-01-05 12:00:00  warning  device module: refused\n                              to do: is the port right?\n";
        assert!(text.starts_with(begin), "{text}");
    }
}
