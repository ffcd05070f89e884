//! Retention of the logs of a machine: how long they are stored, and their maximum total size.
//!
//! A wrong clock must not delete logs. The age of a log is the difference between its day and the day of the newest
//! log. The age is used only if the computer's day is the day of the newest log, or the next day. Logs from before a
//! large correction of the clock have no age. They are deleted, oldest first, only if the total size is too large.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use jiff::civil::Date;

use crate::clock::Correction;
use crate::gateway::store::log::outputs::ENDING;
use isotherm_core::compensation::Stop;
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::duration_text;
use isotherm_profile::log_columns::CLOCK;
use isotherm_profile::{History, safe_file};

/// Limit for setting the clock back. If the clock was set back by a longer time, the age of earlier logs is
/// not known.
const A_DAY: Duration = Duration::from_hours(24);

/// Maximum size of the header and first row of a log, in bytes. The first row contains the saved state of a machine.
const FIRST_ROW: u64 = 4 * 1024 * 1024;

/// Log file of one day.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::gateway) struct DayLog {
    pub(in crate::gateway) day: Date,
    pub(in crate::gateway) name: String,
    size: u64,
}

/// Log files that must be deleted, by the reason for the deletion.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct ExpiredLogs {
    too_old: Vec<String>,
    too_large: Vec<String>,
}

impl DayLog {
    fn is_of_decisions(&self) -> bool {
        self.name.ends_with(".csv") && !self.name.ends_with(ENDING)
    }
}

/// Returns the date of a time stamp, in UTC.
pub(super) fn day(stamp: Moment) -> Date {
    let stamp = jiff::Timestamp::from_nanosecond(i128::from(stamp.as_nanos())).unwrap_or_default();
    stamp.to_zoned(jiff::tz::TimeZone::UTC).date()
}

/// Returns whether the clock was set so far that the age of earlier logs is not known.
fn breaks_the_days(correction: &Correction) -> bool {
    correction.from.since(correction.to) > A_DAY || correction.to.since(correction.from) > Stop::LONGEST
}

/// Returns the logs of this machine of all kinds, oldest first.
pub(in crate::gateway) fn logs(directory: &Path, machine: &str) -> Vec<DayLog> {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    let mut logs: Vec<DayLog> = entries
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let rest = name.strip_prefix(machine)?.strip_prefix('-')?;
            let (day, ending) = rest.split_at_checked(10)?;
            let is_log = ending.starts_with('.') && (ending.ends_with(".csv") || ending.ends_with(".jsonl"));
            let day = day.parse().ok().filter(|_| is_log)?;
            let size = entry.metadata().ok().filter(std::fs::Metadata::is_file)?.len();
            Some(DayLog { day, name, size })
        })
        .collect();
    logs.sort();
    logs
}

/// Returns the decision logs of the days from `from` to `to`.
pub(in crate::gateway) fn of_decisions(
    directory: &Path,
    machine: &str,
    from: Moment,
    to: Moment,
) -> Vec<PathBuf> {
    let days = day(from)..=day(to);
    let logs = logs(directory, machine).into_iter();
    logs.filter(|log| log.is_of_decisions() && days.contains(&log.day))
        .map(|log| directory.join(log.name))
        .collect()
}

/// Returns the decision logs of the newest day for which a decision log exists. Logs from before a large correction
/// of the clock are ignored.
pub(super) fn newest_of_decisions(directory: &Path, machine: &str, now: Moment) -> Vec<PathBuf> {
    let logs = logs(directory, machine);
    let set = breaks(directory, &logs);
    let found = of_these_days(&logs, day(now), &set).filter(|log| log.is_of_decisions());
    let newest = found.clone().map(|log| log.day).max();
    found.filter(|log| Some(log.day) == newest).map(|log| directory.join(&log.name)).collect()
}

