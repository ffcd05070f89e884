//! `isotherm learn`: learns a candidate for the model of an axis from the probe measurements (touches) in a gateway's
//! logs.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context;
use rustix::process::{Resource, Rlimit, Signal, nice, set_parent_process_death_signal, setrlimit};

use super::loading::load_quietly;
use super::logs::LogFormat;
use super::print::print_json;
use super::progress::Progress;
use super::running;
use super::values::key_and_value;
use crate::clock::Clock;
use crate::gateway::{Disk, Files, candidates, log, make_directory, preferences_in};
use isotherm_core::compensation::settings::AxisSettings;
use isotherm_core::quantity::{Moment, time};
use isotherm_identify::applied::Applied;
use isotherm_identify::dataset::{Dataset, Split};
use isotherm_identify::learning::{InUse, Learning, TakenRun, choice};
use isotherm_identify::setup::{Choice, units};
use isotherm_identify::uses;
use isotherm_profile::{Profile, counted, safe_file};

mod result;
mod text;

use result::{AxisResult, GainShown};

/// Number of days whose logs are read together. These days cover the longest run with touches, and the hours before the
/// datum of the run (zero point of Cz).
const TOGETHER: usize = 3;
/// Remark if the logs that the command line names give nothing new.
const NOTHING_NEW: &str = "the named logs have no new run. Each of their runs was used before, is \
                           older than the last used run, or has no measured error";
/// Largest size of a file of learned data, in bytes.
const LARGEST: u64 = 16 * 1024 * 1024;

/// Learns the model of each axis with a probe from its touches, run by run. A touch is the result of one probing.
///
/// The touches are in the logs of the state directory. The intermediate results of each run (products) are stored in
/// NAME.products in the state directory. They remain when the gateway deletes the logs ([history] keep). Therefore the
/// verb reads only new logs, and may run every night. The gateway may run at the same time.
///
/// The touches of each day first test the model in use, and the candidate from the previous days. Then the
/// candidate is learned again with this day. The candidate is proposed if its residual error over the last
/// five tested days is smaller than that of the model in use. No axis moves, and the profile does not change.
/// `isotherm adopt` adopts the candidate of an axis that learns (`learn` in its probe). `--write` writes the
/// candidate as a block for the profile.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm learn my-machine.toml\n  isotherm learn my-machine.toml campaign/ --axis z\n  isotherm learn my-machine.toml --axis z --write z-model.toml"
)]
pub(super) struct Arguments {
    /// The machine's profile, or the name of a shipped one
    #[arg(value_name = "PROFILE")]
    profile: PathBuf,
    /// Logs of the commissioning with a measured error in each row, in addition to those of the state directory. Give
    /// each log only once: its results are stored
    #[arg(value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Overrides one key, may be repeated: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    set: Vec<(String, String)>,
    /// The axis [default: every axis with a probe]
    #[arg(long, value_name = "NAME")]
    axis: Option<String>,
    /// Signals that the candidate must not use. Use the same list for all runs
    #[arg(long, value_name = "SIGNAL", value_delimiter = ',')]
    without: Vec<String>,
    /// The state directory with which the gateway was started
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    #[command(flatten)]
    format: LogFormat,
    /// Writes the candidate as an [[axis.…model]] block to this file, if it is better than the model in use
    #[arg(long, value_name = "MODEL.toml", requires = "axis")]
    write: Option<PathBuf>,
    /// Also writes a candidate that is not better, or was not compared yet
    #[arg(long, requires = "write")]
    force: bool,
    /// Runs in the background of a gateway: with the lowest priority, and a limit for its memory
    #[arg(long, hide = true)]
    background: bool,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

/// Largest address space of a learning process in the background, in bytes.
const MOST_MEMORY: u64 = 2 * 1024 * 1024 * 1024;
/// Lowest priority of a process, as a nice value.
const LOWEST_PRIORITY: i32 = 19;

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.background {
        retire().context(
            "the priority and the memory of this process cannot be limited (a unit of systemd must allow the system \
             call setpriority)",
        )?;
    }
    let profile = load_quietly(&arguments.profile, &arguments.set, arguments.json)?.profile;
    let directory = running::directory(arguments.state.as_deref(), &profile)?;
    let axes = axes(&profile, arguments)?;
    let progress = Progress::begin("learning");
    // An error of one axis does not prevent the others from learning.
    let results: Vec<anyhow::Result<AxisResult>> =
        axes.iter().map(|axis| of_axis(arguments, &profile, &directory, axis)).collect();
    let results = results.into_iter().collect::<anyhow::Result<Vec<AxisResult>>>()?;
    drop(progress);
    if arguments.json {
        print_json(&serde_json::json!({ "machine": profile.name, "axes": results }))?;
    } else {
        results.iter().try_for_each(text::render)?;
    }
    let (Some(path), [result]) = (&arguments.write, results.as_slice()) else { return Ok(()) };
    let Some(block) = &result.block else {
        anyhow::bail!(
            "{} is not written: no run was found from which a model could be learned",
            path.display()
        );
    };
    anyhow::ensure!(
        result.proposed || arguments.force,
        "{} is not written: the candidate is not better than the model in use. --force writes it anyway",
        path.display()
    );
    std::fs::write(path, block).with_context(|| format!("{} cannot be written", path.display()))
}

