//! `isotherm record`: logs readings for a later identification. It writes to no device.
//!
//! One file is one run. It has the column `time`, and a column for every signal in its unit; a cell is empty if the
//! signal had no usable value. A displacement sensor is another signal of the profile. With a virtual machine, columns
//! `<axis>_error_um` contain the true error.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::time::Duration;

use super::loading::{ProfileArguments, load};
use super::run::known_directory;
use super::signals::Signals;
use super::{machines, values};
use crate::cli::print::{say_all, say_beside};
use crate::clock::Clock;
use crate::gateway::{Gateway, Options};
use crate::virtual_machine::{Setup, VirtualMachine, Window};
use isotherm_core::quantity::Shifted;
use isotherm_profile::Profile;

mod recording;

use isotherm_profile::{counted, duration_text};
use recording::Recording;

/// Interval of the progress lines if stderr is not a terminal.
const SHOWN_EVERY: Duration = Duration::from_secs(600);

/// Logs readings, including those of displacement sensors, for `identify` and `select`. Writes to no device.
///
/// Start the verb on a cold machine, let the machine warm up and cool down, and end the verb with Ctrl-C: that is one
/// run. Several runs, on other days and at other speeds, are needed for an identification. If --out is a directory,
/// each run gets its own file name.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm record my-machine.toml --out campaign/\n  isotherm record my-machine.toml \
                  --out monday.csv --every 10s --for 8h\n  isotherm record surface-grinder --virtual --seed 7 --for 8h \
                  --out day7.csv"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The log file, or a directory for log files that are named by machine and time; existing files are never
    /// overwritten
    #[arg(long, value_name = "LOG.csv")]
    out: PathBuf,
    /// Interval between the rows of the log
    #[arg(long, default_value = "10s", value_name = "SPAN", value_parser = positive)]
    every: Duration,
    /// Duration of the recording [default: until Ctrl-C]
    #[arg(long = "for", value_name = "SPAN", value_parser = positive)]
    span: Option<Duration>,
    /// Begins a new file, which counts as another run, after this time
    #[arg(long, default_value = "24h", value_name = "SPAN", value_parser = positive)]
    rotate: Duration,
    /// Uses the plant (simulation) of a shipped machine instead of devices, as fast as possible, and logs its true
    /// error as <axis>_error_um
    #[arg(long = "virtual", requires = "span")]
    on_plant: bool,
    /// Seed of the simulated day of the virtual machine. Each seed has its own date
    #[arg(long, default_value_t = 1, requires = "on_plant")]
    seed: u64,
}

fn positive(text: &str) -> Result<Duration, String> {
    values::span(text, Duration::MAX, "write a time above zero, such as 10s")
}

/// Returns the time from the start date of the plant (simulated machine) to the date of this seed. Successive
/// seeds have successive days, so that logs of at most one day do not contain the same times. The dates
/// repeat after 10 000 seeds.
fn days_of(seed: u64) -> Duration {
    const DAY: Duration = Duration::from_secs(86_400);
    const DATES: u32 = 10_000;
    let date = u32::try_from(seed.saturating_sub(1) % u64::from(DATES)).unwrap_or_default();
    DAY * date
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let runtime = super::runtime::start()?;
    let recording = if arguments.on_plant {
        let (profile, plant) =
            machines::with_plant(&arguments.profile.path.to_string_lossy(), &arguments.profile.set)?;
        runtime.block_on(async {
            let clock = Clock::simulated(plant.start().after(days_of(arguments.seed)), None);
            let hold = clock.hold();
            let mut machine =
                VirtualMachine::start(&profile, Setup::on_free_ports(plant, arguments.seed), &clock).await?;
            let profile = machine.serving(profile);
            let window = machine.window();
            tokio::select! {
                recording = record(arguments, profile, &clock, Some(&window), hold) => recording,
                error = machine.failure() => Err(error.into()),
            }
        })?
    } else {
        let profile = load(&arguments.profile, false)?;
        runtime.block_on(record(arguments, profile, &Clock::wall(), None, ()))?
    };
    say_all!("{recording}")?;
    Ok(())
}

/// Records until the requested time is over, or until Ctrl-C. `ready` is dropped when all tasks have registered with
/// the clock.
async fn record(
    arguments: &Arguments,
    profile: Profile,
    clock: &Clock,
    window: Option<&Window>,
    ready: impl Sized,
) -> anyhow::Result<Recording> {
    let axes = window.map(|window| window.summary().axes).unwrap_or_default();
    let mut recording = Recording::begin(&arguments.out, &profile, &axes, clock.time_of_day())?;
    // Times in a recording are counted from its start. They ignore later changes of the computer's clock.
    let shift = clock.shift();
    let signals = counted(profile.signals.len(), "signal");
    say_beside!("recording {signals} into {}; end it with Ctrl-C", recording.path());
    let mut signals = Signals::listen()?;
    let remembered_in = Some(known_directory(profile.history.directory.as_deref()));
    let gateway =
        Gateway::new(profile, clock, Options { dry_run: true, remembered_in, ..Options::default() });
    let source = gateway.source();
    let mut sleeper = clock.join();
    drop(ready);
    let begun = clock.now();
    let mut done = Ok(());
    let until_done = async {
        let mut shown = Duration::ZERO;
        let rows = async {
            loop {
                let now = sleeper.sleep_until(clock.now().next_tick(begun, arguments.every)).await;
                let spent = now.since(begun);
                if arguments.span.is_some_and(|span| spent > span) {
                    return Ok(());
                }
                let stamp = now.shifted(shift);
                recording.rotate(stamp, arguments.rotate)?;
                let truth = window.and_then(Window::latest_truth);
                recording.row(stamp, &source.status(), truth.as_ref())?;
                show_progress(&mut shown, spent, arguments.span, &recording);
            }
        };
        done = tokio::select! {
            done = rows => done,
            () = signals.next() => Ok(()),
        };
    };
    gateway.run(until_done, std::future::ready(())).await;
    done.map(|()| recording)
}

/// Shows the progress on stderr. `shown` is the time of the last line, which is used if stderr is not a terminal.
fn show_progress(shown: &mut Duration, spent: Duration, span: Option<Duration>, recording: &Recording) {
    let of = span.map_or(String::new(), |span| format!(" of {}", duration_text(span)));
    let whole = duration_text(Duration::from_secs(spent.as_secs()));
    let missing = recording.missing_now();
    let missing =
        if missing.is_empty() { String::new() } else { format!(", without {}", missing.join(", ")) };
    let progress = format!("{whole}{of}, {}{missing}", counted(recording.rows(), "row"));
    // A closed stderr must not end the recording.
    let mut stderr = std::io::stderr();
    if stderr.is_terminal() {
        let _ = write!(stderr, "\r\x1b[K{progress}");
    } else if spent >= *shown + SHOWN_EVERY {
        *shown = spent;
        let _ = writeln!(stderr, "{progress}");
    }
}