/// Returns the logs of this machine that must be deleted, in groups with the same reason. `today` is the present date
/// of the computer's clock.
pub(super) fn expired(
    directory: &Path,
    machine: &str,
    history: &History,
    today: Date,
) -> [(Vec<String>, String); 2] {
    let logs = logs(directory, machine);
    let found = superfluous(&logs, history, today, &breaks(directory, &logs));
    [
        (found.too_old, format!("older than {}", duration_text(history.keep))),
        (found.too_large, format!("all logs together are larger than {} MB", history.max_size / 1_000_000)),
    ]
}

/// Returns the large corrections of the clock. They are in the first rows of the logs.
fn breaks(directory: &Path, logs: &[DayLog]) -> Vec<Correction> {
    let found = logs.iter().filter(|log| log.is_of_decisions()).filter_map(|log| {
        let begins = safe_file::open(&directory.join(&log.name)).ok()?.take(FIRST_ROW);
        let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(begins);
        let place = reader.headers().ok()?.iter().position(|name| name == CLOCK)?;
        let row = reader.records().next()?.ok()?;
        let (from, to) = row.get(place)?.split_once(" → ")?;
        Some(Correction { from: time::parse(from).ok()?, to: time::parse(to).ok()? })
    });
    found.filter(breaks_the_days).collect()
}

/// Returns the logs since the last large correction of the clock. Without such a correction, these are all logs.
fn of_these_days<'a>(
    logs: &'a [DayLog],
    today: Date,
    set: &[Correction],
) -> impl Iterator<Item = &'a DayLog> + Clone + use<'a> {
    let set: Vec<(Date, Date)> = set.iter().map(|set| (day(set.from), day(set.to))).collect();
    logs.iter().filter(move |log| {
        // A correction to a day in the future was taken back.
        set.iter().filter(|(_, to)| *to <= today).all(|(from, to)| {
            let is_from_before = from > to && log.day > today && log.day <= *from;
            log.day >= *to && !is_from_before
        })
    })
}

