//! `isotherm record`: logs readings for identification. Writes nothing to any device.
//!
//! A run is one file: `time`, then every signal in its unit, empty where it could not be used. A displacement probe is one
//! more signal of the profile. On a virtual machine its true error stands beside them, as `<axis>_error_um`.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::time::Duration;

use super::signals::Signals;
use super::{Failure, ProfileArguments, load, machines, values};
use crate::clock::Clock;
use crate::gateway::{Gateway, Options};
use crate::virtual_machine::{Setup, VirtualMachine, Window};
use isotherm_profile::Profile;

mod sheet;

use sheet::Sheet;

/// How often progress is told where no terminal redraws it.
const TOLD_EVERY: Duration = Duration::from_secs(600);

/// Logs readings, and displacement signals among them, for `identify` and `select`. Reads only.
///
/// Start it on a cold machine, let the machine warm up and cool down, and end it with Ctrl-C: that is one run. Several
/// runs, on other days and with other speeds, make a campaign; with a directory as --out each gets a name of its own.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm record my-machine.toml --out campaign/\n  isotherm record my-machine.toml \
                  --out monday.csv --every 10s --for 8h\n  isotherm record surface-grinder --virtual --seed 7 --for 8h \
                  --out day7.csv"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// The log, or a directory that gets a log named by machine and time; nothing is ever overwritten
    #[arg(long, value_name = "LOG.csv")]
    out: PathBuf,
    /// A row this often
    #[arg(long, default_value = "10s", value_name = "SPAN", value_parser = positive)]
    every: Duration,
    /// Ends by itself after this long
    #[arg(long = "for", value_name = "SPAN", value_parser = positive)]
    span: Option<Duration>,
    /// A new file, which is a run of its own, after this long
    #[arg(long, default_value = "24h", value_name = "SPAN", value_parser = positive)]
    rotate: Duration,
    /// A shipped machine's plant instead of devices, as fast as it goes, with its true error as <axis>_error_um
    #[arg(long = "virtual", requires = "span")]
    on_plant: bool,
    /// The virtual machine's day
    #[arg(long, default_value_t = 1, requires = "on_plant")]
    seed: u64,
}

fn positive(text: &str) -> Result<Duration, String> {
    values::span(text, Duration::MAX, "write a time above zero, such as 10s")
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let sheet = if arguments.on_plant {
        let (profile, plant) =
            machines::with_plant(&arguments.profile.path.to_string_lossy(), &arguments.profile.set)?;
        runtime.block_on(async {
            let clock = Clock::simulated(plant.start(), None);
            let hold = clock.hold();
            let mut machine =
                VirtualMachine::start(&profile, Setup::on_free_ports(plant, arguments.seed), &clock).await?;
            let profile = machine.serving(profile);
            let window = machine.window();
            tokio::select! {
                sheet = record(arguments, profile, &clock, Some(&window), hold) => sheet,
                error = machine.failure() => Err(error.into()),
            }
        })?
    } else {
        let profile = load(&arguments.profile, false)?;
        runtime.block_on(record(arguments, profile, &Clock::wall(), None, ()))?
    };
    print!("{sheet}");
    Ok(())
}

/// Records until the span is over or a person ends it. `ready` is dropped once everybody may begin.
async fn record(
    arguments: &Arguments,
    profile: Profile,
    clock: &Clock,
    window: Option<&Window>,
    ready: impl Sized,
) -> anyhow::Result<Sheet> {
    let axes = window.map(|window| window.summary().axes).unwrap_or_default();
    let mut sheet = Sheet::begin(&arguments.out, &profile, &axes, clock.now())?;
    eprintln!("recording {} signals into {}; end it with Ctrl-C", profile.signals.len(), sheet.path());
    let mut signals = Signals::listen()?;
    let gateway = Gateway::new(profile, clock, Options { dry_run: true, ..Options::default() });
    let source = gateway.source();
    let mut sleeper = clock.join();
    drop(ready);
    let begun = clock.now();
    let mut done = Ok(());
    let recording = async {
        let mut progress = Progress::default();
        let rows = async {
            loop {
                let now = sleeper.sleep_until(clock.now().next_tick(begun, arguments.every)).await;
                let spent = now.since(begun);
                if arguments.span.is_some_and(|span| spent > span) {
                    return Ok(());
                }
                sheet.rotate(now, arguments.rotate)?;
                let truth = window.and_then(Window::latest_truth);
                sheet.row(now, &source.status(), truth.as_ref())?;
                progress.tell(spent, arguments.span, &sheet);
            }
        };
        done = tokio::select! {
            done = rows => done,
            () = signals.next() => Ok(()),
        };
    };
    gateway.run(recording, std::future::ready(())).await;
    done.map(|()| sheet)
}

/// What a person sees meanwhile, on stderr.
#[derive(Default)]
struct Progress {
    told: Duration,
}

impl Progress {
    fn tell(&mut self, spent: Duration, span: Option<Duration>, sheet: &Sheet) {
        let of = span.map_or(String::new(), |span| format!(" of {}", humantime::format_duration(span)));
        let whole = humantime::format_duration(Duration::from_secs(spent.as_secs()));
        let missing = sheet.missing_now();
        let missing =
            if missing.is_empty() { String::new() } else { format!(", without {}", missing.join(", ")) };
        let words = format!("{whole}{of}, {} rows{missing}", sheet.rows());
        // A closed stderr is no reason to lose a run.
        let mut stderr = std::io::stderr();
        if stderr.is_terminal() {
            let _ = write!(stderr, "\r\x1b[K{words}");
        } else if spent >= self.told + TOLD_EVERY {
            self.told = spent;
            let _ = writeln!(stderr, "{words}");
        }
    }
}