/// Gives this process the lowest priority, limits its memory, and lets the kernel kill it when the gateway ends.
fn retire() -> std::io::Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL))?;
    // If the computer has no memory left, the system ends this process and not the gateway.
    let _ = std::fs::write("/proc/self/oom_score_adj", "1000");
    nice(LOWEST_PRIORITY)?;
    setrlimit(Resource::As, Rlimit { current: Some(MOST_MEMORY), maximum: Some(MOST_MEMORY) })?;
    Ok(())
}

/// Returns the names of the axes whose models are learned: the axis of `--axis`, or every axis with a probe. In the
/// background of a gateway, these are the axes with `learn` in their probe.
fn axes(profile: &Profile, arguments: &Arguments) -> anyhow::Result<Vec<String>> {
    let all = || profile.axes.iter().map(|axis| &axis.settings);
    if let Some(named) = arguments.axis.as_deref() {
        let names: Vec<&str> = all().map(|axis| axis.name.as_str()).collect();
        anyhow::ensure!(
            names.contains(&named),
            "the profile has no axis {named}; there are {}",
            names.join(", ")
        );
        return Ok(vec![named.to_owned()]);
    }
    let is_meant = |axis: &&AxisSettings| match arguments.background {
        true => axis.learned.is_some(),
        false => axis.probe.is_some(),
    };
    let probed: Vec<String> = all().filter(is_meant).map(|axis| axis.name.clone()).collect();
    anyhow::ensure!(!probed.is_empty(), "no axis of the profile has a probe: select an axis with --axis");
    Ok(probed)
}

