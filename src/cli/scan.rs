//! `isotherm scan`: which units of a line answer, and which registers they have.

use std::io::{IsTerminal, Write};
use std::time::Duration;

use super::signals::Signals;
use super::target::{self, Target};
use super::{Failure, print_json};
use crate::clock::Clock;
use crate::discovery::Register;
use crate::discovery::ask::Asker;
use crate::discovery::bus::{Parity, Place, Transport, baud};
use crate::discovery::remedy::{Asked, remedy};
use crate::discovery::scan::{Found, How, Scan, Stopped, Told};
use crate::discovery::walk::{Walked, walk};
use isotherm_core::quantity::Moment;

mod told;

/// Asks every unit of a line once, for one register, and tells which answer. An exception is an answer too. Reads only.
///
/// A device that is there but answers nothing at all for a register it does not have is found only with another
/// --register.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  isotherm scan --bus tcp://192.168.0.10:502\n  isotherm scan --bus \
                  rtu:///dev/ttyUSB0 --baud 1200,9600,19200 --parity none,even --units 1..32\n  isotherm scan --bus \
                  tcp://192.168.0.10 --units 1 --registers holding:0..199\n  isotherm scan my-machine.toml --bus cell")]
pub(super) struct Arguments {
    #[command(flatten)]
    target: Target,
    /// Which units, both ends included
    #[arg(long, value_name = "FROM..TO", default_value = "1..247", value_parser = target::units)]
    units: (u8, u8),
    /// What each unit is asked for; several, and the next is tried where nothing comes for the one before
    #[arg(long, value_name = "REGISTER", value_delimiter = ',', default_value = "holding:0")]
    register: Vec<Register>,
    /// Bits per second to try on a serial line, one after the other
    #[arg(long, value_name = "BAUD", value_delimiter = ',', value_parser = baud)]
    baud: Vec<u32>,
    /// Parities to try on a serial line: none, even, odd
    #[arg(long, value_name = "PARITY", value_delimiter = ',')]
    parity: Vec<Parity>,
    /// Then reads these registers of every unit that answers, in steps of 16, and tells which it has
    #[arg(long, value_name = "holding:0..99", value_parser = target::stretch)]
    registers: Option<(Register, u16)>,
    /// The bytes of each frame, on stderr
    #[arg(long)]
    trace: bool,
    /// One JSON document
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if arguments.target.bus.is_none() && arguments.target.profile.is_none() {
        super::refuse("name the line: --bus tcp://192.168.0.10:502, or a PROFILE with --bus NAME");
    }
    let found = arguments.target.find(arguments.json)?;
    let is_serial = matches!(found.place.transport, Transport::Serial(_));
    let has_settings = !arguments.baud.is_empty() || !arguments.parity.is_empty();
    if has_settings && !is_serial {
        super::refuse("--baud and --parity are for a serial line: rtu:///dev/ttyUSB0");
    }
    let scan = Scan {
        places: places(&found.place, &arguments.baud, &arguments.parity),
        bus: found.bus.clone(),
        quirks: found.quirks,
        units: arguments.units.0..=arguments.units.1,
        registers: arguments.register.clone(),
        traced: arguments.trace,
    };
    eprintln!("{}", told::plan(&scan));
    let mut seen = Seen { json: arguments.json, ..Seen::default() };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let stopped = runtime.block_on(async {
        let mut signals = Signals::listen()?;
        let clock = Clock::wall();
        seen.progress =
            Some(Progress { clock: clock.clone(), begun: clock.now(), questions: scan.questions() });
        let all = async {
            scan.run(|told| seen.take(told)).await?;
            if let Some(stretch) = arguments.registers {
                registers(&scan, stretch, &mut seen).await;
            }
            Ok(())
        };
        let stopped = tokio::select! {
            done = all => done.err().map(|stopped| in_words(&scan, stopped)),
            () = signals.next() => Some(String::new()),
        };
        anyhow::Ok(stopped)
    })?;
    seen.clear();
    let stopped = stopped.map(|why| match (why.as_str(), seen.last) {
        ("", asked) => format!("stopped after {asked} of {} questions", scan.questions()),
        _ => why,
    });
    if arguments.json {
        print_json(&told::document(&scan, &seen.found, &seen.stretches, stopped.as_deref()))?;
    } else {
        let bus = found.known.as_ref().map(|(profile, bus)| (profile, *bus));
        print!("{}", told::summary(&scan, &seen.found, bus));
    }
    match stopped {
        Some(why) => Err(anyhow::anyhow!(why).into()),
        None if seen.found.is_empty() => Err(anyhow::anyhow!(told::nobody(&scan)).into()),
        None => Ok(()),
    }
}

