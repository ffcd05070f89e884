//! `isotherm identify`: identifies a model from logs with a measured error, cross-validates the model, and writes its
//! block for a profile.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::builder::TypedValueParser;

use super::columns::ColumnTable;
use super::extra_files::ExtraFiles;
use super::loading::load_quietly;
use super::print::print_json;
use super::progress::Progress;
use super::runs::Runs;
use super::values::{one_of, wrong_arguments};
use crate::cli::print::{Out, say_beside};
use crate::clock::Clock;
use isotherm_core::compensation::model::Outside;
use isotherm_identify::applied::Applied;
use isotherm_identify::dataset::Column;
use isotherm_identify::facts::document;
use isotherm_identify::method::{Method, Settings};
use isotherm_identify::repaired_runs::repaired_files;
use isotherm_identify::report::{self, Subject};
use isotherm_identify::setup::{Choice, ready, units, without_cz, without_incomplete};
use isotherm_identify::written::written;
use isotherm_identify::{Identified, identify, uses};
use isotherm_profile::{NO_MACHINE_START, Profile};

use into_profile::{IntoProfile, IntoProfileArguments};

mod balls;
mod into_profile;
mod prior;
mod text;

/// Finds the model of an axis from logs: its coefficients with their uncertainty. Also shows the remaining
/// error on days that were not used to find the model.
///
/// A log is CSV or Parquet with a column `time`, `time_s` or `time_min`. The column may also have a name of a logger,
/// such as `Zeit [min]`, `timestamp`, or `Date` and `Time`. `time` is in seconds, RFC 3339, or `05.01.2026 06:00:10` by
/// the clock of --zone. The other columns are the signals of the profile, and the measured displacement error in µm. One
/// file is one run: a warm-up that begins with a cold machine. Faulty sensors are reported, and their readings are
/// mended (repaired) or left out. Each run is once held out, that is, used only to test the model from the other runs.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm identify my-machine.toml mon.csv tue.csv wed.csv --axis z --error z_error_um\n  isotherm identify my-machine.toml campaign/ --axis z --into-profile\n  isotherm identify my-machine.toml week.parquet --gap 2h --axis z --write z-model.toml --report z.html\n  isotherm identify --balls touches.csv --recorded mon.csv --out mon-drift.csv"
)]
pub(super) struct Arguments {
    /// Profile of the machine, or the name of a shipped one
    #[arg(value_name = "PROFILE", required_unless_present = "balls")]
    path: Option<PathBuf>,
    /// Overrides one key, may be repeated: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = super::values::key_and_value)]
    set: Vec<(String, String)>,
    /// Log files, or directories that contain log files
    #[arg(value_name = "LOG", required_unless_present = "balls")]
    logs: Vec<PathBuf>,
    #[command(flatten)]
    balls: balls::Touches,
    /// The axis; needed if the profile has several axes
    #[arg(long, value_name = "NAME")]
    axis: Option<String>,
    /// Column with the measured error e, µm [default: <axis>_error_um]
    #[arg(long, value_name = "COLUMN")]
    error: Option<String>,
    /// The column with the Cz that acted on the error during the measurement, µm. `none` means that no Cz acted
    /// [default: as a log of the gateway says]
    #[arg(long, value_name = "COLUMN")]
    cz: Option<String>,
    /// Method that finds the model
    #[arg(long, value_parser = methods(), default_value = Method::default().name())]
    method: Method,
    /// Signals that the model may use [default: every temperature of the profile; with whitened also every speed]
    #[arg(long, value_name = "SIGNAL", value_delimiter = ',')]
    inputs: Vec<String>,
    /// Signals that the model must not use
    #[arg(long, value_name = "SIGNAL", value_delimiter = ',')]
    without: Vec<String>,
    /// Signals that the model may use although their readings look faulty
    #[arg(long, value_name = "SIGNAL", value_delimiter = ',')]
    keep: Vec<String>,
    /// Time constants of the lags that are tried [default: 0s,6min,25min,100min; ridge-lag, sparse-lag, stepwise and
    /// position: 0s,3min,6min,12min,25min,50min,100min,200min; rbf and network: 0s,12min,50min]
    #[arg(long, value_name = "TIME", value_delimiter = ',', value_parser = humantime::parse_duration)]
    lags: Vec<Duration>,
    /// With --method whitened: largest number of sensors in the model. The sensors with the smallest error on held-out
    /// runs are chosen
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    sensors: Option<u16>,
    /// With --method whitened: an existing model, from --write or from a profile. The gains are drawn towards
    /// the gains of this model instead of towards zero. Use this option if there is only one day of logs:
    /// from this machine after a repair, or from another machine of the same type. With two days of logs,
    /// this option helps less often. An existing model that is worse on the new days than no compensation is
    /// refused
    #[arg(long, value_name = "MODEL.toml")]
    prior: Option<PathBuf>,
    /// With --method sparse-lag, stepwise, lag or position: largest number of terms in the model
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    terms: Option<u16>,
    /// With --method rbf: number of radial basis functions in each of the five models whose mean is used
    #[arg(long, value_name = "N", default_value_t = 20)]
    centres: usize,
    /// With --method network: number of neurons in each of the five networks whose mean is used
    #[arg(long, value_name = "N", default_value_t = 8)]
    neurons: usize,
    /// With --method rbf or network: seed of the random numbers. The same seed gives the same model
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// In F tests, rows that are closer in time than this count as one sample
    #[arg(long, value_name = "TIME", default_value = "30min", value_parser = humantime::parse_duration)]
    independent: Duration,
    /// Also tests the model together with a probe that measures the error at this interval and removes it
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    probe: Option<Duration>,
    /// Time over which rows are averaged after the lags were applied; 0s switches averaging off
    #[arg(long, value_name = "TIME", default_value = "1min", value_parser = humantime::parse_duration)]
    resample: Duration,
    /// Signal with the position of the axis, for errors measured at several positions (--method position)
    #[arg(long, value_name = "SIGNAL")]
    position: Option<String>,
    /// With --method position: position at which the slope adds nothing to Cz, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true)]
    position_reference: f64,
    /// With --method two-source: runs in which the spindle stands still
    #[arg(long, value_name = "RUN", value_delimiter = ',')]
    waiting: Vec<String>,
    /// With --method two-source: sensors of the first heat source
    #[arg(long, value_name = "SIGNAL", value_delimiter = ',')]
    first: Vec<String>,
    /// With --method two-source: sensors of the second heat source
    #[arg(long, value_name = "SIGNAL", value_delimiter = ',')]
    second: Vec<String>,
    #[command(flatten)]
    runs: Runs,
    /// Writes the [[axis.…model]] block to this file, and the files that the block names to the same directory
    #[arg(long, value_name = "MODEL.toml")]
    write: Option<PathBuf>,
    #[command(flatten)]
    into: IntoProfileArguments,
    /// Writes the block, or the models for lost sensors, even if too many runs are worse than without compensation. Too
    /// many means: more than a third of at least six held-out runs
    #[arg(long)]
    force: bool,
    /// Writes a page with diagrams as one file, for any browser
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,
    /// Writes each run with a mended sensor as a CSV file to this directory, with the mended values and the recorded
    /// values
    #[arg(long, value_name = "DIR")]
    mended: Option<PathBuf>,
    /// Action of the axis when its inputs are outside the envelope of the model, that is, unlike the inputs
    /// in the logs
    #[arg(long, value_parser = outsides(), default_value = "agree")]
    outside: Outside,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

fn methods() -> impl TypedValueParser<Value = Method> {
    one_of(Method::ALL)
}

fn outsides() -> impl TypedValueParser<Value = Outside> {
    one_of([
        (
            Outside::Agree,
            "agree",
            "Follows the model as far as its two halves agree (the two models whose mean is the model)",
        ),
        (Outside::Warn, "warn", "Follows the model"),
        (Outside::Hold, "hold", "Keeps the last Cz"),
        (Outside::Shrink, "shrink", "Follows the model less with increasing distance"),
    ])
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    // A new profile has signals that no model uses yet. No warning is printed about them.
    let Some(path) = &arguments.path else { return balls::run(&arguments.balls, arguments.json) };
    let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    if ["csv", "parquet"].iter().any(|log| ending.eq_ignore_ascii_case(log)) {
        let log = path.display();
        anyhow::bail!(
            "{log} is a log; give the machine's profile before the log: isotherm identify my-machine.toml {log} …"
        );
    }
    if arguments.force && arguments.write.is_none() && !arguments.into.into_profile {
        return Err(wrong_arguments("--force needs --write or --into-profile"));
    }
    // First, because its error for a file that does not exist names the file that was probably meant.
    let profile = load_quietly(path, &arguments.set, arguments.json)?.profile;
    let before = arguments.into.into_profile.then(|| into_profile::text_of(path)).transpose()?;
    let mut beside = ExtraFiles::default();
    let (found, document, columns) = find(arguments, &profile, &mut beside)?;
    if let Some(path) = &arguments.write {
        match found.refusal().filter(|_| !arguments.force) {
            Some(why) => beside.refuse(format!("{} is not written: {why}", path.display())),
            None => write(arguments, &found, path, &mut beside),
        }
    }
    match document {
        Some(document) => print_json(&document)?,
        None => {
            text::render(&mut Out, &found, arguments.probe)?;
            columns.render(&mut Out)?;
            let counts_from_start =
                || written(&found, "model", arguments.outside).block.contains("\"start\"");
            if profile.machine.on.is_none() && before.is_none() && counts_from_start() {
                say_beside!("note: {NO_MACHINE_START}");
            }
        }
    }
    beside.end(arguments.json)?;
    let Some(before) = before else { return Ok(()) };
    if let Some(why) = found.refusal().filter(|_| !arguments.force) {
        anyhow::bail!("{} is not changed: {why}", path.display());
    }
    let found = if arguments.force { found } else { found.without_harmful_fallbacks().0 };
    let edit = IntoProfile::prepare(path, before, &found, arguments.outside)?;
    edit.ask_and_write(&profile, &found.axis, arguments.into.yes)
}

/// Identifies the model. Also returns the JSON document if it was requested, and the table of used and unused columns.
fn find(
    arguments: &Arguments,
    profile: &Profile,
    beside: &mut ExtraFiles,
) -> anyhow::Result<(Identified, Option<serde_json::Value>, ColumnTable)> {
    let choice = Choice {
        axis: arguments.axis.clone(),
        error: arguments.error.clone(),
        inputs: arguments.inputs.clone(),
        speeds: arguments.method == Method::Whitened,
        without: arguments.without.clone(),
        keep: arguments.keep.clone(),
        resample: arguments.resample,
        position: arguments.position.clone().map(|name| (name, arguments.position_reference)),
    };
    let error = choice.error_column(profile);
    let applied = arguments.cz.as_deref().map(Applied::named).unwrap_or_default();
    let uses = uses::of_identify(profile, &choice, &applied);
    let mut dataset = arguments.runs.read(&arguments.logs, (&error, &[]), &units(profile), &uses)?;
    without_cz(profile, &mut dataset, &choice, &applied)?;
    without_incomplete(profile, &mut dataset, &choice);
    let ready = ready(profile, &dataset, &choice)?;
    if let Some(directory) = &arguments.mended {
        write_mended(directory, &repaired_files(&ready), beside);
    }
    let prior = arguments.prior.as_ref().map(|path| prior::terms(path, &ready.axis));
    let mut settings = Settings {
        method: arguments.method,
        terms: arguments.terms.map(usize::from),
        sensors: arguments.sensors.map(usize::from),
        prior: prior.transpose()?,
        independent: arguments.independent,
        centres: arguments.centres,
        neurons: arguments.neurons,
        seed: arguments.seed,
        waiting: arguments.waiting.clone(),
        first: arguments.first.clone(),
        second: arguments.second.clone(),
        ..Settings::default()
    };
    if !arguments.lags.is_empty() {
        settings.lags = arguments.lags.iter().map(|lag| (!lag.is_zero()).then_some(*lag)).collect();
    }
    let probe = arguments.probe.map(|interval| interval.as_secs_f64());
    let fallbacks = arguments.write.is_some() || arguments.report.is_some() || arguments.into.into_profile;
    let progress = Progress::begin("runs held out");
    let note = |done, all| progress.note("runs held out", done, all);
    let found = identify(&ready, &settings, probe, fallbacks, &note).map_err(anyhow::Error::msg)?;
    drop(progress);
    if let Some(path) = &arguments.report {
        let subject = Subject { profile, ready: &ready, found: &found, made: Clock::wall().now() };
        beside.write("the report", path, report::identified(&subject));
    }
    let document = || document(profile, &ready, &found, Clock::wall().now());
    let document = arguments.json.then(document).transpose()?;
    let is_used = |column: &Column| {
        let shown = found.columns.iter().find(|shown| shown.name == column.name);
        shown.is_some_and(|shown| shown.used != "not used")
    };
    let columns = ColumnTable::new(&dataset, &is_used);
    Ok((found, document, columns))
}

/// Writes a file for each of these runs into the directory, which is created if it does not exist.
fn write_mended(directory: &Path, runs: &[(String, String)], beside: &mut ExtraFiles) {
    if runs.is_empty() {
        beside.say("no sensor reading was repaired, so no file is written".to_owned());
        return;
    }
    // If the directory cannot be created, writing each file fails and is reported.
    drop(std::fs::create_dir_all(directory));
    for (run, text) in runs {
        // The name of a run may contain any characters, because it can come from a directory or a column.
        let name = run.replace(['/', '\\'], "-");
        beside.write("the repaired log", &directory.join(format!("{name}.mended.csv")), text);
    }
}

fn write(arguments: &Arguments, found: &Identified, path: &Path, beside: &mut ExtraFiles) {
    let stem = path.file_stem().and_then(|stem| stem.to_str()).unwrap_or("model");
    let (harmless, dropped) = found.clone().without_harmful_fallbacks();
    let found = if arguments.force { found } else { &harmless };
    let written = written(found, stem, arguments.outside);
    beside.write("the block", path, &written.block);
    written
        .files
        .iter()
        .for_each(|(name, text)| beside.write("a file of the model", &path.with_file_name(name), text));
    if !arguments.force {
        dropped.into_iter().for_each(|line| beside.say(line));
    }
}