/// Learns the model of one axis from the new logs, and stores the intermediate results (products) of the new runs.
fn of_axis(
    arguments: &Arguments,
    profile: &Profile,
    directory: &Path,
    axis: &str,
) -> anyhow::Result<AxisResult> {
    let place = candidates::products(directory, &profile.name);
    let (mut learning, mut known, mut remarks) = stored(&place, axis)?;
    let choice = choice(profile, axis, &arguments.without);
    let preferred = preferences_in(directory, profile).into_iter().find(|(own, _)| own == axis);
    let adopted = preferred.as_ref().and_then(|(_, preference)| preference.preferred().learned());
    let in_use = match adopted {
        Some(model) => Some(InUse::adopted(profile, axis, model)),
        None => InUse::of(profile, axis).map_err(|why| remarks.push(why)).ok(),
    };
    learning.compare_with(in_use.as_ref());
    let mut new = Vec::new();
    let now = Clock::wall().time_of_day();
    let (days, later) = until_today(log::days(directory, &profile.name), now);
    let first_unread = learning.first_day();
    if !arguments.logs.is_empty() {
        let dataset = named(arguments, profile, &choice)?;
        new.extend(learning.take(profile, dataset, (&choice, in_use.as_ref()), Some(now))?);
        if new.is_empty() {
            remarks.push(NOTHING_NEW.to_owned());
        }
    }
    let first_day = learning.first_day();
    let is_passed = |day: &str| first_unread.as_str() < day && day < first_day.as_str();
    let passed = days.iter().filter(|(day, _)| is_passed(day)).count();
    if passed > 0 {
        remarks.push(format!(
            "logs in {} are older than the touches of the named logs and are not used: {}. To learn from these logs, \
             remove {}, and run `isotherm learn` without the named logs first",
            directory.display(),
            counted(passed, "day"),
            place.display()
        ));
    }
    if later > 0 {
        remarks.push(format!("logs with a date after today, which are not used: {}", counted(later, "day")));
    }
    for (number, (day, _)) in (1..).zip(&days).filter(|(_, (day, _))| *day >= first_day) {
        let together = days.iter().take(number).skip(number.saturating_sub(TOGETHER));
        let files: Vec<PathBuf> = together.flat_map(|(_, files)| files.iter().cloned()).collect();
        let until = (number == days.len()).then_some(now);
        let taken = read_usable(profile, &files, &choice, &mut remarks)
            .and_then(|dataset| Ok(learning.take(profile, dataset, (&choice, in_use.as_ref()), until)?));
        match taken {
            // A run that is not used is found again in the logs of the next days.
            Ok(taken) => {
                let is_new = |run: &TakenRun| new.iter().all(|known: &TakenRun| known.run != run.run);
                let taken: Vec<TakenRun> = taken.into_iter().filter(is_new).collect();
                new.extend(taken);
                // The logs of a year may need more time than this process has. The next one continues here.
                if learning.runs() > known.len() {
                    store(&place, axis, &learning, &known)?;
                    known = learning.names();
                }
            }
            // One unusable log does not prevent learning from the others.
            Err(why) => remarks.push(format!("logs up to {day}: {why:#}")),
        }
    }
    let candidate = learning.candidate();
    let compared_with = adopted.map(|model| model.name.clone());
    let offer = candidate.as_ref().map(|candidate| learning.offer(profile, candidate, compared_with));
    if learning.runs() > 0 {
        store(&place, axis, &learning, &known)?;
    }
    candidates::write(&Files, (directory, profile.name.as_str()), axis, offer.as_ref())
        .map_err(anyhow::Error::msg)?;
    if learning.unlike() > 0 {
        remarks.push(format!(
            "runs whose signals differ from those of the newest run, which are not used: {}",
            learning.unlike()
        ));
    }
    if learning.runs() == 0 && new.is_empty() {
        remarks.push(nothing_found((directory, profile.name.as_str()), axis, days.len()));
    }
    Ok(AxisResult {
        axis: axis.to_owned(),
        new,
        runs: candidate.as_ref().map_or(0, |candidate| candidate.from_runs),
        gain: learning.judgement().gain().map(GainShown::from),
        proposed: learning.judgement().is_better(),
        is_learning: profile
            .axes
            .iter()
            .any(|own| own.settings.name == axis && own.settings.learned.is_some()),
        remarks,
        block: candidate.map(|candidate| learning.block(&candidate, in_use.as_ref())),
    })
}

/// Reads the logs that the command line names.
fn named(arguments: &Arguments, profile: &Profile, choice: &Choice) -> anyhow::Result<Dataset> {
    let LogFormat { decimal, dates, time_unit, .. } = arguments.format;
    let zone = Some(arguments.format.zone());
    let split = Split { zone, decimal, dates, time_unit, ..Split::default() };
    let dataset = read(profile, &arguments.logs, choice, &split)?;
    anyhow::ensure!(dataset.repeats.is_empty(), "{}", dataset.repeats.join("; "));
    Ok(dataset)
}

/// Returns the message that explains why no run was found. `days`: number of days with logs.
fn nothing_found((directory, machine): (&Path, &str), axis: &str, days: usize) -> String {
    match days {
        0 => format!(
            "there is no log of {machine} in {}. Give the state directory of the gateway with --state",
            directory.display()
        ),
        days => format!(
            "the logs of {} in {} have no complete run with touches ({axis}_measured_um)",
            counted(days, "day"),
            directory.display()
        ),
    }
}

/// Days as dates, each with the paths of its log files.
type Days = Vec<(String, Vec<PathBuf>)>;

/// Returns the days until today, and the number of later days. Logs of later days come from a wrong clock. If these
/// logs were used, the following real days would be older than the last learned run, and would not be judged.
fn until_today(mut days: Days, now: Moment) -> (Days, usize) {
    let mut today = Vec::new();
    time::write(&mut today, now);
    let today = String::from_utf8_lossy(&today).into_owned();
    let all = days.len();
    days.retain(|(day, _)| today.get(..day.len()).is_none_or(|today| day.as_str() <= today));
    let later = all - days.len();
    (days, later)
}