/// The line in every setting that is to be tried.
fn places(place: &Place, bauds: &[u32], parities: &[Parity]) -> Vec<Place> {
    let Transport::Serial(serial) = place.transport else { return vec![place.clone()] };
    let bauds = if bauds.is_empty() { &[serial.baud] } else { bauds };
    let parities = if parities.is_empty() { &[serial.parity] } else { parities };
    let each = bauds.iter().flat_map(|baud| parities.iter().map(move |parity| (*baud, *parity)));
    each.map(|(baud, parity)| {
        place.with_serial(|mut serial| {
            serial.baud = baud;
            serial.parity = parity;
            serial
        })
    })
    .collect()
}

fn in_words(scan: &Scan, Stopped { unit, fault }: Stopped) -> String {
    let (place, from) = (&scan.places[0], scan.registers[0]);
    remedy(fault, Asked { place, unit, from, count: 1, timeout: scan.bus.timeout })
}

/// Walks the registers of every unit that has been found.
async fn registers(scan: &Scan, (from, count): (Register, u16), seen: &mut Seen) {
    for (place, found) in seen.found.clone() {
        if matches!(found.how, How::Garbled(_)) {
            continue;
        }
        let mut asker = Asker::new(&place, &scan.bus, scan.quirks);
        if scan.traced {
            asker = asker.listened_to();
        }
        let unit = found.unit;
        let walked = walk(&mut asker, unit, from, count, |walked| match walked {
            Walked::Exchange(exchange) => seen.exchange(&exchange),
            Walked::Stretch(stretch) => {
                seen.say(&told::stretch(unit, &stretch));
                seen.stretches.push((unit, stretch));
            }
        });
        if let Err(fault) = walked.await {
            seen.say(&format!("unit {unit}: given up: {fault}"));
        }
    }
}

/// What has been seen so far.
#[derive(Default)]
struct Seen {
    found: Vec<(Place, Found)>,
    stretches: Vec<(u8, crate::discovery::walk::Stretch)>,
    /// Questions put.
    last: usize,
    json: bool,
    several: bool,
    progress: Option<Progress>,
}

struct Progress {
    clock: Clock,
    begun: Moment,
    questions: usize,
}

impl Seen {
    fn take(&mut self, told: Told) {
        match told {
            Told::Place(place) => {
                if self.several || matches!(place.transport, Transport::Serial(_)) {
                    self.clear();
                    eprintln!("{place}");
                }
                self.several = true;
            }
            Told::Found(place, found) => {
                self.say(&told::found(&place, &found));
                self.found.push((place, found));
            }
            Told::Asked(asked) => {
                self.last = asked;
                self.show();
            }
            Told::Exchange(exchange) => self.exchange(&exchange),
        }
    }

    fn exchange(&self, exchange: &impl std::fmt::Display) {
        self.clear();
        eprintln!("{exchange}");
    }

    /// A line of the result. A closed stdout ends the program soon enough.
    fn say(&self, line: &str) {
        self.clear();
        if !self.json {
            let _ = writeln!(std::io::stdout(), "{line}").and_then(|()| std::io::stdout().flush());
        }
    }

    /// The line that a terminal redraws.
    fn show(&self) {
        let mut stderr = std::io::stderr();
        let Some(progress) = self.progress.as_ref().filter(|_| stderr.is_terminal()) else { return };
        let spent = progress.clock.now().since(progress.begun);
        let share = self.last.max(1).min(progress.questions);
        let left = spent.mul_f64((progress.questions - share) as f64 / share as f64);
        let _ = write!(
            stderr,
            "\r\x1b[K{} of {} asked, {} found, some {} left",
            self.last,
            progress.questions,
            self.found.len(),
            humantime::format_duration(Duration::from_secs(left.as_secs()))
        );
    }

    fn clear(&self) {
        if std::io::stderr().is_terminal() {
            eprint!("\r\x1b[K");
        }
    }
}