/// Returns the logs that must be deleted. `today` is the present date of the computer's clock, and `set` contains the
/// large corrections of the clock.
fn superfluous(logs: &[DayLog], history: &History, today: Date, set: &[Correction]) -> ExpiredLogs {
    let mut found = ExpiredLogs::default();
    let of_these_days = of_these_days(logs, today, set);
    let newest = of_these_days.clone().map(|log| log.day).filter(|day| *day != today).max();
    let is_accepted =
        newest.is_some_and(|newest| newest <= today && newest.tomorrow().is_ok_and(|next| today <= next));
    let days = i32::try_from(history.keep.as_secs() / A_DAY.as_secs()).unwrap_or(i32::MAX);
    let oldest = today.checked_sub(jiff::Span::new().try_days(days).unwrap_or_default());
    if let Some(oldest) = oldest.ok().filter(|_| is_accepted) {
        found.too_old = of_these_days.filter(|log| log.day < oldest).map(|log| log.name.clone()).collect();
    }
    let mut size: u64 =
        logs.iter().filter(|log| !found.too_old.contains(&log.name)).map(|log| log.size).sum();
    for log in logs.iter().filter(|log| log.day != today && !found.too_old.contains(&log.name)) {
        if size <= history.max_size {
            break;
        }
        size -= log.size;
        found.too_large.push(log.name.clone());
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const GIGABYTE: u64 = 1_000_000_000;

    fn stamp(text: &str) -> Moment {
        isotherm_core::quantity::time::parse(&format!("{text}T12:00:00Z")).unwrap()
    }

    fn log(day: &str) -> DayLog {
        DayLog { day: day.parse().unwrap(), name: format!("m-{day}.csv"), size: GIGABYTE }
    }

    fn gone(days: &[&str], today: &str, set: Option<(&str, &str)>, size: u64) -> ExpiredLogs {
        let mut logs: Vec<DayLog> = days.iter().map(|day| log(day)).collect();
        logs.sort();
        let history = History { keep: 10 * A_DAY, max_size: size, ..History::default() };
        let set = set.map(|(from, to)| Correction { from: stamp(from), to: stamp(to) });
        superfluous(&logs, &history, today.parse().unwrap(), set.as_slice())
    }

    #[test]
    fn a_log_goes_by_the_newest_logs_date_and_never_by_a_clock_that_is_elsewhere() {
        const OLD: &str = "2026-03-01";
        for (newest, today, goes) in [
            ("2026-03-14", "2026-03-14", true),
            ("2026-03-14", "2026-03-15", true),
            ("2026-03-14", "2026-03-16", false),
            ("2026-03-14", "2035-03-14", false),
            ("2026-03-14", "2026-03-13", false),
            ("2026-03-14", "1970-01-01", false),
            ("2026-03-11", "2026-03-11", false),
        ] {
            // On the day of the newest log, the log before it decides.
            let days = [OLD, "2026-03-13", newest, today];
            let days: Vec<&str> =
                if newest == "2026-03-11" { vec![OLD, "2026-03-10", newest] } else { days.to_vec() };
            let found = gone(&days, today, None, u64::MAX).too_old;
            assert_eq!(
                found,
                if goes { vec![format!("m-{OLD}.csv")] } else { Vec::new() },
                "{newest} {today}"
            );
        }
    }

    #[test]
    fn two_days_with_a_clock_nine_years_ahead_delete_nothing_and_neither_does_the_way_back() {
        let ahead = Some(("2026-03-14", "2035-03-14"));
        let days = ["2026-02-01", "2026-03-14", "2035-03-14", "2035-03-15"];
        assert_eq!(gone(&days, "2035-03-15", ahead, u64::MAX), ExpiredLogs::default());
        let back = Some(("2035-03-15", "2026-03-16"));
        let days = ["2026-02-01", "2026-03-14", "2026-03-16", "2026-03-17", "2035-03-14", "2035-03-15"];
        assert_eq!(gone(&days, "2026-03-17", back, u64::MAX), ExpiredLogs::default());
    }

    #[test]
    fn logs_of_1970_stay_once_the_clock_is_right() {
        let right = Some(("1970-01-01", "2026-03-14"));
        for today in ["2026-03-14", "2026-03-15"] {
            let days = ["1970-01-01", "2026-03-14", today];
            assert_eq!(gone(&days, today, right, u64::MAX), ExpiredLogs::default());
        }
    }

    #[test]
    fn after_the_clock_was_set_the_days_count_again() {
        let set = Some(("1970-01-01", "2026-03-01"));
        let days = ["1970-01-01", "2026-03-01", "2026-03-13", "2026-03-14"];
        assert_eq!(gone(&days, "2026-03-14", set, u64::MAX).too_old, ["m-2026-03-01.csv"]);
    }

    #[test]
    fn what_needs_too_much_room_goes_the_oldest_first_and_never_todays() {
        let days = ["1970-01-01", "2026-03-11", "2026-03-12", "2026-03-14"];
        let found = gone(&days, "2026-03-14", None, 2 * GIGABYTE);
        assert_eq!(found.too_large, ["m-1970-01-01.csv", "m-2026-03-11.csv"]);
        assert_eq!(gone(&["2026-03-14"], "2026-03-14", None, 1), ExpiredLogs::default());
    }

    #[test]
    fn only_logs_of_the_machine_are_looked_at() {
        let directory = tempfile::tempdir().unwrap();
        let names = ["m-2026-03-14.csv", "m-2026-03-14.2.outputs.csv", "m-2026-03-14.events.jsonl"];
        let others = [
            "m-2-2026-03-14.csv",
            "m-2026-03-14.csv.bak",
            "m-2026-13-14.csv",
            "m-20é6-03-14.csv",
            "m.state.json",
        ];
        for name in names.iter().chain(&others) {
            std::fs::write(directory.path().join(name), "four").unwrap();
        }
        std::fs::create_dir(directory.path().join("m-2026-03-15.csv")).unwrap();
        let found: Vec<String> = logs(directory.path(), "m").into_iter().map(|log| log.name).collect();
        assert_eq!(found, ["m-2026-03-14.2.outputs.csv", "m-2026-03-14.csv", "m-2026-03-14.events.jsonl"]);
    }
}