/// Reads the columns that learning needs from these logs.
fn read(profile: &Profile, files: &[PathBuf], choice: &Choice, split: &Split) -> anyhow::Result<Dataset> {
    let applied = Applied::AsLogged;
    let uses = uses::of_identify(profile, choice, &applied);
    Ok(Dataset::read(files, split, &units(profile), &uses)?)
}

/// Reads the columns that learning needs from the logs of these days. An unusable file is left out, and a remark names
/// the file. For example, a file may be empty after a power cut.
fn read_usable(
    profile: &Profile,
    files: &[PathBuf],
    choice: &Choice,
    remarks: &mut Vec<String>,
) -> anyhow::Result<Dataset> {
    let split = Split::default();
    read(profile, files, choice, &split).or_else(|why| {
        let is_usable = |file: &&PathBuf| read(profile, std::slice::from_ref(*file), choice, &split).is_ok();
        let usable: Vec<PathBuf> = files.iter().filter(is_usable).cloned().collect();
        if usable.is_empty() || usable.len() == files.len() {
            return Err(why);
        }
        for remark in format!("{why:#}").lines().map(str::to_owned) {
            if !remarks.contains(&remark) {
                remarks.push(remark);
            }
        }
        read(profile, &usable, choice, &split)
    })
}

/// Reads the stored runs of an axis. Also returns the names of their files, and remarks about unusable files.
fn stored(place: &Path, axis: &str) -> anyhow::Result<(Learning, Vec<String>, Vec<String>)> {
    let entries = match std::fs::read_dir(place) {
        Ok(entries) => entries.collect::<Result<Vec<_>, _>>(),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error),
    };
    let entries = entries.with_context(|| format!("{} cannot be read", place.display()))?;
    let names = entries.iter().filter_map(|entry| entry.file_name().into_string().ok());
    let (mut files, mut unreadable) = (Vec::new(), Vec::new());
    for name in names.filter(|name| Learning::is_run(axis, name)) {
        match safe_file::read(&place.join(&name), LARGEST) {
            Ok(bytes) => files.push((name, bytes)),
            // One unusable file does not prevent learning from the others.
            Err(error) => unreadable.push(format!("{name} cannot be read: {error}")),
        }
    }
    let path = place.join(Learning::record_name(axis));
    let record = match Files.read(&path) {
        Ok(bytes) => Some(bytes),
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(error).with_context(|| format!("{} cannot be read", path.display())),
    };
    let (learning, mut remarks) = Learning::restore(axis, files, record.as_deref());
    remarks.extend(unreadable);
    let known = learning.names();
    Ok((learning, known, remarks))
}

/// Stores the new runs and the learning record. The record is written last: after a power cut, the runs that are
/// missing in the record are found by their file names.
fn store(place: &Path, axis: &str, learning: &Learning, known: &[String]) -> anyhow::Result<()> {
    let shown = |path: &Path| format!("{} cannot be written", path.display());
    let new = learning.new_files(known).map_err(anyhow::Error::msg)?;
    let record = learning.record().map_err(anyhow::Error::msg)?;
    make_directory(place).with_context(|| shown(place))?;
    for (name, text) in &new {
        let path = place.join(name);
        Files.replace(&path, text.as_bytes()).with_context(|| shown(&path))?;
    }
    for name in learning.superfluous() {
        Files.forget(&place.join(name));
    }
    let path = place.join(Learning::record_name(axis));
    Files.replace(&path, record.as_bytes()).with_context(|| shown(&path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_of_days_after_today_are_left_out() {
        let days =
            |names: &[&str]| -> Days { names.iter().map(|name| ((*name).to_owned(), Vec::new())).collect() };
        // 2026-01-05, one o'clock.
        let now = Moment::from_nanos(1_767_574_800_000_000_000);
        let (found, later) =
            until_today(days(&["2026-01-04", "2026-01-05", "2026-01-06", "2099-01-01"]), now);
        assert_eq!((found, later), (days(&["2026-01-04", "2026-01-05"]), 2));
    }
}
